"""Is a diagnosis what the file formats say? Checks of its JSON and of its figures, by means of their own.

`format_errors` reads the dictionary alone. `rms_of` puts fitted numbers into the plain simulator and compares with the
measurement file, with no residual of rodgen's. `far_aliases` fits each effect that is said to be the same anew.
"""

from __future__ import annotations

import csv
import json
import math
import tomllib
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from machine_simulator import RADIANS, Simulated

import rodgen
from rodgen.calibration.fit import Fit, fit
from rodgen.machines.machine import Machine

VERDICTS = ("nothing_missing", "effects_missing", "unknown_effect", "cannot_tell")
COMPONENTS = ("reading", "tx", "ty", "tz", "rx", "ry", "rz")
KEYS = {"verdict", "rows", "copies", "set_aside", "outliers", "rms", "steps", "unexplained", "dependence"}
RMS = {"before", "after", "before_held_out", "after_held_out", "noise", "unit"}
STEP = {
    "effect",
    "joint",
    "p_value",
    "p_value_of_all",
    "rms",
    "rms_held_out",
    "parameters",
    "indistinguishable_from",
    "indistinguishable_pairs",
    "meaning",
}
UNEXPLAINED = {
    "driver",
    "component",
    "joint",
    "form",
    "p_value",
    "p_value_of_all",
    "rms",
    "rms_held_out",
    "parameters",
    "effect",
}


def _number(value: Any, *, least: float = -math.inf, none: bool = False) -> bool:
    if value is None:
        return none
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and value >= least
    )


