"""A fitted mount as a model of TPOINT."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.emit._content import title_of
from rodgen.machines.emit._numbers import Covariance
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.emit.pointing_terms import pointing_terms
from rodgen.machines.imports.tpoint_model import model_text
from rodgen.machines.mounts import MOUNTS, mount_of

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine


def tpoint_text(
    machine: Machine,
    note: str,
    travel: Any = None,
    covariance: Covariance | None = None,
    residual: tuple[int, float] | None = None,
) -> str:
    """Return the file of the model: the terms and, from a fit, their standard deviations, its rows and its rms.

    Raises
    ------
    InputFileError
        When the machine is no such mount, has an effect that is no term, or a parameter without a value.
    """
    file = machine.file or machine.name
    if mount_of(machine) is None:
        axes = "; or ".join(
            " and ".join(f"{name} about {list(axis)}" for name, axis in zip(m.joints, m.axes, strict=True))
            for m in MOUNTS.values()
        )
        expected = f"directions seen by a mount with the axes {axes}, as 'rodgen new' writes it"
        raise InputFileError(file, "[[joint]]", "no mount whose errors TPOINT's terms are", expected)
    scope_of(machine, travel)  # which says what has no value
    try:
        terms = pointing_terms(machine, covariance)
    except RodgenError as error:
        if isinstance(error, InputFileError):
            raise
        raise InputFileError(file, "[[effect]]", *str(error).split("; expected ")) from None
    rows, rms = residual or (0, 0.0)
    values, sigma = ({term: pair[k] for term, pair in terms.items()} for k in (0, 1))
    return model_text(f"{title_of(machine)}. {note}", values, sigma, rows=rows, rms=rms / ARCSEC)
