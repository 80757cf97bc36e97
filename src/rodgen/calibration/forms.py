"""Forms outside the catalogue: what a recorded quantity does to a component of a place, by no effect of the catalogue.

A form is a candidate like any other: columns of derivatives times the functions of a term, and odds. These are those of
something that nobody has named, shared among all places, drivers and terms that are tried; each value that is searched
costs ln n, besides. So a form is chosen only where no effects of the catalogue come near. What is no form at all is not
proposed: columns that effects of the catalogue at the place span; what errors of single poses explain at the same cost.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import NamedTuple, TypeAlias

import numpy as np

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.candidates import (
    FEWEST_WAVES,
    Candidate,
    columns_at,
    number_tried,
    promising_periods,
    with_searched,
)
from rodgen.calibration.evidence import Columns, Evidence
from rodgen.calibration.form_terms import Term, drivers_of, effect_of, terms, word
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.sensitivities import Place, is_direct
from rodgen.machines.drivers import Driver
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.machine import Effect
from rodgen.machines.plausibility import Plausibility, plausibility
from rodgen.stages import stage
from rodgen.statistics.columns import (
    Whiten,
    falls_from_products,
    inverse_root,
    orthonormal_basis,
    project_out,
    unchanged,
    unit_columns,
)
from rodgen.statistics.thresholds import COST

SOMETHING_UNNAMED = 0.01
"""Odds that something acts that nobody has named, compared with what nearly every machine has: one machine in a
hundred. They are shared among all that is tried."""
GROSS, FEW_POSES = 0.01, 6
"""How often a pose is wrong for a reason of its own, and how many of them may be there in place of a form."""
MOST = 10
"""Forms that are proposed."""
DRIVE_ERROR = "periodic_drive_error"
OVERTONES = (2, 3, 4)
"""Waves of a part in one of its turns: it may be oval, or have few teeth. These may be finer than what is searched."""
COMPONENTS = ("reading", "tx", "ty", "tz", "rx", "ry", "rz")
FEW_ROWS = 200
"""Rows that tell, at least, how much of every term is beyond what is known: it is a property of the poses, whatever the
readings."""
SHORT_LIST, ALIKE = 160, 2
"""Terms that are compared on all rows, and how many of one family at one component."""
REFINED, ROUNDS = 8, 6
"""Terms whose searched values are refined, and how often the step is halved."""
MULTIPLIED = 5
"""Terms that are multiplied by functions of further drivers."""
UNDETERMINED = 1e-6
"""Part of the sum of squares of a form's columns that must remain beyond the model: less is rounding."""
SIMILAR = 0.3
"""Part of what a form explains beyond another form below which the two are variants, of which the cheaper one is
proposed: what they explain correlates by 95 %."""
DIGITS, LOST = 4, 0.3
"""Most digits of a searched value, and what fewer of them may lose in chi-square: a third of a standard deviation."""
COSINES = 12
"""Of each freedom of the frame: how a drift is seen without the whitening."""


class Piece(NamedTuple):
    """A term at a component of a place, by number."""

    term: Term
    at: int


Scored: TypeAlias = tuple[float, Piece]
"""By how much a piece raises the cost of a set, and the piece."""