def format_errors(
    found: Mapping[str, Any],
    machine: Mapping[str, Any],
    rows: int,
    names: Iterable[str],
    *,
    test: bool = False,
) -> list[str]:
    """List what is not as formats.md, section 4, says.

    Parameters
    ----------
    found : mapping
        What `rodgen diagnose --json` printed.
    machine : mapping
        The machine file.
    rows : int
        Of the measurement file.
    names : iterable of str
        Names of the catalogue.
    test : bool
        Whether `--test` was given.
    """
    errors: list[str] = []

    def hold(true: bool, what: str) -> None:
        if not true:
            errors.append(what)

    joints = [joint["name"] for joint in machine["joint"]]
    targets = [target["name"] for target in machine["target"]]
    names = set(names)
    try:
        json.dumps(found, allow_nan=False)
    except (ValueError, TypeError) as error:
        errors.append(f"no JSON: {error}")
    verdict = found.get("verdict")
    hold(verdict in VERDICTS, f"verdict {verdict!r}")
    wanted = KEYS | ({"reason"} if verdict == "cannot_tell" else set())
    wanted |= {"could_hide"} if verdict == "nothing_missing" else set()
    wanted |= {"indistinguishable_sets"} & set(found)
    wanted |= {"exclude"} if found.get("outliers") else set()
    hold(set(found) == wanted, f"keys {sorted(set(found) ^ wanted)}")
    reason = found.get("reason")
    hold(
        (isinstance(reason, str) and bool(reason)) if verdict == "cannot_tell" else reason is None,
        f"reason {reason!r}",
    )
    hold(found.get("rows") == rows, f"rows {found.get('rows')}, the file has {rows}")
    out = found.get("outliers", [])
    hold(all(type(i) is int and 0 <= i < rows for i in out) and out == sorted(set(out)), f"outliers {out}")

    for one in found.get("indistinguishable_sets", []):
        hold(set(one) == {"steps", "effects", "odds_with_data"}, f"keys of a set {sorted(one)}")
        steps_of = [(s["effect"], s["joint"]) for s in found["steps"]]
        hold(all((s["effect"], s["joint"]) in steps_of for s in one["steps"]), f"no steps {one['steps']}")

    shared = found.get("dependence", {})
    hold(set(shared) == {"independent", "factor", "text"} and bool(shared["text"]), f"dependence {shared}")
    hold(shared.get("independent") is (shared.get("factor") == 1.0), f"dependence {shared}")

    rms = found.get("rms", {})
    further = {"before_test", "after_test"} if test else set()
    hold(set(rms) == RMS | further, f"keys of rms {sorted(set(rms) ^ (RMS | further))}")
    for key in ("before", "after", *further):
        hold(_number(rms.get(key), least=0), f"rms.{key} {rms.get(key)!r}")
    for key in ("before_held_out", "after_held_out", "noise"):
        hold(_number(rms.get(key), least=0, none=True), f"rms.{key} {rms.get(key)!r}")
    unit = "arcsec" if machine["measured"]["kind"] == "direction" else machine["units"]["length"]
    hold(rms.get("unit") == unit, f"rms.unit {rms.get('unit')!r}")

    steps, unexplained = found.get("steps", []), found.get("unexplained", [])
    if verdict == "nothing_missing":
        hold(steps == [] and unexplained == [], "nothing_missing with steps or forms")
    if verdict == "effects_missing":
        hold(bool(steps) and unexplained == [], "effects_missing without steps, or with forms")
    if verdict == "unknown_effect":
        hold(bool(unexplained), "unknown_effect without a form")
    before = rms.get("before", math.inf)
    for n, step in enumerate(steps):
        where = f"steps[{n}]"
        hold(set(step) == STEP, f"{where}: keys {sorted(set(step) ^ STEP)}")
        pairs = step.get("indistinguishable_pairs", [])
        inside = [named for pair in pairs for named in pair["effects"]]
        for named in (step, *step.get("indistinguishable_from", []), *inside):
            place = named.get("joint")
            hold(named.get("effect") in names, f"{where}: effect {named.get('effect')!r}")
            hold(place is None or place in joints + targets, f"{where}: joint {place!r}")
            hold(
                (named.get("effect") == "target_offset") == (place in targets and place not in joints),
                f"{where}: {named.get('effect')} at {place!r}",
            )
        for alias in step.get("indistinguishable_from", []):
            keys = {"effect", "joint", "chi_square", "odds", "odds_with_data"}
            hold(set(alias) == keys, f"{where}: keys of an alias {sorted(alias)}")
        for pair in pairs:
            keys = {"effects", "chi_square", "odds", "odds_with_data"}
            hold(set(pair) == keys and len(pair["effects"]) == 2, f"{where}: keys of a pair {sorted(pair)}")
            for odds in ("odds", "odds_with_data"):
                hold(alias.get(odds, 0) > 0, f"{where}: {odds} {alias.get(odds)}")
        titles = [(a["effect"], a["joint"]) for a in step.get("indistinguishable_from", [])]
        hold(len(set(titles)) == len(titles), f"{where}: an alias twice")
        hold((step.get("effect"), step.get("joint")) not in titles, f"{where}: an alias of itself")
        hold(
            _number(step.get("p_value"), least=1e-300) and step["p_value"] <= 1,
            f"{where}: p {step.get('p_value')}",
        )
        hold(_number(step.get("rms"), least=0), f"{where}: rms")
        hold(_number(step.get("rms_held_out"), least=0, none=True), f"{where}: rms_held_out")
        hold(isinstance(step.get("meaning"), str) and bool(step["meaning"]), f"{where}: meaning")
        hold(bool(step.get("parameters")), f"{where}: no parameters")
        for name, p in step.get("parameters", {}).items():
            hold(set(p) == {"value", "std", "unit"}, f"{where}.{name}: keys {sorted(p)}")
            hold(_number(p.get("value")), f"{where}.{name}: value {p.get('value')!r}")
            hold(_number(p.get("std"), least=0, none=True), f"{where}.{name}: std {p.get('std')!r}")
            hold(isinstance(p.get("unit"), str), f"{where}.{name}: unit {p.get('unit')!r}")
    pairs = [(step.get("effect"), step.get("joint")) for step in steps]
    hold(len(set(pairs)) == len(pairs), f"an effect twice in {pairs}")
    every = [*steps, *unexplained]
    for former, latter in pairwise([before, *(step.get("rms", 0) for step in every)]):
        hold(latter <= former * 1.05, f"rms rises from {former} to {latter}")
    if every and _number(rms.get("after")):
        hold(
            math.isclose(every[-1]["rms"], rms["after"], rel_tol=1e-9),
            "rms.after is not that of the last step",
        )
    elif not every and _number(rms.get("after")) and _number(before):
        hold(math.isclose(before, rms["after"], rel_tol=1e-9), "rms.after differs from before without a step")
    for n, form in enumerate(unexplained):
        where = f"unexplained[{n}]"
        hold(set(form) == UNEXPLAINED, f"{where}: keys {sorted(set(form) ^ UNEXPLAINED)}")
        hold(isinstance(form.get("driver"), str) and bool(form["driver"]), f"{where}: driver")
        hold(form.get("component") in COMPONENTS, f"{where}: component {form.get('component')!r}")
        hold(form.get("joint") is None or form["joint"] in joints, f"{where}: joint {form.get('joint')!r}")
        hold(isinstance(form.get("form"), str) and bool(form["form"]), f"{where}: form")
        hold(_number(form.get("p_value"), least=1e-300), f"{where}: p {form.get('p_value')!r}")
        hold(_number(form.get("rms"), least=0), f"{where}: rms {form.get('rms')!r}")
        hold(_number(form.get("rms_held_out"), least=0, none=True), f"{where}: rms_held_out")
        effect = form.get("effect", {})
        hold(effect.get("formula") == form.get("form"), f"{where}: formula {effect.get('formula')!r}")
        hold(set(effect.get("parameters", ())) == set(form.get("parameters", {0})), f"{where}: parameters")
    return errors


