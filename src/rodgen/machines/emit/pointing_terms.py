"""A fitted mount as terms, and as a model, of TPOINT."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.emit._numbers import Covariance, standard, varied
from rodgen.machines.emit._scope import scope_of
from rodgen.machines.imports.tpoint_model import model_text, terms_of
from rodgen.machines.model import Frame
from rodgen.machines.mounts import MOUNTS, mount_of
from rodgen.machines.rigid import complete_basis, rotation_vector

if TYPE_CHECKING:
    from rodgen.machines.machine import Machine

_SMALL = 0.02
"""Largest turn of a free frame, rad, of which terms are formulas to first order."""


def pointing_terms(
    machine: Machine, covariance: Covariance | None = None, *, others: bool = False
) -> dict[str, tuple[float, float]]:
    """Return the terms of TPOINT that a mount's numbers are, with standard deviations, in arcsec.

    Parameters
    ----------
    machine : Machine
        One for which :func:`rodgen.machines.mounts.mount_of` finds a mount; fitted, or with held effects.
    covariance : pair of keys and covariance, optional
        Of the fit, internal units; without it, or where it is not known, deviations are 0.
    others : bool
        Whether it may have effects that are no terms; these are left out.

    Raises
    ------
    RodgenError
        When it has an effect that is no term, or counts from another frame.
    """
    mount = mount_of(machine)
    assert mount is not None
    gx, _, gz = machine.gravity
    latitude = math.atan2(-gz, -gx) if mount.name == "equatorial" else math.nan
    machines = [_with_its_frame(each) for each in varied(machine, covariance)]
    variants = [terms_of(each, mount, latitude, others=others) for each in machines]
    sigma = standard([np.array([each.get(term, 0.0) for term in variants[0]]) for each in variants])
    return {term: (value, u) for (term, value), u in zip(variants[0].items(), sigma.tolist(), strict=True)}


def _with_its_frame(machine: Machine) -> Machine:
    """Return the mount with the turn of a free frame as tilts of its axes and of what it points with."""
    frame = Frame.fitted(machine.values)
    if machine.measured.frame != "free" or frame is None:
        return machine
    turn = rotation_vector(frame.rotation)
    if float(np.linalg.norm(turn)) > _SMALL:
        found = f"a frame turned by {math.degrees(float(np.linalg.norm(turn))):.3g} deg"
        file = machine.file or machine.name
        raise InputFileError(file, "[measured], frame", found, "angles that count nearly from its axes")
    values = dict(machine.values)
    vectors = [(f"{joint.name}.axis", joint.axis) for joint in machine.joints]
    vectors += [(f"target.{target.name}", target.point) for target in machine.targets]
    for key, vector in vectors:
        for x, direction in zip("ab", complete_basis(np.array(vector)), strict=True):
            values[f"{key}.{x}"] = values.get(f"{key}.{x}", 0.0) + float(turn @ direction)
    return replace(machine, values=values)


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
    from rodgen.machines.emit._content import title_of  # with templates, which terms alone do not need

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
