"""Where a fitted machine will be at commands that were not measured, and how sure that is.

The covariance of the parameters that a fit found, carried to the place of the target: U_y = J U_x Jᵀ with the
derivative J of the place by the parameters. It is the uncertainty of the parameters, not of the model: what the
model lacks is not in it.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import open_legs
from rodgen.calibration.problem.attitudes import attitude_columns
from rodgen.calibration.problem.binding import bind, names_of
from rodgen.calibration.problem.blocks import Motion, entries
from rodgen.data.measurements import Scan
from rodgen.data.tables.parts import Part
from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, listed, shown
from rodgen.files import new_folder
from rodgen.machines.machine import Machine
from rodgen.machines.measured import TURNS
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.schedulers import workers
from rodgen.statistics.digits import round_by
from rodgen.views import Tabular, brief

ROUNDING = 1e-6
"""Part of what its parameters change one by one below which a combination of them changes nothing."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Tabular):
    """Places of the target, in the frame of the measurements.

    Attributes
    ----------
    place : ndarray, shape (n, 3), or (n, 1) for distances
        Length unit of the machine; unit vectors where directions are measured.
    covariance : ndarray, shape (n, m, m)
        Of the place, length unit squared: m is 3 for points and 1 for distances; of directions the angles to the left
        and upwards, rad², m = 2; of poses also of the turn about each axis of the measuring frame, rad, m = 6. NaN
        where it is not determined, and where the noise is not known.
    determined : ndarray of bool, shape (n,)
        Whether the data of the fit determine the place.
    names : tuple of str
        What is predicted, as columns of measurements call it.
    unit : str
        Of a scalar reading, and of `u`.
    attitude : mapping of str to ndarray, shape (n,)
        Of poses the columns of the attitude, in the notation of the design, or as a rotation vector; else none.
    """

    place: Array
    covariance: Array
    determined: NDArray[np.bool_]
    names: tuple[str, ...]
    unit: str
    attitude: Mapping[str, Array] = field(default_factory=dict)
    _factor: float = 1.0

    __repr__ = brief

    @property
    def u(self) -> Array:
        """Standard uncertainties, (n, m), in :attr:`unit`: the model's own, without the noise of a reading.

        Those of turns are in arcsec.
        """
        factors = [ARCSEC if name in TURNS else self._factor for name in self.names]
        u = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return np.asarray(u / factors[: u.shape[1]])

    @property
    def row_count(self) -> int:
        """Number of places."""
        return len(self.place)

    def shown_columns(self, rows: Sequence[int]) -> dict[str, NDArray[Any]]:
        """Return the columns of some rows."""
        return {name: values[rows] for name, values in self.columns().items()}

    def columns(self, *, coverage: float | None = None, rounded: bool = False) -> dict[str, NDArray[Any]]:
        """Return the prediction as columns of a table, ``determined`` 1 or 0.

        Parameters
        ----------
        coverage : float, optional
            Factor k of expanded uncertainties ``model_U_…``, which stand instead of the standard ones, ``model_u_…``.
        rounded : bool
            Whether uncertainties have two significant digits, and places as many decimals (GUM, 7.2.6); not attitudes.
        """
        k = 1.0 if coverage is None else coverage
        u, is_direction = k * self.u, self.names[0] == "ux"
        place = self.place if is_direction else self.place / self._factor
        if rounded:
            seen = u[:, : place.shape[1]]
            of_place = np.min(u, axis=1, keepdims=True) * self._factor if is_direction else seen
            place, u = round_by(place, of_place), round_by(u, u)
        unit = "" if is_direction else f" [{self.unit}]"
        columns: dict[str, NDArray[Any]] = {}
        if self.names != TURNS:  # attitudes have no place
            columns = {f"predicted_{n}{unit}": x for n, x in zip(self.names, place.T, strict=False)}
        columns |= {f"predicted_{n}": x for n, x in self.attitude.items()}
        parts = ("horizontal", "vertical") if is_direction else self.names
        known = "u" if coverage is None else "U"
        for n, x in zip(parts, u.T, strict=True):
            columns[f"model_{known}_{n} [{'arcsec' if n in TURNS else self.unit}]"] = x
        return columns | {"determined": self.determined.astype(np.int8)}


