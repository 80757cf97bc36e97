"""Fit a machine's model to measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.assembly_modes import in_its_mode, with_what_was_seen
from rodgen.calibration.determinacy import Determinacy, determinacy
from rodgen.calibration.lack_of_fit import LackOfFit, lack_of_fit
from rodgen.calibration.least_squares import Solution, minimise
from rodgen.calibration.noise import NoiseFloor, noise_floor
from rodgen.calibration.observations import Observations, bind
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.robust import NO_SAY, robust_fit
from rodgen.calibration.starting_values import linear_falls, placed, searched
from rodgen.calibration.summary import as_dict, as_text
from rodgen.data.measurements import Measurements
from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model
from rodgen.machines.parameters import Parameter
from rodgen.machines.rigid import rotation_vector
from rodgen.machines.structure import row_effects

if TYPE_CHECKING:
    from rodgen.calibration.compare import Comparison
    from rodgen.calibration.diagnose import Diagnosis
    from rodgen.calibration.held_out import HeldOut
    from rodgen.calibration.predict import Prediction

__all__ = ["Estimate", "Fit", "FitError", "fit"]

Array: TypeAlias = NDArray[np.float64]
Progress: TypeAlias = Callable[[str, int, float], object]

LOSSES = ("linear", "huber")


class FitError(RodgenError):
    """A fit that cannot be done, in one sentence."""


@dataclass(frozen=True)
class Estimate:
    """A parameter as it was fitted, in the unit that it is shown in.

    Attributes
    ----------
    key, unit : str
    value : float
    std : float or None
        One standard deviation; None where it is held, where the data do not determine it, or where the noise is not
        stated and no reading is left to tell it from.
    held, determined : bool
    """

    key: str
    unit: str
    value: float
    std: float | None
    held: bool
    determined: bool


@dataclass(frozen=True)
class Fit:
    """A model fitted to measurements.

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
    """

    machine: Machine
    observations: Observations
    problem: Problem = field(repr=False)
    solution: Solution = field(repr=False)
    free: tuple[int, ...]
    outliers: NDArray[np.bool_] = field(repr=False)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The model's parameters."""
        return self.problem.model.parameters

    @property
    def unit(self) -> str:
        """What residuals and their rms are shown in."""
        return self.machine.measurand.unit(self.machine.length_unit)

    @property
    def unit_factor(self) -> float:
        """Internal value of one :attr:`unit`."""
        return np.pi / 648000 if self.unit == "arcsec" else 1.0

    @cached_property
    def residuals(self) -> Array:
        """Measured less predicted, (n, m), in :attr:`unit`.

        Of directions: the angle on the sphere, split into a horizontal part and one towards the zenith.
        """
        r = self.problem.residuals(self.solution.theta, self.solution.frame)
        return np.asarray(self.machine.measurand.error(r) / self.unit_factor)

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residuals per scalar reading, in :attr:`unit`, without the outliers."""
        return float(np.sqrt(np.mean(self.residuals[~self.outliers] ** 2)))

    @cached_property
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
        """Readings less determined parameters."""
        readings = int((~self.outliers).sum()) * self.problem.components
        return readings - self.determinacy.rank

    @property
    def variance_factor(self) -> float:
        """What the covariance is multiplied by: 1 where the noise is stated, else the residuals' variance."""
        if self.observations.sigma is not None:
            return 1.0
        return self.solution.cost / self.degrees_of_freedom if self.degrees_of_freedom > 0 else np.nan

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the parameters, internal units, (parameters, parameters)."""
        return self.determinacy.covariance * self.variance_factor

    @cached_property
    def correlation(self) -> Array:
        """Correlations of the parameters, (parameters, parameters); zero beside what is not estimated."""
        std = np.sqrt(np.diag(self.covariance))
        std = np.where(std > 0, std, 1.0)
        return np.asarray(self.covariance / np.outer(std, std))

    @cached_property
    def values(self) -> Array:
        """Values of all parameters, internal units; the frame as a rotation vector and a position."""
        return _values(self.parameters, self.solution)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Every parameter by its key, in the unit that it is shown in."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        found = {}
        for i, p in enumerate(self.parameters):
            held, determined = i not in self.free, not self.determinacy.undetermined[i]
            spread = None if held or not determined or np.isnan(std[i]) else float(std[i] / p.factor)
            found[p.key] = Estimate(p.key, p.unit, float(self.values[i] / p.factor), spread, held, determined)
        return found

    @cached_property
    def noise(self) -> NoiseFloor:
        """How well the machine could be modelled at all, from the data alone."""
        return noise_floor(self)

    @cached_property
    def lack_of_fit(self) -> LackOfFit | None:
        """Whether the residuals are larger than the noise; None where the noise is not known."""
        return lack_of_fit(self)

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
        from rodgen.calibration.held_out import held_out

        return held_out(self, folds=folds, progress=progress)

    def compare(self) -> Comparison:
        """Hold what is left against everything that was noted: where the model is worst, and what that depends on."""
        from rodgen.calibration.compare import compare

        return compare(self)

    def predict(self, design: Measurements) -> Prediction:
        """Tell where the machine will be, and how sure that is; see :func:`rodgen.calibration.predict.predict`."""
        from rodgen.calibration.predict import predict

        return predict(self, design)

    def diagnose(self, *, test: Measurements | None = None, progress: Progress | None = None) -> Diagnosis:
        """Find out which effects are missing in the model; see :func:`rodgen.calibration.diagnose.diagnose`."""
        from rodgen.calibration.diagnose import diagnose

        return diagnose(self, test=test, progress=progress)

    def summary(self) -> str:
        """Return the fit as text."""
        return as_text(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as plain data, as `rodgen fit --json` prints it."""
        return as_dict(self)


