"""The last model of a diagnosis: with the effects that were found, and with the forms that no effect explains."""

from __future__ import annotations

from dataclasses import replace

from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit, fit
from rodgen.errors import RodgenError
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine

__all__ = ["last_fit"]


def last_fit(diagnosis: Diagnosis) -> Fit:
    """Return the fit with everything that was found, from what a user would paste into the machine file.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    Fit
        That of the effects alone where there are no forms, or where these cannot be fitted.
    """
    final = diagnosis.final
    blocks = [form.block for form in diagnosis.unexplained if form.block]
    if not blocks:
        return final
    try:
        text = "\n".join([machine_text(final.machine), *blocks])
        machine = machine_of(text, final.machine.file or final.machine.name, Machine)
        machine = replace(machine, values=final.machine.values)
        found = fit(machine, final.observations, outliers=final.outliers)
    except RodgenError:
        return final
    return found if found.rms < final.rms else final