def predict(fit: Fit, design: Any) -> Prediction:
    """Return where a fitted machine will be, with the covariance that comes from the fit.

    Parameters
    ----------
    fit : Fit
    design : Measurements, or a table in memory
        What is commanded, and what else the effects depend on; readings are not needed and do not matter.

    Returns
    -------
    Prediction

    Raises
    ------
    InputFileError
        When the design has no rows, does not fit the machine, is of a set-up that was not measured, or has legs that do
        not close.

    Notes
    -----
    GUM (JCGM 100:2008), 5.2, and JCGM 102:2011, 6.2; for a Tricept Kureková et al., eq. (21).

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine", noise=0.002), estimate=("target",),
    ... )
    >>> data = Measurements.from_frame(
    ...     {"C [deg]": [0.0, 90.0], "x [mm]": [100.0, 0.0], "y [mm]": [0.0, 100.0], "z [mm]": [0.0, 0.0]})
    >>> table.fit(data).predict(Measurements.from_frame({"C [deg]": [45.0]})).u.round(5)
    array([[0.00141, 0.00141, 0.00141]])
    """
    if isinstance(design, Scan):
        expected = "one table, or predict_parts, which writes a folder"
        raise InputFileError(design.file, "file", "commands in many files", expected)
    predictor = Predictor.of(fit)
    o = predictor.bound(design)
    o.demand_rows("pose")
    return predictor.at(o)


@dataclass(frozen=True, eq=False)
class Predictor:
    """What of a fit predicts: small enough to be sent to a worker."""

    machine: Machine
    model: Model
    theta: Array
    frame: Frame
    covariance: Array
    null: Array
    runs: tuple[str, ...]
    unit: str
    factor: float

    @classmethod
    def of(cls, fit: Fit) -> Predictor:
        """Return that of a fit."""
        solution, names = fit.solution, fit.observations.run_names
        at = fit.problem.model, solution.theta, solution.frame
        return cls(fit.machine, *at, fit.covariance, fit.determinacy.null, names, fit.unit, fit.unit_factor)

    def bound(self, design: Any) -> Observations:
        """Return a design in internal units, its runs numbered as those of the fit."""
        o = bind(self.machine, design, allow_missing_readings=True)
        return in_known_runs(o, self.model, self.runs)

    def at(self, o: Observations) -> Prediction:
        """Return the prediction for a design; see :func:`predict`."""
        measurand, theta, frame = self.model.structure.measurand, self.theta, self.frame
        reading = np.ones(o.reading.shape)
        problem = Problem(self.model, replace(o, sigma=None, reading=reading))
        with one_thread_in_blas():
            place = problem.predicted(theta, frame)
            if problem.is_closed_chain and not np.isfinite(place).all():
                row = int(np.argmin(np.isfinite(place).all(axis=1)))
                raise open_legs(o, row, "the fitted machine")
            jacobian = problem.read_as_predicted(theta, frame).jacobian(theta, frame)
            jacobian = np.moveaxis(problem.coloured(np.moveaxis(jacobian, 2, 0)), 0, 2)
            covariance = np.einsum("nip,pq,njq->nij", jacobian, self.covariance, jacobian, optimize=True)
            determined = _determined(jacobian, self.null) & np.isfinite(place).all(axis=1)
            attitude = {}
            if measurand.has_attitude:
                arms = np.array([o.arm if name in TURNS else 1.0 for name in measurand.columns])
                covariance /= arms[:, None] * arms
                turned = problem.attitudes(theta, frame)
                attitude = attitude_columns(turned, o.data, self.machine.angle_unit)
        covariance[~determined] = np.nan
        return Prediction(place, covariance, determined, measurand.columns, self.unit, attitude, self.factor)


