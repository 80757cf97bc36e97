"""Keep a fit in one file for an audit: a zip archive of machine, data and what was found, with versions and hashes.

Any program that unpacks archives opens it. ``machine.toml`` and the data are the files as they were fitted, to the byte
where they still exist; ``fit.json`` has everything else, also what `rodgen fit --json` prints. Nothing in it is
executed when it is read.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import platform
import tempfile
import zipfile
import zlib
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.solve.least_squares import Solution
from rodgen.data.measurements import Measurements
from rodgen.data.set_aside import SetAside, rows_text
from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.files import check_unpacked, write_file
from rodgen.machines.files.read import machine_of
from rodgen.machines.files.write import machine_text
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, model_of
from rodgen.machines.observations import Observations

ENDINGS = (".csv", ".csv.gz", ".parquet")
FORMAT = 1
FIRST_LINE = 2
"""Of measurements in a CSV file, after the columns' names."""
AGREE = 1e-6
"""Relative difference of the rms from the one that was saved above which another model was fitted."""
_LARGEST = 100_000_000
"""Bytes of what is unpacked, and 200 more for each packed one: more than numbers and text need."""
_EXPECTED = "a fit as Fit.save writes it"


def save(fit: Fit, path: str | os.PathLike[str]) -> None:
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
    if fit.observations.blocks is not None:
        raise InputFileError(path, "file", "a fit to many files", "a fit to one, which the archive holds")
    start = replace(fit.problem.model.machine, file=None)
    with tempfile.TemporaryDirectory() as folder:
        data, as_it_was = _data_file(fit, Path(folder))
        machine = _machine_file(fit, as_it_was=as_it_was)
        again = _bound(_read_machine(machine, "machine.toml", start.values), data, fit)
        if not _equal(again, fit.observations):
            found = "a fit to some rows of observations, whose order and approaches are not in a table"
            raise InputFileError(path, "file", found, "a fit to measurements")
        content = data.read_bytes()
    files = {"machine.toml": machine, data.name: content}
    about = {
        "format": FORMAT,
        "saved": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": _versions(),
        "inputs": {"machine": fit.machine.file, "data": fit.observations.data.file},
        "sha256": {name: hashlib.sha256(text).hexdigest() for name, text in files.items()},
        "settings": {
            "loss": fit.loss,
            "compiled": fit.problem.model.compiled,
            "outliers": again.given(np.flatnonzero(fit.outliers)).tolist(),
            "start": dict(start.values),
            "arm": fit.observations.arm,
        },
        "solution": {
            "values": {p.key: x for p, x in zip(fit.parameters, fit.solution.theta.tolist(), strict=True)},
            "rotation": fit.solution.frame.rotation.tolist(),
            "position": fit.solution.frame.position.tolist(),
            "cost": fit.solution.cost,
            "iterations": fit.solution.iterations,
            "converged": fit.solution.converged,
            "free": [fit.parameters[i].key for i in fit.free],
        },
        "rms": fit.rms,
        "result": fit.to_dict(),
    }
    files["fit.json"] = (json.dumps(about, indent=1, ensure_ascii=False) + "\n").encode()
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
        for name, text in files.items():
            made.writestr(name, text)
    write_file(path, archive.getvalue())


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
    files = _files(file)
    try:
        about = json.loads(files["fit.json"])
        if about["format"] != FORMAT:
            raise InputFileError(file, "fit.json, format", str(about["format"]), str(FORMAT))
        for name, expected in about["sha256"].items():
            if name not in files or hashlib.sha256(files[name]).hexdigest() != expected:
                raise InputFileError(
                    file, name, "not the content that was fitted, by its hash", "the file as it was"
                )
        settings, solution, inputs = about["settings"], about["solution"], about["inputs"]
        machine = _read_machine(files["machine.toml"], inputs["machine"] or "machine.toml", settings["start"])
        name = next(name for name in about["sha256"] if name.endswith(ENDINGS))
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder, os.path.basename(name))
            place.write_bytes(files[name])
            data = replace(Measurements.load(place), file=inputs["data"])
        observations = bind_once(machine, data)
        observations = replace(observations, arm=float(settings.get("arm", 1.0)), arm_is_known=True)
        model = model_of(
            machine, observations.travel, observations.run_names, compiled=bool(settings["compiled"])
        )
        values, keys = solution["values"], [p.key for p in model.parameters]
        if set(keys) != set(values):
            raise _of_another_version(file, about, "other parameters")
        rotation, position = (np.array(solution[name], float) for name in ("rotation", "position"))
        frame = Frame(rotation.reshape(3, 3), position.reshape(3))
        theta = np.array([values[key] for key in keys], float)
        free = tuple(keys.index(key) for key in solution["free"])
        given = observations.counted_as
        named = np.zeros(observations.n if given is None else len(given), bool)
        named[settings["outliers"]] = True
        outliers = observations.counted(named)
        found = Solution(theta, frame, solution["cost"], solution["iterations"], solution["converged"])
        rms, loss = float(about["rms"]), str(settings["loss"])
    except InputFileError:
        raise
    except (
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        StopIteration,
        OverflowError,
        RecursionError,
    ) as error:
        what = f"{type(error).__name__}: {error}"
        raise InputFileError(file, "fit.json", shown(what), _EXPECTED) from None
    problem = Problem(model, observations)
    if outliers.any():
        problem.leave_out(outliers)
    fit = Fit.of(problem, found, free, outliers, loss)
    if not math.isclose(
        fit.rms, rms, rel_tol=AGREE, abs_tol=1e-12 * float(np.abs(observations.reading).max())
    ):
        raise _of_another_version(file, about, f"an rms of {rms:.6g}, which is {fit.rms:.6g} with this one")
    return fit


