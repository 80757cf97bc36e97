"""The figures of a diagnosis: the falling error, residuals before and after, the candidates, and the planned poses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import plotly.graph_objects as go

from rodgen.calibration.diagnose.diagnosis import Unexplained
from rodgen.calibration.words import plain
from rodgen.data.measurements import Measurements
from rodgen.data.units import parse_unit
from rodgen.output.figures.drawn_rows import Against, DrawnRows, coordinate
from rodgen.output.figures.ladders import error_ladder
from rodgen.output.figures.maps import (
    SKY_NOTE,
    in_machine_axes,
    residuals_in_space,
    residuals_on_the_sky,
    space_note,
)
from rodgen.output.figures.style import (
    BLUE,
    GREY,
    ORANGE,
    OUTLIER,
    Array,
    Index,
    Panel,
    add_trace,
    column,
    describe,
    evenly,
    label,
    mark_size,
)
from rodgen.output.numbers import Shown, percent, shown_unit

if TYPE_CHECKING:
    from rodgen.calibration.diagnose.diagnosis import Diagnosis
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.plan import Plan

__all__ = [
    "LEVEL",
    "MOST_RANKED",
    "Rung",
    "candidates",
    "diagnosis",
    "errors_of",
    "planned_poses",
    "residuals_over",
    "rungs",
    "unit_of",
]

MOST_ARROWS = 300
MOST_RANKED = 10
LEVEL = 0.01
"""Probability of a false alarm among all candidates together."""
MARGIN = 1.12
"""Of the y axis beyond the largest residual."""
PANEL, SINGLE = 140, 260
"""Heights of a panel among others, and alone, in pixels."""
ANGLES = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0)
"""Steps between the numbers of an axis that counts degrees."""

PLANNED = {"symbol": "diamond-open", "size": 9, "color": BLUE, "line": {"width": 2}}

Rung: TypeAlias = tuple[str, float, float | None, float | None]
"""Title, rms fitted, held out, on further measurements."""


def diagnosis(diagnosis: Diagnosis, plan: Plan | None = None) -> Iterator[go.Figure]:
    """Yield every figure of a diagnosis; the name of each is in its ``layout.meta``.

    Parameters
    ----------
    diagnosis : rodgen.calibration.diagnose.Diagnosis
    plan : rodgen.calibration.plan.Plan, optional
        What to measure next.
    """
    shown = unit_of(diagnosis)
    rows = DrawnRows(diagnosis, diagnosis.final_with_forms, shown)
    yield errors_of(diagnosis, shown)
    for against in rows.drivers():
        yield residuals_over(rows, against)
    yield _in_space(rows) if rows.base.machine.measurand.moving else _on_the_sky(rows)
    if diagnosis.ranking:
        yield candidates(diagnosis)
    planned = planned_poses(rows, plan)
    if planned is not None:
        yield planned


def unit_of(diagnosis: Diagnosis) -> Shown:
    """Return the unit in which the errors of a diagnosis are shown."""
    rms = diagnosis.rms
    values: list[float | None] = [rms.before, rms.after, rms.before_held_out, rms.after_held_out, rms.noise]
    values += [step.rms for step in diagnosis.steps]
    return shown_unit(rms.unit, values)


# the falling error -------------------------------------------------------------------------------------------------


def rungs(diagnosis: Diagnosis) -> list[Rung]:
    """Return the models from the base on, each with its errors in the diagnosis' unit."""
    rms = diagnosis.rms
    every = diagnosis.found
    found: list[Rung] = [("base", rms.before, rms.before_held_out, rms.before_test)]
    for i, step in enumerate(every, 1):
        title = plain(step.effect.title, 60)
        if isinstance(step, Unexplained):
            title = f"{plain(step.form, 40)}{f' at {plain(step.joint)}' if step.joint else ''}, outside the catalogue"
        title = f"+ {title}"
        found.append((title, step.rms, step.rms_held_out, rms.after_test if i == len(every) else None))
    return found


