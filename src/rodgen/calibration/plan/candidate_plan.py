"""One way to go on measuring: with some targets, at once or from cold; what it brings for every goal."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.plan.design import SWEEPS, Coordinates, Pair, Sharpen, Task, chosen
from rodgen.calibration.plan.order import ordered, wrong_sides
from rodgen.calibration.plan.pool import Levels, levels, readings
from rodgen.calibration.plan.rivals import Rival, Rivals
from rodgen.calibration.plan.rows import Rows, Surroundings
from rodgen.calibration.plan.words import joint_unit
from rodgen.calibration.problem import Problem

if TYPE_CHECKING:
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Effect, Machine

__all__ = ["MOST_TRIED", "Attempt", "Class", "Question", "attempt"]

Array: TypeAlias = NDArray[np.float64]

APART = 12.0
"""Effects are told apart when one fits worse by this and ln(rows), in chi-square, for each parameter saved."""
DOUBT = 0.035
"""Probability that a plan is allowed to leave the true effect beside a wrong one."""
MARGIN = 2.0
"""Quantile of the normal distribution that goes with it, for two or three wrong ones."""
IMITATED = 1e-3
"""A model does the same as another one whose readings it meets within a thirtieth of the noise (here squared)."""
LIKELY = 9.0
"""... with parameters that the data leave open: those within three standard deviations of what was fitted."""
FEWEST = 2
"""Readings that are planned at least: one alone could not be doubted."""
RESTS = 0.005
"""A parameter with a greater part in a combination that nothing shows rests on it."""
OPEN = 1e-3
"""A parameter is hardly determined whose standard deviation would be below this part if the others were known."""
SMALL = 0.1
"""Where readings cover less than this part of what positions within the travel make of them, the instrument reads small
deviations only, and positions count that keep to these."""
SIZES = (3, 6, 12, 24, 48, 100, 200)
"""Sizes of plans that are tried one after the other, and then those between."""
IDLE = 0.01
"""More readings that raise the probability by less are not worth while."""
EXCHANGES = 60
"""So many readings are exchanged in a large plan before it counts as good."""
FAR, MANY = 5, (60, 120)
"""How many readings would be enough is told from a plan with so many times more, within these limits."""
MOST_DEPENDENT = 30.0
"""Dependent readings raise the variance of a mean so much at most; beyond, a fit went elsewhere."""
MOST_TRIED = 500
"""Readings beyond which nobody counts."""
EFFORT = 0.01
"""What it costs, in parts of what is needed, to go where nothing was measured, to mount a load, to see a new target."""


@dataclass(frozen=True)
class Class:
    """Effects of which one is there."""

    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class Question:
    """What is to be settled.

    Attributes
    ----------
    machine : Machine
        Without the effects in question.
    classes : tuple of Class
    keys : tuple of str
        Parameters that are to be sharpened.
    further : tuple of Effect
        Effects that have some of them.
    kind : str
        Of the goal for the parameters.
    of_all : bool
        Whether nobody asked for these parameters.
    trusted : bool
        Whether a diagnosis, which knows how readings depend on each other, says that the effects of a class cannot be
        told apart: where they differ by more in independent readings, these are not.
    notes : list of str
    """

    machine: Machine
    classes: tuple[Class, ...]
    keys: tuple[str, ...]
    further: tuple[Effect, ...]
    kind: str
    of_all: bool = False
    trusted: bool = False
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class PairGain:
    """What the plan brings for one pair.

    Attributes
    ----------
    of : int
        Number of the class.
    pair : Pair
    threshold : float
        Chi-square from which they count as told apart.
    after : float
        Expected chi-square.
    probability : float
    possible : bool
        Whether all readings considered together would do.
    tiny : bool
        Where not: whether the two differ, but by less than the noise.
    sure : float
        The probability that is asked for; none, where the class as a whole is settled well enough.
    """

    of: int
    pair: Pair
    threshold: float
    after: float
    probability: float
    possible: bool
    tiny: bool
    sure: float

    @property
    def reached(self) -> bool:
        """Whether it is likely enough."""
        return self.possible and self.probability >= self.sure


@dataclass(frozen=True)
class KeyGain:
    """What the plan brings for one parameter; standard deviations in its own unit."""

    key: str
    unit: str
    now: float | None
    after: float | None
    gauge: bool


@dataclass(frozen=True, eq=False)
class Attempt:
    """A plan, as yet without words."""

    machine: Machine
    rivals: Rivals
    models: list[Rival]
    surroundings: Surroundings
    choice: Levels
    travel: Array
    rows: Rows
    pairs: list[PairGain]
    keys: list[KeyGain]
    needed: int | None
    wrong: int
    included: list[tuple[int, int, int]]
    refuted: list[tuple[int, int]]
    asks_load: bool
    asks_time: bool
    wait: float

    @property
    def reached(self) -> bool:
        """Whether every pair is."""
        return all(pair.reached for pair in self.pairs)

    @property
    def reached_so_far(self) -> bool:
        """Whether every pair is that readings like these can tell apart."""
        return all(pair.reached for pair in self.pairs if pair.possible)

    @property
    def settled(self) -> bool:
        """Whether some pair is reached, and every one that differs at all."""
        return any(p.reached for p in self.pairs) and all(
            p.reached for p in self.pairs if p.tiny or p.possible
        )

    @property
    def worth(self) -> float:
        """How many pairs are told apart, and the least gain of the others, in parts of what is needed."""
        rest = [p.after / p.pair.needed for p in self.pairs if not p.reached]
        return len(self.pairs) - len(rest) + min([1.0, *(max(x, 0.0) for x in rest)])

    def title(self, k: int) -> str:
        """Return the title of the effect in question that a model has."""
        return self._titles[k]

    @property
    def _titles(self) -> dict[int, str]:
        return dict(enumerate(m.title for m in self.models))


def attempt(
    question: Question,
    machine: Machine,
    o: Observations,
    n: int,
    *,
    wait: float = 0.0,
    travel: Array | None = None,
    quick: bool = False,
) -> Attempt:
    """Plan n readings, or fewer where they are enough.

    Parameters
    ----------
    question : Question
    machine : Machine
        That of the question, or with a further target.
    o : Observations
        The data without outliers.
    n : int
    wait : float
        For how many times the duration of the data the machine waits before; negative: it begins anew.
    travel : ndarray, shape (J, 2), optional
        To be planned within; left out: the machine's, or that of the data.
    quick : bool
        Do not say how many readings would be enough.
    """
    return _Planning(question, machine, o, wait, travel).planned(n, quick=quick)


class _Planning:
    def __init__(
        self, question: Question, machine: Machine, o: Observations, wait: float, travel: Array | None
    ) -> None:
        self.question, self.machine, self.o, self.wait = question, machine, o, wait
        effects = {(e.name, e.place): e for c in question.classes for e in c.effects}
        effects |= {(e.name, e.place): e for e in question.further if (e.name, e.place) not in effects}
        self.rivals = Rivals(machine, o, list(effects.values()))
        self.asked = {(e.name, e.place) for c in question.classes for e in c.effects} & set(self.rivals.asked)
        self.further = {(e.name, e.place) for e in question.further} & set(self.rivals.asked)
        self._models()
        self.travel = self.models[0].fit.problem.model.travel if travel is None else travel
        self.variance = self.rivals.variance(self.models)
        if question.trusted:
            self.variance *= self._dependence()
        self._pool()
        self._task()

    # models --------------------------------------------------------------------------------------------------

    def _models(self) -> None:
        """Fit every model; that of the parameters in question is the one with the likeliest effects."""
        members = [
            [place for e in c.effects if (place := (e.name, e.place)) in self.rivals.asked]
            for c in self.question.classes
        ]
        first = [places[0] for places in members if places]
        self.models: list[Rival] = []
        self.titles: list[str] = []
        self.of_class: list[list[int]] = []
        for places in members:
            numbers = []
            for place in places:
                others = {p for p in first if places and p != places[0]}
                title = next(e.title for e in self.rivals.asked.values() if (e.name, e.place) == place)
                numbers.append(self._number({*others, place}, title))
            self.of_class.append(numbers)
        self.key_model = self._number({*first, *self.further}, "") if self.question.keys else None

    def _number(self, places: set[tuple[str, str | None]], title: str) -> int:
        rival = self.rivals.rival(places)
        for k, (model, name) in enumerate(zip(self.models, self.titles, strict=True)):
            if model is rival and name in ("", title):
                self.titles[k] = title or name
                return k
        self.models.append(rival)
        self.titles.append(title)
        return len(self.models) - 1

    def _dependence(self) -> float:
        """Return by what factor the variance of a reading must be larger for the classes to be such."""
        factor = 1.0
        for numbers in self.of_class:
            sane = [k for k in numbers if self.models[k].plausible]
            for a, b in itertools.permutations(sane, 2):
                factor = max(factor, self._now(a, b) / self._threshold(a, b))
        return min(factor, MOST_DEPENDENT)

    # readings ------------------------------------------------------------------------------------------------

    def _pool(self) -> None:
        o, rivals = self.o, self.rivals
        counted = self.asked | self.further
        uses = {kind: rivals.uses(kind, counted) for kind in "svT"}
        self.asks_load = bool(rivals.uses("F", counted))
        self.asks_time = bool(rivals.uses("t", counted))
        self.surroundings = Surroundings(o, len(self.machine.targets), wait=self.wait)
        self.choice = levels(
            o,
            len(self.machine.targets),
            sides=uses["s"],
            speeds=uses["v"],
            temperatures=uses["T"],
            load=self.asks_load,
        )
        units = np.array([joint_unit(o, j)[1] for j in range(len(self.machine.joints))])
        self.pool = readings(self.machine, o, self.travel, units, self.choice)
        self.pool = self._within_reach(self.pool, units)
        middle = None if o.t is None else self.surroundings.begin + 6 * self.surroundings.step
        seen = self.surroundings.observations(self.pool, middle)
        self.columns = rivals.columns(self.models, seen, self.variance)
        finite = np.all(
            [np.isfinite(c.jacobian).all((1, 2)) & np.isfinite(c.residual).all(1) for c in self.columns],
            axis=0,
        )
        if not finite.all():
            self.pool = self.pool.take(finite)
            self.columns = [type(c)(c.residual[finite], c.jacobian[finite]) for c in self.columns]
        same = np.concatenate(
            [self.pool.q, self.pool.s, self.pool.load[:, None], self.pool.state[:, None]], axis=1
        )
        self.groups = np.unique(same, axis=0, return_inverse=True)[1].ravel()
        pool, q = self.pool, np.asarray(o.q)
        new = np.any((pool.q < q.min(axis=0)) | (pool.q > q.max(axis=0)), axis=1).astype(float)
        new += ~np.isin(pool.target, o.target)
        if o.load is not None:
            new += ~np.isin(pool.load, o.load)
        self.effort = EFFORT * new

    def _within_reach(self, pool: Rows, units: Array) -> Rows:
        """Leave out readings beyond an instrument that measures deviations only: a probe on a ball, a ball bar."""
        if not self.machine.measurand.moving:
            return pool
        fit = self.models[0].fit
        seen = self.surroundings.observations(pool, None if self.o.t is None else self.surroundings.begin)
        at = fit.solution.theta, fit.solution.frame
        predicted = seen.reading - Problem(fit.problem.model, seen).residuals(*at)
        low, high = self.o.reading.min(axis=0), self.o.reading.max(axis=0)
        small = np.linalg.norm(high - low) < SMALL * np.linalg.norm(np.nanstd(predicted, axis=0))
        if not small:
            return pool
        room = 0.5 * (high - low)
        pool = readings(self.machine, self.o, self.travel, units, self.choice, again=True)
        seen = self.surroundings.observations(pool, None if self.o.t is None else self.surroundings.begin)
        predicted = seen.reading - Problem(fit.problem.model, seen).residuals(*at)
        inside = np.all((predicted > low - room) & (predicted < high + room), axis=1)
        return pool.take(inside) if inside.sum() > 1 else pool

    # goals ---------------------------------------------------------------------------------------------------

    def _task(self) -> None:
        rows = self.o.n
        self.coordinates = [
            Coordinates(m.information / self.variance, rows, c.jacobian)
            for m, c in zip(self.models, self.columns, strict=True)
        ]
        self.pairs: list[tuple[int, Pair, float, bool, bool]] = []
        self.included: list[tuple[int, int, int]] = []  # class, model, larger model that includes it
        self.refuted: list[tuple[int, int]] = []
        for k, numbers in enumerate(self.of_class):
            sane = [a for a in numbers if self.models[a].plausible]
            left = [a for a in sane if not any(self._now(a, b) < -self._threshold(b, a) for b in sane)]
            self.refuted += [(k, a) for a in numbers if a not in left]
            for a, b in itertools.permutations(left, 2):
                self._pair(k, a, b)
        self.sharpen, self.lost = self._sharpened()
        self._agreed()

    def _agreed(self) -> None:
        """Make a task of the pairs that can be told apart both ways."""
        hopeless = {frozenset((p.true, p.wrong)) for _, p, _, possible, _ in self.pairs if not possible}
        self.pairs = [
            (k, p, threshold, frozenset((p.true, p.wrong)) not in hopeless, tiny)
            for k, p, threshold, _, tiny in self.pairs
        ]
        pairs = [pair for _, pair, _, possible, _ in self.pairs if possible]
        self.task = Task(self.coordinates, pairs, self.sharpen)

    def _now(self, a: int, b: int) -> float:
        """Return by how much model b fits the data worse than a."""
        return (self.models[b].fit.chi_square - self.models[a].fit.chi_square) / self.variance

    def _threshold(self, a: int, b: int) -> float:
        """Return by how much b must fit worse than a to be refuted."""
        return float(APART + np.log(self.o.n)) * max(self.models[a].own - self.models[b].own, 1)

    def _pair(self, k: int, a: int, b: int) -> None:
        """Look at a pair: nothing, where the wrong model includes the true one and is larger."""
        true, wrong = self.models[a], self.models[b]
        now, threshold = self._now(a, b), self._threshold(a, b)
        root = MARGIN + np.sqrt(MARGIN**2 + threshold + MARGIN)
        pair = Pair(a, b, now, float(root**2))
        alone = Task(self.coordinates, [pair], [])
        gain = float(alone.gains(self.columns)[0][0]) * max(1.0, MOST_TRIED / len(self.pool.q))
        imitated = gain < IMITATED * max(len(self.pool.q), MOST_TRIED)
        if imitated and wrong.own > true.own:
            self.included.append((k, a, b))
            return
        possible = now + gain >= pair.needed
        same = not possible and true.own == wrong.own and self._as_likely_the_same(pair)
        tiny = not imitated and not same
        self.pairs.append((k, pair, threshold, bool(possible), tiny))

    def _as_likely_the_same(self, pair: Pair) -> bool:
        """Whether the wrong model imitates a true one that the data may mean as well as the one that was fitted.

        Two effects may differ in a part that none of them is known to have.
        """
        true = self.coordinates[pair.true]
        wrong, a, b = self.coordinates[pair.wrong], self.columns[pair.true], self.columns[pair.wrong]
        d = (b.residual - a.residual).reshape(-1, 1)
        of_a, of_b = (
            x.jacobian.reshape(-1, x.jacobian.shape[-1]) @ c.root for x, c in ((a, true), (b, wrong))
        )
        both = np.concatenate([of_a, d], axis=1)
        cross = of_b.T @ both
        rise = both.T @ both - cross.T @ np.linalg.solve(wrong.prior + of_b.T @ of_b, cross)
        for weight in np.logspace(-6, 6, 25) * np.trace(rise[:-1, :-1]) / max(np.trace(true.prior), 1e-300):
            x = np.append(np.linalg.solve(rise[:-1, :-1] + weight * true.prior, rise[:-1, -1]), -1.0)
            unlikely = x[:-1] @ true.prior @ x[:-1]
            if unlikely <= LIKELY and x @ rise @ x < IMITATED * len(self.pool.q):
                return True
        return False

    def _sharpened(self) -> tuple[list[Sharpen], set[str]]:
        """Return the parameters to sharpen, and those that nothing shows."""
        if self.key_model is None:
            return [], set()
        model, unseen = self.models[self.key_model], self.coordinates[self.key_model].unseen
        keys = {model.fit.parameters[i].key: k for k, i in enumerate(model.index)}
        found, lost = [], set()
        for key in self.question.keys:
            if key not in keys:
                lost.add(key)
                continue
            if unseen.shape[1] and np.abs(unseen[keys[key]]).max() > RESTS:
                lost.add(key)
            found.append(Sharpen(self.key_model, keys[key], key))
        return found, lost

    # plans ---------------------------------------------------------------------------------------------------

    def planned(self, n: int, *, quick: bool) -> Attempt:
        """Return a plan of n readings at most; a quick one does not say how many more would be enough."""
        rows, needed = self._ordered([0]), None
        while self.task.pairs or self.task.sharpen:
            rows, needed = self._least(n), None
            if not self.task.pairs or quick or self._all_reached(rows):
                break
            more = self._many(n)
            needed = self._enough(more)
            if needed is not None or not self._given_up(more):
                break
        return self._told(rows, needed)

    def _chosen(self, n: int) -> Rows:
        count = min(n, len(self.pool.q))
        sweeps = max(1, min(SWEEPS, EXCHANGES // max(count, 1)))
        picked = chosen(self.task, self.columns, self.groups, self.effort, count, sweeps=sweeps)
        return self._ordered(picked)

    def _least(self, n: int) -> Rows:
        """Return the fewest readings that are enough, or n."""
        if self.task.sharpen or not self.task.pairs:
            return self._chosen(n)
        failed, found = FEWEST - 1, []
        for size in (*(x for x in SIZES if x < n), n):
            rows = self._chosen(size)
            missing = self._missing(rows)
            found.append((missing, rows))
            if missing <= 0:
                break
            failed = size
        else:
            return next(rows for missing, rows in found if missing <= found[-1][0] + IDLE)
        while size - failed > 1:
            middle = (size + failed) // 2
            fewer = self._chosen(middle)
            if self._all_reached(fewer):
                size, rows = middle, fewer
            else:
                failed = middle
        return rows

    def _many(self, n: int) -> Rows:
        """Return so many readings that more of them would be the same once more."""
        count = min(max(FAR * n, MANY[0]), MANY[1], len(self.pool.q))
        return self._ordered(chosen(self.task, self.columns, self.groups, self.effort, count, sweeps=0))

    def _given_up(self, rows: Rows) -> bool:
        """Take no count of pairs that readings like these never tell apart, and say whether there were such."""
        after = self._gains(rows, self.task, MOST_TRIED / rows.n)
        bad = {p for p, x in zip(self.task.pairs, after, strict=True) if x < p.needed}
        self.pairs = [
            (k, p, threshold, possible and p not in bad, tiny)
            for k, p, threshold, possible, tiny in self.pairs
        ]
        self._agreed()
        return bool(bad)

    def _ordered(self, picked: Sequence[int]) -> Rows:
        span = np.ptp(self.travel, axis=1)
        rows = ordered(self.pool.take(np.array(picked)), self.choice.sides, span, np.asarray(self.o.q[-1]))
        return self._as_moved(rows)

    def _as_moved(self, rows: Rows) -> Rows:
        made = rows.as_moved()
        stated = [f"dir_{joint.name}" in self.o.columns_given for joint in self.machine.joints]
        s = np.where(stated, rows.s, made.s).astype(np.int8)
        return Rows(made.q, s, np.abs(made.v) * s, made.target, made.load, made.state)

    def _gains(self, rows: Rows, task: Task, times: float = 1.0) -> Array:
        """Return the chi-squares that readings in their order bring, each taken so many times."""
        seen = self.surroundings.observations(rows)
        columns = self.rivals.columns(self.models, seen, self.variance / times)
        return np.array([p.now for p in task.pairs]) + task.gains(columns)[0]

    def _probability(self, rows: Rows, task: Task, thresholds: Array) -> tuple[Array, Array, Array]:
        """Return chi-squares, the probabilities that they pass thresholds, and variances."""
        seen = self.surroundings.observations(rows)
        columns = self.rivals.columns(self.models, seen, self.variance)
        gains, variances = task.gains(columns)
        now = np.array([p.now for p in task.pairs])
        chances = [task.probability(p, columns, t) for p, t in zip(task.pairs, thresholds, strict=True)]
        return now + gains, np.array(chances), variances

    @property
    def _thresholds(self) -> Array:
        return np.array([threshold for _, _, threshold, possible, _ in self.pairs if possible])

    def _all_reached(self, rows: Rows) -> bool:
        return self._missing(rows) <= 0

    def _missing(self, rows: Rows) -> float:
        """Return by how much it is too likely that a true effect is left beside a wrong one."""
        solvable = [(k, pair) for k, pair, _, possible, _ in self.pairs if possible]
        _, chances, _ = self._probability(rows, self.task, self._thresholds)
        return max(_doubts(solvable, chances).values(), default=0.0) - DOUBT

    def _sure(self, k: int) -> float:
        """Return the probability that is planned for, so that all wrong effects of a class fail at once."""
        return 1 - DOUBT / max(len(self.of_class[k]) - 1, 1)

    def _enough(self, rows: Rows) -> int | None:
        """Return how many readings would be enough, if each of these were taken several times."""
        needed = np.array([p.needed for p in self.task.pairs])

        def enough(times: float) -> bool:
            return bool(np.all(self._gains(rows, self.task, times) >= needed))

        low, high = 1.0, 1.0
        while not enough(high):
            low, high = high, 2 * high
            if high * rows.n > MOST_TRIED:
                return None
        while high / low > 1.1:
            middle = math.sqrt(low * high)
            low, high = (low, middle) if enough(middle) else (middle, high)
        return math.ceil(high * rows.n)

    def _told(self, rows: Rows, needed: int | None) -> Attempt:
        task = Task(self.coordinates, [p[1] for p in self.pairs], self.sharpen)
        thresholds = np.array([p[2] for p in self.pairs])
        after, probability, variances = self._probability(rows, task, thresholds)
        solvable = [(k, p, x) for (k, p, _, yes, _), x in zip(self.pairs, probability, strict=True) if yes]
        doubts = _doubts([(k, p) for k, p, _ in solvable], np.array([x for _, _, x in solvable]))
        settled = {k for k, doubt in doubts.items() if doubt <= DOUBT}
        pairs = [
            PairGain(
                k,
                pair,
                threshold,
                float(x),
                float(chance),
                possible,
                tiny,
                0.0 if k in settled else self._sure(k),
            )
            for (k, pair, threshold, possible, tiny), x, chance in zip(
                self.pairs, after, probability, strict=True
            )
        ]
        for k, title in enumerate(self.titles):
            model = self.models[k]
            if title != model.title:
                self.models[k] = Rival(title, model.fit, model.own)
        return Attempt(
            machine=self.machine,
            rivals=self.rivals,
            models=self.models,
            surroundings=self.surroundings,
            choice=self.choice,
            travel=self.travel,
            rows=rows,
            pairs=pairs,
            keys=self._keys(variances),
            needed=needed,
            included=self.included,
            refuted=self.refuted,
            wrong=len(wrong_sides(rows, self.choice.sides)),
            asks_load=self.asks_load,
            asks_time=self.asks_time,
            wait=self.wait,
        )

    def _keys(self, variances: Array) -> list[KeyGain]:
        if self.key_model is None:
            return []
        model, c = self.models[self.key_model], self.coordinates[self.key_model]
        parameters = {p.key: p for p in model.fit.parameters}
        prior = np.linalg.inv(c.prior)
        jacobian = self.columns[self.key_model].jacobian
        # the most that readings here can tell: of each parameter, when only it is unknown
        usual = np.einsum("nmp,nmp->p", jacobian, jacobian) / len(jacobian)
        rows = self.o.n + 12
        found = [KeyGain(key, "", None, None, True) for key in self.question.keys if key in self.lost]
        for s, variance in zip(self.sharpen, variances, strict=True):
            if s.key in self.lost:
                continue
            w = c.root[s.parameter]
            factor, unit = parameters[s.key].factor, parameters[s.key].unit
            now = float(w @ prior @ w)
            alone = max(usual[s.parameter] * rows, 1e-300)

            def shown(variance: float, alone: float = alone, factor: float = factor) -> float | None:
                return float(np.sqrt(variance)) / factor if variance * alone < OPEN**-2 else None

            found.append(KeyGain(s.key, unit, shown(now), shown(float(variance)), False))
        order = {key: k for k, key in enumerate(self.question.keys)}
        return sorted(found, key=lambda k: order[k.key])


def _doubts(pairs: Sequence[tuple[int, Pair]], chances: Array) -> dict[int, float]:
    """Return, for each class, how likely the true effect is left beside a wrong one, any of them being the true one."""
    missed: dict[int, dict[int, float]] = {}
    for (k, pair), chance in zip(pairs, chances, strict=True):
        of_class = missed.setdefault(k, {})
        of_class[pair.true] = of_class.get(pair.true, 0.0) + 1.0 - float(chance)
    return {k: float(np.mean(list(each.values()))) for k, each in missed.items()}
