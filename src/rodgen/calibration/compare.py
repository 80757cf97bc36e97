"""Compare the residuals of a fit with everything that was recorded: what they follow, and where the model is worst.

A view of the evidence: each driver, and each pair of drivers, is a candidate with a curve of low order in one component
of the residuals, or along the motion that a joint causes. Those that the data call for are selected like effects, and
said with odds; a set-up that wanders, and errors that the readings of a pose share, are allowed for.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen import views
from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.dependence import Correlation
from rodgen.calibration.diagnosis import odds_of
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.fitted import Fit
from rodgen.calibration.gross_readings import on_gross_readings
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.selection import equals, log10_of, select, worth
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.calibration.summary import contradictions
from rodgen.calibration.words import (
    IN_UNCERTAINTIES,
    NOTHING_LEFT,
    in_component,
    odds_text,
    percent,
    plain,
    sized,
)
from rodgen.calibration.worst_regions import Region, worst_regions
from rodgen.data.poses import stretches
from rodgen.document import Document, Documented, Paragraph, Part, Table
from rodgen.errors import counted, joined
from rodgen.machines.drivers import HARMONICS, Driver, drivers_of_place, products
from rodgen.machines.effects.definition import EffectDefinition
from rodgen.machines.effects.formula import Formula
from rodgen.machines.machine import Effect
from rodgen.machines.plausibility import Plausibility
from rodgen.statistics.thresholds import COST
from rodgen.views import Records, Result

ROUNDING = 64 * np.finfo(float).eps
"""Residuals below this part of the largest reading are rounding, of which nothing is said."""
COMPETING = 30
"""Drivers in a component, the likeliest each alone, of which sets are selected."""


# candidates ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trial:
    """Drivers that may matter, in one component of the residuals or along the motion of a joint."""

    drivers: tuple[Driver, ...]
    """One, or two together; none for the set-up as a whole."""
    motion: Array = field(repr=False)
    """What an error there does to the weighted residuals, (n, m, k)."""
    component: str = ""
    joint: str = ""
    """Names; one of them is empty."""
    log_odds: float = 0.0

    @property
    def where(self) -> str:
        """The component, or ``along JOINT``."""
        return f"along {self.joint}" if self.joint else self.component or "all"

    @property
    def name(self) -> str:
        """Name of the driver, or both."""
        return " and ".join(driver.name for driver in self.drivers) or "set-up"

    @property
    def text(self) -> str:
        """What a sentence calls the drivers."""
        if not self.drivers:
            return "a turn or shift of the whole set-up"
        texts = [plain(driver.text, 90) for driver in self.drivers]
        if len(texts) > 1:
            each = self.drivers[0].kind == "target"
            return f"{texts[1]}, differently for each target" if each else f"{joined(texts)} together"
        return texts[0]

    def curves(self) -> Iterator[Array]:
        """Yield the columns of curves, (n, k), of the lowest order first."""
        if not self.drivers:
            yield np.ones((len(self.motion), 1))
        elif len(self.drivers) > 1:
            yield products(*map(_first_order, self.drivers))
        else:
            (driver,) = self.drivers
            first = _first_order(driver)
            if driver.coordinate is not None:  # the warm screw of a slide is longer far out
                first = np.column_stack([first, products(first, _first_order(driver.coordinate))])
            yield first - first.mean(axis=0)
            yield driver.low_columns
            yield driver.columns

    @cached_property
    def candidates(self) -> list[Candidate]:
        """The drivers as candidates, one of each curve."""
        by_size = {curve.shape[1]: curve for curve in reversed([*self.curves()]) if curve.shape[1]}
        curves = [*(_waves(self.drivers[0]) if len(self.drivers) == 1 else ()), *reversed(by_size.values())]
        definition = EffectDefinition(self.name, frozenset({"machine"}), "reading", _BARE, {}, own=True)
        effect, several = Effect(definition, self.where), list[Candidate]()
        by_place = any(driver.kind == "place" for driver in self.drivers)  # by the joints
        for curve in curves:
            columns = self.motion[:, :, :, None] * curve[:, None, None, :]
            columns = columns.reshape(*self.motion.shape[:2], -1)
            names = tuple(f"{self.name}.{k}" for k in range(columns.shape[2]))
            prior = Plausibility(self.log_odds - by_place * COST.needed / 2)
            several.append(Candidate(effect, names, columns, {}, float(len(curves)), prior))
        return several


_BARE = Formula.parse("a", file="comparison", place="driver")


def _waves(driver: Driver) -> Iterator[Array]:
    """Yield each wave of several a turn, (n, 2), such as that of a graduation that is out of round."""
    if driver.turn is not None:
        angle = 2 * np.pi * driver.values / driver.turn
        for k in range(2, min(HARMONICS, (driver.levels - 1) // 2) + 1):
            yield np.column_stack([np.cos(k * angle), np.sin(k * angle)])


def _first_order(driver: Driver) -> Array:
    """Return what physics makes of a driver first, (n, k).

    A straight line, one wave of an angle, and of a load what is proportional to it.
    """
    if driver.categories or driver.levels < 2:
        return driver.low_columns
    if driver.period is not None:
        angle: Array = 2 * np.pi * driver.values / driver.period
        return np.column_stack([np.cos(angle), np.sin(angle)])
    middle = 0.0 if driver.kind == "load" else driver.low + driver.span / 2
    return ((driver.values - middle) / driver.span)[:, None]


def _drivers(rows: Sensitivities) -> list[Driver]:
    """Return everything that residuals are compared with, as far as it varies."""
    fit, rows_of_fit = rows.fit, rows.rows
    recorded = (
        driver.as_noted(lambda values: values[rows_of_fit], rows_of_fit)
        for driver in fit.observations.drivers()
    )
    places = drivers_of_place(fit.machine, fit.places(rows.observations))
    return [driver for driver in (*recorded, *places) if driver.levels > 1]


def _trials(rows: Sensitivities, drivers: Sequence[Driver]) -> list[Trial]:
    """Return each driver, and pairs of joints with each other, with load, temperatures, columns and targets."""
    joints = [driver for driver in drivers if driver.kind == "joint"]
    others = [d for d in drivers if d.kind in {"load", "temperature", "column", "target"}]
    pairs = [*combinations(joints, 2), *((o, j) for o in others for j in joints if o.joint != j.joint)]
    machine = rows.fit.machine
    along = {joint.name: rows.component(joint.name, "reading") for joint in machine.joints}
    weights = [rows.weight[:, :, None] * unit[:, None] for unit in np.eye(rows.residual.shape[1])]
    trials = [Trial((driver,), rows.frame) for driver in drivers if driver.kind == "run"]
    if machine.measured.frame != "free":
        trials.append(Trial((), rows.frame))
    for several in (*((driver,) for driver in drivers), *pairs):
        trials += map(Trial, repeat(several), weights, machine.measurand.components)
        any_joint = any(driver.kind == "load" for driver in several)  # a weight winds up any
        for name, motion in along.items():
            if motion is not None and (any_joint or name in {driver.joint for driver in several}):
                trials.append(Trial(several, motion[:, :, None], joint=name))
    many = Counter(len(trial.drivers) > 1 for trial in trials)  # half of the odds are for pairs
    return [replace(one, log_odds=-math.log(2 * many[len(one.drivers) > 1])) for one in trials]


# the result ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, repr=False, eq=False)
class Followed(Result):
    """A driver that the residuals follow, in one component or along a motion."""

    trial: Trial
    explained: float
    """Part of the variance of all residuals, less what chance explains."""
    log10_odds: float
    """Logarithm of the odds that it matters."""
    places: tuple[str, ...] = ()
    """Where it shows: components, or motions of joints."""
    instead: tuple[str, ...] = ()
    """Drivers that explain the same in its place."""

    @property
    def unit(self) -> str:
        """Of the driver where there is one."""
        return self.trial.drivers[0].unit if len(self.trial.drivers) == 1 else ""

    _keys = "covariate=trial.name unit component=trial.where explained log10_odds"


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Documented, Result):
    """What the residuals of a fit follow, and where the model is worst; made by :func:`compare`.

    ``print(comparison)`` shows sentences, the most important first, and a table.

    Attributes
    ----------
    fit : Fit
    sensitivities : Sensitivities
        The rows that were looked at, without outliers.
    correlation : Correlation or None
        How readings depend on each other; None where none is beyond the fitted parameters.
    covariates : tuple of Driver
        What varies in the data and was compared with the residuals, in these rows.
    alone : tuple of Followed
        Each driver alone, in each component where it was tried.
    found : tuple of Followed
        Those that the data call for, each given those before.
    worst : tuple of Region
        Where the model is worse than elsewhere, the clearest first.
    """

    fit: Fit
    sensitivities: Sensitivities
    correlation: Correlation | None
    covariates: tuple[Driver, ...]
    alone: tuple[Followed, ...]
    found: tuple[Followed, ...]
    worst: tuple[Region, ...]

    @property
    def exact(self) -> bool:
        """Whether the residuals are rounding."""
        reading = np.abs(self.fit.observations.reading)
        return bool(self.fit.rms * self.fit.unit_factor <= ROUNDING * np.max(reading, initial=0.0))

    @property
    def rms(self) -> NDArray[np.float64]:
        """Root mean square of each component, (m,), in the fit's `units`, without outliers."""
        squares = np.mean(self.fit.residuals[~self.fit.outliers] ** 2, axis=0)
        return np.sqrt(squares) * self.fit.in_units  # type: ignore[no-any-return]

    @property
    def table(self) -> Records[dict[str, Any]]:
        """What each driver explains alone, as dicts with the keys of :meth:`to_dict`, or as a DataFrame."""
        return Records([one.to_dict() for one in self.alone], dict)

    @property
    def claims(self) -> list[str]:
        """The sentences that say that something is there; empty when these data show nothing."""
        return [] if self.exact else [*_worst(self), *_found(self), *_shared(self, wanders=True)]

    @property
    def sentences(self) -> list[str]:
        """What an engineer needs to know, the most important first."""
        return list(_sentences(self))

    def document(self) -> Document:
        """Return the sentences, then a table of each driver alone, then the error of each component."""
        each = zip(self.fit.machine.measurand.components, self.rms, self.fit.units, strict=True)
        rms = ", ".join(f"{name} {sized(value, unit)}" for name, value, unit in each)
        paragraphs = [Paragraph(text, "line") for text in self.sentences]
        parts = [Part(part) for part in (paragraphs, _table(self)) if part]
        return Document([*parts, Part([Paragraph(f"rms by component: {rms}", "line")])])

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, as ``rodgen compare --json`` prints it.

        Returns
        -------
        dict
            ``machine``, ``data``, ``rows``, ``copies``, ``set_aside``, ``poses``, ``outliers`` (numbers of rows,
            from 0), ``unit``, ``rms``; of ``set_aside`` how many ``rows``, and the ``entries`` of the machine file;
            ``gross``: readings that are grossly wrong: ``row``, ``component``, ``off``, ``others`` (what others are off
            at most);
            ``rows_looked_at``: fewer where there are very many;
            ``components``: ``name``, ``rms`` and ``unit`` of each;
            ``sentences``: those that are printed; ``claims``: those of them that say that something is there;
            ``depends_on``: what residuals follow, each given those before: ``covariate``, ``component`` (or ``"along
            JOINT"`` for a joint's reading, ``"all"`` for the whole set-up), ``explained`` (part of the variance of all
            residuals, each in its uncertainty), ``log10_odds`` that it matters, ``instead`` (what the data cannot
            distinguish from it);
            ``table``: each covariate alone: ``covariate``, ``unit``, ``component``, ``explained``, ``log10_odds``;
            ``correlation``: a sentence on errors that readings share, or null;
            ``worst``: regions: ``covariate``, ``unit``, ``low``, ``high``, ``category``, ``where``, ``rms``, in stated
            uncertainties where these differ much, and ``poses``.
        """
        fit = self.fit
        return {
            **views.plain(fit, "machine=machine.name data=observations.data.file"),
            **fit.used_rows,
            "rows_looked_at": len(self.sensitivities.rows),
            "poses": len(stretches(fit.observations.pose)[0]),
            **views.plain(fit, "unit rms"),
            "components": [
                {"name": n, "rms": float(r), "unit": unit}
                for n, r, unit in zip(self.fit.machine.measurand.components, self.rms, fit.units, strict=True)
            ],
            "sentences": self.sentences,
            "claims": self.claims,
            "depends_on": [one.to_dict() | {"instead": list(one.instead)} for one in self.found],
            "table": list(self.table),
            "correlation": (self.correlation and self.correlation.text) or None,
            "worst": [region.to_dict() for region in self.worst],
        }


def compare(fit: Fit) -> Comparison:
    """Return what the residuals of a fit follow: joints, directions, time, temperatures, places, columns.

    Parameters
    ----------
    fit : Fit
        Its outliers are left out.

    Returns
    -------
    Comparison

    Examples
    --------
    >>> from rodgen.calibration.fit import fit
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     name="Rotary table", length_unit="mm", angle_unit="deg", gravity=(0, 0, -1), reference_temperature=20,
    ...     joints=(Joint("C", "revolute", (0, 0, 1)),), targets=(Target("ball", (120, 0, 40)),),
    ...     measured=Measured("point", "machine"), estimate=("target",),
    ... )
    >>> random = np.random.default_rng(1)
    >>> C = random.permutation(np.arange(0, 360, 5.0))
    >>> angle, noise = np.radians(C), random.normal(size=(3, 72)) * 0.002
    >>> angle = angle + 1e-4 * np.cos(2 * angle)  # an ellipse in the scale
    >>> x, y, z = 120 * np.cos(angle), 120 * np.sin(angle), 40 + 0 * angle
    >>> data = {"C [deg]": C, "x [mm]": x + noise[0], "y [mm]": y + noise[1], "z [mm]": z + noise[2]}
    >>> comparison = compare(fit(table, Measurements.from_frame(data)))
    >>> print(comparison.sentences[0])
    The residuals depend on C: 87 % of their variance, along the motion of C (more than a million to 1).
    """
    with one_thread_in_blas():
        rows = Sensitivities.of(fit)
        drivers = tuple(_drivers(rows))
        worst = tuple(worst_regions(drivers, fit.sizes[rows.rows], np.asarray(rows.observations.pose)))
        nothing = Comparison(fit, rows, None, drivers, (), (), worst)
        if nothing.exact or not drivers:
            return nothing
        trials, beside = _trials(rows, drivers), None
        if not rows.model.shape[2]:  # an offset in a component would seem to be a set-up that wanders
            beside = rows.weight[:, :, None] * np.eye(rows.residual.shape[1])
        widest = [trial.candidates[-1] for trial in trials if trial.candidates]
        chosen = list[Candidate]()
        for _ in range(2):  # what was selected would seem to be errors that readings share
            bare = Evidence.of_curves(fit, rows, widest, chosen, beside)
            if bare.dof < 1 or not bare.models[0].square > 0:
                return nothing
            alone = [one for trial in trials if (one := _alone(bare, trial))]
            likeliest = sorted(alone, key=lambda one: -one.log10_odds)[:COMPETING]
            evidence = bare.including([c for one in likeliest for c in one.trial.candidates])
            chosen = select(evidence)
            if not chosen:
                break
        followed = tuple(_together(evidence, chosen, trials))
        correlation = evidence.correlation if chosen else evidence.correlation_for([])
        return Comparison(fit, rows, correlation, drivers, tuple(alone), followed, worst)


def _alone(bare: Evidence, trial: Trial) -> Followed | None:
    """Return what a trial is worth by itself, with its best curve; None where the fitted parameters imitate it."""
    evidence = bare.including(trial.candidates)
    if not evidence.candidates:
        return None
    best = min(evidence.candidates, key=lambda c: evidence.cost([c]))
    odds = log10_of(evidence.cost([]) - evidence.cost([best]))
    return Followed(trial, _explained(evidence, [best]), odds)


def _together(evidence: Evidence, chosen: list[Candidate], trials: Sequence[Trial]) -> Iterator[Followed]:
    """Yield the drivers of a set, each given those before; one in several components is one dependence."""
    of = {id(c): trial for trial in trials for c in trial.candidates}
    together, before = dict[str, list[Candidate]](), list[Candidate]()
    for c in sorted(chosen, key=lambda c: -_explained(evidence, [c])):
        together.setdefault(of[id(c)].name, []).append(c)
    alike, explained = equals(evidence, chosen), 0.0
    for parts in together.values():
        before += parts
        last, explained = explained, _explained(evidence, before)
        single = [e.candidates[0] for e in alike if e.replaced == (parts[0],) and len(e.candidates) == 1]
        names = tuple(dict.fromkeys(of[id(c)].name for c in single if of[id(c)].name not in together))
        odds = log10_of(sum(worth(evidence, chosen, c) for c in parts))
        places = tuple(_place(of[id(c)]) for c in parts)
        yield Followed(of[id(parts[0])], explained - last, odds, places, names)


def _place(trial: Trial) -> str:
    return f"along the motion of {plain(trial.joint)}" if trial.joint else in_component(trial.where)


def _explained(evidence: Evidence, chosen: Sequence[Candidate]) -> float:
    """Return which part of the variance of independent readings a set explains, beyond chance."""
    model, count = evidence.independent, sum(len(evidence.parts[id(c)]) for c in chosen)
    fall = evidence.explained(chosen, model)
    by_chance = count * (model.square - fall) / max(evidence.dof - count, 1)
    return min(max((fall - by_chance) / model.square, 0.0), 1.0)


# words ---------------------------------------------------------------------------------------------------------------


def _sentences(comparison: Comparison) -> Iterator[str]:
    fit = comparison.fit
    yield from fit.observations.on_rows
    if gross := on_gross_readings(fit):
        yield gross
    yield from contradictions(fit)
    if comparison.exact:
        rounding = "The model fits the data to rounding: there is nothing to explain."
        yield rounding if fit.degrees_of_freedom > 0 else NOTHING_LEFT
        return
    claims = comparison.claims
    yield from claims
    yield from _shared(comparison, wanders=False)
    likely = any(one.log10_odds > 0 for one in comparison.alone)  # is neither claimed nor denied
    if comparison.alone and not (likely or claims):
        yield "No dependence is seen on anything that was recorded."
    lack = fit.lack_of_fit
    if lack and lack.misses and not claims:
        yield (
            f"The residuals are {lack.ratio:.3g} times the noise all the same: what causes them may vary faster than "
            "the curves that a comparison tries, or was not recorded. A diagnosis tries more."
        )
    if not comparison.covariates:
        yield "All readings are of one pose and one target: nothing varies that the residuals could depend on."
    elif comparison.correlation is None:
        poses = len(stretches(fit.observations.pose)[0])
        yield f"{counted(poses, 'pose')}: too few, with this many parameters fitted, to show a dependence."
    elif (looked_at := len(comparison.sensitivities.rows)) < fit.rows:
        yield f"Dependences were sought in {looked_at} of {fit.rows} rows, in stretches spread over the data."


def _worst(comparison: Comparison) -> Iterator[str]:
    fit = comparison.fit
    unit = IN_UNCERTAINTIES if fit.weighted else fit.unit
    for region in comparison.worst[:1]:
        overall = float(np.sqrt(np.mean(fit.sizes[~fit.outliers] ** 2)))
        yield (
            f"The model is worst where {plain(region.text, 90)}: {sized(region.rms, unit)} there, "
            f"{sized(overall, unit)} overall."
        )


def _found(comparison: Comparison) -> Iterator[str]:
    for i, one in enumerate(comparison.found):
        start = "The residuals depend on" if i == 0 else "In addition they depend on"
        statement = f"{start} {one.trial.text}: {percent(one.explained)} of their variance"
        if one.trial.joint or (one.trial.component and len(one.places) < len(comparison.rms)):
            statement += f", {joined(one.places)}"
        yield f"{statement} ({_odds(one.log10_odds)})."
        if one.instead:
            names = [plain(name) for name in one.instead]
            yield f"These data cannot distinguish that from a dependence on {joined(names, 'or')}."


def _shared(comparison: Comparison, *, wanders: bool) -> Iterator[str]:
    """Say which errors readings share; that a set-up wanders is a claim, what the readings of a pose share is noise."""
    correlation = comparison.correlation
    if correlation and correlation.text and correlation.wanders == wanders:
        yield correlation.text


def _table(comparison: Comparison) -> list[Table]:
    best = dict[str, Followed]()
    for one in sorted(comparison.alone, key=lambda one: -one.log10_odds):
        if len(one.trial.drivers) == 1 or one.log10_odds > 0:
            best.setdefault(one.trial.name, one)
    rows = []
    for one in best.values():
        name, unit = plain(one.trial.name), one.unit
        name += f" [{plain(unit)}]" if unit and name != "order" else ""
        rows.append((name, one.trial.where, percent(one.explained), _odds(one.log10_odds)))
    part = "of the variance" + (", weighted" if comparison.fit.weighted else "")
    head = ("covariate, each alone", "component", part, "odds that it matters")
    return [Table(head, rows, "llrr")] if rows else []


def _odds(log10_odds: float) -> str:
    number = odds_text(odds_of(abs(log10_odds)))
    return f"{number} to 1" if log10_odds >= 0 else f"1 to {number}"
