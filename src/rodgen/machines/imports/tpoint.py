"""A telescope's mount from TPOINT's files: a pointing run, a model, or both."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from rodgen.errors import InputFileError, joined
from rodgen.machines.imports.imported import Imported
from rodgen.machines.imports.mounts import ALTAZ, EQUATORIAL
from rodgen.machines.imports.tpoint_data import Pointings, read_pointings
from rodgen.machines.imports.tpoint_model import TpointModel, read_model, with_terms


def machine_from_tpoint(
    run: str | None,
    model: str | None = None,
    *,
    latitude: float | None = None,
    from_south: bool = True,
    form: int | None = None,
) -> Imported:
    """Return the mount of a pointing run, or with the terms of a model, or both.

    Parameters
    ----------
    run, model : str or None
        The files; one of them at least.
    latitude : float, optional
        rad; of an equatorial mount, where no run gives it.
    from_south : bool
        Whether azimuths of the run are from south through east, else from north.
    form : {1, 2, 3, 4}, optional
        Format of the run's observations; default: that which their numbers fit.

    Returns
    -------
    Imported
        Without a model a base fit adjusts axes and boresight. The terms of a model are effects with held parameters.

    Raises
    ------
    InputFileError
    """
    pointings = read_pointings(run, from_south=from_south, form=form) if run else None
    terms = read_model(model) if model else None
    mount = pointings.mount if pointings else (terms and terms.mount) or ALTAZ
    if latitude is None and pointings and pointings.site:
        latitude = pointings.site.latitude
    if latitude is None:
        if mount is EQUATORIAL:
            raise InputFileError(
                model or run or "",
                "--latitude",
                "missing, for an equatorial mount",
                "such as --latitude 31.7deg",
            )
        latitude = 0.0
    notes: list[str] = []
    if pointings:
        notes.append(
            f"{os.path.basename(run or '')}: a pointing run, {len(pointings.seen)} stars, {mount.words}."
        )
        notes += pointings.notes
    notes.append(f"Axes {mount.joints[0]} and {mount.joints[1]}; {mount.frame}.")
    title = pointings.caption if pointings else terms.caption if terms else mount.words
    machine = mount.machine(title, latitude, temperature=_temperature(pointings))
    if terms:
        notes.append(_on_model(os.path.basename(model or ""), terms))
        machine = with_terms(machine, mount, terms, latitude, model or "")
    return Imported(machine, tuple(notes), _columns(pointings) if pointings else {}, source=run or "")


def _temperature(pointings: Pointings | None) -> float:
    site = pointings.site if pointings else None
    return 20.0 if site is None or site.temperature is None else site.temperature


def _on_model(file: str, terms: TpointModel) -> str:
    return f"{file}: a model, whose terms are held effects: {joined(terms.terms)} (arcsec there, deg here)."


def _columns(pointings: Pointings) -> dict[str, Any]:
    commanded = np.degrees(pointings.commanded).round(10)
    found: dict[str, Any] = {
        f"{name} [deg]": column for name, column in zip(pointings.mount.joints, commanded.T, strict=True)
    }
    found |= dict(zip(("ux", "uy", "uz"), pointings.seen.T.round(12), strict=True))
    if pointings.time is not None:
        found["t [s]"] = pointings.time.round(3)
    found |= {f"aux_{k}": column for k, column in enumerate(pointings.auxiliary.T, start=1)}
    return found