def in_file_units(found: Fit, angle: str) -> dict[str, float]:
    """Give the fitted values as the simulator takes them: angles in the unit of the file."""
    seconds = RADIANS["arcsec"] / RADIANS[angle]
    values = {}
    for key, e in found.estimates.items():
        if not (e.held and e.value == 0.0):
            values[key] = e.value * (seconds if "arcsec" in e.unit else 1.0)
    return values


def rms_of(machine: Path, data: Path, found: Fit, outliers: Iterable[int]) -> float:
    """Give the RMS of a fitted model by the plain simulator: measured less simulated, in the unit of reports."""
    file = tomllib.loads(machine.read_text(encoding="utf-8"))
    header, *body = csv.reader(data.read_text(encoding="utf-8").splitlines())
    columns = {name.partition(" [")[0]: [row[i] for row in body] for i, name in enumerate(header)}

    def numbers(name: str) -> np.ndarray | None:
        return np.array(columns[name], dtype=float) if name in columns else None

    joints = [joint["name"] for joint in file["joint"]]
    kind = file["measured"]["kind"]
    names = {"point": ["x", "y", "z"], "direction": ["ux", "uy", "uz"], "distance": ["d"]}[kind]
    reading = np.stack([np.array(columns[name], dtype=float) for name in names], -1)

    def table(prefix: str) -> np.ndarray | None:
        if not any(f"{prefix}_{name}" in columns for name in joints):
            return None
        return np.stack([numbers(f"{prefix}_{name}") for name in joints], -1)

    simulated = Simulated(file, in_file_units(found, file["units"]["angle"])).measure(
        np.stack([numbers(name) for name in joints], -1),
        target=columns.get("target"),
        s=table("dir"),
        v=table("v"),
        t=numbers("t"),
        temperature={name: numbers(f"T_{name}") for name in joints if f"T_{name}" in columns},
        load=numbers("load"),
        run=columns.get("run"),
    )
    kept = np.ones(len(reading), bool)
    kept[list(outliers)] = False
    if kind == "direction":
        angle = 2 * np.arcsin(np.linalg.norm(reading - simulated, axis=1)[kept] / 2) / RADIANS["arcsec"]
        return float(np.sqrt(np.mean(angle**2) / 2))
    return float(np.sqrt(np.mean((reading - simulated)[kept] ** 2)))


def allowed(rows: int, saved: int) -> float:
    """Give by how many variances an effect may fit worse and still be the same."""
    return (12 + math.log(rows)) * max(saved, 1)


def far_aliases(base: Machine, data: rodgen.Measurements, found: Mapping[str, Any]) -> list[str]:
    """Check each list of indistinguishable effects against full refits.

    Returns
    -------
    list of str
        What stands in a list and differs by more than the rule allows, whether the effects of the later steps are in
        the model or not.
    """
    wrong = []
    steps = [(step["effect"], step["joint"]) for step in found["steps"]]
    out = found["outliers"]
    rows = found["rows"] - len(out)
    for n, step in enumerate(found["steps"]):
        for alias in step["indistinguishable_from"]:
            differences = []
            for others in (steps[:n], steps[:n] + steps[n + 1 :]):
                machine = base
                if (alias["effect"], alias["joint"]) in others:
                    continue
                for title in others:
                    machine = machine.with_effect(machine.effect(*title))
                own, many = refitted(machine, data, steps[n], out)
                other, few = refitted(machine, data, (alias["effect"], alias["joint"]), out)
                variance = own[1]
                differences.append(((other[0] - own[0]) / variance, allowed(rows, many - few)))
            if differences and not any(d < most for d, most in differences):
                said = ", ".join(f"{d:.1f} of {most:.1f}" for d, most in differences)
                wrong.append(
                    f"{steps[n]} ~ {alias['effect']} at {alias['joint']}: chi-square differs by {said}"
                )
    return wrong


def refitted(
    machine: Machine, data: rodgen.Measurements, title: tuple[str, str | None], out: Iterable[int]
) -> tuple[tuple[float, float], int]:
    """Fit a machine with one effect more from scratch; give chi-square, the variance factor, and the rank."""
    from rodgen.calibration.problem.binding import bind

    machine = machine.with_effect(machine.effect(*title))
    observations = bind(machine, data)
    kept = np.ones(observations.n, bool)
    kept[list(out)] = False
    found = fit(machine, observations if kept.all() else observations.take(kept))
    return (found.chi_square, found.variance_factor), found.determinacy.rank