def _versions() -> dict[str, str]:
    return {name: version(name) for name in ("rodgen", "numpy", "scipy")} | {
        "python": platform.python_version()
    }


def _of_another_version(file: str, about: Any, found: str) -> InputFileError:
    used = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    return InputFileError(
        file, "fit.json", f"{found}: its model was another one", f"the versions that made it: {used}"
    )


def _files(file: str) -> dict[str, bytes]:
    try:
        with zipfile.ZipFile(file) as archive:
            check_unpacked(file, archive, _EXPECTED, _LARGEST + 200 * os.path.getsize(file))
            return {name: archive.read(name) for name in archive.namelist()}
    except InputFileError:
        raise
    except OSError as error:
        raise InputFileError(file, "file", f"cannot be read ({error.strerror})", _EXPECTED) from None
    except (
        zipfile.BadZipFile,
        zipfile.LargeZipFile,
        zlib.error,
        EOFError,
        ValueError,
        RuntimeError,
    ) as error:
        raise InputFileError(file, "file", f"no archive ({error})", _EXPECTED) from None


def _read_machine(text: bytes, name: str, start: Any) -> Machine:
    return replace(machine_of(text.decode(), name), values=dict(start))


def _machine_file(fit: Fit, *, as_it_was: bool) -> bytes:
    """Return the machine file as it is where that is still the machine, and the data are, else one of its own."""
    machine, aside = fit.problem.model.machine, fit.observations.aside
    if aside and not as_it_was:
        lines = rows_text((np.flatnonzero(aside.mask) + FIRST_LINE).tolist())
        entries = (SetAside(lines, file=aside.data.file),) if lines else ()
        machine = replace(machine, measured=replace(machine.measured, set_aside=entries))
    try:
        text = Path(machine.file or "").read_bytes()
        if replace(_read_machine(text, machine.file or "", machine.values), joints=machine.joints) == machine:
            return text
    except (OSError, UnicodeDecodeError, RodgenError):
        pass
    return machine_text(machine).encode()


def _bound(machine: Machine, copy: Path, fit: Fit) -> Observations:
    return bind_once(machine, replace(Measurements.load(copy), file=fit.observations.data.file))


def _data_file(fit: Fit, folder: Path) -> tuple[Path, bool]:
    """Return a copy of the measurements' file where that is still what was fitted, else a table of its own.

    And whether it is that file.
    """
    data = fit.observations.data
    ending = next((ending for ending in ENDINGS if data.file.lower().endswith(ending)), "")
    if ending and os.path.isfile(data.file):
        copy = folder / f"data{ending}"
        try:
            copy.write_bytes(Path(data.file).read_bytes())
            if _equal(_bound(fit.problem.model.machine, copy, fit), fit.observations):
                return copy, True
        except (OSError, RodgenError):
            pass
    from rodgen.data.tables import write_columns

    path, aside = folder / "data.csv", fit.observations.aside
    columns = (aside.data if aside else data).columns.values()
    write_columns(path, {c.text: c.values for c in columns})
    return path, False


def _equal(one: Observations, other: Observations) -> bool:
    """Return whether all is the same but the file and the copies of rows that it has."""
    a, b = list(one.arrays()), list(other.arrays())
    same = len(a) == len(b) and one.run_names == other.run_names
    return same and all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))