def predict_parts(
    fit: Fit,
    design: Scan,
    folder: str | os.PathLike[str],
    *,
    coverage: float | None = None,
    rounded: bool = False,
) -> int:
    """Write where a fitted machine will be at the commands of many files; return how many rows are not determined.

    Each worker writes the parts that it reads, with the predictions as further columns, so that it and the program must
    see one file system. The folder is there when all of them are.

    Parameters
    ----------
    fit : Fit
    design : Scan
    folder : str or os.PathLike
        Is made, with a Parquet file for each part.
    coverage, rounded
        As of `Prediction.columns`.

    Raises
    ------
    InputFileError
        As of `predict`, and when the folder is there already or cannot be written.
    """
    predictor = Predictor.of(fit)
    columns = predictor.bound(design.empty)
    if not design.rows:
        columns.demand_rows("pose")
    options = {"coverage": coverage, "rounded": rounded}
    with new_folder(folder) as into, workers() as some:
        motions = dict(some.each("looking at the design", _motion, design.parts, predictor))
        directions = entries([motions[k] for k in range(len(motions))])
        common = predictor, directions, into, options
        return sum(count for _, count in some.each("predicting", _predict_part, design.parts, *common))


def _motion(part: Part, predictor: Predictor) -> Motion:
    return Motion.of(predictor.bound(Scan.load(part, names_of(predictor.machine))))


def _predict_part(
    part: Part,
    predictor: Predictor,
    directions: Sequence[NDArray[np.int8]],
    into: Path,
    options: Mapping[str, Any],
) -> int:
    """Write the rows of a part with their predictions, some at a time; return how many are not determined."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    o = predictor.bound(Scan.load(part))
    s = o.s.copy()
    Motion.of(o).enter(s, directions[part.number])
    o = replace(o, s=s)
    undetermined, writer = 0, None
    file = into / f"part-{part.number:05d}.parquet"
    with contextlib.ExitStack() as stack:
        table = stack.enter_context(part.open())
        for start, batch in table.batches():
            prediction = predictor.at(o.take(slice(start, start + len(batch))))
            undetermined += int((~prediction.determined).sum())
            further = prediction.columns(**options)
            if taken := next((name for name in further if name in batch.schema.names), None):
                raise InputFileError(part.file, "schema", f"a column {shown(taken)}", "none of this name")
            arrays = [*batch.columns, *(pa.array(column) for column in further.values())]
            whole = pa.RecordBatch.from_arrays(arrays, names=[*batch.schema.names, *further])
            writer = writer or stack.enter_context(pq.ParquetWriter(file, whole.schema))
            writer.write_batch(whole)
    return undetermined


def in_known_runs(o: Observations, model: Model, runs: Sequence[str]) -> Observations:
    """Return observations whose runs are numbered as those of a fit."""
    known = {name: i for i, name in enumerate(runs)}
    if not model.structure.by_run or len(known) == 1:
        return replace(o, run=np.zeros(o.n, np.int32))
    unknown = next((name for name in o.run_names if name not in known), None)
    if unknown is not None:
        found = f"run {shown(unknown)}, which was not measured"
        raise InputFileError(o.data.file, "column 'run'", found, listed(known))
    return replace(o, run=np.array([known[name] for name in o.run_names], np.int32)[o.run])


def _determined(jacobian: Array, null: Array) -> NDArray[np.bool_]:
    """Return which rows no combination changes that the data leave open."""
    change = np.linalg.norm(np.einsum("nip,kp->nik", jacobian, null), axis=1)
    parts = np.sqrt(np.einsum("nip,kp->nk", jacobian**2, null**2))
    return np.asarray((change <= ROUNDING * parts).all(axis=1))
