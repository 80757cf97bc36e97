"""Diagnose every machine of a fleet that has no result yet, on several processors."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import date as calendar
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from rodgen.calibration.fleet.changes import moment
from rodgen.calibration.fleet.fleet import Fleet
from rodgen.calibration.fleet.store import (
    FORMAT,
    MACHINES,
    PLAN,
    Plan,
    read_plan,
    read_result,
    result_file,
    write_plan,
    write_result,
)
from rodgen.errors import InputFileError, RodgenError, listed, shown
from rodgen.files import make_folder, unreadable, written_at_once
from rodgen.schedulers import local_processes, workers
from rodgen.stages import stage, step
from rodgen.statistics.thresholds import FLEET

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import Diagnosis

DATA = (".csv", ".csv.gz", ".parquet")
"""Endings of measurement files."""


@dataclass(frozen=True)
class Pair:
    """A machine of the fleet.

    Attributes
    ----------
    name : str
    machine, data : str
        The files; empty where there is none.
    """

    name: str
    machine: str
    data: str


def pairs_of(machines: str, data: str) -> list[Pair]:
    """Return the machines of a fleet by name.

    Parameters
    ----------
    machines : str
        A folder of machine files, which have the names of their measurements; or one machine file for all.
    data : str
        A folder of measurement files.

    Raises
    ------
    InputFileError
        When there are none.
    """
    if not os.path.exists(machines):
        raise unreadable(machines, FileNotFoundError(), "a folder of machine files, or one machine file")
    files = _files(data, DATA)
    known = _files(machines, (".toml",)) if os.path.isdir(machines) else dict.fromkeys(files, machines)
    found = [Pair(name, known.get(name, ""), files.get(name, "")) for name in sorted({*known, *files})]
    if not found:
        raise InputFileError(data, "file", "no machine", f"measurements, {listed(DATA)}")
    return found


def _files(folder: str, endings: Iterable[str]) -> dict[str, str]:
    """Return the files of a folder with some endings, by their names without them."""
    found: dict[str, str] = {}
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputFileError(folder, "file", f"cannot be read ({error.strerror})", "a folder") from None
    for name in names:
        ending = next((e for e in sorted(endings, key=len, reverse=True) if name.endswith(e)), None)
        if ending is None or name.startswith("."):
            continue
        stem, file = name.removesuffix(ending), os.path.join(folder, name)
        if stem in found:
            raise InputFileError(file, "file", f"a second file of {shown(stem)}", "one file for each machine")
        found[stem] = file
    return found


def diagnose_fleet(
    pairs: Sequence[Pair],
    results: str | os.PathLike[str],
    *,
    history: Sequence[str] = (),
    date: str | None = None,
    false_alarms: float = FLEET.false_alarms,
    jobs: int = 0,
    scheduler: str | None = None,
) -> Fleet:
    """Diagnose machines, and return what they have in common.

    What was diagnosed before, from the same files, is not diagnosed again; a run that was killed goes on where it was.

    Parameters
    ----------
    pairs : sequence of Pair
        As of :func:`pairs_of`.
    results : str or os.PathLike
        A folder, in which each machine gets a file.
    history : sequence of str, optional
        Folders of earlier results of these machines.
    date : str, optional
        When they were measured, ``YYYY-MM-DD``. Left out: that of the run that is continued, else today.
    false_alarms : float, optional
        For the whole fleet, a year.
    jobs : int, optional
        Processes; 0 is this one. A script that asks for more must guard its entry by ``if __name__ == "__main__"``.
    scheduler : str, optional
        As of :func:`rodgen.schedulers.workers`, instead of `jobs`; its workers read the files by the same names.

    Returns
    -------
    Fleet

    Raises
    ------
    InputFileError
        When the folder cannot be written, or a run with another fleet wrote to it, too.
    SchedulerError
        When the scheduler cannot be used.
    """
    folder = os.fspath(results)
    _check_apart(folder, pairs)
    make_folder(folder)
    with written_at_once():
        with stage("reading results"):
            keys = [_key_of(pair) for pair in pairs]
            known = [read_result(folder, pair.name) for pair in pairs]
        stale = any(r is not None and r.get("key") != k for r, k in zip(known, keys, strict=True))
        names = tuple(pair.name for pair in pairs)
        plan = Plan(_date(folder, date, stale), false_alarms, tuple(history), names)
        _check_history(folder, plan)
        write_plan(folder, plan)
        todo = [
            pair
            for pair, key, result in zip(pairs, keys, known, strict=True)
            if result is None or result.get("key") != key or result.get("internal")
        ]
        with closing(_each(todo, jobs, scheduler)) as found:
            for number, result in found:
                write_result(folder, todo[number].name, result)
        fleet = Fleet.load(folder)
        if [(each.name, each.result.get("key")) for each in fleet.machines] != [
            *zip(names, keys, strict=True)
        ]:
            what = "another run of rodgen has written to it, or a file of the fleet has changed"
            raise InputFileError(folder, "file", what, "another folder for each fleet, and one more run")
        return fleet


def _check_apart(folder: str, pairs: Sequence[Pair]) -> None:
    """Refuse a folder of results that has files of the fleet, or where results would replace them."""
    files = [os.path.join(folder, PLAN), *(result_file(folder, pair.name) for pair in pairs)]
    taken = {
        *map(os.path.realpath, files),
        *(os.path.realpath(each) for each in (folder, f"{folder}/{MACHINES}")),
    }
    for file in (file for pair in pairs for file in (pair.machine, pair.data) if file):
        place = os.path.realpath(file)
        if not taken.isdisjoint({place, os.path.dirname(place)}):
            expected = "another folder of results"
            raise InputFileError(file, "file", f"in the folder of results, {folder}", expected)


def _date(folder: str, given: str | None, stale: bool) -> str:
    if given is None:
        try:
            return calendar.today().isoformat() if stale else read_plan(folder).date
        except RodgenError:
            return calendar.today().isoformat()
    try:
        moment(given)
    except ValueError:
        raise InputFileError("command line", "--date", shown(given), "a date, such as 2026-11-25") from None
    return given


def _check_history(folder: str, plan: Plan) -> None:
    """Refuse earlier results that cannot be read, are not earlier, or are of the same date as others."""
    dates = [moment(plan.date)]
    for each in plan.history:
        date = read_plan(each).date
        if (
            os.path.realpath(each) == os.path.realpath(folder)
            or not moment(date) < dates[0]
            or moment(date) in dates
        ):
            expected = (
                f"earlier results than of {plan.date}, each of another date and folder; --date says when"
            )
            raise InputFileError(each, "file", f"results of {date}", expected)
        dates.append(moment(date))


def _each(
    pairs: Sequence[Pair], jobs: int, scheduler: str | None
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Yield the number of each machine and its result as soon as it is there."""
    what = "diagnosing machines"
    if not jobs and scheduler is None:
        with stage(what, len(pairs)):
            for number, pair in enumerate(pairs):
                yield number, diagnose_pair(pair)
                step(number + 1)
    elif pairs:
        files = pairs
        if scheduler is not None:  # its workers are in other folders
            files = [Pair(p.name, *(f and os.path.abspath(f) for f in (p.machine, p.data))) for p in pairs]
        with local_processes(jobs) if scheduler is None else workers(scheduler) as some:
            yield from some.each(what, diagnose_pair, files, of_killed=lambda number: _killed(pairs[number]))


