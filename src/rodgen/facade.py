"""What users call on a machine or a fit, and which function of which module it is.

Machines and fits are data below everything that reads, judges, draws or writes them; their classes name these methods
(`rodgen.methods`), and this module, which nothing imports but the package itself, ties each to its function. For type
checkers it has both classes with the methods in them.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from rodgen.errors import RodgenError
from rodgen.methods import implement

if TYPE_CHECKING:
    from rodgen.calibration import fitted
    from rodgen.calibration.check import Check
    from rodgen.calibration.compare import Comparison
    from rodgen.calibration.dependence import Dependence
    from rodgen.calibration.diagnosis import Diagnosis
    from rodgen.calibration.gross_readings import GrossReading
    from rodgen.calibration.held_out import HeldOut, HeldOutGeometry
    from rodgen.calibration.noise_floor import LackOfFit, NoiseFloor
    from rodgen.calibration.predict import Prediction
    from rodgen.machines import machine
    from rodgen.stages import Progress

    class Machine(machine.Machine):
        """A machine, as users see it."""

        @staticmethod
        def load(path: str | os.PathLike[str]) -> Machine: ...
        def fit(self, data: Any, *, loss: str = "linear", progress: Progress | None = None) -> Fit: ...

    class Fit(fitted.Fit):
        """A fit, as users see it."""

        machine: Machine
        noise: NoiseFloor
        dependence: Dependence
        lack_of_fit: LackOfFit | None
        gross_readings: tuple[GrossReading, ...]
        held_out_geometry: HeldOutGeometry | None

        @staticmethod
        def load(path: str | os.PathLike[str]) -> Fit: ...
        def refit(self, *arguments: Any, **options: Any) -> Fit: ...
        def held_out(self, folds: int | None = None, *, progress: Progress | None = None) -> HeldOut: ...
        def check(self) -> Check: ...
        def compare(self) -> Comparison: ...
        def diagnose(self, *, test: Any = None, progress: Progress | None = None) -> Diagnosis: ...
        def predict(self, design: Any) -> Prediction: ...
        def plot(self, against: str = "order") -> Any: ...


FUNCTIONS = {
    "Diagnosis.document": "rodgen.calibration.diagnosis_text.document",
    "Diagnosis.plot": "rodgen.facade.plot_errors",
    "Derivation.report": "rodgen.symbolic.display.report",
    "Entry._repr_markdown_": "rodgen.symbolic.display.markdown",
    "Entry.steps": "rodgen.symbolic.display.steps",
    "Fit.check": "rodgen.calibration.check.check",
    "Fit.compare": "rodgen.calibration.compare.compare",
    "Fit.correlation": "rodgen.calibration.estimates.correlation",
    "Fit.covariance": "rodgen.calibration.estimates.covariance",
    "Fit.dependence": "rodgen.calibration.dependence.dependence",
    "Fit.diagnose": "rodgen.calibration.diagnose.diagnose",
    "Fit.document": "rodgen.calibration.summary.document",
    "Fit.estimates": "rodgen.calibration.estimates.estimates",
    "Fit.estimates_with": "rodgen.calibration.estimates.estimates_with",
    "Fit.extended": "rodgen.calibration.fit.extended",
    "Fit.gross_readings": "rodgen.calibration.gross_readings.gross_readings",
    "Fit.held_out": "rodgen.calibration.estimates.held_out",
    "Fit.held_out_geometry": "rodgen.calibration.held_out.held_out_geometry",
    "Fit.held_out_of_poses": "rodgen.calibration.held_out.held_out",
    "Fit.lack_of_fit": "rodgen.calibration.noise_floor.lack_of_fit",
    "Fit.load": "rodgen.calibration.archive.load",
    "Fit.noise": "rodgen.calibration.noise_floor.noise_floor",
    "Fit.plot": "rodgen.facade.plot",
    "Fit.predict": "rodgen.calibration.predict.predict",
    "Fit.refit": "rodgen.calibration.fit.refit",
    "Fit.save": "rodgen.calibration.archive.save",
    "Fit.to_dict": "rodgen.calibration.summary.as_dict",
    "Fit.used_rows": "rodgen.calibration.estimates.used_rows",
    "Fit.with_bodies": "rodgen.calibration.fit.with_bodies",
    "Fit.without_bounds": "rodgen.calibration.fit.without_bounds",
    "Fleet.document": "rodgen.calibration.fleet.summary.document",
    "Machine.aside": "rodgen.machines.set_aside.aside",
    "Machine.bringing_back": "rodgen.machines.set_aside.bringing_back",
    "Machine.describe": "rodgen.machines.files.write.description",
    "Machine.emit": "rodgen.machines.emit.emit",
    "Machine.fit": "rodgen.calibration.fit.fit",
    "Machine.load": "rodgen.machines.files.read.read_machine",
    "Machine.save": "rodgen.machines.files.write.save_machine",
    "Machine.setting_aside": "rodgen.machines.set_aside.setting_aside",
    "Machine.validate": "rodgen.machines.files.read.validate",
}
implement(FUNCTIONS)


def plot(fit: fitted.Fit, against: str = "order") -> Any:
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
    return _figure("residual_plot")(fit, against)


def plot_errors(diagnosis: Diagnosis) -> Any:
    """Return the error of each model, fitted and held out, as a figure of Plotly; see ``rodgen.figures.diagnosis``.

    Raises
    ------
    RodgenError
        Where Plotly is not installed.
    """
    return next(_figure("diagnosis")(diagnosis))


def _figure(name: str) -> Any:
    from rodgen.output import figures

    try:
        return getattr(figures, name)
    except ModuleNotFoundError as error:
        raise RodgenError(f"no module {error.name!r}; expected it: pip install 'rodgen[plot]'") from None