def errors_of(diagnosis: Diagnosis, shown: Shown) -> go.Figure:
    """Return the error of each model from the base on: fitted, on poses held out, on the test file, with the noise."""
    steps = rungs(diagnosis)
    fitted, unseen, test = (
        [None if rung[k] is None else float(rung[k] or 0.0) * shown.factor for rung in steps]
        for k in (1, 2, 3)
    )
    noise = None if diagnosis.rms.noise is None else diagnosis.rms.noise * shown.factor
    floor = diagnosis.final.noise
    interval = None
    if noise is not None and floor.source == "replicates" and floor.replicates is not None:
        interval = (floor.replicates.low * shown.factor, floor.replicates.high * shown.factor)
    words = "; ".join(f"{rung[0]} {shown(rung[1])} (held out {shown(rung[2])})" for rung in steps)
    known = "not known" if noise is None else shown.plain(noise)
    return error_ladder(
        [rung[0] for rung in steps],
        [value or 0.0 for value in fitted],
        unseen,
        test=test if any(value is not None for value in test) else (),
        unit=shown.unit,
        title="The error, model by model",
        texts=[
            f"{shown(rung[1])} / {shown(rung[2])}" if rung[2] is not None else shown(rung[1])
            for rung in steps
        ],
        noise=noise,
        interval=interval,
        note="Numbers: fitted / held out." if any(value is not None for value in unseen) else "",
        alt=f"Rms in {shown.unit}: {words}; noise {known}.",
    )


# residuals ---------------------------------------------------------------------------------------------------------


def residuals_over(rows: DrawnRows, against: Against) -> go.Figure:
    """Return the residuals before and after over what they depend on, one of ``rows.drivers()``, in the same axes."""
    driver, sides = against.driver, _sides(rows)
    curves = [_curves(rows, fit, against) for _, fit in sides]
    titles = [title for title, _ in curves[0]]
    height = PANEL if len(titles) > 1 else SINGLE
    below = label(plain(driver.label))
    figure = column([Panel(title, height, below if title is titles[-1] else "") for title in titles])
    x = np.asarray(driver.noted, float)
    hover = [label(tip).replace("\n", "<br>") for tip in rows.tips]
    for number in range(len(titles)):
        limit = _limit(np.concatenate([curve[number][1][~rows.bad] for curve in curves]))
        for (name, fit), curve in zip(sides, curves, strict=True):
            y = curve[number][1]
            for words, mask, mark in _kinds(rows, against, name):
                at = np.flatnonzero(mask & ~rows.bad & np.isfinite(y))
                _dots(
                    figure, number, x[at], y[at], _named(rows, words, name, fit), mark, [hover[i] for i in at]
                )
        bad = np.flatnonzero(rows.bad & np.isfinite(curves[-1][number][1]))
        if len(bad):
            y = np.clip(curves[-1][number][1][bad], -0.95 * limit, 0.95 * limit)
            _dots(figure, number, x[bad], y, "outlier, left out", OUTLIER, [hover[i] for i in bad])
        figure.update_layout({f"yaxis{number + 1}": {"range": [-limit, limit], "zeroline": True}})
    _scale(figure, len(titles), driver, x)
    name = re.sub(r"[^A-Za-z0-9]", "_", driver.name)[:40].strip("_") or "column"
    sizes = ", ".join(f"{name} {rows.shown(fit.rms)} {rows.shown.unit}" for name, fit in sides)
    return describe(
        figure,
        f"residuals_by_{name}",
        f"Residuals over {plain(driver.text)}",
        note=" ".join(filter(None, [_measured(rows), *_remarks(rows, against)])),
        alt=f"Measured minus predicted over {plain(driver.text)}; rms {sizes}.",
    )


def _sides(rows: DrawnRows) -> list[tuple[str, Fit]]:
    return [("before", rows.base), ("after", rows.final)] if rows.two else [("residual", rows.base)]


def _curves(rows: DrawnRows, fit: Fit, against: Against) -> list[tuple[str, Array]]:
    found = []
    if against.joint is not None:
        along, unit = rows.along_reading(fit, against.joint)
        if np.isfinite(along[~rows.bad]).any():
            name = label(plain(fit.machine.joints[against.joint].name, 12))
            found.append((f"reading of {name} [{label(unit)}]", along))
    for name, r in zip(rows.names, rows.residuals(fit).T, strict=True):
        found.append((f"{name} [{label(rows.shown.unit)}]", r))
    return found


