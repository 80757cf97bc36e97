"""Score a diagnosis of a machine as it is met: several effects, of which the readings show some."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from hidden_effects import Title, Truth
from scipy import stats

import rodgen
from rodgen.calibration.fit import Estimate, Fit, fit
from rodgen.calibration.problem.binding import bind
from rodgen.calibration.validation import bind_validation, validation_error
from rodgen.machines.machine import Effect

SECONDS, MILLIMETRES = 1800.0, 1.0
IMPOSSIBLE: dict[str, float] = {
    "scale": 0.02, "encoder_eccentricity": SECONDS, "encoder_ellipticity": 600, "periodic_drive_error": 1000,
    "radial_error_motion": MILLIMETRES, "axial_error_motion": MILLIMETRES, "tilt_error_motion": 600,
    "straightness": MILLIMETRES, "angular_error_motion": SECONDS, "thermal_expansion": 1e-3, "gravity_sag": 3.0,
    "guide_windup": SECONDS, "gravity_windup": SECONDS, "lateral_windup": SECONDS, "load_windup": SECONDS / 60,
    "instrument_scale": 0.01, "refraction": 300, "tube_flexure": SECONDS, "backlash_gradient": 1e-3, "servo_lag": 0.5,
    "leg_zero_offset": 5, "leg_scale": 0.01, "leg_thermal_expansion": 1e-3, "leg_backlash": 0.5, "leg_compliance": 0.01,
    "base_joint_offset": 10, "platform_joint_offset": 10, "target_offset": 20, "warm_up_drift": 5,
}  # fmt: skip
"""Sizes that no machine has: mm, arcsec, quotients by K and N; compliances per length times the longest arm."""
BY_ARM = {"guide_windup", "gravity_windup", "lateral_windup", "load_windup"}
NEVER_NEGATIVE = {"lateral_windup", "load_windup", "guide_windup", "leg_compliance"}


def judged_real(
    machine: rodgen.Machine, data: rodgen.Measurements, further: rodgen.Measurements, found: Any, truth: Truth
) -> dict[str, Any]:
    """Compare a diagnosis with the truth.

    Parameters
    ----------
    machine : Machine
    data, further : Measurements
        The readings that were diagnosed, and independent ones of other poses.
    found : Diagnosis
    truth : Truth

    Returns
    -------
    dict
        false : claims for which no true effect stands, neither as the step nor among its aliases, and no true pair, nor
            a true set in the place of two steps.
        missed : effects that the readings must show, and that are in no step.
        named : of each step that is right, whether it is named as the true effect.
        plausible : or, of what the data cannot tell from it, as one that such machines have as often.
        further : error on further readings, over that of the model with all true effects.
        further_shown : the same of the model with those true effects that a test at 1 % rather finds than not.
        coverage : of effects and of geometry, intervals of 95 % that hold the true value, and their number.
        coverage_true : the same of the fit with all true effects, where the set-up is at rest.
        impossible : claimed sizes that no machine has.
    """
    equal = {title: set(truth.equal.get(title, (title,))) for title in truth.effects}
    there = set().union(*equal.values())
    names, classes, steps = list[Title](), list[set[Title]](), list[Any]()
    named = {s.effect.identity: s for s in found.steps}
    replaced = set[Title]()
    for one in found.indistinguishable_sets:
        two, others = [e.identity for e in one.named], [e.identity for e in one.effects]
        if there.issuperset(others) and not there.issuperset(two) and replaced.isdisjoint(two):
            replaced |= set(two)
            for title, k in zip(others, two, strict=False):
                names.append(k)
                classes.append({title})
                steps.append(named[k])
    for s in found.steps:
        if s.effect.identity in replaced:
            continue
        aliases = s.indistinguishable_from
        alone = {s.effect.identity, *(a.effect.identity for a in aliases if not a.effects[1:])}
        pairs_listed = [{e.identity for e in a.effects} for a in aliases if a.effects[1:]]
        true_pair = next((pair for pair in pairs_listed if pair <= there), None)
        for members in [alone] if alone & there or not true_pair else [{one} for one in true_pair]:
            names.append(s.effect.identity)
            classes.append(members)
            steps.append(s)
    # one step may do what two effects do together: it stands for the one that must be seen, or that it names
    first = sorted(equal, key=lambda title: (title not in truth.seen, not equal[title] & set(names)))
    pairs = matched(classes, {title: equal[title] for title in first})
    # where the simulator has real weights, the catalogue's formula leaves a rest, which forms may name
    rests = {place for _, place in truth.inexact}
    false: list[Any] = [list(name) for i, name in enumerate(names) if i not in pairs]
    false += [[u.driver, u.component, u.joint, u.form] for u in found.unexplained if u.joint not in rests]
    right = set(pairs.values())
    missed = sorted(truth.seen - right, key=str)
    record: dict[str, Any] = {
        "seen": sorted(map(list, truth.seen), key=str),
        "false": bool(false),
        "false_claims": false,
        "missed": [list(title) for title in missed],
        "named": [names[i] in equal[title] for i, title in pairs.items()],
        "plausible": [
            names[i] in equal[title] or truth.chance.get(names[i], 0.0) >= truth.chance[title]
            for i, title in pairs.items()
        ],
        "outliers": [len(set(found.outliers) & truth.outliers), len(truth.outliers), len(found.outliers)],
        "wanders": truth.wanders,
        "impossible": _impossible(found, truth),
        "notes": list(found.notes),
    }
    others = bind_validation(machine, further)
    own = _true_model(machine, data, truth, truth.effects)
    shown = _true_model(machine, data, truth, truth.shown) if truth.shown != set(truth.effects) else own
    error, least, of_shown = (validation_error(f, others) for f in (found.final_with_forms, own, shown))
    record |= {"further": error / least, "further_shown": of_shown / least, "further_own": least}
    if not truth.wanders:
        record["coverage_true"] = _of_true_model(own, truth)
    if not false and right == set(truth.effects) and all(record["named"]):  # the model is the true one
        effects = [(title, steps[i].effect, steps[i].parameters) for i, title in pairs.items()]
        record["coverage"] = _coverage(found.final, found.estimates, effects, truth)
    return record


def matched(classes: list[set[Title]], equal: dict[Title, set[Title]]) -> dict[int, Title]:
    """Match steps with true effects, each at most once and as many as possible: step by number to effect.

    Effects that come first are matched in any case where they can be.
    """
    pairs: dict[int, Title] = {}

    def place(title: Title, tried: set[int]) -> bool:
        for i, names in enumerate(classes):
            if i not in tried and names & equal[title]:
                tried.add(i)
                if i not in pairs or place(pairs[i], tried):
                    pairs[i] = title
                    return True
        return False

    for title in equal:
        place(title, set())
    return pairs


def _true_model(
    machine: rodgen.Machine, data: rodgen.Measurements, truth: Truth, effects: Iterable[Title]
) -> Fit:
    """Fit the machine with true effects to the rows that are no gross errors."""
    for title in effects:
        try:
            machine = machine.with_effect(machine.effect(*title))
        except rodgen.RodgenError:  # an effect that the catalogue does not have, or that another one is
            others = [t for t in truth.equal.get(title, ()) if t != title]
            machine = machine.with_effect(machine.effect(*others[0])) if others else machine
    observations = bind(machine, data)
    good = ~np.isin(np.arange(observations.n), list(truth.outliers))
    return fit(machine, observations.take(good))


def _coverage(
    final: Fit,
    estimates: Mapping[str, Estimate],
    effects: Iterable[tuple[Title, Effect, Mapping[str, Estimate]]],
    truth: Truth,
) -> dict[str, list[int]]:
    """Count intervals of 95 % that hold the true value: of effects, with the title that is true, and of geometry."""
    stated = final.observations.sigma is not None
    quantile = stats.norm.ppf(0.975) if stated else stats.t.ppf(0.975, final.degrees_of_freedom)
    of_effects = [
        (estimate, truth.values.get(effect.key(name).replace(".[", "["), 0.0))
        for title, effect, parameters in effects
        if title not in truth.inexact
        for name, estimate in parameters.items()
        if not (name == "tau" and title[0] == "warm_up_drift")  # its interval is not symmetric
    ]
    # where the frame stands says nothing of the machine
    known = [key for key in truth.known & estimates.keys() if not key.startswith("frame.")]
    of_geometry = [(estimates[key], truth.values[key]) for key in known]

    def count(pairs: list[tuple[Estimate, float]]) -> list[int]:
        held = [
            abs(estimate.value - value * (3600.0 if "arcsec" in estimate.unit else 1.0))
            <= quantile * estimate.std
            for estimate, value in pairs
            if estimate.std is not None and estimate.std > 0 and not estimate.convention
        ]
        return [sum(map(bool, held)), len(held)]

    return {"effects": count(of_effects), "geometry": count(of_geometry)}


def _of_true_model(own: Fit, truth: Truth) -> dict[str, list[int]]:
    """Count intervals of the fit with all true effects, whatever was found: the fit's share in `coverage`."""
    effects = [
        (
            effect.identity,
            effect,
            {p.key.rpartition(".")[2]: own.estimates[p.key] for p in own.parameters if effect.owns(p.key)},
        )
        for effect in own.machine.effects
    ]
    return _coverage(own, own.estimates, effects, truth)


def _impossible(found: Any, truth: Truth) -> list[str]:
    """List claimed sizes that no machine has, and compliances that are negative beyond three standard deviations."""
    listed = []
    for step in found.steps:
        name = step.effect.name
        for parameter, estimate in step.parameters.items():
            if parameter in ("P", "tau"):
                continue
            size = abs(estimate.value) * (truth.reach if name in BY_ARM else 1.0)
            most = IMPOSSIBLE.get(name, np.inf) * (1.0 if estimate.unit != "mm/K" else 0.2)
            most = max(most, truth.windup.get(step.effect.identity, 0.0) * truth.reach)  # this machine has it
            negative = (
                name in NEVER_NEGATIVE and estimate.std is not None and estimate.value < -3 * estimate.std
            )
            if size > most or negative:
                listed.append(f"{step.effect.title} {parameter} = {estimate.value:.4g} {estimate.unit}")
    return listed