@stage("forms outside the catalogue")
def propose(evidence: Evidence, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Return the most promising forms outside the catalogue, ten at most, given chosen candidates.

    Each would lower the cost of the chosen set, of that without one effect, or of none: what effects hide shows once
    they are taken out, and what they imitate shows without them. Beside a wave of a joint, its drive's.
    """
    search = _Search.of(evidence)
    if search is None:
        return []
    every = (*evidence.candidates, *evidence.unseen)
    known = [c for c in every if c.effect.definition.own or c.key in evidence.refused]
    with one_thread_in_blas():
        views = search.views(chosen)
        drives = [c for view, scored in views for c in search.drives(view, scored)]
        # the best of each view, then the second of each
        of_views = [search.forms(view, scored, known) for view, scored in views]
        turns = itertools.chain.from_iterable(itertools.zip_longest(*of_views))
        forms = list(itertools.islice(filter(None, turns), MOST))
        # of those that are alike, one
        alike = {(*c.key, *(f"{value:.4g}" for value in c.searched.values())): c for c in drives}
        return [*forms, *sharpened(evidence, chosen), *alike.values()]


def sharpened(evidence: Evidence, chosen: Sequence[Candidate]) -> list[Candidate]:
    """Return chosen effects whose searched value is better between those that were tried.

    At a period of the grid a wave leaves a part of itself, which a form of just the right period would take away.
    """
    sharp = list[Candidate]()
    for c in chosen:
        if len(c.searched) != 1 or is_direct(c.effect):
            continue
        view = _Given.of(evidence, [each for each in chosen if each is not c])
        finer = _sharper(view, c)
        before, after = view.falls([c.columns, finer.columns])
        if after - before > LOST * (view.left - after) / view.dof:
            sharp.append(finer)
    return sharp


def _sharper(view: _Given, c: Candidate) -> Candidate:
    """Return an effect with its searched value where it explains most of what a set leaves."""
    sensitivities, ((name, value),) = view.evidence.sensitivities, c.searched.items()
    reach, most, columns = math.log(2), math.inf, c.columns
    if c.effect.definition.searched[name] is StartSearch.PERIOD:  # half a wave more or less
        j = sensitivities.fit.machine.number_of(str(c.effect.place))
        span = float(np.ptp(sensitivities.observations.q[:, j]))
        reach, most = min(reach, value / 2 / span), max(value, span / FEWEST_WAVES)
    for k in range(ROUNDS):
        values = np.minimum(value * np.exp(reach * np.linspace(-1, 1, 9) / 4**k), most)
        near = columns_at(sensitivities, c.effect, {name: values})
        best = int(np.argmax(view.falls([*near])))
        value, columns = float(values[best]), near[best]
    return replace(c, searched={name: value}, columns=columns)


def _further_wave(evidence: Evidence, c: Candidate, there: Sequence[Effect]) -> Candidate:
    """Return a wave of a drive that has others already, as an effect that a user could have written."""
    machine, definition, place = evidence.base.machine, c.effect.definition, str(c.effect.place)
    taken = {effect.name for effect in (*there, *machine.effects)}
    wave = own_effect(
        next(name for k in itertools.count(2) if (name := f"{DRIVE_ERROR}_{k}") not in taken),
        definition.component,
        definition.formula.text,
        c.effect.units(machine),
        "A further wave of the same drive: another of its parts runs out, or the same one has a second wave.",
        at=machine.kind_of(place),
        file=machine.file or machine.name,
        place=f"wave at {place}",
    )
    effect = Effect(wave, place)
    return replace(c, effect=effect, names=tuple(map(effect.key, c.short_names)))


def _is_wave_of(joint: str | None, effect: Effect) -> bool:
    """Return whether an effect is a wave of a joint's drive, also one of a user's own."""
    return effect.place == joint and [*effect.definition.searched.values()] == [StartSearch.PERIOD]


@dataclass(frozen=True)
class _Search:
    evidence: Evidence
    drivers: list[Driver]
    places: list[tuple[Place, str]]
    follow: Array
    """How the weighted residuals follow each component of a place, (components, n, m)."""
    terms: list[Term]

    @classmethod
    def of(cls, evidence: Evidence) -> _Search | None:
        """Return a prepared search; None where there is nothing to look for, or to look with."""
        o, component = evidence.sensitivities.observations, evidence.sensitivities.component
        drivers = drivers_of(o)
        every = itertools.product((*(joint.name for joint in o.machine.joints), None), COMPONENTS)
        follow = {at: column for at in every if (column := component(*at)) is not None and np.any(column)}
        if not drivers or not follow or evidence.dof < 1 or not evidence.models[0].square > 0:
            return None
        return cls(evidence, drivers, [*follow], np.array([*follow.values()]), terms(drivers))

    def views(self, chosen: Sequence[Candidate]) -> list[tuple[_Given, list[Scored]]]:
        """Return what sets of candidates leave, under a noise model, with pieces that may explain it and their costs.

        Of the chosen candidates C a form F may replace a part R. Without R the misfit is no less, and no more is saved
        than what C costs apart from the misfit, its price:

            cost(C - R + F) - cost(C) >= cost(C + F) - cost(C) - price(C)

        So only a piece that raises the cost of C by less than the price may be worth its own. Where all of these were
        found beside C, nothing else is searched; else the search is done without any effect, too.
        """
        views = self._searched(chosen)
        price = views[0][0].price
        if chosen and any(scored and scored[-1][0] < price for _, scored in views):
            views += self._searched([])
        pieces = [piece for _, scored in views for cost, piece in scored if cost < price]
        fewer = [tuple(c for c in chosen if c is not one) for one in chosen]
        parts = [*fewer, ()] if pieces and chosen else []
        each_view = [_Given.of(self.evidence, part) for part in dict.fromkeys(parts)]
        return [*views, *zip(each_view, self._exact(each_view, pieces), strict=True)]

    def _searched(self, chosen: Sequence[Candidate]) -> list[tuple[_Given, list[Scored]]]:
        """Return what a set leaves, with the pieces of a search; and that as if there were no errors readings share."""
        models = dict.fromkeys([self.evidence.model_for(chosen), self.evidence.independent])
        views = [_Given.of(self.evidence, chosen, model) for model in models]
        return [(view, self._promising(view)) for view in views]

    def forms(self, view: _Given, scored: Sequence[Scored], forms: list[Candidate]) -> Iterator[Candidate]:
        """Yield forms that lower the cost of a set, the best first, and add them to those that were found."""
        similar = list[Array]()
        for cost, piece in scored:
            if cost >= 0:
                break
            similar += [orthonormal_basis(view.beyond(c.columns)) for c in forms[len(similar) :]]
            if self._is_variant(view, piece, similar):
                continue
            (refined,) = self._refined(view, [piece])
            if refined != piece and self._is_variant(view, refined, similar):
                continue
            columns = self._independent(refined)
            if columns is None or self._is_catalogued(refined) or self._is_error(view, refined):
                continue
            forms.append(self._candidate(refined, columns, [c.effect for c in forms]))
            yield forms[-1]

    def drives(self, view: _Given, scored: Sequence[Scored]) -> Iterator[Candidate]:
        """Yield a wave of a joint's drive in addition to the best form that is a wave of that joint: plain physics.

        One more wave of a drive that has another already is an effect of its own. It may be finer than any form, so it
        is searched among all periods.
        """
        evidence, solution = self.evidence, self.evidence.base.solution
        words = evidence.base.machine.quantities.keys() | evidence.base.observations.data.columns.keys()
        terms = [piece.term for cost, piece in scored if cost < 0]
        waves = [term.factors[0] for term in terms if self._reading_wave(term) is not None]
        of_forms = {wave.driver: wave.values[0] for wave in reversed(waves) if wave.kind == "wave"}
        for number, driver in enumerate(self.drivers):
            waves_there = [one for one in view.chosen if _is_wave_of(driver.joint, one.effect)]
            fitted = [e for e in evidence.base.machine.effects if _is_wave_of(driver.joint, e)]
            there = [*fitted, *(one.effect for one in waves_there)]
            if driver.kind != "joint" or not (number in of_forms or there):
                continue
            c = self._drive_error(driver.joint)
            if c is None or c.key in evidence.refused or words & c.effect.definition.parameters.keys():
                continue
            ((name, _),) = c.searched.items()
            numbers = [evidence.base.problem.model.keys[e.key(name)] for e in fitted]
            periods = [*solution.theta[numbers], *(one.searched[name] for one in waves_there)]
            tried = [2 * math.pi / of_forms[number]] if number in of_forms else []
            if there:
                tried += [searched[name] for of, searched in self._periods(view.chosen) if of is c.effect]
                tried += [period / k for period in periods for k in OVERTONES]
            # half a wave away is what a coarse period leaves
            counts = {p: driver.span / p for p in tried}
            far = [
                p
                for p, n in counts.items()
                if all(abs(driver.span / known_period - n) > 0.5 for known_period in periods)
            ]
            if not far:
                continue
            near = columns_at(evidence.sensitivities, c.effect, {name: far})
            best = int(np.argmax(view.falls([*near])))
            c = _sharper(view, replace(c, searched={name: far[best]}, columns=near[best]))
            count = driver.span / c.searched[name]
            if count >= FEWEST_WAVES and all(abs(driver.span / p - count) > 0.5 for p in periods):
                yield c if c.effect.name not in {e.name for e in there} else _further_wave(evidence, c, there)

    def _periods(self, chosen: Sequence[Candidate]) -> list[tuple[Effect, dict[str, float]]]:
        """Return the best further periods, given candidates, of each drive that has a wave already."""
        key = frozenset(chosen)
        if key not in self._known_periods:
            there = [*self.evidence.base.machine.effects, *(c.effect for c in chosen)]
            joints = [d.joint for d in self.drivers if d.kind == "joint"]
            joints = [joint for joint in joints if any(_is_wave_of(joint, effect) for effect in there)]
            effects = [c.effect for joint in joints if (c := self._drive_error(joint)) is not None]
            self._known_periods[key] = [*promising_periods(self.evidence.sensitivities, effects, chosen)]
        return self._known_periods[key]

    @cached_property
    def _known_periods(self) -> dict[frozenset[Candidate], list[tuple[Effect, dict[str, float]]]]:
        return {}

    def _drive_error(self, joint: str | None) -> Candidate | None:
        """Return a wave of a joint's drive, at any period; None where the joint can have none."""
        sensitivities, machine = self.evidence.sensitivities, self.evidence.base.machine
        every = [c for c in self.evidence.candidates if c.key == (DRIVE_ERROR, joint)]
        for effect in machine.effects:
            if effect.identity == (DRIVE_ERROR, joint):  # it is in the model, at a period of its own
                period = dict.fromkeys(effect.definition.searched, 1.0)
                prior, tries = plausibility(machine, effect), number_tried(sensitivities, effect)
                every.append(replace(with_searched(sensitivities, effect, period), tries=tries, prior=prior))
        return every[-1] if every else None

    def _is_variant(self, view: _Given, piece: Piece, others: Sequence[Array]) -> bool:
        """Return whether a piece explains what one of other forms does, given by orthonormal columns."""
        basis = orthonormal_basis(view.beyond(self.columns(piece)))
        explained = basis @ (basis.T @ view.y)
        least = min(
            (np.linalg.norm(project_out(basis_of, explained)) for basis_of in others), default=math.inf
        )
        return bool(least < SIMILAR * np.linalg.norm(explained))

    def _candidate(self, piece: Piece, columns: Array, others: Sequence[Effect]) -> Candidate:
        o = self.evidence.sensitivities.observations
        effect = effect_of(piece.term, self.places[piece.at], self.drivers, o, others)
        names = tuple(effect.key(name) for name in effect.definition.parameters if name not in effect.hold)
        tries = math.exp(self._log_tries([piece.term])[piece.at, 0])
        odds = Plausibility(math.log(SOMETHING_UNNAMED))
        return Candidate(effect, names, columns, {}, tries, odds, piece.term.follows(self.drivers))

    def _independent(self, piece: Piece) -> Array | None:
        """Return independent combinations of a piece's columns; None where a coefficient is not determined.

        The powers of a curve are much alike: of their coefficients the usual sizes would say nothing.
        """
        columns = self.columns(piece)
        length = np.maximum(np.linalg.norm(columns, axis=(0, 1)), 1e-300)
        beyond = self._beyond_model(piece) / length
        root = inverse_root(beyond.T @ beyond, least=UNDETERMINED) * float(
            np.linalg.norm(self.follow[piece.at])
        )
        return np.asarray(columns / length @ root) if root.shape[1] == len(root) else None

    def columns(self, piece: Piece) -> Array:
        """Return the derivatives of the weighted residuals by the coefficients of a piece, (n, m, k)."""
        return np.asarray(self.follow[piece.at][:, :, None] * piece.term.functions(self.drivers)[:, None, :])

    # the cost ---------------------------------------------------------------------------------------------------------

    def _log_tries(self, some: Sequence[Term]) -> Array:
        """Return the logarithms of the number of tries of terms at all components, (places, terms).

        Among how many forms one is: places, drivers, terms, and values that the data distinguish. What belongs to a
        joint rather follows what that joint does, and is rather an error along its own motion.
        """
        dof, drivers = math.log(self.evidence.dof), math.log(len(self.drivers))
        of_terms = [math.log(t.choices) + drivers * len(t.factors) + dof * len(t.searched) / 2 for t in some]
        across = np.array([component != "reading" for _, component in self.places])
        doublings = ~_any(self._belongs, some) + across[:, None].astype(float)
        return np.asarray(math.log(len(self.places)) + np.array(of_terms) + math.log(2) * doublings)

    def _prices(self, some: Sequence[Term]) -> Array:
        """Return what terms at all components cost, whatever they explain, (places, terms).

        Infinite where a formula has no word for a driver, or where an effect of the catalogue has all waves.
        """
        counts = np.array([term.count for term in some])
        of_one = 2 * (self.evidence.log_choices - math.log(SOMETHING_UNNAMED))
        prices = of_one + 2 * self._log_tries(some) + counts * math.log(self.evidence.dof)
        prices[_any(self._unnamed, some)] = math.inf
        for k, term in enumerate(some):
            if (reading := self._reading_wave(term)) is not None:
                prices[reading, k] = math.inf
        return np.asarray(prices)

    @cached_property
    def _belongs(self) -> Mask:
        """Whether a driver acts at a place rather than elsewhere; a load acts anywhere."""
        return np.array([[d.joint == at or d.kind == "load" for d in self.drivers] for at, _ in self.places])

    @cached_property
    def _unnamed(self) -> Mask:
        """Whether a formula at a place has no word for a driver."""
        machine = self.evidence.sensitivities.observations.machine
        return np.array([[not word(d, place, machine) for d in self.drivers] for place, _ in self.places])

    def _exact(self, views: Sequence[_Given], pieces: Sequence[Piece]) -> list[list[Scored]]:
        """Return pieces with their costs by all rows in each view, the cheapest first."""
        pieces = list(dict.fromkeys(pieces))
        if not pieces:
            return [[] for _ in views]
        columns = [self.columns(piece) for piece in pieces]
        prices = np.array([self._prices([term])[at, 0] for term, at in pieces])
        white = {model: _white(model, columns) for model in {view.model for view in views}}
        costs = [view.gains(view.falls_of(white[view.model])) + prices for view in views]
        return [[(float(of[i]), pieces[i]) for i in np.argsort(of, kind="stable")] for of in costs]

    def _falls(self, view: _Given, pieces: Sequence[Piece]) -> Array:
        return view.falls([self.columns(piece) for piece in pieces])

    # the search -------------------------------------------------------------------------------------------------------

    def _promising(self, view: _Given) -> list[Scored]:
        """Return the pieces that explain most of what a set leaves, searched values refined, and products of them."""
        if not view.left > 0:
            return []
        rough, everywhere = _Rough.of(view, self.follow), [*range(len(self.places))]
        (scored,) = self._exact([view], self._best(view, rough, self.terms, everywhere, SHORT_LIST))
        searched = [piece for _, piece in scored if piece.term.searched][:REFINED]
        (more,) = self._exact([view], self._refined(view, searched))
        scored = sorted([*scored, *more], key=itemgetter(0))
        products = [
            product
            for _, piece in scored[:MULTIPLIED]
            for product in self._best(view, rough, piece.term.multiplied(self.drivers), [piece.at], ALIKE)
        ]
        (more,) = self._exact([view], self._refined(view, products))
        return sorted([*scored, *more], key=itemgetter(0))

    def _best(
        self, view: _Given, rough: _Rough, tried: Sequence[Term], places: Sequence[int], most: int
    ) -> list[Piece]:
        """Return the cheapest pieces, roughly, not too many of one family at one component."""
        costs, ordered = [np.zeros((len(places), 0))], list[Term]()
        alike = self._functions if tried is self.terms else _alike(tried, self.drivers)
        for some, falls in rough.falls(alike, places):
            costs.append(view.gains(falls) + self._prices(some)[places])
            ordered += some
        every = np.concatenate(costs, axis=1)
        pieces, times = list[Piece](), Counter[object]()
        for i in np.argsort(every, axis=None, kind="stable")[: np.count_nonzero(every < math.inf)]:
            number, k = divmod(int(i), len(ordered))
            piece = Piece(ordered[k], places[number])
            family = piece.at, *((factor.driver, factor.kind) for factor in piece.term.factors)
            times[family] += 1
            if times[family] <= ALIKE:
                pieces.append(piece)
                if len(pieces) == most:
                    break
        return pieces

    @cached_property
    def _functions(self) -> list[tuple[list[Term], Array]]:
        return _alike(self.terms, self.drivers)

    def _refined(self, view: _Given, pieces: Sequence[Piece]) -> list[Piece]:
        """Return pieces with better searched values, of as few digits as the data determine; all at once."""
        refined, fall = [*pieces], self._falls(view, pieces)
        for k in range(ROUNDS):
            tried = [
                (number, Piece(near, at))
                for number, (term, at) in enumerate(refined)
                for near in term.neighbours(self.drivers, 0.5**k)
            ]
            falls = self._falls(view, [piece for _, piece in tried])
            for (number, piece), falls_of_piece in zip(tried, falls, strict=True):
                if falls_of_piece > fall[number]:
                    fall[number], refined[number] = falls_of_piece, piece
        enough, digits = fall - LOST * (view.left - fall) / view.dof, range(DIGITS, 0, -1)
        short = [Piece(term.rounded(some, self.drivers), at) for some in digits for term, at in refined]
        falls = self._falls(view, short).reshape(DIGITS, -1)  # the fewest last
        for some, number in np.argwhere(falls >= enough).tolist():
            refined[number] = short[some * len(pieces) + number]
        return refined

    # what is no form --------------------------------------------------------------------------------------------------

    def _reading_wave(self, term: Term) -> int | None:
        """Return where a wave of one joint is an effect of the catalogue of any period: the number of its reading."""
        wave, *more = term.factors
        joint = self.drivers[wave.driver].joint
        at, machine = (joint, "reading"), self.evidence.sensitivities.observations.machine
        if more or wave.kind not in {"wave", "harmonic"} or joint is None or at not in self.places:
            return None
        return None if machine.joint(joint).period is not None else self.places.index(at)

    def _is_catalogued(self, piece: Piece) -> bool:
        """Return whether effects of the catalogue, at the place or at the joint that it follows, span a form."""
        evidence, model = self.evidence, self.evidence.models[0]
        place = self.places[piece.at][0]
        if place is None and [factor.kind for factor in piece.term.factors] == ["decay"]:
            return True
        at = {place, *(self.drivers[f.driver].joint for f in piece.term.factors)}
        there = [
            evidence.parts[id(c)]
            for c in evidence.candidates
            if c.effect.place in at and not c.searched and not c.effect.definition.own
        ]
        span, beyond = model.across[:, np.concatenate([np.zeros(0, int), *there])], self._beyond_model(piece)
        if (reading := self._reading_wave(piece.term)) is not None:
            span = np.concatenate([span, self._beyond_model(Piece(piece.term, reading))], axis=1)
        span = unit_columns(span)
        explained = falls_from_products(span.T @ span, beyond.T @ span, relative=COST.visible**2)
        return bool(np.sum(beyond**2) - np.sum(explained) < COST.imperfect**2 * np.sum(beyond**2))

    def _beyond_model(self, piece: Piece) -> Array:
        space = self.evidence.models[0].space
        return space.seen(self.columns(piece))

    def _is_error(self, view: _Given, piece: Piece) -> bool:
        """Return whether errors of the few worst poses, each for itself, explain as much at the same cost."""
        n, m = self.evidence.sensitivities.residual.shape
        number = np.unique(self.evidence.sensitivities.observations.pose, return_inverse=True)[1]
        readings = np.bincount(number) * m
        squares = np.bincount(number, np.sum(view.y.reshape(n, m) ** 2, axis=1))
        worst = np.argsort(-squares / readings, kind="stable")[:FEW_POSES]
        blocks = [np.flatnonzero(np.repeat(number == pose, m)) for pose in worst]
        errors = [(np.arange(n * m)[:, None] == rows).astype(float).reshape(n, m, -1) for rows in blocks]
        fall, *falls = view.falls([self.columns(piece), *errors])
        variance = (view.left - fall) / view.dof
        sizes = np.array(falls) / variance / readings[worst]
        gains = readings[worst] * (sizes - np.log(np.maximum(sizes, 1.0))) + 2 * math.log(GROSS)
        price = self._prices([piece.term])[piece.at, 0]
        return bool(np.sum(np.maximum(gains, 0.0)) > fall / variance - price)


@dataclass(frozen=True)
class _Given:
    """What chosen candidates leave of the whitened readings."""

    evidence: Evidence
    chosen: Sequence[Candidate]
    model: Columns
    basis: Array
    """Orthonormal, of the chosen candidates' columns, (N, r)."""
    y: Array
    left: float
    """|y|²."""
    dof: int
    dearer: float
    """By how much the noise model is dearer than the one that is best without further candidates."""

    @classmethod
    def of(cls, evidence: Evidence, chosen: Sequence[Candidate], model: Columns | None = None) -> _Given:
        """Return what candidates leave under a noise model; that under which they cost least without."""
        model = model or evidence.model_for(chosen)
        index = np.concatenate([np.zeros(0, int), *(evidence.parts[id(c)] for c in chosen)])
        basis = orthonormal_basis(model.across[:, index])
        y = project_out(basis, model.space.residual)
        left, dof = float(y @ y), max(evidence.dof - basis.shape[1], 1)
        return cls(evidence, chosen, model, basis, y, left, dof, evidence.dearer(model, chosen))

    @property
    def price(self) -> float:
        """What the chosen candidates cost, apart from the misfit, as if it were that of any sizes of theirs."""
        n = self.evidence.dof
        misfit = n + n * math.log(self.left / n) + self.model.space.log_determinant
        return self.evidence.cost(self.chosen) - misfit if self.left > 0 else 0.0

    @cached_property
    def out(self) -> Array:
        """Orthonormal, of the model's columns and those of chosen candidates, (N, p + r)."""
        return np.concatenate([self.model.space.basis, self.basis], axis=1)

    def gains(self, falls: Array) -> Array:
        """Return by how much falls of the sum of squares raise the cost, before what explains them has a price."""
        return np.asarray(self.dof * np.log1p(-np.minimum(falls / self.left, 1 - 1e-12)) + self.dearer)

    def beyond(self, columns: Array) -> Array:
        """Return what of columns, (n, m, K), neither the model nor chosen candidates imitate, (N, K)."""
        return project_out(self.basis, self.model.space.seen(columns))

    def falls(self, columns: Sequence[Array]) -> Array:
        """Return by how much each set of columns, (n, m, k), lowers the sum of squares."""
        return self.falls_of(_white(self.model, columns)) if len(columns) else np.zeros(0)

    def falls_of(self, white: Sequence[Array]) -> Array:
        """Return by how much each set of whitened columns, (N, k), lowers the sum of squares."""
        # the products beyond the model and what was chosen, from whose rounding the least part is far
        whole = np.concatenate(white, axis=1)
        along, pull = self.out.T @ whole, whole.T @ self.y
        falls, sizes = np.zeros(len(white)), np.array([c.shape[1] for c in white])
        starts = np.cumsum(sizes) - sizes
        for size in np.unique(sizes):
            these = np.flatnonzero(sizes == size)
            part = starts[these][:, None] + np.arange(size)
            x, a = np.moveaxis(whole[:, part], 0, 1), np.moveaxis(along[:, part], 0, 1)
            gram = np.swapaxes(x, 1, 2) @ x - np.swapaxes(a, 1, 2) @ a
            falls[these] = falls_from_products(gram, pull[part], least=COST.visible**2)
        return falls


def _white(model: Columns, columns: Sequence[Array]) -> list[Array]:
    """Return sets of columns, (n, m, k), scaled to length 1 and whitened, (N, k)."""
    whole = np.concatenate([*columns], axis=2)
    unit = unit_columns(whole.reshape(len(model.space.residual), -1)).reshape(whole.shape)
    white = model.space.whiten(unit).reshape(len(model.space.residual), -1)
    return np.split(white, np.cumsum([c.shape[2] for c in columns])[:-1], axis=1)


@dataclass(frozen=True)
class _Rough:
    """What products of a component and a function explain, by sums over rows."""

    pulls: Array
    """Products of each component with what is to be explained, (components, n)."""
    few: Ints
    """Rows that tell how much of the products is beyond what is known."""
    weight: Array
    """Squares of the components in these, (components, few)."""
    sums: Array
    """Products of each component with what is known, (components, few, r)."""

    @classmethod
    def of(cls, view: _Given, follow: Array) -> _Rough:
        """Return this of what chosen candidates leave, with a drift in place of the whitening."""
        sensitivities = view.evidence.sensitivities
        residual, whiten = sensitivities.residual, view.model.space.whiten
        n, m = residual.shape
        known, drift = view.out.reshape(n, m, -1), np.zeros((n, m, 0))
        if whiten is not unchanged:
            known = np.concatenate([sensitivities.model, *(c.columns for c in view.chosen)], axis=2)
            drift = _drift(sensitivities.frame, whiten)
        basis = _basis(known, drift)
        rest = residual - np.reshape(basis @ (basis.T @ residual.ravel()), (n, m))
        rest *= math.sqrt(view.left / max(float(np.sum(residual * rest)), 1e-300))
        # drawn, so that no cycle of the rows shows in them
        most = max(FEW_ROWS, 4 * (known.shape[2] + drift.shape[2]) // m)
        few = np.sort(np.random.default_rng(0).permutation(n)[:most])
        out = _basis(known[few], drift[few]).reshape(len(few), m, -1)
        some = follow[:, few]
        # in single precision: only which terms are compared exactly depends on it
        sums = np.einsum("pnm,nmr->pnr", some, out, dtype=np.float32, casting="same_kind", optimize=True)
        return cls(np.einsum("pnm,nm->pn", follow, rest), few, np.sum(some**2, axis=2), sums)

    def falls(
        self, alike: Sequence[tuple[list[Term], Array]], places: Sequence[int]
    ) -> Iterator[tuple[list[Term], Array]]:
        """Yield terms of as many functions, and by about how much they lower the sum of squares, (places, terms)."""
        for same, single in alike:
            pull = np.stack([self.pulls[places] @ of_rows for of_rows in single], axis=2)
            gram = np.zeros((*pull.shape, pull.shape[2]))
            single = single[:, self.few]
            for k, second in itertools.product(range(len(single)), repeat=2):
                gram[:, :, k, second] = self.weight[places] @ (single[k] * single[second])
            size = np.sqrt(np.einsum("ptkk->ptk", gram))
            size = np.where(size > 0, size, 1.0)
            single = single.astype(np.float32)
            for number, at in enumerate(places):
                along = self.sums[at].T @ single
                gram[number] -= np.einsum("krt,lrt->tkl", along, along)
            gram /= size[:, :, :, None] * size[:, :, None, :]
            falls = falls_from_products(gram, pull / size, least=COST.visible**2)
            yield same, falls * len(self.few) / self.pulls.shape[1]


def _alike(tried: Sequence[Term], drivers: Sequence[Driver]) -> list[tuple[list[Term], Array]]:
    """Return terms, those of as many functions together, and these, of length 1, (count, n, terms)."""
    alike: dict[int, list[Term]] = {}
    for term in tried:
        alike.setdefault(term.count, []).append(term)
    groups = []
    for members in alike.values():
        functions = np.stack([term.functions(drivers) for term in members], axis=1)
        size = np.sqrt(np.einsum("ntk,ntk->tk", functions, functions))
        # function by function, so that each is in one piece
        single = np.ascontiguousarray(np.moveaxis(functions / np.where(size > 0, size, 1.0), 2, 0))
        groups.append((members, single))
    return groups


def _basis(known: Array, drift: Array) -> Array:
    """Return Q, with 1 - QQᵀ the inverse covariance of readings beyond known columns and a drift's, of variance 1.

    They are the rows of an orthonormal basis that belong to readings: those of the known variances stand below them.
    """
    size, p, d = known.shape[0] * known.shape[1], known.shape[2], drift.shape[2]
    columns = np.concatenate([known, drift], axis=2).reshape(size, -1)
    return orthonormal_basis(np.concatenate([columns, np.eye(d, p + d, p)]))[:size]


def _any(of_drivers: Mask, some: Sequence[Term]) -> Mask:
    """Return whether something is true, (places, drivers), of any driver of a term, (places, terms)."""
    first, last = (np.array([term.factors[end].driver for term in some], int) for end in (0, -1))
    return np.asarray(of_drivers[:, first] | of_drivers[:, last])


def _drift(frame: Array, whiten: Whiten) -> Array:
    """Return columns of variance 1 of a drift of the frame, (n, m, d), as the whitening has it.

    The frame's freedoms times cosines over the row are nearly what the covariance of a drift only stretches: by how
    much is seen from what whitening makes of them.
    """
    n, m, _ = frame.shape
    waves = np.cos(np.pi * np.outer((np.arange(n) + 0.5) / n, np.arange(COSINES)))
    columns = unit_columns((frame[:, :, :, None] * waves[:, None, None, :]).reshape(n * m, -1))
    left = np.sum(whiten(columns.reshape(n, m, -1)) ** 2, axis=(0, 1))
    columns *= np.sqrt(np.maximum(1 / np.maximum(left, 1e-12) - 1, 0.0))
    return columns.reshape(n, m, -1)
