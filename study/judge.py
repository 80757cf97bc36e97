"""Score a diagnosis against the known truth."""

from __future__ import annotations

import re
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hidden_effects import Hidden, Truth
from judge_real import judged_real

import rodgen
from rodgen.calibration.fit import Fit, fit

Title = tuple[str, str | None]
DRIFTS = {"warm_up_drift", "linear_drift", "frame_shift"}
STD = 1.959964


def judged(
    case: Hidden, *, with_peers: bool = False, installed: bool = False, show: bool = False
) -> dict[str, Any]:
    """Diagnose a case through the public functions, read the truth, and compare the two.

    Parameters
    ----------
    case : Hidden
    with_peers : bool
        Whether the other methods are run on the same data.
    installed : bool
        Whether the methods that need further packages are available.
    show : bool
        Whether the diagnosis is printed, before the truth is read.

    Returns
    -------
    dict
        Plain data; keys that do not apply are missing.
    """
    with TemporaryDirectory() as folder:
        machine_file, data_file = case.write(Path(folder))
        machine, data = rodgen.Machine.load(machine_file), rodgen.Measurements.load(data_file)
        if case.further is not None:
            further = rodgen.Measurements.load(case.write_further(Path(folder) / "further.csv"))
    base = fit(machine, data)  # kernels are made here, so that they do not count as time of the diagnosis
    start = time.process_time()  # others may use the machine, too
    found = fit(machine, data).diagnose()
    seconds = time.process_time() - start
    if show:
        print(found)
    truth = case.sealed.open(found)

    steps: list[Title] = [(s.effect.name, s.effect.place) for s in found.steps]
    same: list[list[Title]] = [
        [(a.effect.name, a.effect.place) for a in s.indistinguishable_from if not a.effects[1:]]
        for s in found.steps
    ]
    record: dict[str, Any] = {
        "case": case.name,
        "kind": truth.kind,
        "verdict": found.verdict,
        "reason": found.reason,
        "truth": [list(title) for title in truth.effects],
        "values": {key: float(x) for key, x in truth.values.items()},
        "steps": [list(title) for title in steps],
        "p": [-s.log10_odds for s in found.steps],
        "same": [[list(title) for title in titles] for titles in same],
        "unexplained": [[u.driver, u.component, u.joint, u.form] for u in found.unexplained],
        "rms": found.rms.to_dict(),
        "seconds": seconds,
        "claims": bool(steps or found.unexplained),
        "cannot_tell": found.verdict == "cannot_tell",
    }
    if case.further is not None:
        return record | judged_real(machine, data, further, found, truth)
    if truth.kind == "none":
        record["false"] = record["claims"] and not (truth.wanders == "day" and _of_time(found))
    if truth.kind == "catalogue":
        record |= _catalogue(machine, data, found, truth, steps, same)
    if truth.kind == "outside":
        first = found.unexplained[0] if found.unexplained else None
        record |= {
            "recognised": found.verdict == "unknown_effect",
            "reached": found.rms.after / (found.rms.before / truth.raises),
            "driver": first is not None and bool(set(re.findall(r"\w+", first.driver)) & truth.drivers),
            "place": first is not None and first.joint == truth.place,
            "spurious": len(set(steps) - set(truth.effects)),
        }
    if with_peers:
        record["peers"] = _peers(base, truth, steps, installed)
    return record


def _of_time(found: Any) -> bool:
    """Return whether the diagnosis claims only a drift of the set-up in time, which is true under a daily cycle."""
    return all(s.effect.name in DRIFTS for s in found.steps) and all(
        u.driver == "t" for u in found.unexplained
    )


def _catalogue(
    machine: rodgen.Machine,
    data: rodgen.Measurements,
    found: Any,
    truth: Truth,
    steps: list[Title],
    same: list[list[Title]],
) -> dict[str, Any]:
    wanted = set(truth.effects)
    true = machine
    for title in truth.effects:
        true = true.with_effect(true.effect(*title))
    reached = _without(found.final, true, data)
    record: dict[str, Any] = {
        "first": bool(steps) and bool(wanted & {steps[0], *same[0]}),
        "first_named": bool(steps) and steps[0] in wanted,
        "exact": _matched(wanted, steps, same) and not found.unexplained,
        "named": set(steps) == wanted and not found.unexplained,
        "further": len(steps) - len(wanted),
        "aliases": [len(titles) for titles in same],
        "reached": found.rms.after / reached.rms,
    }
    if truth.exact and set(steps) == wanted:
        record["coverage"] = _coverage(found, truth)
    return record


def _without(like: Fit, machine: rodgen.Machine, data: rodgen.Measurements) -> Fit:
    """Fit another machine to the rows that are no outliers of a fit."""
    from rodgen.calibration.problem.binding import bind

    observations = bind(machine, data)
    return fit(machine, observations.take(~like.outliers) if like.outliers.any() else observations)


def _matched(wanted: set[Title], steps: list[Title], same: list[list[Title]]) -> bool:
    """Return whether each true effect is a step of its own, by name or as an effect indistinguishable from it."""
    if len(steps) != len(wanted):
        return False

    def match(rest: list[Title], left: frozenset[int]) -> bool:
        if not rest:
            return True
        return any(match(rest[1:], left - {i}) for i in left if rest[0] == steps[i] or rest[0] in same[i])

    return match(list(wanted), frozenset(range(len(steps))))


def _coverage(found: Any, truth: Truth) -> list[int]:
    """Return how many 95 % intervals contain the true parameter, and how many intervals there are."""
    held = counted = 0
    for step in found.steps:
        for name, estimate in step.parameters.items():
            if estimate.std is None or not estimate.std > 0 or estimate.convention:
                continue  # what is a choice of coordinates has no true value
            # effects of several runs are one group of parameters, with the run in brackets
            true = truth.values.get(step.effect.key(name).replace(".[", "["), 0.0) * (
                3600.0 if "arcsec" in estimate.unit else 1.0
            )
            if name == "tau" and step.effect.name == "warm_up_drift":
                continue  # its interval is not symmetric
            counted += 1
            held += abs(estimate.value - true) <= STD * estimate.std
    return [held, counted]


def _peers(base: Fit, truth: Truth, steps: list[Title], installed: bool) -> dict[str, Any]:
    import peers

    columns = peers.columns_of(base)
    wanted = [title for title in truth.effects if title in columns.titles]
    reachable = columns.held_out(wanted)
    chosen = {"rodgen": [t for t in steps if t in columns.titles]} | peers.chosen_by_all(columns, installed)
    return {
        name: {
            "chosen": len(titles),
            "first": bool(titles) and titles[0] in wanted,
            "exact": set(titles) == set(wanted) and bool(wanted),
            "missed": len(set(wanted) - set(titles)),
            "held_out": columns.held_out(titles) / reachable,
        }
        for name, titles in chosen.items()
    }
