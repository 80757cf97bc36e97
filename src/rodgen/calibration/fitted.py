"""The result of a fit: values, residuals, and what the data determine of the parameters.

What makes a fit stands above it, in `rodgen.calibration.fit`, and so does what judges one: its noise, the dependence of
readings, tests, a diagnosis.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.determinacy import Determinacy, determinacy
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import in_its_mode, with_what_was_seen
from rodgen.calibration.problem.attitudes import attitude_columns
from rodgen.calibration.problem.blocks import BlockProblem
from rodgen.calibration.residuals import Residuals
from rodgen.calibration.solve.least_squares import Solution
from rodgen.calibration.solve.staged_fit import measured_along
from rodgen.calibration.words import sized
from rodgen.data.units import ARCSEC, parse_unit, readable
from rodgen.document import Document, Documented
from rodgen.errors import NotConvergedError
from rodgen.machines.machine import Machine
from rodgen.machines.measured import TURNS
from rodgen.machines.observations import Observations
from rodgen.machines.parameters import Parameter
from rodgen.machines.rigid import rotation_vector
from rodgen.machines.set_aside import setting_aside
from rodgen.methods import attribute, method
from rodgen.stages import stage
from rodgen.statistics.digits import measured
from rodgen.views import Records, Result, brief, plain

UNEQUAL = 1.5
"""Ratio of stated uncertainties from which an error that is not weighted does not show what was found."""


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


@dataclass(frozen=True, repr=False)
class Fit(Documented):
    """A model fitted to measurements: its values, its residuals, and what can be asked of it.

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
    weighed : bool
        Whether the estimates weigh what poses share by its noise, as those of points of one body may.
    """

    machine: Machine
    observations: Observations
    problem: Problem = field(repr=False)
    solution: Solution = field(repr=False)
    free: tuple[int, ...]
    outliers: NDArray[np.bool_] = field(repr=False)
    loss: str = field(default="linear", repr=False)
    weighed: bool = field(default=False, repr=False)

    # implemented by modules above, as rodgen.facade says
    load = cast("Callable[..., Fit]", method(of_class=True))
    refit = cast("Callable[..., Fit]", method())
    extended = cast("Callable[..., Fit]", method())
    with_bodies = cast("Callable[..., NDArray[np.bool_]]", method())
    without_bounds = cast("Fit | None", attribute())
    covariance = cast(Array, attribute())
    correlation = cast(Array, attribute())
    estimates = cast("dict[str, Estimate]", attribute())
    estimates_with = cast("Callable[..., dict[str, Estimate]]", method())
    used_rows = cast("dict[str, Any]", attribute())
    dependence, noise, lack_of_fit, gross_readings = attribute(), attribute(), attribute(), attribute()
    held_out, held_out_of_poses, held_out_geometry = method(), attribute(), attribute()
    check, compare, diagnose, predict, plot = method(), method(), method(), method(), method()
    save = cast("Callable[..., None]", method())
    document = cast("Callable[..., Document]", method())
    to_dict = cast("Callable[..., dict[str, Any]]", method())
    __repr__ = brief

    def __setstate__(self, state: dict[str, Any]) -> None:
        # A machine is pickled without its fit; with its fit it has it again.
        self.__dict__.update(state)
        self.__dict__["machine"] = replace(self.machine, doubts=self._doubts)

    def _doubts(self) -> str:
        """Return why the fitted machine may be wrong; empty where nothing is known to be."""
        unfinished = "" if self.solution.converged else NotConvergedError.reason
        useless = self.held_out_geometry
        return str(
            self.check().sentence
            or unfinished
            or (useless.text if useless and useless.lowers is False else "")
        )

    @classmethod
    def of(
        cls,
        problem: Problem,
        solution: Solution,
        free: Sequence[int],
        outliers: NDArray[np.bool_],
        loss: str = "linear",
        *,
        weighed: bool = False,
    ) -> Fit:
        """Return the fit of a problem's model whose parameters are those of a solution."""
        model = problem.model
        numbers = _values(model.parameters, solution)
        values = {p.key: float(x) for p, x in zip(model.parameters, numbers, strict=True)}
        values |= {tied.parameter.key: model.tied_value(tied, numbers) for tied in model.tied}
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
        fit = cls(machine, problem.observations, problem, solution, tuple(free), outliers, loss, weighed)
        return replace(fit, machine=replace(machine, doubts=fit._doubts))

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
        return setting_aside(self.machine, table, rows=rows, why=why) if rows else self.machine

    @property
    def outlier_rows(self) -> list[int]:
        """The outliers as their table numbers them, with their copies; none where it is unknown or read in parts."""
        o = self.observations
        if o.table is None or o.blocks is not None:
            return []
        rows: list[int] = o.table.numbers(np.flatnonzero(o.in_table(self.outliers))).tolist()
        return rows

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the parameters that were adjusted and are not at a bound of the machine file."""
        bounds = self.problem.at_bounds(self.solution.theta)
        return tuple(i for i in self.free if i not in bounds)

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
        residuals = (
            self.problem.residuals(self.solution.theta, self.solution.frame) * self.problem.base_weight
        )
        whitening = self.observations.whitening
        return np.asarray(residuals if whitening is None else np.einsum("nij,nj->ni", whitening, residuals))

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residuals per scalar reading, in :attr:`unit`, without the outliers."""
        return float(np.sqrt(self._squares.sum() / (self.rows * self.problem.components)))

    @cached_property
    def _squares(self) -> Array:
        """Sums of the squares of the residuals, by component, in :attr:`unit`, without the outliers."""
        if isinstance(self.problem, BlockProblem):
            return self.problem.squares(self.solution.theta, self.solution.frame) / self.unit_factor**2
        inliers = self._residuals[~self.outliers]
        return np.asarray(np.einsum("ij,ij->j", inliers, inliers))

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
    def variance_factor(self) -> float:
        """What the covariance is multiplied by: 1 where the noise is stated, else the residuals' variance."""
        if self.observations.sigma is not None:
            return 1.0
        return self.solution.cost / self.degrees_of_freedom if self.degrees_of_freedom > 0 else np.nan

    def residual_columns(self) -> dict[str, NDArray[Any]]:
        """Return predictions and residuals as columns for the measurement file.

        Returns
        -------
        dict of str to ndarray
            ``predicted_x`` … and ``residual_x`` … in the unit of the column ``x``. Of directions the prediction, and
            the angle between both, split into a horizontal part (to the left) and one towards the zenith. Of poses
            also the predicted attitude, in the notation of the readings, and the rotation vector from there to these.
            ``outlier``, 1 or 0.
            A row that is a copy of another has what that has; those of rows that are set aside are masked.
        """
        measurand = self.machine.measurand
        names = measurand.columns
        columns: dict[str, NDArray[Any]] = {}
        if measurand.is_direction:
            places = self.problem.places(self.solution.theta, self.solution.frame)
            columns |= {f"predicted_{name}": values for name, values in zip(names, places.T, strict=True)}
            parts = zip(("horizontal", "vertical"), self.residuals.T, strict=True)
            columns |= {f"residual_{part} [{self.unit}]": values for part, values in parts}
        else:
            data, residuals = self.observations.data, self.residuals * self.unit_factor
            reading = (
                residuals[:, :0]
                if measurand.has_attitude and not measurand.is_pose
                else self.observations.reading
            )
            of_places = residuals[:, : reading.shape[1]]
            for label, values in (("predicted", reading - of_places), ("residual", of_places)):
                for name, part in zip(names, values.T, strict=False):
                    unit = str(data.columns[name].unit)
                    columns[f"{label}_{name} [{unit}]"] = part / parse_unit(unit).factor(
                        self.machine.length_unit
                    )
            if measurand.has_attitude:
                attitudes = self.problem.attitudes(self.solution.theta, self.solution.frame)
                columns |= {
                    f"predicted_{name}": part for name, part in attitude_columns(attitudes, data).items()
                }
                turns = (self.residuals * self.in_units)[:, -3:]
                columns |= {
                    f"residual_{name} [arcsec]": part for name, part in zip(TURNS, turns.T, strict=True)
                }
        columns["outlier"] = self.outliers.astype(np.int8)
        rows = self.observations.counted_as
        if rows is None:
            return columns
        everywhere = {name: values[rows] for name, values in columns.items()}
        return (
            {n: np.ma.array(x, mask=rows < 0) for n, x in everywhere.items()}
            if (rows < 0).any()
            else everywhere
        )

    @property
    def independent_covariance(self) -> Array:
        """Covariance that the parameters would have if readings were independent of each other."""
        return self.determinacy.covariance * self.variance_factor

    @cached_property
    def values(self) -> Array:
        """Values of all parameters, internal units; the frame as a rotation vector and a position."""
        return _values(self.parameters, self.solution)

    def places(self, observations: Observations) -> Array:
        """Return where the model puts what is measured, in machine axes, (n, 3); unit vectors of directions."""
        frame = self.solution.frame
        places = Problem(self.problem.model, observations).places(self.solution.theta, frame)
        return (places - frame.position) @ frame.rotation if self.machine.measured.frame == "free" else places

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
        arguments: dict[str, Any] = {
            "travel": self.observations.travel,
            "covariance": ([p.key for p in self.parameters], self.covariance),
            "residual": (self.rows, float(np.sqrt(self._squares.sum() / self.rows)) * self.unit_factor),
        }
        from rodgen.machines.emit import emit

        return emit(self.machine, lang, folder, **arguments | options)


def _values(parameters: Sequence[Parameter], solution: Solution) -> Array:
    """Return the values of all parameters, the frame as a rotation vector and a position."""
    values = solution.theta.copy()
    turn = dict(zip(("rx", "ry", "rz"), rotation_vector(solution.frame.rotation), strict=True))
    at = turn | dict(zip("xyz", solution.frame.position, strict=True))
    for i, p in enumerate(parameters):
        if p.slot[0] == "frame":
            values[i] = at[str(p.slot[1])]
    return values
