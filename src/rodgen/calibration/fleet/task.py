"""The diagnosis of one machine of a fleet, as plain data."""

from __future__ import annotations

import hashlib
import os
import time
import warnings
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from rodgen.calibration.fleet.pairs import Pair
from rodgen.calibration.fleet.store import FORMAT
from rodgen.errors import InputFileError, RodgenError
from rodgen.files import unreadable

if TYPE_CHECKING:
    from rodgen.calibration.diagnose import Diagnosis


def key_of(pair: Pair) -> dict[str, Any]:
    """Return what the result of a machine depends on: the contents of its files, and what made it."""
    found = {"machine": _sha256(pair.machine), "data": _sha256(pair.data)}
    return {"sha256": found, "rodgen": version("rodgen"), "format": FORMAT}


def _sha256(file: str) -> str:
    """Return the hash of a file; empty where it cannot be read."""
    try:
        with open(file, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def diagnose_pair(pair: Pair) -> dict[str, Any]:
    """Return the diagnosis of a machine, as ``rodgen diagnose --json`` prints it, with ``"fleet"``: what a fleet needs.

    Where it cannot be diagnosed ``"error"`` is a sentence that says why, and ``"internal"`` whether rodgen is at fault.
    """
    begun = time.process_time()
    key = key_of(pair)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            record = _diagnosed(pair)
    except RodgenError as error:
        record = failed(str(error))
    except MemoryError:
        record = failed("out of memory; expected fewer rows or columns, or more memory", internal=True)
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        record = failed(f"an error in rodgen itself: {what}", internal=True)
    return record | {"key": key, "seconds": round(time.process_time() - begun, 3)}


def failed(error: str, *, internal: bool = False) -> dict[str, Any]:
    """Return the result of a machine that could not be diagnosed."""
    return {"error": error, "internal": internal}


def _diagnosed(pair: Pair) -> dict[str, Any]:
    from rodgen.calibration.diagnose import diagnose
    from rodgen.data.measurements import Measurements
    from rodgen.machines.machine import Machine

    for file, other, what in (
        (pair.machine, pair.data, "a machine file"),
        (pair.data, pair.machine, "measurements"),
    ):
        if not file:
            raise InputFileError(
                other, "file", f"no {what.split()[-1]} of this name", f"{what} of the same name"
            )
        if not os.path.exists(file):
            raise unreadable(file, FileNotFoundError(), what)
    return _record(diagnose(Machine.load(pair.machine), Measurements.load(pair.data)))


def _record(found: Diagnosis) -> dict[str, Any]:
    from rodgen.calibration.fleet.estimates import estimates_of

    base, last = found.base, found.final_with_forms
    as_file = estimates_of(base)
    machine = base.machine
    about = [f"{joint.name} {joint.type}" for joint in machine.joints]
    about += [f"with {effect.title}" for effect in machine.effects]
    stated = base.observations.sigma is not None
    return found.to_dict() | {
        "fleet": {
            "kind": f"{machine.measured.kind}s by {', '.join(about)}",
            "converged": all(each.solution.converged for each in found.fits),
            "residual_dof": last.degrees_of_freedom,
            "degrees_of_freedom": None if stated else last.degrees_of_freedom,
            "as_file": as_file,
            "with_found": as_file if last is base else estimates_of(last),
        }
    }
