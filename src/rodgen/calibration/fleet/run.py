"""Diagnose every machine of a fleet that has no result yet, on several processors."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import date as calendar
from importlib.metadata import version
from typing import Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate, candidates
from rodgen.calibration.fitted import Fit
from rodgen.calibration.fleet import store
from rodgen.calibration.fleet.changes import moment
from rodgen.calibration.fleet.fleet import Fleet
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.data.units import unit_factor
from rodgen.errors import InputFileError, RodgenError, listed, shown
from rodgen.files import make_folder, unreadable, written_at_once
from rodgen.schedulers import local_processes, workers
from rodgen.stages import stage, step
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import COST, FLEET

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
    pairs = [Pair(name, known.get(name, ""), files.get(name, "")) for name in sorted({*known, *files})]
    if not pairs:
        raise InputFileError(data, "file", "no machine", f"measurements, {listed(DATA)}")
    return pairs


def _files(folder: str, endings: Iterable[str]) -> dict[str, str]:
    """Return the files of a folder with some endings, by their names without them."""
    files: dict[str, str] = {}
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputFileError(folder, "file", f"cannot be read ({error.strerror})", "a folder") from None
    for name in names:
        ending = next((e for e in endings if name.endswith(e)), None)
        if ending is None or name.startswith("."):
            continue
        stem, file = name.removesuffix(ending), os.path.join(folder, name)
        if stem in files:
            raise InputFileError(file, "file", f"a second file of {shown(stem)}", "one file for each machine")
        files[stem] = file
    return files


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

    What was diagnosed before, from the same files, is not diagnosed again; a run that was killed continues.

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
            known = [store.read_result(folder, pair.name) for pair in pairs]
        stale = any(r is not None and r.get("key") != k for r, k in zip(known, keys, strict=True))
        names = tuple(pair.name for pair in pairs)
        plan = store.Plan(_date(folder, date, stale), false_alarms, tuple(history), names)
        _check_history(folder, plan)
        store.write_plan(folder, plan)
        todo = [
            pair
            for pair, key, result in zip(pairs, keys, known, strict=True)
            if result is None or result.get("key") != key or result.get("internal")
        ]
        with closing(_each(todo, jobs, scheduler)) as finished:
            for number, result in finished:
                store.write_result(folder, todo[number].name, result)
        fleet = Fleet.load(folder)
        if [each.result.get("key") for each in fleet.machines] != keys:
            what = "another run of rodgen has written to it, or a file of the fleet has changed"
            raise InputFileError(folder, "file", what, "another folder for each fleet, and one more run")
        return fleet


def _check_apart(folder: str, pairs: Sequence[Pair]) -> None:
    """Refuse a folder of results that has files of the fleet, or where results would replace them."""
    written = [os.path.join(folder, each) for each in ("", store.PLAN, store.MACHINES)]
    taken = set(map(os.path.realpath, written + [store.result_file(folder, pair.name) for pair in pairs]))
    for file in (file for pair in pairs for file in (pair.machine, pair.data) if file):
        place = os.path.realpath(file)
        if not taken.isdisjoint({place, os.path.dirname(place)}):
            expected = "another folder of results"
            raise InputFileError(file, "file", f"in the folder of results, {folder}", expected)


def _date(folder: str, stated: str | None, stale: bool) -> str:
    if stated is None:
        with suppress(InputFileError):
            if not stale:
                return store.read_plan(folder).date
        return calendar.today().isoformat()
    try:
        moment(stated)
    except ValueError:
        raise InputFileError("command line", "--date", shown(stated), "a date, such as 2026-11-25") from None
    return stated


def _check_history(folder: str, plan: store.Plan) -> None:
    """Refuse earlier results that cannot be read, are not earlier, or are of the same date as others."""
    taken: set[object] = {os.path.realpath(folder)}
    for each in plan.history:
        date = store.read_plan(each).date
        if moment(date) >= moment(plan.date) or not taken.isdisjoint({moment(date), os.path.realpath(each)}):
            expected = f"earlier results than of {plan.date}, each of another date; --date says when"
            raise InputFileError(each, "file", f"results of {date}", expected)
        taken.add(moment(date))


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

        def killed(number: int) -> dict[str, Any]:
            why = "its process was killed, perhaps for lack of memory; expected more of it, fewer --jobs, or fewer rows"
            return _failed(why, internal=True) | {"key": _key_of(pairs[number])}

        with local_processes(jobs) if scheduler is None else workers(scheduler) as some:
            yield from some.each(what, diagnose_pair, files, of_killed=killed)


# one machine ---------------------------------------------------------------------------------------


def _key_of(pair: Pair) -> dict[str, Any]:
    """Return what the result of a machine depends on: the contents of its files, and what made it."""
    hashes = {"machine": _sha256(pair.machine), "data": _sha256(pair.data)}
    return {"sha256": hashes, "rodgen": version("rodgen"), "format": store.FORMAT}


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

    if not (pair.machine and pair.data):
        what = "measurements" if pair.machine else "machine file"
        expected = "a machine file and measurements of one name"
        raise InputFileError(pair.machine or pair.data, "file", f"no {what} of this name", expected)
    diagnosis = diagnose(Machine.load(pair.machine), Measurements.load(pair.data))
    base, last = diagnosis.base, diagnosis.final_with_forms
    as_file = _estimates_of(base)
    machine = base.machine
    about = [f"{joint.name} {joint.type}" for joint in machine.joints]
    about += [f"with {effect.title}" for effect in machine.effects]
    stated = base.observations.sigma is not None
    return diagnosis.to_dict() | {
        "fleet": {
            "kind": f"{machine.measured.kind}s by {', '.join(about)}",
            "converged": all(each.solution.converged for each in diagnosis.fits),
            "residual_dof": last.degrees_of_freedom,
            "degrees_of_freedom": None if stated else last.degrees_of_freedom,
            "as_file": as_file,
            "with_found": as_file if last is base else _estimates_of(last),
        }
    }


def _estimates_of(fit: Fit) -> dict[str, Any]:
    """Return what can be compared with other machines and nights, as plain data.

    Whether an effect is found depends on chance where it is as large as the noise. Were only found ones compared, their
    mean would be too large (those that chance enlarges are found), and their spread too small. So every effect of the
    catalogue has an estimate in every machine: that of the fit where it is in the model, else that of adding it, to
    first order. All readings count alike, as in the fit: were they weighed by how they depend on each other, which is
    estimated anew each night, what the model lacks would change the estimates from night to night.

    Parameters
    ----------
    fit : Fit

    Returns
    -------
    dict
        ``"values"``: by key of a parameter its value, standard deviation and unit; ``"effects"``: by the start of
        these keys, the effect's name and place. Parameters that are held or not determined are left out, and so are
        those of set-ups, and effects with a parameter that is searched for, such as a period. What is a choice of
        coordinates is the nearest to the machine file, and thus the same choice for machines of one design.
    """
    values = {
        key: [e.value, e.std, e.unit]
        for key, e in fit.estimates.items()
        if e.std and e.determined and "[" not in key and not key.startswith("frame.")
    }
    effects = {effect.key(""): [effect.name, effect.place] for effect in fit.machine.effects}
    wanted = [e for e in catalogue_effects(fit.machine, fit.observations) if not e.definition.searched]
    with one_thread_in_blas():
        of = Sensitivities.of(fit, wanted)
        basis = orthonormal_basis(of.model.reshape(of.residual.size, -1))
        for candidate in candidates(of, wanted):
            effect = candidate.effect
            if effect.key("") in effects:  # with weights at later joints, too
                continue
            effects[effect.key("")] = [effect.name, effect.place]
            units = effect.units(fit.machine)
            for name, value, std in _first_order(of, basis, candidate):
                factor, _ = unit_factor(units[name], fit.machine.length_unit)
                values[effect.key(name)] = [value / factor, std / factor, units[name]]
    return {"values": values, "effects": effects}


def _first_order(of: Sensitivities, basis: Array, candidate: Candidate) -> list[tuple[str, float, float]]:
    """Return the parameters that a candidate would have, with standard deviations; none where they cannot be seen.

    Parameters
    ----------
    of : Sensitivities
    basis : ndarray, shape (n m, p)
        Of the model's columns.
    candidate : Candidate
    """
    columns = candidate.columns.reshape(of.residual.size, -1)
    length = np.linalg.norm(columns, axis=0)
    if not (np.isfinite(length).all() and length.all()):
        return []
    seen = project_out(basis, columns / length)
    values, vectors = eigh(seen.T @ seen)
    if values.min() < COST.visible**2:
        return []
    covariance = (vectors / values) @ vectors.T
    weights, residual, fit = seen @ covariance, of.residual.ravel(), of.fit
    gradient = -(weights.T @ residual)
    if fit.dependence.independent:
        variances = fit.variance_factor * np.diag(covariance)
    else:
        variances = np.diag(fit.dependence.correlation.covariance_of(weights.reshape(*of.residual.shape, -1)))
    if of.observations.sigma is None:  # what the candidate explains is no noise
        total, degrees = float(residual @ residual), max(fit.degrees_of_freedom - len(gradient), 1)
        left = max(total + float(gradient @ (seen.T @ residual)), 0.0)
        variances = variances * (left / total * fit.degrees_of_freedom / degrees)
    std = np.sqrt(variances)
    if not (np.isfinite(std).all() and std.all()):
        return []
    return [*zip(candidate.short_names, (gradient / length).tolist(), (std / length).tolist(), strict=True)]
