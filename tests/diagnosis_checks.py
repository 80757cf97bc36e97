"""Does a diagnosis agree with itself and with the data? Checks of its JSON and of its figures, by means of their own.

`check_numbers` reads the dictionary alone. `rms_of` puts fitted numbers into the plain simulator and compares with the
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
from hidden_effects import Hidden, Truth
from machine_simulator import RADIANS, Simulated

import rodgen
from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit, fit
from rodgen.machines.machine import Machine


def loaded(case: Hidden, folder: str | Path) -> tuple[Machine, rodgen.Measurements]:
    """Write the files of a machine with hidden effects, and read them as a user does."""
    machine, data = case.write(folder)
    return rodgen.Machine.load(machine), rodgen.Measurements.load(data)


def diagnosis_of(case: Hidden, folder: str | Path) -> Diagnosis:
    machine, data = loaded(case, folder)
    return fit(machine, data).diagnose()


def diagnosed(case: Hidden, folder: str | Path) -> tuple[Diagnosis, Truth]:
    """Go the way of a user; give the diagnosis, and then the truth."""
    found = diagnosis_of(case, folder)
    assert not case.sealed.opened
    return found, case.sealed.open(found)


def groups(found: Diagnosis) -> list[set[tuple[str, str | None]]]:
    """Return each step with the effects indistinguishable from it."""
    return [
        {
            step.effect.identity,
            *(a.effect.identity for a in step.indistinguishable_from if len(a.effects) == 1),
        }
        for step in found.steps
    ]


VERDICTS = ("nothing_missing", "effects_missing", "wrong_geometry", "unknown_effect", "cannot_tell")


def check_numbers(found: Mapping[str, Any], rows: int) -> None:
    """Assert that verdict, steps, errors and rows of a diagnosis agree; its keys are frozen among the answers.

    Parameters
    ----------
    found : mapping
        What `rodgen diagnose --json` printed.
    rows : int
        Of the measurement file.
    """
    json.dumps(found, allow_nan=False)
    verdict, steps, forms, rms = (found[key] for key in ("verdict", "steps", "unexplained", "rms"))
    assert verdict in VERDICTS
    assert (verdict == "cannot_tell") == bool(found.get("reason"))
    assert (verdict == "unknown_effect") == bool(forms)
    assert steps or verdict != "effects_missing"
    assert not steps or verdict != "nothing_missing"
    assert found["rows"] == rows
    assert found["outliers"] == sorted({*found["outliers"]} & {*range(rows)})
    assert found["dependence"]["independent"] is (found["dependence"]["factor"] == 1.0)
    unknown = None in (rms["before_held_out"], rms["after_held_out"])
    assert ("not_held_out" in found) is unknown
    assert not unknown or found["not_held_out"]["text"].endswith(".")
    errors = [rms["before"], *(each["rms"] for each in (*steps, *forms))]
    assert all(later <= 1.05 * former for former, later in pairwise(errors))
    assert math.isclose(errors[-1], rms["after"], rel_tol=1e-9)
    assert all(1 < each["odds"] <= 1e300 for each in (*steps, *forms))
    titles = [(step["effect"], step["joint"]) for step in steps]
    assert len({*titles}) == len(titles)
    for step, title in zip(steps, titles, strict=True):
        alike = [
            frozenset((e["effect"], e["joint"]) for e in alias["effects"])
            for alias in step["indistinguishable_from"]
        ]
        assert len({frozenset([title]), *alike}) == 1 + len(alike)
        odds = [alias["odds"] for alias in step["indistinguishable_from"]]
        assert odds == sorted(odds, reverse=True)
        # in the place of what every telescope has, others are named as far as the readings do not distinguish them
        assert all(one > 0.01 for one in odds) or step["effect"] in {"tube_flexure", "refraction"}
        assert step["parameters"]
    for form in forms:
        assert form["effect"]["formula"] == form["form"]
        assert {*form["effect"]["parameters"]} == {*form["parameters"]}
    for one in found.get("indistinguishable_sets", []):
        assert {(step["effect"], step["joint"]) for step in one["steps"]} <= {*titles}


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
        for alias in (a["effects"][0] for a in step["indistinguishable_from"] if len(a["effects"]) == 1):
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