def fit(
    machine: Machine,
    data: Measurements | Observations,
    *,
    loss: str = "linear",
    start: Mapping[str, float] | None = None,
    outliers: NDArray[np.bool_] | None = None,
    compiled: bool = True,
    progress: Progress | None = None,
) -> Fit:
    """Adjust a machine's parameters until the model meets the measurements best.

    Parameters
    ----------
    machine : Machine
        Its ``estimate`` and the parameters of its effects are adjusted; fitted values that it carries are the start.
    data : Measurements or Observations
    loss : {"linear", "huber"}
        Sum of squares, or one that outliers do not pull: they are found, named and taken out.
    start : mapping of str to float, optional
        Further values to start from, by key, internal units.
    outliers : ndarray of bool, shape (n,), optional
        Rows that are known not to be believed; only with the linear loss.
    compiled : bool
        False for kernels on NumPy: quicker for one fit to few rows of a model that no other fit has been of.
    progress : callable, optional
        Called with what is done, the iteration and the cost.

    Returns
    -------
    Fit

    Raises
    ------
    InputFileError
        When the data do not fit the machine.
    FitError
        When the loss is another one, there is nothing to fit, or the model is not finite at the start.
    """
    if loss not in LOSSES:
        raise FitError(f"loss {shown(loss)}; expected one of {', '.join(LOSSES)}")
    observations = data if isinstance(data, Observations) else bind(machine, data)
    if not observations.n:
        raise InputFileError(
            observations.data.file, "file", "no rows", "at least one measurement under the header"
        )
    if start:
        machine = replace(machine, values={**machine.values, **start})
    model = Model(machine, observations.travel, observations.run_names, compiled=compiled)
    problem = Problem(model, observations)
    _check_travel(problem)
    with one_thread_in_blas():
        if loss == "linear":
            gone = np.zeros(observations.n, bool) if outliers is None else outliers
            if gone.any():
                problem.set_weight(np.where(gone, NO_SAY, 1.0))
            solution, free = _solve(problem, progress)
            return _finished(problem, solution, free, gone)
        found = robust_fit(problem, lambda: _solve(problem, progress))
        return _finished(problem, found.solution, found.free, found.outliers)


def _finished(problem: Problem, solution: Solution, free: Sequence[int], outliers: Any) -> Fit:
    model = problem.model
    found = _values(model.parameters, solution)
    values = {p.key: float(x) for p, x in zip(model.parameters, found, strict=True)}
    # what is measured along a travel means nothing without it
    joints = tuple(
        replace(joint, travel=(float(model.travel[j, 0]), float(model.travel[j, 1])))
        if j in _measured_along(model)
        else joint
        for j, joint in enumerate(model.machine.joints)
    )
    machine = in_its_mode(replace(model.machine, values=values, joints=joints), problem.observations)
    machine = with_what_was_seen(machine, problem.observations)
    return Fit(machine, problem.observations, problem, solution, tuple(free), outliers)


def _values(parameters: Sequence[Parameter], solution: Solution) -> Array:
    """Return the values of all parameters, the frame as a rotation vector and a position."""
    values = solution.theta.copy()
    turn = dict(zip(("rx", "ry", "rz"), rotation_vector(solution.frame.rotation), strict=True))
    at = turn | dict(zip("xyz", solution.frame.position, strict=True))
    for i, p in enumerate(parameters):
        if p.slot[0] == "frame":
            values[i] = at[str(p.slot[1])]
    return values


