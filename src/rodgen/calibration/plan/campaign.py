"""One way to continue measuring, and what readings of all positions within the travel could settle in it.

A campaign has a machine with its targets, a travel, and a time to begin. The models in question are fitted to the data,
and compared by pairs: of every pair, one is taken for true and the other for wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.positions import distinct_positions, position_of
from rodgen.calibration.plan.chosen_places import brought_to, listed_readings
from rodgen.calibration.plan.design import PARTS, Coordinates, Moves, Pair, Sharpen, Task, both_ways
from rodgen.calibration.plan.pool import READINGS, levels, readings
from rodgen.calibration.plan.rivals import Rival, Rivals
from rodgen.calibration.plan.rows import Rows, Surroundings
from rodgen.calibration.problem import Problem
from rodgen.errors import InputFileError, joined
from rodgen.statistics.thresholds import DETERMINACY, PLAN, SELECTION

if TYPE_CHECKING:
    from rodgen.calibration.plan.question import Question
    from rodgen.data.observations import Observations
    from rodgen.machines.machine import Machine
    from rodgen.machines.parts import EffectIdentity


SMALL = 0.1
"""Where readings cover less than this part of what positions within the range of those measured make of them, the
instrument reads small deviations only, and only positions that keep to these are considered."""
FINER = (8, 64)
"""By what factors more positions are looked at where constraints leave few of them."""
ENOUGH_READINGS = 200
"""Readings to choose from that are enough."""
FEWEST_STARTS = 40
"""From how many positions at least one is sought that brings the target to a place."""
MOST_READINGS = 500
"""No plan is made of more readings, and none is promised by more."""
EFFORT = 0.01
"""Cost, as a fraction of what is needed, of going where nothing was measured, of mounting a load, of a new target."""


class Campaign:
    """One way to continue measuring.

    Parameters
    ----------
    machine : Machine
        That of the question, or with a further target.
    o : Observations
        The data without outliers.
    wait : float
        For how many times the duration of the data the machine waits before; negative: it begins cold again.
    travel : ndarray, shape (J, 2), optional
        To be planned within; left out: the machine's, or that of the data.

    Attributes
    ----------
    models : list of Rival
        Those of all alternatives, and that of the parameters in question.
    titles : list of str
        Of the effect in question that each has.
    pool : Rows
        All readings that are considered.
    linearized : list of Linearized
        Each model for these readings.
    moves : Moves
        From reading to reading of the pool.
    way : ndarray, shape (J,)
        Length of each joint's travel, or the way that it goes in the time of the longest move.
    effort : ndarray
        What each costs.
    sides : tuple of int
        Joints whose direction of approach counts: those in question, and those that the data approach from one side.
    coordinates : list of Coordinates
        Of each model.
    pairs : list of Pair
    included : list of (int, int, int)
        Number of the alternatives, a model, and a larger one that can do all that it does.
    refuted : list of (int, int)
        Number of the alternatives, and a model that the data refute.
    sharpen : list of Sharpen
    unshown : set of str
        Parameters in question that no reading shows.
    out_of_reach : list of int
        Numbers, from 1, of given places that no target reaches.
    """

    def __init__(
        self,
        question: Question,
        machine: Machine,
        o: Observations,
        *,
        wait: float = 0.0,
        travel: Array | None = None,
    ) -> None:
        self.question, self.machine, self.o, self.wait = question, machine, o, wait
        effects = {e.identity: e for each in question.alternatives for e in each}
        effects |= {e.identity: e for e in question.further if e.identity not in effects}
        self.rivals = Rivals(machine, o, list(effects.values()))
        self._fit_models()
        known = self.models[0].fit.problem.model.travel if travel is None else travel
        self.travel = question.constraints.travel(machine, known)
        self.out_of_reach: list[int] = []
        self.variance = self.rivals.variance(self.models)
        if question.trusted:
            self.variance *= self._dependence()
        self._collect_readings()
        self.coordinates = [
            Coordinates(model.information / self.variance, o.n, linearized.jacobian)
            for model, linearized in zip(self.models, self.linearized, strict=True)
        ]
        self._pair_models()
        self.sharpen, self.unshown = self._parameters()

    # models --------------------------------------------------------------------------------------------------

    def _fit_models(self) -> None:
        """Fit every model; that of the parameters in question is the one with the likeliest effects."""
        question, known = self.question, self.rivals.asked
        members = [[place for e in each if (place := e.identity) in known] for each in question.alternatives]
        first = [places[0] for places in members if places]
        self.models: list[Rival] = []
        self.titles: list[str] = []
        self.groups: list[list[int]] = []
        for places in members:
            others = {p for p in first if places and p != places[0]}
            self.groups.append([self._number({*others, place}, known[place].title) for place in places])
        further = {e.identity for e in question.further} & set(known)
        self.key_model = self._number({*first, *further}, "") if question.keys else None
        self.counted = {place for places in members for place in places} | further

    def _number(self, places: set[EffectIdentity], title: str) -> int:
        """Return the number of the model with some of the effects; it is fitted where there is none yet."""
        rival = self.rivals.rival(places)
        for k, (model, name) in enumerate(zip(self.models, self.titles, strict=True)):
            if model is rival and name in ("", title):
                self.titles[k] = title or name
                return k
        self.models.append(rival)
        self.titles.append(title)
        return len(self.models) - 1

    def worse_now(self, a: int, b: int) -> float:
        """Return by how much model b fits the data worse than a, in chi-square."""
        return (self.models[b].fit.chi_square - self.models[a].fit.chi_square) / self.variance

    def threshold(self, a: int, b: int) -> float:
        """Return by how much b must fit worse than a to be refuted."""
        return SELECTION.parameter_cost(self.o.n) * max(self.models[a].own - self.models[b].own, 1)

    def _dependence(self) -> float:
        """Return by what factor the variance of a reading must be larger for the data not to refute any alternative."""
        factor = 1.0
        for numbers in self.groups:
            plausible = [k for k in numbers if self.models[k].plausible]
            for a, b in itertools.permutations(plausible, 2):
                factor = max(factor, self.worse_now(a, b) / self.threshold(a, b))
        return min(factor, PLAN.most_dependent)

    # readings ------------------------------------------------------------------------------------------------

    def _collect_readings(self) -> None:
        """Collect the readings that are considered, and linearize each model for them."""
        o, rivals, question = self.o, self.rivals, self.question
        uses = {kind: rivals.uses(kind, self.counted) for kind in "svTFt"}
        for kind in "sv":  # a joint that cannot move comes from no side
            uses[kind] = [
                j for j in uses[kind] if np.ptp(self.travel[j]) > 0 and self.machine.joints[j].is_read
            ]
        self.asks_load, self.asks_time = bool(uses["F"]), bool(uses["t"])
        targets = len(self.machine.targets)
        self.surroundings = Surroundings(o, targets, wait=self.wait, pace=question.constraints.pace)
        self.choice = levels(
            o, targets, sides=uses["s"], speeds=uses["v"], temperatures=uses["T"], load=self.asks_load
        )
        if (listed := question.constraints.poses) is not None and "load" in listed.columns_given:
            loads = np.unique(np.asarray(listed.load)).tolist()
            self.choice = replace(self.choice, loads=tuple(loads))
        pool = self._within_constraints()
        middle = None if o.t is None else self.surroundings.begin + 6 * self.surroundings.step
        found = rivals.linearized(self.models, self.surroundings.observations(pool, middle), self.variance)
        finite = np.all(
            [np.isfinite(x.jacobian).all((1, 2)) & np.isfinite(x.residual).all(1) for x in found], axis=0
        )
        self.pool, self.linearized = pool.take(finite), [x.take(finite) for x in found]
        pool = self.pool
        one_sided = np.flatnonzero(
            np.abs(o.s.sum(axis=0, dtype=int)) == o.n
        )  # as measured: a change would be one more
        self.sides = tuple(sorted({*self.choice.sides, *one_sided.tolist()}))
        same = np.concatenate([pool.q, pool.s, pool.load[:, None], pool.state[:, None]], axis=1)
        poses = np.unique(same, axis=0, return_inverse=True)[1].ravel()
        self.way = np.ptp(self.travel, axis=1)
        if (
            pace := question.constraints.pace
        ) is not None:  # as far as each joint goes in the time of the longest move
            finite = np.isfinite(pace.speed)
            longest = float(np.max(self.way[finite] / pace.speed[finite], initial=0.0)) + pace.settle
            self.way = pace.speed * (longest or 1.0)
        position = pool.q / np.where(self.way > 0, self.way, 1.0)
        self.moves = Moves(poses, position if pace is not None else None, self._parts_of_travel(pool))
        q = np.asarray(o.q)
        new = np.any((pool.q < q.min(axis=0)) | (pool.q > q.max(axis=0)), axis=1).astype(float)
        new += ~np.isin(pool.target, o.target)
        if o.load is not None:
            new += ~np.isin(pool.load, o.load)
        self.effort = EFFORT * new

    def _parts_of_travel(self, pool: Rows) -> NDArray[np.int_] | None:
        """Return in which part of their travel joints are, (n, k), of which an effect in question is a function.

        Where the data have many positions of a joint, further ones may be anywhere.
        """
        o, asked = self.o, self.rivals.asked
        names = {position_of(effect, o) for place, effect in asked.items() if place in self.counted}
        poses = len(np.unique(o.pose))
        of = [
            j
            for j, joint in enumerate(self.machine.joints)
            if joint.name in names
            and np.ptp(self.travel[j]) > 0
            and distinct_positions(np.asarray(o.q[:, j]), poses) is not None
        ]
        if not of:
            return None
        low, high = self.travel[of].T
        parts = (pool.q[:, of] - low) / (high - low) * PARTS
        return np.asarray(np.clip(parts, 0, PARTS - 1).astype(int))

    def _readings(self, travel: Array | None = None, **how: Any) -> Rows:
        """Return readings within the travel, or another one; see :func:`rodgen.calibration.plan.pool.readings`."""
        units = np.array([self.o.unit_of(joint.column)[1] for joint in self.machine.joints])
        within = self.travel if travel is None else travel
        return readings(self.machine, self.o, within, units, self.choice, **how)

    def _within_constraints(self) -> Rows:
        """Return readings that can be taken.

        Raises
        ------
        InputFileError
            When the constraints leave none; it names the first that no reading meets together with those before.
        """
        constraints = self.question.constraints
        if constraints.poses is not None:
            pool = self._listed(constraints.poses)
        elif constraints.places is not None:
            pool = self._at_places(constraints.places)
        else:
            pool = self._within_reach()
        if not constraints.regions and not constraints.boxes:
            return pool
        found, reason = self._allowed(pool)
        for finer in FINER if constraints.poses is None and constraints.places is None else ():
            if found.n >= ENOUGH_READINGS:
                break
            found, reason = self._allowed(self._readings(finer=finer))
        if not found.n:
            within = "the list of poses" if constraints.poses is not None else "the travel and the limits"
            expected = "constraints that some reading meets"
            raise InputFileError(constraints.file, reason, f"no reading within {within} meets it", expected)
        some = np.random.default_rng(0).permutation(found.n)[:READINGS]
        return found.take(np.sort(some))

    def _allowed(self, pool: Rows) -> tuple[Rows, str]:
        """Return readings within regions and outside boxes; where there are none, which condition none meets."""
        constraints, reason = self.question.constraints, ""
        met = np.ones(pool.n, bool)
        before: list[str] = []
        for text, mask in constraints.allowed(self.machine, pool.q, self.places(pool)):
            before.append(text)
            if not mask.any():
                reason = text
            elif met.any() and not (met & mask).any():
                reason = joined(before)
            met &= mask
        return pool.take(met), reason

    def _listed(self, poses: Observations) -> Rows:
        """Return readings in listed poses that are within the travel."""
        low, high = self.travel.T
        q = poses.q[np.all((poses.q >= low) & (poses.q <= high), axis=1)]
        pool = listed_readings(self._readings(among=q), poses) if len(q) else None
        if pool is None or not pool.n:
            raise InputFileError(
                poses.data.file, "file", "no pose within the travel and the limits", "one at least"
            )
        return pool

    def _at_places(self, places: Array) -> Rows:
        """Return readings whose target is brought to one of some places, by small moves from readings elsewhere."""
        random = np.random.default_rng(0)
        starts = self._readings()
        starts = starts.take(random.permutation(starts.n)[: max(READINGS // len(places), FEWEST_STARTS)])
        found = [brought_to(starts, place, self.travel, self.places) for place in places]
        pool = Rows.joined(found)
        pool = replace(pool, q=self.machine.followed(pool.q))
        self.out_of_reach = [k for k, rows in enumerate(found, 1) if not rows.n]
        if not pool.n:
            expected = "a ball that some target reaches within the travel and the limits"
            raise InputFileError(
                self.question.constraints.file, "[artefact], balls", "out of reach", expected
            )
        return pool

    def places(self, pool: Rows) -> Array:
        """Return where the target is, or the direction, in machine axes, (n, 3)."""
        seen = self.surroundings.observations(pool, None if self.o.t is None else self.surroundings.begin)
        return self.models[0].fit.places(seen)

    def _within_reach(self) -> Rows:
        """Return readings without those beyond an instrument for deviations only: a probe on a ball, a ball bar."""
        pool = self._readings()
        if not self.machine.measurand.moving:
            return pool
        low, high = self.o.reading.min(axis=0), self.o.reading.max(axis=0)
        measured = np.stack([self.o.q.min(axis=0), self.o.q.max(axis=0)], axis=1)
        near = self._readings(measured)
        usual = np.linalg.norm(np.nanstd(self._predicted(near), axis=0)) if near.n > 1 else 0.0
        if not np.linalg.norm(high - low) < SMALL * usual:
            return pool
        room = 0.5 * (high - low)
        pool = self._readings(among=self.o.q)
        predicted = self._predicted(pool)
        inside = np.all((predicted > low - room) & (predicted < high + room), axis=1)
        return pool.take(inside) if inside.sum() > 1 else pool

    def _predicted(self, pool: Rows) -> Array:
        """Return what the first model predicts for readings, (n, m)."""
        fit = self.models[0].fit
        seen = self.surroundings.observations(pool, None if self.o.t is None else self.surroundings.begin)
        return Problem(fit.problem.model, seen).predicted(fit.solution.theta, fit.solution.frame)

    # what could be settled -----------------------------------------------------------------------------------

    def _pair_models(self) -> None:
        pairs: list[Pair] = []
        self.included: list[tuple[int, int, int]] = []
        self.refuted: list[tuple[int, int]] = []
        for group, numbers in enumerate(self.groups):
            plausible = [a for a in numbers if self.models[a].plausible]
            left = [
                a
                for a in plausible
                if not any(self.worse_now(a, b) < -self.threshold(b, a) for b in plausible)
            ]
            self.refuted += [(group, a) for a in numbers if a not in left]
            weights = self._weights(left)
            for a, b in itertools.permutations(left, 2):
                pair = self._pair(group, a, b)
                if pair is None:
                    self.included.append((group, a, b))
                else:
                    pairs.append(replace(pair, weight=weights[a]))
        self.pairs = both_ways(pairs)

    def _weights(self, models: Sequence[int]) -> dict[int, float]:
        """Return how much each model counts: all the same that are not improbable.

        How probable they are is said by the data (weights of Akaike) and by what is known before them.
        """
        rivals, variance = [self.models[a] for a in models], self.variance
        cost = [m.fit.chi_square / variance + 2 * m.fit.determinacy.rank + m.prior_cost for m in rivals]
        likelihood = np.exp(-(np.array(cost) - min(cost, default=0.0)) / 2)
        counts = likelihood > PLAN.unlikely * likelihood.sum()
        return dict(zip(models, (counts / max(counts.sum(), 1)).tolist(), strict=True))

    def _pair(self, group: int, a: int, b: int) -> Pair | None:
        """Return the pair of a true model and a wrong one; None where the wrong one is larger and includes the true."""
        true, wrong = self.models[a], self.models[b]
        now, threshold = self.worse_now(a, b), self.threshold(a, b)
        root = PLAN.margin + np.sqrt(PLAN.margin**2 + threshold + PLAN.margin)
        pair = Pair(a, b, now, float(root**2), threshold, group)
        considered = len(self.pool.q)
        alone = Task(self.coordinates, [pair], [])
        gain = float(alone.gains(self.linearized)[0][0]) * max(1.0, MOST_READINGS / considered)
        imitated = gain < PLAN.imitated * max(considered, MOST_READINGS)
        possible = now + gain >= pair.needed
        if (imitated or not possible) and wrong.own > true.own:
            return None
        same = not possible and true.own == wrong.own and self._may_be_the_same(pair)
        return replace(pair, possible=bool(possible), tiny=not imitated and not same)

    def _may_be_the_same(self, pair: Pair) -> bool:
        """Return whether the wrong model imitates a true one that the data allow as well as the one that was fitted.

        Two effects may differ in a part that neither of them is known to have.
        """
        true, wrong = self.coordinates[pair.true], self.coordinates[pair.wrong]
        of_a = true.derivative(self.linearized[pair.true])
        of_b = wrong.derivative(self.linearized[pair.wrong])
        d = pair.difference(self.linearized).reshape(-1, 1)
        both = np.concatenate([of_a, d], axis=1)
        cross = of_b.T @ both
        rise = both.T @ both - cross.T @ np.linalg.solve(wrong.prior + of_b.T @ of_b, cross)
        for weight in np.logspace(-6, 6, 25) * np.trace(rise[:-1, :-1]) / max(np.trace(true.prior), 1e-300):
            x = np.append(np.linalg.solve(rise[:-1, :-1] + weight * true.prior, rise[:-1, -1]), -1.0)
            unlikely = x[:-1] @ true.prior @ x[:-1]
            if unlikely <= PLAN.likely and x @ rise @ x < PLAN.imitated * len(self.pool.q):
                return True
        return False

    def _parameters(self) -> tuple[list[Sharpen], set[str]]:
        """Return the parameters to sharpen, and those in question that no reading shows."""
        if self.key_model is None:
            return [], set()
        model, unseen = self.models[self.key_model], self.coordinates[self.key_model].unseen
        numbers = {model.fit.parameters[i].key: k for k, i in enumerate(model.index)}
        rests = np.abs(unseen).max(axis=1, initial=0.0) > DETERMINACY.rests
        changing = np.any(self.coordinates[self.key_model].root, axis=1)
        keys = self.question.keys
        shown = [key for key in keys if key in numbers and not rests[numbers[key]]]
        if not shown and self.question.by_default:  # the model as a whole, in these coordinates
            some = [key for key in keys if key in numbers and changing[numbers[key]]]
        else:
            some = shown
        return [Sharpen(self.key_model, numbers[key], key) for key in some], set(keys) - set(shown)
