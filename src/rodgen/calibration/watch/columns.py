"""What new readings of a fitted machine say: residuals, and their derivatives by everything that may change."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rodgen.array_types import Array, Mask
from rodgen.calibration.candidates import Candidate, possible, unsearched
from rodgen.calibration.dependence import INDEPENDENT, estimate_correlation, frame_motion, shared_motion
from rodgen.calibration.evidence import ROUNDING, Columns, Evidence, Space
from rodgen.calibration.fitted import Fit
from rodgen.calibration.possible_effects import bare_effects, catalogue_effects, model_with
from rodgen.calibration.predict import in_known_runs
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.sensitivities import Sensitivities, is_direct
from rodgen.data.measurements import Measurements
from rodgen.data.units import unit_factor
from rodgen.errors import InputFileError, UnexpectedError, in_file
from rodgen.machines.effects.definition import EffectDefinition
from rodgen.machines.effects.formula import Formula
from rodgen.machines.machine import Effect
from rodgen.machines.observations import Observations
from rodgen.statistics.change_detector import StreamWhitener
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import SMALLEST_P
from rodgen.statistics.whitening import SHORTEST

BEYOND = 0.1
"""Part of the range that the reference covers, of a coordinate say, beyond which the model may be wrong."""

ROUND = 1.9 * math.pi
"""Range of a joint that goes round, where no angle is beyond it."""
SMALLEST = 1e-9


@dataclass(frozen=True, eq=False)
class Alternative:
    """Something that may change: parameters of the model, or an effect of the catalogue that the model lacks.

    Attributes
    ----------
    candidate : Candidate
        As the evidence weighs it; its columns are those of the reference.
    columns : tuple of int
        Numbers of its columns.
    units : tuple of str
        Of its parameters, ...
    factors : tuple of float
        ... and the internal value of one unit.
    adjusted : bool
        Whether it is of parameters that the model has.
    """

    candidate: Candidate
    columns: tuple[int, ...]
    units: tuple[str, ...]
    factors: tuple[float, ...]
    adjusted: bool = False

    @property
    def title(self) -> str:
        """An effect and its place, or what parameters of the model belong to."""
        return self.candidate.effect.title


class WatchedColumns:
    """The columns of new readings, in the same order as those of the readings of a fit.

    Parameters
    ----------
    fit : Fit
        The reference.

    Attributes
    ----------
    rows : ndarray, shape (n, m, d + 1)
        Of the reference: derivatives of what weighted readings would be, and what they are more than the fit predicts;
        without what readings share.
    correlation : Correlation
    free : int
        The first so many columns are of what the fit adjusted.
    alternatives : list of Alternative
    rules : list of SetAside
        What the machine file sets aside by rule or run; rows by their numbers are those of the reference.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        self.rules = [entry for entry in fit.machine.measured.set_aside if not entry.rows]
        self._machine = replace(fit.machine, measured=replace(fit.machine.measured, set_aside=()))
        effects = [
            effect
            for effect in catalogue_effects(fit.machine, fit.observations)
            if not effect.definition.follows_time
        ]
        sensitivities = self._sensitivities = Sensitivities.of(fit, effects)
        known = possible(sensitivities, effects)
        candidates = [
            replace(candidate, prior=known[effect.identity])
            for effect in effects
            if effect.identity in known and (candidate := unsearched(sensitivities, effect)) is not None
        ]
        self._effects = [candidate.effect for candidate in candidates]
        extra = [*(e for e in effects if is_direct(e)), *bare_effects(fit.machine)]
        self._model, self._theta = model_with(fit, extra, compiled=True)
        self.rows = self._stacked(sensitivities, candidates)
        self.correlation = estimate_correlation(sensitivities, [c.columns for c in candidates])
        self._motion(sensitivities)
        self.free = len(fit.moving)
        self.alternatives = [*self._adjusted(), *self._lacking(candidates)]
        round_about = {joint.column for joint in fit.machine.joints if joint.revolute}
        self._covered = {
            name: (x.min(), x.max())
            for name, x in self._conditions(fit.observations)
            if not (name in round_about and np.ptp(x) > ROUND)
        }

    def _motion(self, sensitivities: Sensitivities) -> None:
        """Whiten the reference row by row, in the order of time, as new readings will be."""
        o, deviations, self._scale = sensitivities.observations, self.correlation.cautious, np.zeros(0)
        self._middle = sensitivities.middle if deviations is not None else None
        self._spacing = self.duration = math.inf
        self._timed = False
        if deviations is None:
            return
        motion, _ = shared_motion(sensitivities)
        ours, frame = (np.sum(x**2, axis=(0, 1)) for x in (motion.columns, sensitivities.frame))
        scale = np.sqrt(np.divide(ours, frame, out=np.zeros_like(frame), where=frame > 0))
        self._scale, self._spacing, self.duration = scale, motion.poses.spacing, motion.poses.duration
        self._timed = motion.poses.timed
        time = o.t if self._timed and o.t is not None else np.arange(o.n)
        order = np.lexsort((np.arange(o.n), time, o.run))
        white = self.whitener()
        assert white is not None
        nothing = np.zeros(self.rows.shape[2] - 1)
        self.rows = white(self.rows[order], motion.columns[order], self.gaps(o.take(order)), nothing)

    def whitener(self) -> StreamWhitener | None:
        """Return what whitens readings from the first new one on; None where they are independent."""
        deviations = self.correlation.cautious
        if deviations is None:
            return None
        return StreamWhitener(deviations, self.rows.shape[2], self.correlation.white)

    def gaps(self, o: Observations) -> Array:
        """Return the time since the row before, (n,): 0 of one pose, infinite at the beginning of a run."""
        passed = np.diff(o.t) if self._timed and o.t is not None else np.full(o.n - 1, self._spacing)
        passed = np.maximum(passed, SHORTEST * self._spacing)
        passed[np.diff(o.pose) == 0] = 0.0
        passed[np.diff(o.run) != 0] = np.inf
        return np.concatenate([[np.inf], passed])

    def _adjusted(self) -> Iterator[Alternative]:
        """Yield what the fit adjusted: an axis, a target or the frame moves as a whole."""
        groups: dict[str, list[int]] = {}
        for i, number in enumerate(self.fit.moving):
            groups.setdefault(self.fit.parameters[number].key.rpartition(".")[0], []).append(i)
        for title, columns in groups.items():
            some = [self.fit.parameters[self.fit.moving[i]] for i in columns]
            definition = EffectDefinition(title, frozenset(), "", Formula("0"), {})
            candidate = Candidate(
                Effect(definition), tuple(p.key for p in some), self._sensitivities.model[:, :, columns], {}
            )
            units, factors = tuple(p.unit for p in some), tuple(p.factor for p in some)
            yield Alternative(candidate, tuple(columns), units, factors, adjusted=True)

    def _lacking(self, candidates: Sequence[Candidate]) -> Iterator[Alternative]:
        """Yield the effects that the model lacks."""
        machine, end = self.fit.machine, self.free
        for candidate in candidates:
            of = candidate.effect.units(machine)
            units = tuple(of[name] for name in candidate.short_names)
            factors = tuple(unit_factor(unit, machine.length_unit)[0] for unit in units)
            columns = tuple(range(end, end := end + len(units)))
            yield Alternative(candidate, columns, units, factors)

    def evidence(self, gram: Array, pull: Array, square: float, readings: int, dof: float) -> Evidence:
        """Return what readings say of a change, given the products of their columns X and of them, y.

        Parameters
        ----------
        gram, pull, square : ndarray of shape (d, d) and (d,), and float
            XᵀX, Xᵀy and yᵀy, of variance 1.
        readings : int
            Their number, n m.
        dof : float
            Degrees of freedom with which that variance is known: the reference counts as so many readings more.
        """
        values, vectors = eigh(gram)
        real = values > ROUNDING * max(float(values.max(initial=0.0)), SMALLEST_P)
        root = np.sqrt(values[real])
        along = vectors[:, real].T @ pull / root
        rest = max(square - float(along @ along), readings - float(real.sum()), 0.0) + dof
        y = np.append(along, math.sqrt(rest))
        columns = np.concatenate([root[:, None] * vectors[:, real].T, np.zeros((1, len(pull)))])[:, None, :]
        none = np.zeros((len(y), 0))
        space = Space.of(none, y, y, 0.0)
        rows = replace(self._sensitivities, residual=-y[:, None])
        weights = [Columns.of(space, none)]
        empty = Evidence(self.fit, rows, INDEPENDENT, [], [], [], int(readings + dof), weights)
        return empty.including(
            [replace(one.candidate, columns=columns[:, :, one.columns]) for one in self.alternatives]
        )

    def of(self, candidates: Sequence[Candidate]) -> list[Alternative]:
        """Return the alternatives that candidates of an evidence are."""
        by = {one.candidate.key: one for one in self.alternatives}
        return [by[c.key] for c in candidates]

    def _stacked(self, sensitivities: Sensitivities, candidates: Sequence[Candidate]) -> Array:
        """Return the columns of the model and of effects, as what readings are more, and the readings."""
        columns = [sensitivities.model, *(candidate.columns for candidate in candidates)]
        return np.concatenate([-np.concatenate(columns, axis=2), sensitivities.residual[..., None]], axis=2)

    def bound(self, data: Measurements) -> Observations:
        """Return new measurements as observations of the fit."""
        o = in_known_runs(bind(self._machine, data), self.fit.problem.model, self.fit.observations.run_names)
        return replace(o, arm=self.fit.observations.arm, arm_is_known=True)

    def _conditions(self, o: Observations) -> Iterator[tuple[str, Array]]:
        """Yield the names of columns in which a model may be wrong beyond what the reference covers, and values."""
        conditions = [(joint.column, o.q[:, j]) for j, joint in enumerate(self.fit.machine.joints)]
        conditions += [(f"T_{name}", x) for name, x in o.temperature.items()]
        conditions += [("load", o.load)] if o.load is not None else []
        yield from ((name, x) for name, x in conditions if name in o.data.columns)

    def outside(self, o: Observations) -> Mask:
        """Return which new readings are beyond what the reference covers of a condition, (n,)."""
        is_outside = np.zeros(o.n, bool)
        for name, x in self._conditions(o):
            low, high = self._covered.get(name, (-math.inf, math.inf))
            is_outside |= np.maximum(x - high, low - x) > BEYOND * max(high - low, SMALLEST)
        return is_outside

    def counts(self, data: Measurements) -> Mask:
        """Return which new measurements the machine file does not set aside, (n,).

        Raises
        ------
        InputFileError
            When a rule is on a column that is not there.
        """
        aside = np.zeros(data.rows, bool)
        for entry in self.rules:
            counts = None
            file = self.fit.machine.file or self.fit.machine.name
            # a run may be of other rows
            with suppress(UnexpectedError) if entry.run else in_file(file, "[measured], set_aside"):
                counts = entry.of(data, ())
            if counts is not None:
                aside = aside & ~counts if entry.back else aside | counts
        return ~aside

    def motion(self, o: Observations) -> Array:
        """Return what a motion that readings share does to them, (n, m, k)."""
        weight = Problem(self._model, o).weight
        motion = frame_motion(
            self._model, o, self._theta, self.fit.solution.frame, weight, middle=self._middle
        )
        return np.asarray(motion * self._scale)

    def at(self, o: Observations) -> Array:
        """Return the columns of observations and their weighted residuals, (n, m, d + 1).

        Raises
        ------
        InputFileError
            When the model cannot predict a row.
        """
        problem, frame = Problem(self._model, o), self.fit.solution.frame
        with one_thread_in_blas():
            columns = problem.jacobian(self._theta, frame)
            residual = problem.residuals(self._theta, frame, weighted=True)
        index = {parameter.key: i for i, parameter in enumerate(self._model.parameters)}
        sensitivities = Sensitivities(self.fit, np.arange(o.n), o, problem.weight, residual, columns, index)
        candidates = [unsearched(sensitivities, effect) for effect in self._effects]
        stacked = self._stacked(sensitivities, [candidate for candidate in candidates if candidate])
        finite = np.isfinite(stacked).all(axis=(1, 2))
        if not finite.all():
            row = int(np.argmin(finite))
            raise InputFileError(
                o.data.file, o.data.place(row), "no prediction of the model there", "a place that it reaches"
            )
        return stacked