def _killed(pair: Pair) -> dict[str, Any]:
    why = (
        "its process was killed, perhaps for lack of memory; expected more of it, fewer --jobs, or fewer rows"
    )
    return _failed(why, internal=True) | {"key": _key_of(pair)}


# one machine ---------------------------------------------------------------------------------------


def _key_of(pair: Pair) -> dict[str, Any]:
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
    key = _key_of(pair)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            record = _diagnosed(pair)
    except RodgenError as error:
        record = _failed(str(error))
    except MemoryError:
        record = _failed("out of memory; expected fewer rows or columns, or more memory", internal=True)
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        record = _failed(f"an error in rodgen itself: {what}", internal=True)
    return record | {"key": key}


def _failed(error: str, *, internal: bool = False) -> dict[str, Any]:
    """Return the result of a machine that could not be diagnosed."""
    return {"error": error, "internal": internal}


def _diagnosed(pair: Pair) -> dict[str, Any]:
    from rodgen.calibration.diagnose import diagnose
    from rodgen.data.measurements import Measurements
    from rodgen.machines.machine import Machine

    for file, other, what in (
        (pair.machine, pair.data, "machine file"),
        (pair.data, pair.machine, "measurements"),
    ):
        if not file:
            raise InputFileError(other, "file", f"no {what} of this name", f"{what} of the same name")
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