def _kinds(rows: DrawnRows, against: Against, name: str) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield the groups that differ by shape: name, rows and mark."""
    colour = {"before": ORANGE, "after": BLUE, "residual": BLUE}[name]
    size = mark_size(len(rows.chosen))
    if against.approach is None:
        symbol = "circle" if name == "after" else "circle-open"
        yield name, np.ones(len(rows.chosen), bool), {"symbol": symbol, "color": colour, "size": size}
        return
    ahead = against.approach >= 0
    for words, mask, symbol in (
        ("forwards", ahead, "triangle-right"),
        ("backwards", ~ahead, "triangle-left-open"),
    ):
        yield f"{name}, {words}", mask, {"symbol": symbol, "color": colour, "size": 1.2 * size}


def _named(rows: DrawnRows, words: str, name: str, fit: Fit) -> str:
    return f"{words}: rms {rows.shown(fit.rms)} {label(rows.shown.unit)}" if words == name else words


def _dots(
    figure: go.Figure, number: int, x: Array, y: Array, name: str, mark: dict[str, Any], hover: Sequence[str]
) -> None:
    add_trace(
        figure, number, name, x=x, y=y, mode="markers", marker={"opacity": 1, **mark}, hovertext=hover,
        hoverinfo="text",
    )  # fmt: skip


def _scale(figure: go.Figure, panels: int, driver: Any, x: Array) -> None:
    """Give the x axes names of categories, or round numbers of degrees."""
    given: dict[str, Any] = {}
    known = x[np.isfinite(x)]
    span = float(np.ptp(known)) if len(known) else 0.0
    if driver.categories:
        names = [label(plain(name, 10)) for name in driver.categories]
        given = {"tickvals": list(range(len(names))), "ticktext": names, "range": [-0.6, len(names) - 0.4]}
    elif driver.unit == "deg" and span >= 5:
        given = {"dtick": next((step for step in ANGLES if span / step <= 6), span / 6)}
    figure.update_layout({f"xaxis{number + 1}": given for number in range(panels)})


def _measured(rows: DrawnRows) -> str:
    if not rows.two:
        return "Measured minus predicted."
    formed = rows.final is not rows.diagnosis.final
    return "Measured minus predicted." + (" After: with the form outside the catalogue." if formed else "")


def _remarks(rows: DrawnRows, against: Against) -> Iterator[str]:
    if against.joint is not None:
        name = plain(rows.base.machine.joints[against.joint].name)
        yield f"At the top: the error of the reading of {name} that would explain each residual best."
    yield rows.thinned
    if rows.bad.any():
        yield "Outliers beyond the axis are drawn at its edge."


def _limit(y: Array) -> float:
    known = np.abs(y[np.isfinite(y)])
    return float(known.max(initial=0.0)) * MARGIN or 1.0


def _in_space(rows: DrawnRows) -> go.Figure:
    """Return residuals where they were measured: arrows of points, signs of distances."""
    some = evenly(np.flatnonzero(~rows.bad & np.isfinite(rows.places).all(axis=1)), MOST_ARROWS)
    residuals = [(name, in_machine_axes(fit, rows.residuals(fit))[some]) for name, fit in _sides(rows)]
    unit, hover = rows.base.machine.length_unit, _hover(rows, some)
    figure = residuals_in_space(rows.places[some], residuals, unit, rows.shown.unit, hover)
    note = " ".join([_measured(rows), space_note(residuals[0][1]), *_few(rows, some)])
    return describe(figure, "residuals_in_space", "Residuals over the workspace", note=note)


def _on_the_sky(rows: DrawnRows) -> go.Figure:
    """Return residuals of directions as arrows, the zenith in the middle."""
    some = evenly(np.flatnonzero(~rows.bad), MOST_ARROWS)
    residuals = [(name, rows.residuals(fit)[some]) for name, fit in _sides(rows)]
    figure = residuals_on_the_sky(
        rows.base, rows.o.take(some), residuals, rows.shown.unit, _hover(rows, some)
    )
    note = " ".join([_measured(rows), SKY_NOTE, *_few(rows, some)])
    return describe(figure, "residuals_on_the_sky", "Residuals on the sky", note=note)


def _hover(rows: DrawnRows, some: Index) -> list[str]:
    return [label(rows.tips[i]).replace("\n", "<br>") for i in some]


def _few(rows: DrawnRows, some: Index) -> list[str]:
    """Say which rows are not on a map."""
    if len(some) < rows.total - int(rows.outlier.sum()):
        return [f"{len(some)} of {rows.total} rows are drawn, evenly spread."]
    return ["Outliers are left out."] if rows.outlier.any() else []


# candidates --------------------------------------------------------------------------------------------------------


def candidates(diagnosis: Diagnosis) -> go.Figure:
    """Return how much the best candidates explain, each alone on the base model, as bars."""
    best = diagnosis.ranking[:MOST_RANKED]
    taken = {s.effect.identity for s in diagnosis.steps}
    share = [100 * min(max(r.explains, 0.0), 1.0) for r in best]
    figure = column([Panel("", 44 * len(best) + 10, "% of the sum of squared residuals")])
    for chosen, name, colour in ((True, "in the model", BLUE), (False, "not in the model", GREY)):
        at = [i for i, r in enumerate(best) if (r.effect.identity in taken) == chosen]
        if at:
            figure.add_trace(
                go.Bar(
                    x=[share[i] for i in at], y=at, width=0.3, orientation="h", name=name,
                    marker={"color": colour, "line": {"width": 0}}, hoverinfo="skip",
                )
            )  # fmt: skip
    said = [percent(r.explains) + (", by chance" if r.log10_p > math.log10(LEVEL) else "") for r in best]
    for i, r in enumerate(best):
        figure.add_annotation(
            x=0, y=i, text=f"<b>{label(plain(r.effect.title, 40))}</b>  {label(said[i])}", xanchor="left",
            yanchor="bottom", yshift=7, showarrow=False, font={"size": 12},
            bgcolor=figure.layout.template.layout.paper_bgcolor, borderpad=0,
        )  # fmt: skip
    figure.update_xaxes(range=[0, 108], showgrid=False)
    figure.update_yaxes(range=[len(best) - 0.5, -0.8], visible=False)
    figure.update_layout(barmode="overlay", margin_l=20)
    listed = "; ".join(f"{plain(r.effect.title)} {part}" for r, part in zip(best[:5], said, strict=False))
    return describe(
        figure,
        "ranking",
        "Candidates, each alone on the base model",
        note="Where one effect is missing, others explain a part of it.",
        alt=f"The best of {len(diagnosis.ranking)}: {listed}.",
    )


# what to measure next ----------------------------------------------------------------------------------------------


def planned_poses(rows: DrawnRows, plan: Plan | None) -> go.Figure | None:
    """Return planned poses among those measured, over the two joints that the plan moves most; None without a plan."""
    new = planned_commands(rows.base, plan)
    if new is None or not len(new):
        return None
    machine, o = rows.base.machine, rows.base.observations
    factors = np.array([coordinate(o, j)[1] for j in range(len(machine.joints))])
    there = o.q[rows.chosen] / factors
    size = np.ptp(np.concatenate([there, new]), axis=0)
    moved = [int(j) for j in np.flatnonzero(size > 0)]
    if not moved:
        return None
    spread = [float(np.ptp(new[:, j]) / (size[j] or 1.0)) for j in range(len(size))]
    # The joints that the question is about come first.
    asked = {step.effect.place for step in rows.diagnosis.steps}
    moved.sort(key=lambda j: (machine.joints[j].name not in asked, -spread[j]))
    names = [label(f"{plain(joint.name)} [{coordinate(o, j)[0]}]") for j, joint in enumerate(machine.joints)]
    single = len(moved) == 1
    a, b = (moved[0], moved[0]) if single else sorted(moved[:2])
    figure = column([Panel("" if single else names[b], 90 if single else 300, names[a])])
    numbers = [f"no. {i + 1}" for i in range(len(new))]
    marks = [
        ("measured", 0, there, {"symbol": "circle", "size": 4, "color": GREY}, None),
        ("planned, in this order", 1, new, PLANNED, numbers),
    ]
    if len(new) > 1:
        marks.append(("the first", 1, new[:1], PLANNED | {"symbol": "diamond"}, numbers[:1]))
    for name, place, q, mark, text in marks:
        y = np.full(len(q), place) if single else q[:, b]
        path = text is not None and len(q) > 1 and not single
        figure.add_trace(
            go.Scatter(
                x=q[:, a], y=y, mode="lines+markers" if path else "markers", marker=mark, name=name,
                line={"color": BLUE, "width": 0.7}, hovertext=text, hoverinfo="text" if text else "skip",
            )
        )  # fmt: skip
    if single:
        figure.update_yaxes(
            tickvals=[0, 1], ticktext=["measured", "planned"], range=[1.5, -0.5], showgrid=False
        )
    words = plain(machine.joints[a].name) + ("" if single else f" and {plain(machine.joints[b].name)}")
    return describe(
        figure,
        "plan",
        "Planned poses among those measured",
        alt=f"{len(new)} planned poses over {words}.",
    )


def planned_commands(fit: Fit, plan: Plan | None) -> Array | None:
    """Return the commanded coordinates of a plan, (poses, joints), in the units of the data; None without."""
    if plan is None or not plan.rows:
        return None
    machine, columns, found = fit.machine, Measurements.from_frame(plan.rows).columns, []
    for j, joint in enumerate(machine.joints):
        if joint.name not in columns:
            return None
        column = columns[joint.name]
        factor = parse_unit(column.unit).factor(machine.length_unit) if column.unit else 1.0
        found.append(np.asarray(column.values, float) * factor / coordinate(fit.observations, j)[1])
    return np.stack(found, axis=1)
