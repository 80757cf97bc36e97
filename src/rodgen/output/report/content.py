"""What a report says: the blocks of a diagnosis and a plan, with what was measured and the figures, in their order."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.diagnosis import DiagnosedEffect, Diagnosis
from rodgen.calibration.diagnosis_text import (
    causes,
    not_seen,
    on_errors,
    on_pointing,
    statements,
    what_could_hide,
)
from rodgen.calibration.misidentified import on_misidentified
from rodgen.calibration.words import capitalized, odds_text, percent, plain, three_digits
from rodgen.data.measurements import Names
from rodgen.document import Block, Bullets, Code, Document, Download, Facts, Figure, Paragraph, Part, Table
from rodgen.errors import counted, joined
from rodgen.machines.observations import order_of_rows
from rodgen.output.figures.diagnoses import MOST_RANKED
from rodgen.output.figures.drawn_rows import coordinate
from rodgen.output.numbers import Shown
from rodgen.output.report.hardware import in_hardware, own_errors

if TYPE_CHECKING:
    from rodgen.calibration.plan import Plan

NAMED = 12
"""Most targets that are listed; the others are only counted."""
LONG = 300
WORST = 5
"""Rows with the largest residuals that are listed."""
RESIDUALS = ("residuals", "around_", "quantiles", "autocorrelation")
"""What names of figures of residuals begin with."""
TERMS = (
    "Error: root mean square of measured minus predicted, per scalar reading, without outliers. For directions it is "
    "the angle on the sphere, divided by √2.",
    "Held out: each pose is predicted by a fit that did not see it. An effect that lowers the fitted error but not "
    "this one fits the noise.",
    "Noise: how well repeated poses agree; without repeated poses, the stated value.",
    "Odds: how many times as probable the model is with an effect as without it, given the readings and what such "
    "machines have. 20 to 1 is strong evidence; no odds are given above a million, as the formulas are not that exact.",
    "±: one standard deviation.",
    "In figures open marks are before, filled ones after, crosses are outliers.",
)


def report(
    diagnosis: Diagnosis,
    plan: Plan | None,
    shown: Shown,
    radii: Mapping[str, float],
    figures: Sequence[Figure],
) -> Document:
    """Return everything that the page says.

    Parameters
    ----------
    diagnosis : Diagnosis
    plan : Plan or None
    shown : Shown
        The unit of errors.
    radii : mapping of str to float
        Radii of scales in millimetres, by joint.
    figures : sequence of Figure
        Places of figures, which are found by their names.
    """
    drawn = {figure.name: figure for figure in figures}
    ladder = drawn["ladder"]
    errors = Part([replace(ladder, title=""), *on_errors(diagnosis)], ladder.title, "section")
    measured = Part(list(_measured(diagnosis, shown)), "What was measured", "section")
    blocks: list[Block] = [
        Part(list(_verdict(diagnosis, plan)), "", f"verdict {diagnosis.verdict}"),
        Facts(list(_sizes(diagnosis, shown)), "", "sizes"),
        *_section("The machine's errors", _machine(diagnosis, radii)),
        Part([errors, measured], "", "two"),
        *_section("Residuals", _residuals(diagnosis, shown, figures)),
        *_section("Candidates, each alone on the base model", _candidates(diagnosis)),
        *_section("What could hide", [*what_could_hide(diagnosis), *not_seen(diagnosis)]),
        *_section("What to measure next", _plan(plan, drawn)),
        *_section("The rest of the model, and how to read this page", _rest(diagnosis)),
    ]
    return Document(blocks, plain(diagnosis.base.machine.name, 120))


def _section(title: str, blocks: Sequence[Block] | Iterator[Block]) -> Iterator[Part]:
    if listed := list(blocks):
        yield Part(listed, title, "section")


def below_the_title(diagnosis: Diagnosis) -> str:
    """Return which data the report is of."""
    file = plain(_file(diagnosis.base.observations.data.file), 120)
    return ", ".join([file, *_recorded(diagnosis, "date", "instrument")])


def _file(name: str | None) -> str:
    return os.path.basename(name) if name else ""


# the verdict -------------------------------------------------------------------------------------------------------


def _verdict(diagnosis: Diagnosis, plan: Plan | None) -> Iterator[Block]:
    *before, (what, error) = statements(diagnosis)
    sentences = [capitalized(error.lstrip(";: ")), *("".join(one) for one in before)]
    yield Paragraph(plain(what, LONG * 4), "word")
    yield Paragraph(plain(" ".join(filter(None, sentences)), LONG * 4), "say")
    todo = [
        (f"Remedy for {plain(step.effect.title, 60)}", step.effect.definition.remedy)
        for step in diagnosis.steps[:2]
        if not step.indistinguishable_from
    ]
    goals = plan.goals if plan is not None and plan.count else ()
    asked = [g for g in goals if g.resolvable and (g.kind != "sharpen" or diagnosis.verdict == "cannot_tell")]
    todo += [("Measure next", goal.sentences[0]) for goal in asked[:1]]
    yield from [Facts(todo, "", "todo")] * any(text for _, text in todo)


def _sizes(diagnosis: Diagnosis, shown: Shown) -> Iterator[tuple[str, str]]:
    """Yield the numbers in large type."""
    rms = diagnosis.rms
    errors: list[tuple[str, float | None]] = [("error before" if diagnosis.found else "error", rms.before)]
    if diagnosis.found:
        errors.append(("error after", rms.after))
    errors.append(("on poses held out", rms.after_held_out))
    errors.append(("on the test file", rms.before_test if rms.after_test is None else rms.after_test))
    yield from ((name, f"{shown(value)} {shown.unit}") for name, value in errors if value is not None)
    yield "noise", "not known" if rms.noise is None else f"{shown(rms.noise)} {shown.unit}"


def _machine(diagnosis: Diagnosis, radii: Mapping[str, float]) -> Iterator[Block]:
    """Yield what was found, how it gets into the machine file, and the errors of the machine as a whole."""

    def more(step: DiagnosedEffect) -> Facts:
        effect, definition = step.effect, step.effect.definition
        hardware = in_hardware(effect, step.parameters, diagnosis.final, radii.get(str(effect.place)))
        rows = [
            ("On the machine", " ".join(hardware)),
            ("Formula", definition.equation),
            ("ISO 230", definition.iso),
        ]
        return Facts(rows)

    yield from causes(diagnosis, more)
    others = [e for step in diagnosis.steps for a in step.indistinguishable_from for e in a.effects]
    named = {step.effect.name for step in diagnosis.steps}
    if rows := {e.name: e.definition.meaning for e in others if e.name not in named}:
        yield Part([Facts([*rows.items()])], "What the alternatives would be", "folded")
    machine, data = diagnosis.base.machine.file, diagnosis.base.observations.data.file
    if diagnosis.found and machine and data:
        command = shlex.join(["rodgen", "diagnose", machine, data, "-o", "better.toml"])
        yield Code(command, "Copy the command that writes a machine file with what was found")
    terms = list(on_pointing(diagnosis))
    parts = [*terms, *own_errors(diagnosis.final_with_forms, locations=not terms)]
    yield from [Part(parts, "", "two" if len(parts) > 1 else "")] * bool(parts)


# what was measured -------------------------------------------------------------------------------------------------


def _measured(diagnosis: Diagnosis, shown: Shown) -> Iterator[Block]:
    yield Facts(list(_facts(diagnosis, shown)))
    yield Table(
        ("joint", "from", "to", "unit", "places", "approached"), list(_joints(diagnosis)), "lrrlrl", "Joints"
    )
    known = diagnosis.correlation.text if diagnosis.correlation is not None else ""
    if notes := [plain(note, LONG * 4) for note in diagnosis.notes if note != known]:
        yield Part([Bullets(notes)], "Notes")


def _facts(diagnosis: Diagnosis, shown: Shown) -> Iterator[tuple[str, str]]:
    fit = diagnosis.base
    machine, o = fit.machine, fit.observations
    file = plain(_file(machine.file), 80)
    yield "Machine", plain(machine.name, 120) + (f" ({file})" if file else "")
    frame = "in a fitted frame" if machine.measured.frame == "free" else f"in {machine.axes_of_places}"
    yield "Readings", f"{machine.measurand.words}, {frame}"
    poses = int(np.sum(np.diff(o.pose) != 0)) + 1 if o.n else 0
    runs = f" in {len(o.run_names)} runs" if len(o.run_names) > 1 else ""
    counts = f"{counted(o.n, 'row')}, {counted(poses, 'pose')}{runs}"
    yield "Data", f"{plain(_file(o.data.file), 80)}: {counts}"
    names = [plain(target.name, 24) for target in machine.targets]
    yield ("Target" if len(names) == 1 else "Targets"), joined(names, most=NAMED)
    for key in ("date", "instrument", "conditions"):
        for text in _recorded(diagnosis, key):
            yield key.capitalize(), text
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
    yield "Noise", diagnosis.final.noise.text
    if diagnosis.correlation is not None:
        yield "Dependence", plain(diagnosis.correlation.text, LONG)
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


def _joints(diagnosis: Diagnosis) -> Iterator[tuple[str, ...]]:
    o = diagnosis.base.observations
    for j, joint in enumerate(o.machine.joints):
        unit, factor = coordinate(o, j)
        q = o.q[:, j] / factor
        sides = set(np.unique(o.s[:, j]).tolist()) - {0}
        approach = {0: "–", 1: "one way"}.get(len(sides), "both ways")
        if not np.ptp(q) > 0:
            approach = "never moved"
        elif not o.approach_known[j]:
            approach = "not known"
        low, high = (_coordinate(float(x)) for x in (q.min(), q.max()))
        yield plain(joint.column, 40), low, high, unit, str(len(np.unique(q))), approach


def _coordinate(value: float) -> str:
    return f"{round(value, 3) + 0.0:g}"


# residuals and candidates ------------------------------------------------------------------------------------------


def _residuals(diagnosis: Diagnosis, shown: Shown, figures: Sequence[Figure]) -> Iterator[Block]:
    yield Part([f for f in figures if f.name.startswith(RESIDUALS)], "", "two")
    if folded := [f for f in figures if f.name.startswith("covariate_")]:
        title = f"Residuals against everything else that varied: {len(folded)} figures"
        yield Part([Part(folded, "", "two")], title, "folded")
    two = diagnosis.final_with_forms is not diagnosis.base
    counted = order_of_rows(diagnosis.base.observations).counted
    header = (counted, "target", "where", *(("before", "after") if two else ("rms",)), shown.unit)
    rows = [row if two else (*row[:3], *row[4:]) for row in _worst(diagnosis, shown)]
    yield Table(header, rows, "lllrrl" if two else "lllrl", "Largest residuals of the last model")


def _worst(diagnosis: Diagnosis, shown: Shown) -> Iterator[tuple[str, ...]]:
    """Yield the rows with the largest residuals after, with what they were before."""
    base, final = diagnosis.base, diagnosis.final_with_forms
    size = np.sqrt(np.mean(final.residuals**2, axis=1))
    size = np.where(np.isfinite(size), size, -1.0)
    o = final.observations
    for row in np.argsort(-size, kind="stable")[:WORST]:
        where = ", ".join(
            f"{plain(joint.column, 16)} {_coordinate(float(o.q[row, j] / coordinate(o, j)[1]))}"
            for j, joint in enumerate(base.machine.joints)
        )
        yield (
            str(o.data.numbers([row])[0]),
            plain(base.machine.targets[int(o.target[row])].name, 24),
            where,
            shown(float(np.sqrt(np.mean(base.residuals[row] ** 2)))),
            shown(float(size[row])),
            "outlier" if final.outliers[row] or base.outliers[row] else "",
        )


def _candidates(diagnosis: Diagnosis) -> Iterator[Block]:
    if not diagnosis.ranking:
        return
    yield Paragraph(
        "Every effect of the catalogue at every place, before anything was added. Explains is its share of the sum of "
        "squared residuals, each in its standard deviation. Visible is the share of the effect that the model's own "
        "parameters cannot imitate. Odds: how many times as probable the model is with it alone as without anything. "
        "Where one effect is missing, others explain a part of it: what has high odds here is missing only if it is "
        "in the model above."
    )
    taken = {step.effect.identity for step in diagnosis.steps}
    like = {
        a.effect.identity
        for step in diagnosis.steps
        for a in step.indistinguishable_from
        if len(a.effects) == 1
    }
    rows = []
    for rank, r in enumerate(diagnosis.ranking, 1):
        key = r.effect.identity
        mark = "in the model" if key in taken else "like one of these" if key in like else ""
        place = plain(r.effect.place, 40) if r.effect.place else "machine"
        numbers = percent(r.explains), percent(r.visible), odds_text(r.odds)
        rows.append((str(rank), plain(r.effect.name, 60), place, *numbers, mark))
    header = ("rank", "effect", "at", "explains", "visible", "odds", "")
    yield Table(header, rows, "rllbrrl", most=MOST_RANKED, kind="sorted ranking")


# what to measure next, and the rest --------------------------------------------------------------------------------


def _plan(plan: Plan | None, figures: Mapping[str, Figure]) -> Iterator[Block]:
    if plan is not None:
        yield from plan.document().blocks
        if plan.count:
            yield Download("plan.csv", plan.csv())
        if "plan" in figures:
            yield Part([figures["plan"]], "", "two")


def _rest(diagnosis: Diagnosis) -> Iterator[Block]:
    keys = {e.key for step in diagnosis.found for e in step.parameters.values()}
    rows = [
        (plain(e.key, 60), e.text)
        for e in diagnosis.estimates.values()
        if e.key not in keys and (not e.held or e.value)
    ]
    if rows:
        title = f"{len(rows)} further parameters of the last model"
        yield Part([Facts(rows)], title, "folded")
    yield Part([Bullets(TERMS)], "What the terms mean", "folded")
