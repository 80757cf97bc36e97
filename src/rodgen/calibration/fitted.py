"""A model fitted to measurements, below everything that judges it: comparison, diagnosis and plans."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.checks.gross import GrossReading, gross_readings
from rodgen.calibration.checks.held_out import HeldOut, HeldOutGeometry, held_out, held_out_geometry
from rodgen.calibration.checks.lack_of_fit import LackOfFit, lack_of_fit
from rodgen.calibration.determinacy import Determinacy, determinacy
from rodgen.calibration.noise import NoiseFloor, noise_floor
from rodgen.calibration.noise.correlation import Dependence, dependence
from rodgen.calibration.noise.noise_floor import estimated_arm
from rodgen.calibration.open_questions import OpenQuestions
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import in_its_mode, with_what_was_seen
from rodgen.calibration.problem.blocks import BlockProblem, observed, problem_of
from rodgen.calibration.residuals import Residuals
from rodgen.calibration.solve.least_squares import NEAR, Solution, minimise, nearest
from rodgen.calibration.solve.robust import robust_fit, robust_fit_of_parts
from rodgen.calibration.solve.staged_fit import FitError, check_travel, fit_in_stages, measured_along
from rodgen.calibration.words import sized
from rodgen.data.observations import Observations
from rodgen.data.units import ARCSEC, readable
from rodgen.errors import shown
from rodgen.machines.known import Tied
from rodgen.machines.machine import Machine
from rodgen.machines.measured import TURNS
from rodgen.machines.model import model_of
from rodgen.machines.parameters import Parameter
from rodgen.machines.rigid import rotation_vector
from rodgen.stages import Progress, reporting, stage
from rodgen.statistics.columns import unit_diagonal
from rodgen.statistics.digits import measured
from rodgen.views import Records, Result, plain

LOSSES = ("linear", "huber")

UNEQUAL = 1.5
"""Ratio of stated uncertainties from which an error that is not weighted does not show what was found."""
BALANCED = 10
"""Times at most that the lever arm of poses is estimated anew: usually three."""
SAME_ARM = 0.02
"""Relative change of a lever arm that changes no estimate by a hundredth of its standard deviation."""
COMPILE_FROM = 20_000
"""Rows from which on a fit by least squares is done with compiled kernels. NumPy needs some 15 evaluations of few rows,
0.002 to 0.04 s, where the compiler works for 0.2 to 1.3 s; with 20 000 rows both take as long. A fit that looks for
outliers evaluates the model some hundred times and is always compiled. The rule counts rows, not seconds, and does not
ask what is in the cache: the same data give the same digits."""


@dataclass(frozen=True)
class Estimate(Result):
    """A parameter as it was fitted, in the unit that it is shown in.

    Attributes
    ----------
    key, unit : str
    value : float
    std : float or None
        One standard deviation; None where it is held or at a bound, where the data do not determine it, or where the
        noise is not stated and there are no more readings than parameters.
    held, determined : bool
    convention : bool
        Whether the value rests on a choice of coordinates: no measurement could tell it from others that, with other
        values of more parameters, predict the same. Of all these it is the one nearest to the machine file, and `std`
        is that of this choice.
    at_bound : str or None
        ``"lowest"`` or ``"highest"`` where the value is at a bound of the machine file; then there is no `std`.
    tied_to : str
        The combination of others that it is, by the machine file; empty of one that was adjusted itself.
    """

    key: str
    unit: str
    value: float
    std: float | None
    held: bool
    determined: bool
    convention: bool = False
    at_bound: str | None = None
    tied_to: str = ""

    @property
    def shown(self) -> tuple[str, str, str]:
        """Value, standard deviation and unit as people read them."""
        factor, unit = readable(self.unit, max(abs(self.value), self.std or 0.0))
        return *measured(self.value * factor, None if self.std is None else self.std * factor), unit

    @property
    def text(self) -> str:
        """Value, standard deviation and unit, in digits that the deviation leaves; or why there is no deviation."""
        value, std, unit = self.shown
        unit = "" if unit == "1" else f" {unit}"
        if self.held:
            return f"{value}{unit}, held"
        if self.at_bound:
            return f"{value}{unit}, the {self.at_bound} that the machine file allows"
        if self.std is None:
            return "not determined by these data"
        choice = ", by a choice of coordinates" if self.convention else ""
        tied = f", tied to {self.tied_to}" if self.tied_to else ""
        return f"{value} ± {std}{unit}{choice}{tied}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, without the key."""
        names = "value std unit held determined convention at_bound"
        return plain(self, f"{names} tied_to" if self.tied_to else names)