def _measured_along(model: Model) -> dict[int, str]:
    """Return the joints along whose travel an effect is measured, with the effect."""
    terms = zip(row_effects(model.machine), model.structure.terms, strict=True)
    return {term.joint: effect.title for effect, term in terms if term.uses_travel and term.joint is not None}


def _check_travel(problem: Problem) -> None:
    """Refuse an effect along a way that has no length."""
    model = problem.model
    for j, title in _measured_along(model).items():
        if not model.travel[j, 1] > model.travel[j, 0]:
            o, joint = problem.observations.data, model.machine.joints[j].name
            found = (
                f"one coordinate in all rows, and no travel in the machine, along which {title} is measured"
            )
            place = f"{o.header_place}, column {shown(joint)}"
            raise InputFileError(o.file, place, found, f"travel of joint {joint}, or rows in which it moves")


def _solve(problem: Problem, progress: Progress | None) -> tuple[Solution, list[int]]:
    """Fit the geometry, then the effects: first those that start from zero, then those that need a search."""
    model = problem.model
    theta = model.start()
    estimated = [i for i, p in enumerate(model.parameters) if p.hold is None]
    base = [i for i in estimated if model.parameters[i].effect is None]

    def tell(what: str) -> Callable[[int, float], object] | None:
        return None if progress is None else lambda i, cost: progress(what, i, cost)

    solution = placed(problem, theta, base)
    if not np.isfinite(solution.cost):
        raise FitError(_not_finite(problem, solution))
    free, known = list(base), model.machine.values
    for new in _stages(model, estimated):
        if any(model.parameters[i].searched and model.parameters[i].key not in known for i in new):
            solution = searched(problem, solution, free, new)
        free += new
        solution = minimise(problem, solution.theta, solution.frame, free, progress=tell("fit"))
    solution, free = _called_for(problem, solution, free)
    return solution, sorted(free)


def _stages(model: Model, estimated: Sequence[int]) -> list[list[int]]:
    """Group the effects' parameters: all that start from zero at once, then effect by effect."""
    effects: dict[tuple[str | None, str], list[int]] = {}
    for i in estimated:
        p = model.parameters[i]
        if p.effect is not None and not p.optional:
            effects.setdefault((p.place, p.effect), []).append(i)
    own = {e.name for e in model.machine.effects if e.definition.own}
    plain, later = [], []
    for (_, name), numbers in effects.items():
        if name in own or any(model.parameters[i].searched for i in numbers):
            later.append(numbers)
        else:
            plain += numbers
    return [stage for stage in (plain, *later) if stage]


def _called_for(problem: Problem, solution: Solution, free: list[int]) -> tuple[Solution, list[int]]:
    """Take in the weights at later joints one after the other while the data call for them.

    The fall of the cost that a linear step promises decides which is tried, and the fall that a fit brings, whether it
    stays: by more than 12 + ln(rows) variances, the measure by which effects are told apart.
    """
    waiting = [i for i, p in enumerate(problem.model.parameters) if p.optional and p.hold is None]
    readings = problem.rows * problem.components
    while waiting:
        promised = linear_falls(problem, solution, free, waiting)
        index = waiting[int(np.argmax(promised))]
        left = max(readings - len(free) - 1, 1)
        variance = 1.0 if problem.observations.sigma is not None else solution.cost / left
        needed = variance * (12 + np.log(problem.rows))
        if max(promised) < needed:
            break
        better = minimise(problem, solution.theta, solution.frame, [*free, index])
        if solution.cost - better.cost < needed:
            break
        solution, free = better, [*free, index]
        waiting.remove(index)
    return solution, free


def _not_finite(problem: Problem, solution: Solution) -> str:
    bad = ~np.isfinite(problem.residuals(solution.theta, solution.frame)).all(axis=1)
    row = int(np.argmax(bad))
    place = problem.observations.data.place(row)
    file = problem.observations.data.file
    own = [effect.title for effect in problem.model.machine.effects if effect.definition.own]
    which = f" (check the formula of {', '.join(own)})" if own else ""
    if not problem.model.structure.moving and not own:
        which = " (a prediction right opposite to its reading? check the signs of axes and targets)"
    if problem.model.machine.geometry is not None and not own:
        which = " (is the pose near a singular one, or the geometry far off?)"
    return f"{file}: {place}: the model is not finite here; expected formulas and numbers that are{which}"
