"""Diagnose every machine of a fleet that has no result yet, on several processors."""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from contextlib import closing
from datetime import date as calendar
from datetime import datetime
from typing import Any

from rodgen.calibration.fleet.changes import moment
from rodgen.calibration.fleet.fleet import Fleet
from rodgen.calibration.fleet.pairs import Pair
from rodgen.calibration.fleet.store import (
    PLAN,
    Plan,
    read_plan,
    read_result,
    result_file,
    write_plan,
    write_result,
)
from rodgen.calibration.fleet.task import diagnose_pair, failed, key_of
from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.files import make_folder, written_at_once
from rodgen.schedulers import local_processes, workers
from rodgen.stages import stage, step
from rodgen.statistics.thresholds import FLEET


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
            keys = [key_of(pair) for pair in pairs]
            known = [read_result(folder, pair.name) for pair in pairs]
        stale = any(r is not None and r.get("key") != k for r, k in zip(known, keys, strict=True))
        plan = Plan(_date(folder, date, stale), false_alarms, tuple(history), tuple(pairs))
        _check_history(folder, plan)
        write_plan(folder, plan)
        written = read_plan(folder)
        todo = [
            pair
            for pair, key, result in zip(pairs, keys, known, strict=True)
            if result is None or result.get("key") != key or result.get("internal")
        ]
        with closing(_each(todo, jobs, scheduler)) as found:
            for number, result in found:
                write_result(folder, todo[number].name, result)
        fleet = Fleet.load(folder)
        if fleet.plan != written:
            expected = "another folder for each fleet"
            raise InputFileError(folder, "file", "another run of rodgen has written to it", expected)
        return fleet


def _check_apart(folder: str, pairs: Sequence[Pair]) -> None:
    """Refuse a folder of results that has files of the fleet where results stand."""
    files = [os.path.join(folder, PLAN), *(result_file(folder, pair.name) for pair in pairs)]
    taken = set(map(os.path.realpath, files))
    for file in {file for pair in pairs for file in (pair.machine, pair.data) if file}:
        if os.path.realpath(file) in taken:
            raise InputFileError(
                file, "file", f"in the place of results, {folder}", "another folder of results"
            )


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
    dates: dict[datetime, str] = {}
    for each in plan.history:
        if os.path.realpath(each) == os.path.realpath(folder):
            raise InputFileError(
                each, "file", "the folder of these results", "earlier results, in another folder"
            )
        date = read_plan(each).date
        if moment(date) >= moment(plan.date) or moment(date) in dates:
            other = dates.get(moment(date), folder)
            found = f"results of {date}, with {other} of {plan.date if other == folder else date}"
            raise InputFileError(
                each, "file", found, "earlier results, each of another date; --date says when"
            )
        dates[moment(date)] = each


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
        whole = [Pair(p.name, *(f and os.path.abspath(f) for f in (p.machine, p.data))) for p in pairs]
        with local_processes(jobs) if scheduler is None else workers(scheduler) as some:
            yield from some.each(what, diagnose_pair, whole, of_killed=lambda number: _killed(pairs[number]))


def _killed(pair: Pair) -> dict[str, Any]:
    why = (
        "its process was killed, perhaps for lack of memory; expected more of it, fewer --jobs, or fewer rows"
    )
    return failed(why, internal=True) | {"key": key_of(pair)}
