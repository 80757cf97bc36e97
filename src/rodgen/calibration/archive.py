"""Keep a fit in one file for an audit: machine, data and what was found, with versions and hashes, as JSON.

The machine is the text of its file, the data are columns of numbers to the last digit, and the rest is settings, the
solution, and what `rodgen fit --json` prints. Nothing in it is executed when it is read.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.solve.least_squares import Solution
from rodgen.data.measurements import Measurements, Places
from rodgen.errors import InputFileError, shown
from rodgen.files import decoded, read_input, write_file
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.model import Frame, model_of
from rodgen.views import plain

FORMAT = 2
AGREE = 1e-6
"""Relative difference of the rms from the one that was saved above which another model was fitted."""
LARGEST = 4_000_000_000
"""Bytes of a file that is read."""
_EXPECTED = "a fit as Fit.save writes it"


def save(fit: Fit, path: str | os.PathLike[str]) -> None:
    """Write the fit as one file for an audit: machine, data, values, settings, versions, hashes.

    Parameters
    ----------
    path : str or os.PathLike
        A JSON file, such as ``"fit.json"``. It is replaced when the new one is complete.

    Raises
    ------
    InputFileError
        When it cannot be written, or the fit is to many files or to some rows of observations.
    """
    o, start = fit.observations, replace(fit.problem.model.machine, file=None)
    if o.table is None or o.blocks is not None:
        found = "a fit to many files, or to some rows of observations"
        raise InputFileError(path, "file", found, "a fit to one table, which the file holds")
    places = o.table._places
    inputs = {
        "machine": machine_text(start),
        "data": {
            "columns": {column.text: column.values.tolist() for column in o.table.columns.values()},
            "header": o.table.header_place,
            "counted": places.counted,
            "first": places.first.tolist(),
            "number": places.number.tolist(),
        },
    }
    about = {
        "format": FORMAT,
        "saved": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": _versions(),
        "files": {"machine": fit.machine.file, "data": o.table.file},
        "sha256": {name: _hash(content) for name, content in inputs.items()},
        **inputs,
        "settings": {
            **plain(
                fit, "loss compiled=problem.model.compiled outliers=outlier_numbers arm=observations.arm"
            ),
            "start": dict(start.values),
        },
        "solution": {
            **plain(fit.solution, "cost iterations converged"),
            "values": {p.key: x for p, x in zip(fit.parameters, fit.solution.theta.tolist(), strict=True)},
            "rotation": fit.solution.frame.rotation.tolist(),
            "position": fit.solution.frame.position.tolist(),
            "free": [fit.parameters[i].key for i in fit.free],
        },
        "rms": fit.rms,
        "result": fit.to_dict(),
    }
    content = json.dumps(about, indent=1, ensure_ascii=False) + "\n"
    _fit_of(os.fspath(path), json.loads(content))  # what would not be read again is not written
    write_file(path, content.encode())


def load(path: str | os.PathLike[str]) -> Fit:
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
    file = os.fspath(path)
    text = decoded(read_input(file, _EXPECTED, largest=LARGEST), file)
    try:
        return _fit_of(file, json.loads(text))
    except InputFileError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        found = shown(f"{type(error).__name__}: {error}")
        raise InputFileError(file, "file", found, _EXPECTED) from None


def _fit_of(file: str, about: Any) -> Fit:
    if about["format"] != FORMAT:
        raise InputFileError(file, "format", str(about["format"]), str(FORMAT))
    for name, expected in about["sha256"].items():
        if _hash(about[name]) != expected:
            wrong = "not the content that was fitted, by its hash"
            raise InputFileError(file, name, wrong, "the file as it was")
    settings, solution, files, data = (about[name] for name in ("settings", "solution", "files", "data"))
    machine = replace(machine_of(about["machine"], files["machine"] or "machine"), values=settings["start"])
    places = Places(data["counted"], np.array(data["first"], int), np.array(data["number"], int))
    table = replace(
        Measurements.from_frame(data["columns"], name=files["data"]),
        header_place=data["header"],
        _places=places,
    )
    observations = replace(bind_once(machine, table), arm=float(settings["arm"]), arm_is_known=True)
    model = model_of(
        machine, observations.travel, observations.run_names, compiled=bool(settings["compiled"])
    )
    values, keys = solution["values"], [p.key for p in model.parameters]
    if set(keys) != set(values):
        raise _of_another_version(file, about, "other parameters")
    rotation, position = (np.array(solution[name], float) for name in ("rotation", "position"))
    frame = Frame(rotation.reshape(3, 3), position.reshape(3))
    theta = np.array([values[key] for key in keys], float)
    least = Solution(theta, frame, solution["cost"], solution["iterations"], solution["converged"])
    rows_counted = observations.counted_as
    named = np.zeros(observations.n if rows_counted is None else len(rows_counted), bool)
    named[settings["outliers"]] = True
    outliers = observations.counted(named)
    problem = Problem(model, observations)
    if outliers.any():
        problem.leave_out(outliers)
    free = tuple(keys.index(key) for key in solution["free"])
    fit, rms = Fit.of(problem, least, free, outliers, str(settings["loss"])), float(about["rms"])
    rounding = 1e-12 * float(np.abs(observations.reading).max())
    if not math.isclose(fit.rms, rms, rel_tol=AGREE, abs_tol=rounding):
        raise _of_another_version(file, about, f"an rms of {rms:.6g}, which is {fit.rms:.6g} here")
    return fit


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _versions() -> dict[str, str]:
    packages = {name: version(name) for name in ("rodgen", "numpy", "scipy")}
    return packages | {"python": platform.python_version()}


def _of_another_version(file: str, about: Any, found: str) -> InputFileError:
    used = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    return InputFileError(
        file, "solution", f"{found}: its model was another one", f"the versions that made it: {used}"
    )
