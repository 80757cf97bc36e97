"""Fit a machine's model to measurements, and ask the fit everything that can be asked of it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.fitted import Estimate, FittedModel
from rodgen.calibration.solve.staged_fit import FitError
from rodgen.calibration.summary import as_dict, as_text
from rodgen.errors import NotConvergedError, RodgenError
from rodgen.machines.machine import Machine
from rodgen.stages import Progress, reporting, stage
from rodgen.views import brief, html_of

if TYPE_CHECKING:
    from rodgen.calibration.compare import Comparison
    from rodgen.calibration.diagnose import Diagnosis
    from rodgen.calibration.file_check import Check
    from rodgen.calibration.predict import Prediction

__all__ = ["Estimate", "Fit", "FitError", "fit"]


class Fit(FittedModel):
    """A model fitted to measurements, with what can be asked of it; its attributes are those of `FittedModel`."""

    __repr__ = brief
    _repr_html_ = html_of

    @classmethod
    def _of(cls, *end: Any) -> Fit:
        found = super()._of(*end)
        return replace(found, machine=replace(found.machine, doubts=found._doubts))

    def __setstate__(self, state: dict[str, Any]) -> None:
        # A machine is pickled without its fit; with its fit it has it again.
        self.__dict__.update(state)
        self.__dict__["machine"] = replace(self.machine, doubts=self._doubts)

    def _doubts(self) -> str:
        """Return why the fitted machine may be wrong; empty where nothing is known to be."""
        unfinished = "" if self.solution.converged else NotConvergedError.reason
        useless = self.held_out_geometry
        return self.check().sentence or unfinished or (useless.text if useless and not useless.lowers else "")

    # What a fit alone does not need is imported when it is asked for, which saves a fifth of a second.

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the fit as one file for an audit: machine, data, values, settings, versions, hashes.

        Parameters
        ----------
        path : str or os.PathLike
            A zip archive, such as ``"fit.zip"``, of ``machine.toml``, the data, and ``fit.json``. It is replaced when
            the new one is complete.

        Raises
        ------
        InputFileError
            When it cannot be written, or the fit is to some rows of observations.
        """
        from rodgen.calibration.archive import save

        save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Fit:
        """Return a fit that was saved, with the values that it had.

        Parameters
        ----------
        path : str or os.PathLike
            As :meth:`save` writes it.

        Raises
        ------
        InputFileError
            When it is no such file, the hash of its machine or data differs from that of the fit, or the model of
            this version of rodgen has another error with these values.
        """
        from rodgen.calibration.archive import load

        return load(cls, path)

    def check(self) -> Check:
        """Return whether the files are plausible, and what mends them: :func:`rodgen.calibration.file_check.check`."""
        from rodgen.calibration.file_check import check

        return check(self)

    def compare(self) -> Comparison:
        """Return where the model is worst, and which of the recorded quantities the residuals depend on."""
        from rodgen.calibration.compare import compare

        return compare(self)

    def plot(self, against: str = "order") -> Any:
        """Return the residuals of each row as a figure of Plotly: ``rodgen.figures.residual_plot`` has more options.

        Parameters
        ----------
        against : str, optional
            What the x axis shows: the order of the rows, a joint, or a column.

        Raises
        ------
        RodgenError
            Where Plotly is not installed, or there is nothing of this name.
        """
        try:
            from rodgen.output.figures import residual_plot
        except ModuleNotFoundError as error:
            raise RodgenError(f"no module {error.name!r}; expected it: pip install 'rodgen[plot]'") from None
        return residual_plot(self, against)

    def predict(self, design: Any) -> Prediction:
        """Return where the machine will be, with uncertainties; see :func:`rodgen.calibration.predict.predict`."""
        from rodgen.calibration.predict import predict

        return predict(self, design)

    def diagnose(self, *, test: Any = None, progress: Progress | None = None) -> Diagnosis:
        """Return which effects the model lacks; see :func:`rodgen.calibration.diagnose.diagnose`."""
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
    data: Any,
    *,
    loss: str = "linear",
    start: Mapping[str, float] | None = None,
    outliers: NDArray[np.bool_] | None = None,
    compiled: bool | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Adjust a machine's parameters until the model meets the measurements best.

    Parameters
    ----------
    machine : Machine
        Its ``estimate`` and the parameters of its effects are adjusted; fitted values that it carries are the start.
    data : Measurements, Observations or a table in memory
        Such as a DataFrame, whose columns are named as those of a measurement file; see
        :meth:`rodgen.data.measurements.Measurements.from_frame`.
    loss : {"linear", "huber"}
        Sum of squares, or one that outliers do not pull: they are found, named and taken out.
    start : mapping of str to float, optional
        Further values to start from, by key, internal units.
    outliers : ndarray of bool, shape (n,), optional
        Rows of `data` that are known not to be believed; only with the linear loss.
    compiled : bool, optional
        Whether the model is compiled: it pays for many rows, many fits of one model, or a robust loss. Left out: with
        the loss "huber", and from 20 000 rows on.
    progress : callable, optional
        Called with the stage, such as "fitting", how many of its steps are done, and of how many; None where that is
        not known.

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
    with reporting(progress), stage("fitting"):
        return Fit.to(machine, data, loss=loss, start=start, outliers=outliers, compiled=compiled)