@dataclass(frozen=True)
class FittedModel:
    """A model fitted to measurements: its values, their covariance, its residuals, and how to fit it again.

    Attributes
    ----------
    machine : Machine
        With the fitted values.
    observations : Observations
    problem : Problem
    solution : Solution
    free : tuple of int
        Numbers of the parameters that were adjusted.
    outliers : ndarray of bool, shape (n,)
        Rows that a robust fit does not believe.
    loss : str
        With which they were found.
    """

    machine: Machine
    observations: Observations
    problem: Problem = field(repr=False)
    solution: Solution = field(repr=False)
    free: tuple[int, ...]
    outliers: NDArray[np.bool_] = field(repr=False)
    loss: str = field(default="linear", repr=False)

    @classmethod
    def to(
        cls,
        machine: Machine,
        data: Any,
        *,
        loss: str = "linear",
        start: Mapping[str, float] | None = None,
        outliers: NDArray[np.bool_] | None = None,
        compiled: bool | None = None,
    ) -> Self:
        """Return a machine's model fitted to measurements; see :func:`rodgen.calibration.fit.fit`."""
        if loss not in LOSSES:
            raise FitError(f"loss {shown(loss)}; expected one of {', '.join(LOSSES)}")
        observations = observed(machine, data)
        if outliers is not None and not isinstance(data, Observations):  # those of all rows
            outliers = observations.counted(outliers)
        if start:
            machine = replace(machine, values={**machine.values, **start})
        if compiled is None:
            compiled = loss != "linear" or observations.n >= COMPILE_FROM or observations.blocks is not None
        model = model_of(machine, observations.travel, observations.run_names, compiled=compiled)
        problem = problem_of(model, observations)
        check_travel(problem)
        with one_thread_in_blas():
            if loss == "linear":
                gone = np.zeros(observations.n, bool) if outliers is None else outliers
                if gone.any():
                    problem.leave_out(gone)
                solution, free = fit_in_stages(problem)
                return cls._finished(problem, solution, free, gone).balanced()
            if isinstance(problem, BlockProblem):
                problem, found = robust_fit_of_parts(problem, fit_in_stages)
                return replace(cls._finished(problem, found.solution, found.free, found.outliers), loss=loss)
            found = robust_fit(problem, lambda: fit_in_stages(problem))
            fit = cls._finished(problem, found.solution, found.free, found.outliers)
            if not observations.arm_is_known:
                return cls.to(machine, fit.balanced().observations, loss=loss, compiled=compiled)
            outliers = fit.with_bodies(fit.outliers)
            fit = fit if np.array_equal(outliers, fit.outliers) else fit.refit(outliers=outliers)
            return replace(fit, loss=loss)

    def balanced(self) -> Self:
        """Return the fit of poses in which positions and attitudes count by their own noise, estimated apart.

        Itself where that is known.
        """
        if self.observations.arm_is_known:
            return self
        fit, free = self, self.free
        for _ in range(BALANCED):
            before, arm = fit.observations.arm, fit.noise_arm
            if abs(np.log(arm / before)) < SAME_ARM:
                break
            problem = Problem(fit.problem.model, replace(fit.observations, arm=arm))
            if fit.outliers.any():
                problem.leave_out(fit.outliers)
            solution = minimise(problem, fit.solution.theta, fit.solution.frame, free, damping=NEAR)
            fit = self._finished(problem, solution, free, fit.outliers)
        known = replace(fit.observations, arm_is_known=True)
        if any(p.optional for p in fit.parameters):  # what the data call for depends on the weights
            return fit.refit(observations=known, outliers=fit.outliers)
        return replace(fit, observations=known)

    @classmethod
    def _finished(
        cls, problem: Problem, solution: Solution, free: Sequence[int], outliers: NDArray[np.bool_]
    ) -> Self:
        return cls._of(problem, nearest(problem, solution, free), free, outliers)

    @classmethod
    def _of(
        cls,
        problem: Problem,
        solution: Solution,
        free: Sequence[int],
        outliers: NDArray[np.bool_],
        loss: str = "linear",
    ) -> Self:
        model = problem.model
        found = _values(model.parameters, solution)
        values = {p.key: float(x) for p, x in zip(model.parameters, found, strict=True)}
        values |= {tied.parameter.key: model.tied_value(tied, found) for tied in model.tied}
        # what is measured along a travel means nothing without it
        along = measured_along(model)
        joints = tuple(
            replace(joint, travel=(float(model.reach[j, 0]), float(model.reach[j, 1])))
            if j in along
            else joint
            for j, joint in enumerate(model.machine.joints)
        )
        machine = in_its_mode(replace(model.machine, values=values, joints=joints), problem.observations)
        machine = with_what_was_seen(machine, problem.observations)
        return cls(machine, problem.observations, problem, solution, tuple(free), outliers, loss)

    @property
    def noise_arm(self) -> float:
        """The ratio of the noise of positions to that of attitudes, by the residuals where it is not stated."""
        o = self.observations
        if o.sigma is not None or not self.machine.measurand.has_attitude:
            return o.arm
        return estimated_arm(self.problem, self.solution, self.free, ~self.outliers)

    def with_bodies(self, rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return rows that are wrong, (n,), with the others of their poses where these were measured as poses."""
        if not rows.any() or not self.noise.one_body:
            return rows
        pose = self.observations.pose
        return np.isin(pose, pose[rows])

    @property
    def outlier_numbers(self) -> list[int]:
        """Numbers of the outliers in the data as they were given, from 0."""
        numbers: list[int] = self.observations.given(np.flatnonzero(self.outliers)).tolist()
        return numbers

    def excluding_outliers(self, why: str = "outlier") -> Machine:
        """Return the machine with its fitted values and, set aside, the outliers: a fit to the same table is this one.

        The machine as it is where there are none, or where the table is not known or read in parts.

        Parameters
        ----------
        why : str
            The note on these rows.
        """
        table, rows = self.observations.table, self.outlier_rows
        return self.machine.setting_aside(table, rows=rows, why=why) if rows else self.machine

    @property
    def outlier_rows(self) -> list[int]:
        """The outliers as their table numbers them, with their copies; none where it is unknown or read in parts."""
        o = self.observations
        if o.table is None or o.blocks is not None:
            return []
        rows: list[int] = o.table.numbers(np.flatnonzero(o.in_table(self.outliers))).tolist()
        return rows

    @property
    def used_rows(self) -> dict[str, Any]:
        """How many rows were fitted, which were not, and which disagree grossly with the others, as plain data."""
        return {
            "rows": self.problem.count,
            **self.observations.not_here,
            "outliers": self.outlier_numbers,
            "gross": [one.to_dict(self.observations) for one in self.gross_readings],
        }

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the parameters that were adjusted and are not at a bound of the machine file."""
        bounds = self.problem.at_bounds(self.solution.theta)
        return tuple(i for i in self.free if i not in bounds)

    @cached_property
    def without_bounds(self) -> Self | None:
        """The same without the bounds of the machine file that hold it; None where none does."""
        held = [self.parameters[i].key for i in set(self.free).difference(self.moving)]
        return self.refit(self.machine.without_bounds(held), outliers=self.outliers) if held else None

    @cached_property
    def gross_readings(self) -> tuple[GrossReading, ...]:
        """The readings that are grossly wrong; see :func:`rodgen.calibration.checks.gross.gross_readings`."""
        return gross_readings(self)

    @property
    def weighted(self) -> bool:
        """Whether stated uncertainties differ so much that an error in a unit of length or angle says little."""
        sigma = self.observations.sigma
        return sigma is not None and bool(sigma.max() > UNEQUAL * sigma.min())

    @property
    def sizes(self) -> Array:
        """Residuals by which rows are compared, (n, m): in `unit`, or, where they are `weighted`, in uncertainties."""
        return self.residuals * (self.problem.base_weight * self.unit_factor if self.weighted else 1.0)

    @property
    def open_questions(self) -> OpenQuestions:
        """What the data leave open about the model, for a plan of measurements."""
        return OpenQuestions(self)

    def refit(
        self,
        machine: Machine | None = None,
        observations: Observations | None = None,
        *,
        outliers: NDArray[np.bool_] | None = None,
    ) -> Self:
        """Return a fit of another machine, or to other observations, without outliers if these are known.

        Parameters
        ----------
        machine : Machine, optional
            Left out: the one that was fitted.
        observations : Observations, optional
            Left out: those of this fit.
        outliers
            As of :func:`rodgen.calibration.fit.fit`.
        """
        return self.to(
            self.machine if machine is None else machine,
            self.observations if observations is None else observations,
            outliers=outliers,
        )

    @property
    def later_weights(self) -> frozenset[str]:
        """Keys of the weights at later joints that the fit took in, as the data called for them."""
        return frozenset(self.parameters[i].key for i in self.free if self.parameters[i].optional)

    def with_weights(self, keys: Collection[str]) -> Self:
        """Return the fit with some weights at later joints taken in, as far as its model estimates them."""
        wanted = {i for i, p in enumerate(self.parameters) if p.key in keys and p.hold is None}
        free = sorted(wanted.union(self.free))
        if len(free) == len(self.free):
            return self
        solution = minimise(self.problem, self.solution.theta, self.solution.frame, free)
        return self._finished(self.problem, solution, free, self.outliers)

    @property
    def parameters(self) -> Records[Parameter]:
        """The model's parameters; as a DataFrame with their estimates."""
        return Records(self.problem.model.parameters, self._record)

    def _record(self, parameter: Parameter) -> dict[str, Any]:
        return {"key": parameter.key} | self.estimates[parameter.key].to_dict()

    @property
    def unit(self) -> str:
        """What residuals and their rms are shown in."""
        return self.machine.measurand.unit(self.machine.length_unit)

    @property
    def unit_factor(self) -> float:
        """Internal value of one :attr:`unit`."""
        return ARCSEC if self.unit == "arcsec" else 1.0

    @property
    def units(self) -> tuple[str, ...]:
        """What each component of a residual is shown in: :attr:`unit`, but for the turns of poses."""
        return tuple("arcsec" if x in TURNS else self.unit for x in self.machine.measurand.components)

    @property
    def in_units(self) -> Array:
        """What brings components of residuals from :attr:`unit` to :attr:`units`, (m,)."""
        angle = 1.0 if self.unit == "arcsec" else 1 / ARCSEC / self.observations.arm
        return np.array([angle if x in TURNS else 1.0 for x in self.machine.measurand.components])

    @property
    def errors(self) -> tuple[float, float] | None:
        """Of poses the rms of a coordinate and of a turn, each in its unit of :attr:`units`; else None."""
        if len(set(self.units)) == 1:
            return None
        squares = self._squares / self.rows * self.in_units**2
        return float(np.sqrt(squares[:3].mean())), float(np.sqrt(squares[3:].mean()))

    @property
    def error_text(self) -> str:
        """The rms of the residuals, of poses that of positions and that of attitudes."""
        if self.errors is None:
            return f"rms {sized(self.rms, self.unit, '.4g')} per reading"
        place, turn = self.errors
        stated = "stated" if self.observations.sigma is not None else "by the residuals"
        return (
            f"rms {sized(place, self.unit, '.4g')} of a coordinate and {turn:.4g} {self.units[-1]} of a turn; "
            f"turns count as lengths on an arm of {self.observations.arm:.4g} {self.unit}, the ratio of both noises "
            f"({stated})"
        )

    @property
    def residuals(self) -> Residuals:
        """Measured less predicted, (n, m), in :attr:`unit`; as a DataFrame with the measurements.

        Of directions: the angle on the sphere, split into a horizontal part and one towards the zenith. Of poses also
        the rotation vector about the axes of the measuring frame, times the arm of the observations.
        """
        return Residuals.of(self, self._residuals)

    @cached_property
    def _residuals(self) -> Array:
        r = self.problem.residuals(self.solution.theta, self.solution.frame)
        return np.asarray(self.machine.measurand.error(r, self.observations.arm) / self.unit_factor)

    @property
    def relative_residuals(self) -> Array:
        """Residuals of all rows, (n, m): in stated standard deviations, or in internal units where none is stated.

        Without their stated correlation.
        """
        found = self.problem.residuals(self.solution.theta, self.solution.frame) * self.problem.base_weight
        whitening = self.observations.whitening
        return np.asarray(found if whitening is None else np.einsum("nij,nj->ni", whitening, found))

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residuals per scalar reading, in :attr:`unit`, without the outliers."""
        return float(np.sqrt(self._squares.sum() / (self.rows * self.problem.components)))

    @cached_property
    def _squares(self) -> Array:
        """Sums of the squares of the residuals, by component, in :attr:`unit`, without the outliers."""
        if isinstance(self.problem, BlockProblem):
            return self.problem.squares(self.solution.theta, self.solution.frame) / self.unit_factor**2
        kept = self._residuals[~self.outliers]
        return np.asarray(np.einsum("ij,ij->j", kept, kept))

    @property
    def rows(self) -> int:
        """Number of rows that are believed."""
        return self.problem.count - int(self.outliers.sum())

    @cached_property
    @stage("what the data determine")
    def determinacy(self) -> Determinacy:
        """What the data determine."""
        with one_thread_in_blas():
            return determinacy(self.problem, self.solution.theta, self.solution.frame, self.free)

    @property
    def chi_square(self) -> float:
        """Sum of squares of the weighted residuals."""
        return self.solution.cost

    @property
    def degrees_of_freedom(self) -> int:
        """Readings less determined parameters, of which priors of the file determine their part."""
        return self.rows * self.problem.components - self.determinacy.rank + round(self._known_by_priors)

    @cached_property
    def _known_by_priors(self) -> float:
        """How many parameters the priors of the file determine: the sum of variances relative to theirs."""
        file = self.problem.file_values
        if not file.is_prior:
            return 0.0
        index = [i for i in self.free if file.precision[i] > 0]
        left = max(self.rows * self.problem.components - len(self.free), 1)
        factor = 1.0 if self.observations.sigma is not None else self.solution.cost / left
        variances = self.determinacy.covariance.diagonal()[index] * factor
        return float(np.sum(variances * file.precision[index] ** 2))

    @property
    def prior_chi_square(self) -> float:
        """Sum of squares of the deviations from the priors of the file, in their standard deviations."""
        file, index = self.problem.file_values, list(self.free)
        return float(np.sum(((self.solution.theta - file.centre) * file.precision)[index] ** 2))

    @property
    def least_sum(self) -> float:
        """What a fit makes least: the chi-square, and that of the deviations from priors with the same weight."""
        if not self.problem.file_values.is_prior:
            return self.chi_square
        return self.chi_square + self.prior_chi_square * self.variance_factor

    @property
    def variance_factor(self) -> float:
        """What the covariance is multiplied by: 1 where the noise is stated, else the residuals' variance."""
        if self.observations.sigma is not None:
            return 1.0
        return self.solution.cost / self.degrees_of_freedom if self.degrees_of_freedom > 0 else np.nan

    @cached_property
    @stage("how readings depend on each other")
    def dependence(self) -> Dependence:
        """How the errors of readings depend on each other: within a pose, and of successive poses."""
        return dependence(self)

    @property
    def independent_covariance(self) -> Array:
        """Covariance that the parameters would have if readings were independent of each other."""
        return self.determinacy.covariance * self.variance_factor

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the parameters, internal units, (parameters, parameters); it allows for :attr:`dependence`."""
        found = self.dependence.covariance
        return self.independent_covariance if found is None else found

    @cached_property
    def correlation(self) -> Array:
        """Correlations of the parameters, (parameters, parameters); zero for what is not estimated."""
        return unit_diagonal(self.covariance)[0]

    @cached_property
    def values(self) -> Array:
        """Values of all parameters, internal units; the frame as a rotation vector and a position."""
        return _values(self.parameters, self.solution)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Every parameter by its key, in the unit that it is shown in."""
        return self._estimates(self.determinacy, self.covariance)

    def estimates_with(self, further: Array) -> dict[str, Estimate]:
        """Return the estimates that are expected when further readings are taken: values as now, and their spread.

        What readings have in common enlarges the spread as it does now.

        Parameters
        ----------
        further : ndarray, shape (k, free)
            Derivatives of the weighted readings by the free parameters.
        """
        theta, frame = self.solution.theta, self.solution.frame
        with one_thread_in_blas():
            more = determinacy(self.problem, theta, frame, self.free, further)
            alone, now = np.diag(self.independent_covariance), np.diag(self.covariance)
            enlarged = np.divide(now, alone, out=np.ones_like(now), where=alone > 0)
            larger = np.sqrt(np.outer(enlarged, enlarged))
            return self._estimates(more, more.covariance * self.variance_factor * larger)

    def _estimates(self, of: Determinacy, covariance: Array) -> dict[str, Estimate]:
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        found, bounds = {}, self.problem.at_bounds(self.solution.theta)
        for i, p in enumerate(self.parameters):
            held, lacking = i not in self.free, bool(of.lacking[i])
            at = None if held else bounds.get(i)
            spread = None if held or lacking or at or np.isnan(std[i]) else float(std[i] / p.factor)
            convention = bool(of.undetermined[i]) and not lacking
            value = float(self.values[i] / p.factor)
            found[p.key] = Estimate(p.key, p.unit, value, spread, held, not lacking, convention, at)
        for tied in self.problem.model.tied:
            found[tied.parameter.key] = self._tied(tied, found, covariance)
        return found

    def _tied(self, tied: Tied, others: Mapping[str, Estimate], covariance: Array) -> Estimate:
        """Return the estimate of a parameter that is tied to others."""
        p, weights = tied.parameter, np.zeros(len(self.parameters))
        for i, factor in tied.factors:
            weights[i] = factor
        parts = [others[self.parameters[i].key] for i, _ in tied.factors]
        moving = [part for part in parts if not part.held and not part.at_bound]
        variance = float(weights @ np.nan_to_num(covariance) @ weights)
        std = float(np.sqrt(max(variance, 0.0)) / p.factor)
        known = bool(moving) and all(part.std is not None for part in moving)
        return Estimate(
            p.key,
            p.unit,
            self.problem.model.tied_value(tied, self.values) / p.factor,
            std if known else None,
            not moving,
            all(part.determined for part in parts),
            any(part.convention for part in parts),
            tied_to=tied.text,
        )

    @cached_property
    @stage("estimating the noise")
    def noise(self) -> NoiseFloor:
        """How well the machine could be modelled at all, from the data alone."""
        return noise_floor(self)

    @cached_property
    def lack_of_fit(self) -> LackOfFit | None:
        """Whether the residuals are larger than the noise; None where the noise is not known."""
        return lack_of_fit(self)

    def places(self, observations: Observations) -> Array:
        """Return where the model puts what is measured, in machine axes, (n, 3); unit vectors of directions."""
        frame = self.solution.frame
        found = Problem(self.problem.model, observations).places(self.solution.theta, frame)
        return (found - frame.position) @ frame.rotation if self.machine.measured.frame == "free" else found

    def emit(self, lang: str, folder: str | os.PathLike[str], **options: Any) -> list[Path]:
        """Write the fitted machine as code or tables, which state the uncertainties of this fit.

        Parameters
        ----------
        lang : str
        folder : str or os.PathLike
            Is made where there is none.
        **options
            Further ones of :func:`rodgen.machines.emit.emit`.

        Returns
        -------
        list of Path
            The files.
        """
        given: dict[str, Any] = {
            "travel": self.observations.travel,
            "covariance": ([p.key for p in self.parameters], self.covariance),
            "residual": (self.rows, float(np.sqrt(self._squares.sum() / self.rows)) * self.unit_factor),
        }
        return self.machine.emit(lang, folder, **given | options)

    def held_out(self, folds: int | None = None, *, progress: Progress | None = None) -> HeldOut:
        """Return the error on whole poses that a fit did not see: each is predicted by a fit to others.

        Parameters
        ----------
        folds : int, optional
            Into how many parts the poses are dealt; left out: each of up to 100 poses is one, else 10 parts, or 5 of
            more than 50 000 rows.
        progress : callable, optional
            As of :func:`fit`.
        """
        with reporting(progress):
            return self._held_out if folds is None else held_out(self, folds=folds)

    @cached_property
    def _held_out(self) -> HeldOut:
        return held_out(self)

    @cached_property
    def held_out_geometry(self) -> HeldOutGeometry | None:
        """Whether estimated axes and points lower the error on poses left out; None where that is no question."""
        return held_out_geometry(self)


def _values(parameters: Sequence[Parameter], solution: Solution) -> Array:
    """Return the values of all parameters, the frame as a rotation vector and a position."""
    values = solution.theta.copy()
    turn = dict(zip(("rx", "ry", "rz"), rotation_vector(solution.frame.rotation), strict=True))
    at = turn | dict(zip("xyz", solution.frame.position, strict=True))
    for i, p in enumerate(parameters):
        if p.slot[0] == "frame":
            values[i] = at[str(p.slot[1])]
    return values
