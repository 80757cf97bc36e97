"""A fitted mount as a model of TPOINT."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.emit._content import title_of
from rodgen.machines.emit._numbers import Covariance, standard, varied
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.imports.mounts import MOUNTS, Mount
from rodgen.machines.imports.tpoint_model import model_text, terms_of
from rodgen.machines.model import Frame
from rodgen.machines.rigid import complete_basis, rotation_vector

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

_ALIGNED = 1e-9
_SMALL = 0.02
"""Largest turn of a free frame, rad, of which terms are formulas to first order."""


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
    mount = next((mount for mount in MOUNTS.values() if _is(machine, mount)), None)
    if mount is None or machine.measurand.moving:
        axes = "; or ".join(
            " and ".join(f"{name} about {list(axis)}" for name, axis in zip(m.joints, m.axes, strict=True))
            for m in MOUNTS.values()
        )
        expected = f"directions seen by a mount with the axes {axes}, as 'rodgen new' writes it"
        raise InputFileError(file, "[[joint]]", "no mount whose errors TPOINT's terms are", expected)
    scope_of(machine, travel)  # which says what has no value
    gx, _, gz = machine.gravity
    latitude = math.atan2(-gz, -gx) if mount.name == "equatorial" else math.nan
    try:
        found = [terms_of(_with_its_frame(m, file), mount, latitude) for m in varied(machine, covariance)]
    except RodgenError as error:
        if isinstance(error, InputFileError):
            raise
        raise InputFileError(file, "[[effect]]", *str(error).split("; expected ")) from None
    terms = found[0]
    sigma = standard([np.array([each.get(term, 0.0) for term in terms]) for each in found])
    rows, rms = residual or (0, 0.0)
    of_terms = dict(zip(terms, sigma.tolist(), strict=True))
    return model_text(f"{title_of(machine)}. {note}", terms, of_terms, rows=rows, rms=rms / ARCSEC)


def _is(machine: Machine, mount: Mount) -> bool:
    axes = [joint.axis for joint in machine.joints]
    same = tuple(joint.name for joint in machine.joints) == mount.joints and not machine.kinematics.is_closed
    return same and bool(np.allclose(axes, mount.axes, atol=_ALIGNED))


def _with_its_frame(machine: Machine, file: str) -> Machine:
    """Return the mount with the turn of a free frame as tilts of its axes and of what it points with."""
    frame = Frame.fitted(machine.values)
    if machine.measured.frame != "free" or frame is None:
        return machine
    turn = rotation_vector(frame.rotation)
    if float(np.linalg.norm(turn)) > _SMALL:
        found = f"a frame turned by {math.degrees(float(np.linalg.norm(turn))):.3g} deg"
        raise InputFileError(file, "[measured], frame", found, "angles that count nearly from its axes")
    values = dict(machine.values)
    vectors = [(f"{joint.name}.axis", joint.axis) for joint in machine.joints]
    vectors += [(f"target.{target.name}", target.point) for target in machine.targets]
    for key, vector in vectors:
        for x, direction in zip("ab", complete_basis(np.array(vector)), strict=True):
            values[f"{key}.{x}"] = values.get(f"{key}.{x}", 0.0) + float(turn @ direction)
    return replace(machine, values=values)
