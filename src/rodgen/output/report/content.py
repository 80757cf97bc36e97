"""What a report says: every sentence and number of the page, gathered from a diagnosis and a plan."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rodgen.calibration.diagnosis import Alias, DiagnosedEffect, Diagnosis
from rodgen.calibration.diagnosis_text import (
    far_from_usual,
    headline,
    how_to_distinguish,
    in_uncertainties,
    nearest,
    of_one_kind,
    on_sets,
    only_together,
    shares,
    together,
)
from rodgen.calibration.fit import Estimate
from rodgen.calibration.misidentified import on_misidentified
from rodgen.calibration.pointing import pointing
from rodgen.calibration.words import (
    comparison,
    odds_text,
    plain,
    three_digits,
    two_digits,
)
from rodgen.data.measurements import Names
from rodgen.data.units import unit_factor
from rodgen.errors import joined
from rodgen.machines.files.edit import name_with
from rodgen.machines.observations import order_of_rows
from rodgen.output.figures.diagnoses import MOST_RANKED, rungs
from rodgen.output.figures.drawn_rows import coordinate
from rodgen.output.numbers import Shown, minus, noise_name, percent
from rodgen.output.report.hardware import eccentricity, in_hardware, own_errors

if TYPE_CHECKING:
    from rodgen.calibration.plan import Goal, Plan

Content: TypeAlias = dict[str, Any]

NAMED = 12
"""Most targets that are listed; the others are only counted."""
LONG = 300
LARGEST = 1e4
"""Power of ten that no odds are sorted below."""

_VERDICTS = {
    "nothing_missing": "Nothing is missing",
    "effects_missing": "{} missing",
    "wrong_geometry": "The dimensions are not those of the file",
    "unknown_effect": "Something is missing that is not in the catalogue",
    "cannot_tell": "These data cannot tell",
}


def content(diagnosis: Diagnosis, plan: Plan | None, shown: Shown, radii: Mapping[str, float]) -> Content:
    """Return everything that the page says.

    Parameters
    ----------
    radii : mapping of str to float
        Radii of scales in millimetres, by joint.
    """
    fit = diagnosis.base
    return {
        "machine": plain(fit.machine.name, 120),
        "data": ", ".join(
            [plain(_file(fit.observations.data.file), 120), *_recorded(diagnosis, "date", "instrument")]
        ),
        "verdict": diagnosis.verdict,
        "verdict_word": _VERDICTS[diagnosis.verdict].format(_counted(len(diagnosis.steps))),
        "sentence": plain(headline(diagnosis), LONG * 4),
        "next": _next(diagnosis, plan),
        "figures": list(_figures(diagnosis, shown)),
        "unit": shown.unit,
        "own": own_errors(diagnosis.final_with_forms),
        "facts": list(_facts(diagnosis, shown)),
        "joints": list(_joints(diagnosis)),
        "rungs": list(_rungs(diagnosis, shown)),
        "how_held_out": "" if diagnosis.rms.before_held_out is None else f" {fit.held_out().how}",
        "has_test": diagnosis.rms.before_test is not None or diagnosis.rms.after_test is not None,
        "steps": [_step(diagnosis, step, i, shown, radii) for i, step in enumerate(diagnosis.steps, 1)],
        "unexplained": list(_unexplained(diagnosis, shown)),
        "ranking": list(_ranking(diagnosis)),
        "top": MOST_RANKED,
        "hiding": [
            {
                "title": plain(one.effect.title, 80),
                "size": plain(one.text),
                "error": f"{two_digits(one.rms * shown.factor)} {shown.unit}",
                "note": one.how_rare,
            }
            for one in diagnosis.could_hide
            if one.possible
        ][:MOST_RANKED],
        "model": list(_model(diagnosis)),
        "terms": list(_terms(diagnosis)),
        "plan": None if plan is None else _plan(plan),
        "notes": [plain(note, LONG * 4) for note in _notes(diagnosis)],
        "worst": list(_worst(diagnosis, shown)),
        "counted": order_of_rows(fit.observations).counted,
        "two": diagnosis.final_with_forms is not fit,
        "version": _version(),
    }


def _file(name: str | None) -> str:
    return os.path.basename(name) if name else ""


def _version() -> str:
    from importlib.metadata import version

    return version("rodgen")


# the verdict -------------------------------------------------------------------------------------------------------


def _counted(effects: int) -> str:
    words = ("No effect is", "One effect is", "Two effects are", "Three effects are")
    return words[effects] if effects < len(words) else f"{effects} effects are"


def _next(diagnosis: Diagnosis, plan: Plan | None) -> list[Content]:
    """Return what to do next, one line each."""
    found = []
    for step in diagnosis.steps[:2]:
        if step.effect.definition.remedy and not step.indistinguishable_from:
            found.append(
                {
                    "what": f"Remedy for {plain(step.effect.title, 60)}",
                    "text": plain(step.effect.definition.remedy, LONG),
                }
            )
    if diagnosis.verdict == "unknown_effect" and diagnosis.unexplained:
        found.append(
            {
                "what": "Compensate",
                "text": "Add the form with 'rodgen diagnose -o', or paste its block below into the machine file; the "
                "emitted model then has it.",
            }
        )
    goals = plan.goals if plan is not None and plan.count else ()
    asked = [g for g in goals if g.resolvable and (g.kind != "sharpen" or diagnosis.verdict == "cannot_tell")]
    if asked:
        found.append({"what": "Measure next", "text": plain(asked[0].sentences[0], LONG)})
    return found


def _figures(diagnosis: Diagnosis, shown: Shown) -> Iterator[Content]:
    """Yield the numbers in large type."""
    rms = diagnosis.rms
    fit = diagnosis.final
    if diagnosis.steps:
        yield {"name": "error before", "value": shown(rms.before), "unit": shown.unit, "kind": "before"}
        name = "with the effects" if diagnosis.unexplained else "error after"
        after = diagnosis.steps[-1].rms
        yield {"name": name, "value": shown(after), "unit": shown.unit, "kind": "after"}
    else:
        yield {"name": "error", "value": shown(rms.before), "unit": shown.unit, "kind": ""}
    if diagnosis.unexplained:
        name = "with the form as well" if diagnosis.steps else "with the form"
        yield {"name": name, "value": shown(rms.after), "unit": shown.unit, "kind": "after"}
    if rms.after_held_out is not None:
        yield {
            "name": "on poses held out",
            "value": shown(rms.after_held_out),
            "unit": shown.unit,
            "kind": "",
        }
    test = rms.after_test if rms.after_test is not None else rms.before_test
    if test is not None:
        yield {"name": "on the test file", "value": shown(test), "unit": shown.unit, "kind": ""}
    source = noise_name(fit.noise.source)
    if rms.noise is not None:
        yield {"name": source, "value": shown(rms.noise), "unit": shown.unit, "kind": "noise"}
    else:
        yield {"name": "noise", "value": "not known", "unit": "", "kind": "noise"}


# what was measured -------------------------------------------------------------------------------------------------


def _facts(diagnosis: Diagnosis, shown: Shown) -> Iterator[tuple[str, str]]:
    fit = diagnosis.base
    machine, o = fit.machine, fit.observations
    file = plain(_file(machine.file), 80)
    yield "Machine", plain(machine.name, 120) + (f" ({file})" if file else "")
    frame = "in a fitted frame" if machine.measured.frame == "free" else f"in {machine.axes_of_places}"
    yield "Readings", f"{machine.measurand.words}, {frame}"
    poses = int(np.sum(np.diff(o.pose) != 0)) + 1 if o.n else 0
    runs = f" in {len(o.run_names)} runs" if len(o.run_names) > 1 else ""
    yield (
        "Data",
        f"{plain(_file(o.data.file), 80)}: {o.n} row{'s' * (o.n != 1)}, {poses} pose{'s' * (poses != 1)}{runs}",
    )
    names = [plain(target.name, 24) for target in machine.targets]
    yield ("Target" if len(names) == 1 else "Targets"), joined(names, most=NAMED)
    for key in ("date", "instrument", "conditions"):
        for said in _recorded(diagnosis, key):
            yield key.capitalize(), said
    if o.t is not None:
        yield "Time", f"{three_digits(float(np.ptp(o.t)) / 60)} min"
    for name, values in o.temperature.items():
        low, high = (float(f(values)) + machine.reference_temperature for f in (np.min, np.max))
        yield f"Temperature of {plain(name)}", f"{low:.1f} to {high:.1f} °C"
    if o.load is not None:
        yield "Load", f"{three_digits(float(o.load.min()))} to {three_digits(float(o.load.max()))} N"
    others = [plain(name, 24) for name in o.covariates if not name.startswith("T_")]
    if others:
        yield "Other columns", joined(others, most=NAMED)
    yield "Noise", _noise(diagnosis, shown)
    if diagnosis.correlation is not None and diagnosis.correlation.text:
        yield "Dependence", plain(diagnosis.correlation.text, LONG)
    if on_sky := pointing(diagnosis.final_with_forms):
        before = diagnosis.base.rms if diagnosis.found else None
        yield "Pointing", on_sky.sentence(before).partition(": ")[2]
    bad = diagnosis.outliers
    if bad:
        places = o.data.places(np.flatnonzero(diagnosis.base.outliers))
        stars = on_misidentified(diagnosis.final_with_forms, diagnosis.base.outliers)
        yield "Outliers, left out", f"{len(bad)}: {plain(places, LONG)}{f'; {stars}' if stars else ''}"
    else:
        yield "Outliers", "none"


def _recorded(diagnosis: Diagnosis, *keys: str) -> Iterator[str]:
    """Yield what is noted of the measurements: in a column of words, else in the machine file."""
    fit = diagnosis.base
    for key in keys:
        column = fit.observations.data.columns.get(key)
        names = list(column.names) if isinstance(column, Names) else [fit.machine.record.get(key, "")]
        if any(names):
            yield joined([plain(name, 120) for name in names], most=NAMED)


def _noise(diagnosis: Diagnosis, shown: Shown) -> str:
    floor = diagnosis.final.noise
    said = []
    if floor.stated is not None:
        said.append(f"{shown(floor.stated)} {shown.unit} stated")
    if floor.replicates is not None:
        e = floor.replicates
        said.append(
            f"{shown(e.value)} {shown.unit} found from {floor.replicated_poses} repeated poses "
            f"({shown(e.low)} to {shown(e.high)} with 95 %)"
        )
    if in_uncertainties(diagnosis):
        said.append("readings are weighted by their own uncertainties, which differ")
    return "; ".join(said) if said else "not known: none is stated, and no pose was repeated"


def _joints(diagnosis: Diagnosis) -> Iterator[Content]:
    fit = diagnosis.base
    o = fit.observations
    for j, joint in enumerate(fit.machine.joints):
        unit, factor = coordinate(o, j)
        q = o.q[:, j] / factor
        sides = set(np.unique(o.s[:, j]).tolist()) - {0}
        approach = {0: "–", 1: "one way"}.get(len(sides), "both ways")
        if not np.ptp(q) > 0:
            approach = "never moved"
        elif not o.approach_known[j]:
            approach = "not known"
        yield {
            "name": plain(joint.column, 40),
            "type": joint.type,
            "low": _coordinate(float(q.min())),
            "high": _coordinate(float(q.max())),
            "unit": unit,
            "places": len(np.unique(q)),
            "approach": approach,
        }


def _coordinate(value: float) -> str:
    return minus(f"{round(value, 3) + 0.0:g}")


def _worst(diagnosis: Diagnosis, shown: Shown) -> Iterator[Content]:
    """Yield the rows with the largest residuals after, with what they were before."""
    base, final = diagnosis.base, diagnosis.final_with_forms
    size = np.sqrt(np.mean(final.residuals**2, axis=1))
    size = np.where(np.isfinite(size), size, -1.0)
    for row in np.argsort(-size, kind="stable")[:5]:
        o = final.observations
        where = ", ".join(
            f"{plain(joint.column, 16)} {_coordinate(float(o.q[row, j] / coordinate(o, j)[1]))}"
            for j, joint in enumerate(base.machine.joints)
        )
        target = plain(base.machine.targets[int(o.target[row])].name, 24)
        yield {
            "row": int(o.data.numbers([row])[0]),
            "target": target,
            "where": where,
            "before": shown(float(np.sqrt(np.mean(base.residuals[row] ** 2)))),
            "after": shown(float(size[row])),
            "outlier": bool(final.outliers[row] or base.outliers[row]),
        }


def _notes(diagnosis: Diagnosis) -> list[str]:
    """Return the notes of a diagnosis except those that the facts already contain."""
    known = diagnosis.correlation.text if diagnosis.correlation is not None else ""
    notes = [note for note in diagnosis.notes if note != known]
    claims = diagnosis.steps or diagnosis.unexplained or diagnosis.geometry
    first = [] if claims or not diagnosis.ranking else [nearest(diagnosis)]
    more = [only_together(diagnosis), *on_sets(diagnosis), how_to_distinguish(diagnosis)]
    return [*first, *filter(None, more), *notes]


# the ladder, the model ---------------------------------------------------------------------------------------------


def _rungs(diagnosis: Diagnosis, shown: Shown) -> Iterator[Content]:
    file = [diagnosis.geometry.before] if diagnosis.geometry is not None else []
    fits = [*file, *diagnosis.fits, *(form.fit for form in diagnosis.unexplained)]
    for (title, fitted, held, test, odds), fit in zip(rungs(diagnosis), fits, strict=True):
        yield {
            "title": title,
            "fitted": shown(fitted),
            "held": shown(held),
            "test": shown(test),
            "odds": odds,
            "free": len(fit.free),
        }


def _model(diagnosis: Diagnosis) -> Iterator[Content]:
    """Yield the parameters of the model that belong to no effect that was found."""
    keys = {e.key for step in diagnosis.found for e in step.parameters.values()}
    for estimate in diagnosis.estimates.values():
        if estimate.key not in keys and (not estimate.held or estimate.value):
            yield _parameter(plain(estimate.key, 60), estimate)


def _terms(diagnosis: Diagnosis) -> Iterator[Content]:
    """Yield the terms of TPOINT that the numbers of the last model are."""
    if on_sky := pointing(diagnosis.final_with_forms):
        for term, estimate in on_sky.terms.items():
            yield _parameter(term, estimate)


def _parameter(name: str, e: Estimate) -> Content:
    value, std, unit = e.shown
    if e.held:
        std = "held"
    elif e.at_bound:
        std = "at its bound"
    elif not e.determined:
        std = "not determined"
    elif e.convention:
        std = f"{std}, by a choice of coordinates"
    return {"name": name, "value": minus(value), "std": std, "unit": plain(_pretty(unit), 24)}


def _pretty(unit: str) -> str:
    return "" if unit == "1" else unit.replace("um", "µm")


# the effects -------------------------------------------------------------------------------------------------------


def _step(
    diagnosis: Diagnosis, step: DiagnosedEffect, number: int, shown: Shown, radii: Mapping[str, float]
) -> Content:
    effect, definition = step.effect, step.effect.definition
    before = rungs(diagnosis)[number - len(diagnosis.found) - 2]
    first = any(one[0] is step for one in of_one_kind(diagnosis.steps))
    radius = radii.get(str(effect.place))
    per_mm = None
    if effect.name == "encoder_eccentricity" and not definition.own:
        per_mm = eccentricity(step.parameters)
    return {
        "number": number,
        "title": plain(effect.title, 80),
        "name": plain(effect.name, 60),
        "place": plain(effect.place, 60) if effect.place else "the whole machine",
        "equation": plain(definition.equation, LONG),
        "iso": definition.iso,
        "meaning": plain(definition.meaning, LONG * 2) if first else "",
        "usual": plain(definition.usual_size, LONG) if first else "",
        "unusual": far_from_usual(step, diagnosis.base.machine),
        "remedy": plain(definition.remedy, LONG * 2) if first else "",
        "source": plain(definition.source, LONG),
        "odds": odds_text(step.odds),
        "from": shown(before[1]),
        "to": shown(step.rms),
        "held_from": shown(before[2]),
        "held_to": shown(step.rms_held_out),
        "parameters": [_parameter(plain(effect.label(x), 40), e) for x, e in step.parameters.items()],
        "hardware": in_hardware(effect, step.parameters, diagnosis.final, radius),
        "per_mm": None if per_mm is None else f"{per_mm[0]:.6g}",
        "radius": None if radius is None else f"{radius:g}",
        "where": shares(step),
        "aliases": [_alias(alias) for alias in step.indistinguishable_from if alias not in step.shares],
        "command": _add(diagnosis, number),
    }


def _alias(alias: Alias) -> Content:
    meanings = [effect.definition.meaning for effect in alias.effects]
    return {
        "title": plain(together(alias), 160),
        "odds": comparison(alias.odds),
        "meaning": plain(" ".join(meanings), LONG * 4),
    }


def _add(diagnosis: Diagnosis, number: int) -> str:
    """Return the command that adds an effect to the file that the commands before it wrote; nothing without files."""
    machine, data = diagnosis.base.machine, diagnosis.base.observations.data.file
    before = [step.effect for step in diagnosis.steps[: number - 1]]
    effect = diagnosis.steps[number - 1].effect
    if not machine.file:
        return ""
    file = reduce(
        lambda file, effect: name_with(file, (effect.name, effect.place or "")), before, machine.file
    )
    words = ["rodgen", "add", file, effect.name, data]
    if effect.place is not None:
        words += ["--target" if machine.kind_of(effect.place) == "target" else "--joint", effect.place]
    units = effect.units(machine)
    for name, value in effect.hold.items():
        unit = units.get(name, "1")
        size = value / unit_factor(unit, machine.length_unit)[0] if value else 0
        words += ["--hold", f"{name}={size:g}{'' if unit == '1' or not value else unit}"]
    return shlex.join(words)


def _unexplained(diagnosis: Diagnosis, shown: Shown) -> Iterator[Content]:
    what = {
        "reading": "reading",
        **{f"t{x}": f"translation along {x}" for x in "xyz"},
        **{f"r{x}": f"rotation about {x}" for x in "xyz"},
    }
    for number, form in enumerate(diagnosis.unexplained, len(diagnosis.steps)):
        before = rungs(diagnosis)[number - len(diagnosis.found) - 1]
        component = what[form.component]
        yield {
            "driver": plain(form.driver),
            "what": f"{component} at {plain(form.joint)}"
            if form.joint
            else f"{component} of the whole machine",
            "form": plain(form.form, LONG),
            "odds": odds_text(form.odds),
            "from": shown(before[1]),
            "to": shown(form.rms),
            "held_from": shown(before[2]),
            "held_to": shown(form.rms_held_out),
            "parameters": [_parameter(plain(name, 40), e) for name, e in form.parameters.items()],
            "block": form.block.strip(),
        }


# the ranking -------------------------------------------------------------------------------------------------------


def _ranking(diagnosis: Diagnosis) -> Iterator[Content]:
    taken = {s.effect.identity: i for i, s in enumerate(diagnosis.steps, 1)}
    aliases: dict[tuple[str, str | None], list[str]] = {}
    for i, step in enumerate(diagnosis.steps, 1):
        for alias in step.indistinguishable_from:
            if len(alias.effects) == 1:
                aliases.setdefault(alias.effect.identity, []).append(str(i))
    for rank, r in enumerate(diagnosis.ranking, 1):
        key = r.effect.identity
        mark = ""
        if key in taken:
            mark = f"step {taken[key]}"
        elif key in aliases:
            mark = f"like step {' and '.join(aliases[key])}"
        yield {
            "rank": rank,
            "name": plain(r.effect.name, 60),
            "place": plain(r.effect.place, 40) if r.effect.place else "machine",
            "mark": mark,
            "taken": key in taken,
            "odds": odds_text(r.odds),
            "odds_number": f"{max(r.log10_odds, -LARGEST):.3f}",
            "explains": percent(r.explains),
            "explains_number": f"{100 * min(max(r.explains, 0.0), 1.0):.1f}",
            "visible": percent(r.visible),
            "visible_number": f"{100 * min(max(r.visible, 0.0), 1.0):.1f}",
        }


# what to measure next ----------------------------------------------------------------------------------------------


def _plan(plan: Plan) -> Content:
    columns = {**plan.rows, **plan.sky}
    rows = [[_cell(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return {
        "notes": [plain(note, LONG * 2) for note in plan.notes],
        "goals": [_goal(goal) for goal in plan.goals],
        "columns": [plain(name) for name in columns],
        "rows": rows,
        "csv": plan.csv() if rows else "",
    }


def _cell(value: Any) -> str:
    return minus(f"{value:.6g}") if isinstance(value, float) else plain(str(value), 24)


def _goal(goal: Goal) -> Content:
    state = "not possible within the travel"
    if goal.resolvable:
        state = "expected to be reached" if goal.reached else "expected to be reached in part"
        if goal.kind == "sharpen":
            state = ""
    first, *more = goal.sentences
    return {"sentence": plain(first, LONG), "more": [plain(x, LONG * 4) for x in more], "state": state}
