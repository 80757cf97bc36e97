"""Diagnoses put together by hand from real fits: what the tests of the report share, with every verdict."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from rodgen.calibration.diagnosis import Alias, DiagnosedEffect, Diagnosis, Ranked, Rms, Unexplained
from rodgen.calibration.fit import Fit, fit
from rodgen.calibration.held_out import held_out
from rodgen.calibration.ladder import ladder
from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.files.read import effect_of
from rodgen.machines.machine import Effect, Joint, Machine, Measured, Target

__all__ = ["HOSTILE", "diagnosis_of", "hostile", "mount", "of_machine", "ranked", "table"]

MACHINES = Path(__file__).parent.parent / "examples/machines"
HOSTILE = "</script><img src=x onerror=alert(1)>\"'&<b>µ"
"""A name that wants out of whatever it is written into."""


def ranked(effects: Sequence[Effect], first: float = 60.0) -> tuple[Ranked, ...]:
    """Rank effects as they are listed."""
    return tuple(
        Ranked(effect, first - 6.0 * i, 1 / (1 + i), 0.9 * 0.6**i) for i, effect in enumerate(effects)
    )


def diagnosis_of(
    machine: Machine,
    data: Measurements,
    effects: Sequence[Effect] = (),
    *,
    verdict: str = "",
    aliases: Sequence[Alias] = (),
    unexplained: Sequence[str] = (),
    ranking: Sequence[Effect] = (),
    reason: str | None = None,
    outliers: Sequence[int] = (),
    notes: Sequence[str] = (),
    test: tuple[float, float] | None = None,
) -> Diagnosis:
    """Fit a machine, and again with each effect; say that this is what a diagnosis found."""
    fits: list[Fit]
    if effects:
        rungs = ladder(machine, data, effects).rungs
        fits, unseen = [rung.fit for rung in rungs], [rung.held_out.rms for rung in rungs]
    else:
        fits = [fit(machine, data)]
        unseen = [held_out(fits[0], folds=3).rms]
    fits = [found.refit(outliers=np.isin(np.arange(data.rows), outliers)) for found in fits]
    steps = []
    for i, effect in enumerate(effects, 1):
        prefix = effect.key("")
        parameters = {
            key.removeprefix(f"{prefix}."): e
            for key, e in fits[-1].estimates.items()
            if key.startswith(f"{prefix}.")
        }
        same = tuple(aliases) if i == 1 else ()
        steps.append(DiagnosedEffect(effect, 60.0, fits[i].rms, unseen[i], parameters, same))
    forms = tuple(formed(fits[-1], unexplained))
    last, held = (forms[-1].rms, forms[-1].rms_held_out) if forms else (fits[-1].rms, unseen[-1])
    rms = Rms(fits[0].rms, last, unseen[0], held, fits[-1].noise.value, fits[0].unit, *(test or ()))
    if not verdict:
        verdict = "unknown_effect" if unexplained else "effects_missing" if steps else "nothing_missing"
    return Diagnosis(
        verdict,
        reason,
        fits[0].observations.n,
        tuple(outliers),
        rms,
        tuple(steps),
        forms,
        ranked([*effects, *ranking]),
        tuple(fits),
        None,
        tuple(notes),
        fits[-1].estimates,
    )


def formed(final: Fit, blocks: Sequence[str]) -> Iterator[Unexplained]:
    """Yield forms with the fit that each gives, from what a user would paste into the machine file."""
    machine = final.machine
    for block in blocks:
        effect = effect_of(machine, tomllib.loads(block)["effect"][0], "block", "effect")
        machine = machine.with_effect(effect)
        found = fit(machine, final.observations, outliers=final.outliers)
        parameters = {key.rpartition(".")[2]: e for key, e in found.estimates.items() if effect.owns(key)}
        yield Unexplained(effect, "C", 12.0, found.rms, held_out(found, folds=3).rms, parameters, found)


@cache
def mount() -> Diagnosis:
    """The real telescope, with both of its effects."""
    machine = Machine.load(MACHINES / "mount/machine.toml")
    data = Measurements.load(MACHINES / "mount/mmt_2021.csv")
    windup = machine.effect("gravity_windup", "EL", hold={"k2": 0.0})
    others = [
        machine.effect(name, place)
        for place in ("EL", "AZ")
        for name in ("encoder_eccentricity", "encoder_ellipticity", "scale", "backlash", "tilt_error_motion")
    ]
    return diagnosis_of(
        machine,
        data,
        [windup, machine.effect("refraction")],
        aliases=[Alias((others[0],), 0.3)],
        ranking=others,
        notes=("Neither axis was approached from both sides.",),
    )


@cache
def of_machine(folder: str, *titles: str) -> Diagnosis:
    """One of the example machines, with effects such as ``encoder_eccentricity@C``."""
    machine = Machine.load(MACHINES / folder / "machine.toml")
    data = Measurements.load(MACHINES / folder / "data.csv")
    effects = [machine.effect(name, place or None) for name, _, place in (t.partition("@") for t in titles)]
    return diagnosis_of(
        machine,
        data,
        effects,
        ranking=[
            machine.effect("scale", j.name)
            for j in machine.joints
            if not any(e.name == "scale" and e.place == j.name for e in machine.effects)
        ],
    )


def table(
    rows: int = 72,
    *,
    name: str = "Table",
    joint: str = "C",
    target: str = "ball",
    column: str = "coolant",
    hidden: Sequence[str] = ("encoder_eccentricity@{}:a=20arcsec",),
    file: str = "data.csv",
    **options: object,
) -> Diagnosis:
    """A rotary table with one ball, quickly measured; names are those given."""
    machine = Machine(
        name,
        "mm",
        "deg",
        (0.0, 0.0, -1.0),
        20.0,
        (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
        (Target(target, (100.0, 0.0, 20.0)),),
        Measured("point", "machine", noise=0.002),
        estimate=("target",),
        file="machine.toml",
    )
    commands = np.linspace(0.0, 350.0, rows)
    design = Measurements.from_frame({"C [deg]": commands, column: np.cos(np.arange(rows))}, name=file)
    data = simulate(machine, design, [h.format("C") for h in hidden], noise="2um", seed=1).data
    effects = [machine.effect("encoder_eccentricity", "C")] if hidden else []
    ranking = [
        machine.effect(n, "C") for n in ("backlash", "scale", "radial_error_motion", "tilt_error_motion")
    ]
    return diagnosis_of(machine, data, effects, ranking=ranking, **options)  # type: ignore[arg-type]


def hostile() -> Diagnosis:
    """Names that want out of whatever they are written into."""
    return table(name=HOSTILE, target=HOSTILE, column=HOSTILE, file=HOSTILE)
