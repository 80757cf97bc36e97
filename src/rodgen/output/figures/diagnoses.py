"""The figures of a diagnosis: the falling error, residuals before and after, the candidates, and the planned poses."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.diagnosis import Diagnosis
from rodgen.calibration.diagnosis_text import rungs
from rodgen.calibration.words import percent, plain
from rodgen.output.figures.distributions import autocorrelation_of_residuals, quantiles_of_residuals
from rodgen.output.figures.drawn_rows import MOST_MARKS, PLANNED, DrawnRows, coordinate, planned_rows
from rodgen.output.figures.ladders import error_ladder
from rodgen.output.figures.maps import map_of
from rodgen.output.figures.polar import joints_that_go_round, polar_of
from rodgen.output.figures.residuals import components_of, file_name, reading_of, residuals_over
from rodgen.output.figures.style import BLUE, GREY, Panel, column, describe, evenly, label
from rodgen.output.numbers import Shown, shown_unit

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit
    from rodgen.calibration.plan import Plan
    from rodgen.machines.drivers import Driver

MOST_RANKED, MOST_MEASURED, MOST_POLAR = 10, 1000, 3
SAME = 0.999
"""Drivers that are correlated more than this count as one."""


def diagnosis(diagnosis: Diagnosis, plan: Plan | None = None) -> Iterator[go.Figure]:
    """Yield every figure of a diagnosis; the name of each is in its ``layout.meta``.

    Parameters
    ----------
    diagnosis : rodgen.calibration.diagnosis.Diagnosis
    plan : rodgen.calibration.plan.Plan, optional
        What to measure next.
    """
    unit_drawn = unit_of(diagnosis)
    rows = DrawnRows(diagnosis.base, diagnosis.final_with_forms, unit_drawn)
    models = [model._replace(odds="") for model in rungs(diagnosis)]  # a telephone has no room for them
    yield error_ladder(models, unit_drawn, diagnosis.final.noise, "The error, model by model")
    drawn = drivers(diagnosis, rows)
    for against in drawn:
        yield residuals_by(diagnosis, rows, against)
    places = map_of(rows, _measured(diagnosis, rows))
    if places is not None:
        yield places
    places_named = {step.effect.place for step in diagnosis.steps}
    for name in sorted(joints_that_go_round(rows.base), key=lambda name: name not in places_named)[
        :MOST_POLAR
    ]:
        yield polar_of(rows, name)
    before = rows.base if rows.two else None
    yield quantiles_of_residuals(rows.final, before=before)
    yield autocorrelation_of_residuals(rows.final, before=before)
    brief = DrawnRows(rows.base, rows.final, unit_drawn, most=MOST_MARKS // 2, brief=True)
    yield from covariates(diagnosis, brief, {against.driver.name for against in drawn})
    if diagnosis.ranking:
        yield candidates(diagnosis)
    planned = planned_poses(rows.base, plan, {step.effect.place for step in diagnosis.steps})
    if planned is not None:
        yield planned


def unit_of(diagnosis: Diagnosis) -> Shown:
    """Return the unit in which the errors of a diagnosis are shown."""
    return shown_unit(diagnosis.rms.unit, [model.rms for model in rungs(diagnosis)])


# residuals ---------------------------------------------------------------------------------------------------------


def residuals_by(diagnosis: Diagnosis, rows: DrawnRows, against: Against) -> go.Figure:
    """Return the residuals before and after against what they depend on, one of `drivers`, in the same axes."""
    joint, remarks = against.joint, [_measured(diagnosis, rows)]
    reading = [] if joint is None else reading_of(rows, joint)[:1]
    if reading and joint is not None:
        name = plain(rows.base.machine.joints[joint].name)
        remarks.append(
            f"At the top: the error of the reading of {name} that would explain each residual best."
        )
    panels = [*reading, *components_of(rows)]
    return residuals_over(rows, against.driver, panels, approach=against.approach, remarks=remarks)


def covariates(diagnosis: Diagnosis, rows: DrawnRows, drawn: Collection[str]) -> Iterator[go.Figure]:
    """Yield the residuals against everything that varies and is not among `drawn`; names begin with "covariate"."""
    used: set[str] = set()
    for driver in rows.drivers.values():
        if driver.name in drawn:
            continue
        name = f"covariate_{file_name(driver.name)}"
        while name.casefold() in used:
            name += "_"
        used.add(name.casefold())
        yield residuals_over(
            rows, driver, components_of(rows), called=name, remarks=[_measured(diagnosis, rows)]
        )


def _measured(diagnosis: Diagnosis, rows: DrawnRows) -> str:
    formed = rows.two and rows.final is not diagnosis.final
    return "Measured minus predicted." + (" After: with the form outside the catalogue." if formed else "")


@dataclass(frozen=True)
class Against:
    """A driver that residuals are drawn against."""

    driver: Driver
    """Of the rows that are drawn."""
    joint: int | None = None
    """The joint whose reading is wrong, where an effect says so."""
    approach: NDArray[np.int8] | None = None
    """Direction of approach, where the effect depends on it, (n,)."""


def drivers(diagnosis: Diagnosis, rows: DrawnRows, most: int = 2) -> list[Against]:
    """Return what the effects that were found depend on, in their order; then the joints that moved."""
    against: list[Against] = []
    for one in _called_for(diagnosis, rows):
        if len(against) == most:
            break
        if not any(_same(one.driver, drawn.driver) for drawn in against):
            against.append(one)
    return against


def _called_for(diagnosis: Diagnosis, rows: DrawnRows) -> Iterator[Against]:
    machine, known = rows.base.machine, rows.drivers
    joints = {str(driver.joint): driver for driver in known.values() if driver.kind == "joint"}
    order = known["order"]
    for step in diagnosis.steps:
        place, definition = step.effect.place, step.effect.definition
        names = definition.formula.names
        joint = joints.get(str(place))
        if joint is not None and joint.number is not None:
            reading = joint.number if definition.component == "reading" else None
            by = {"T": f"T_{joint.name}", "F": "load", "v": f"v_{joint.name}", "acc": f"a_{joint.name}"}
            for name, column in by.items():
                if name in names and column in known:
                    yield Against(known[column], reading)
            yield Against(joint, reading, rows.o.s[:, joint.number] if "s" in names else None)
        elif definition.component == "lift" and "altitude" in known:
            yield Against(known["altitude"])
        elif definition.component in {"frame", "frame_shift"} and "t" in known:
            yield Against(known["t"])
        elif definition.component == "target" and len(machine.targets) > 1 and "target" in known:
            yield Against(known["target"])
        else:
            yield Against(order)
    for form in diagnosis.unexplained:
        driver = known.get(form.driver)
        if driver is not None:
            yield Against(driver, driver.number if form.component == "reading" else None)
    moved = sorted(joints.values(), key=lambda driver: -len(driver.distinct))
    for driver in moved[:1] if diagnosis.steps else moved[:2]:
        yield Against(driver)
    if not diagnosis.steps:
        yield Against(order)


def _same(one: Driver, second: Driver) -> bool:
    if one.name == second.name:
        return True
    a, b = one.noted - one.noted.mean(), second.noted - second.noted.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0 and abs(float(a @ b)) > SAME * size


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
    explained = [percent(r.explains) + (", no better than nothing" if r.log10_odds < 0 else "") for r in best]
    for i, r in enumerate(best):
        figure.add_annotation(
            x=0, y=i, text=f"<b>{label(plain(r.effect.title, 40))}</b>  {label(explained[i])}", xanchor="left",
            yanchor="bottom", yshift=7, showarrow=False, font={"size": 12},
            bgcolor=figure.layout.template.layout.paper_bgcolor, borderpad=0,
        )  # fmt: skip
    figure.update_xaxes(range=[0, 108], showgrid=False)
    figure.update_yaxes(range=[len(best) - 0.5, -0.8], visible=False)
    figure.update_layout(barmode="overlay", margin_l=20)
    listed = "; ".join(
        f"{plain(r.effect.title)} {part}" for r, part in zip(best[:5], explained, strict=False)
    )
    return describe(
        figure,
        "ranking",
        "Candidates, each alone on the base model",
        note="Where one effect is missing, others explain a part of it.",
        alt=f"The best of {len(diagnosis.ranking)}: {listed}.",
    )


# what to measure next ----------------------------------------------------------------------------------------------


def planned_poses(fit: Fit, plan: Plan | None, asked: Collection[str | None] = ()) -> go.Figure | None:
    """Return planned poses among those measured, over the two joints that the plan moves most; None without a plan.

    Parameters
    ----------
    fit : Fit
    plan : Plan or None
    asked : collection of str
        Joints that the question is about, which come first.
    """
    new = planned_commands(fit, plan)
    if new is None or not len(new):
        return None
    machine, o = fit.machine, fit.observations
    factors = np.array([coordinate(o, j)[1] for j in range(len(machine.joints))])
    there = o.q[evenly(o.n, MOST_MEASURED)] / factors
    size = np.ptp(np.concatenate([there, new]), axis=0)
    moved = [int(j) for j in np.flatnonzero(size > 0)]
    if not moved:
        return None
    spread = [float(np.ptp(new[:, j]) / (size[j] or 1.0)) for j in range(len(size))]
    moved.sort(key=lambda j: (machine.joints[j].name not in asked, -spread[j]))
    names = [
        label(f"{plain(joint.column)} [{coordinate(o, j)[0]}]") for j, joint in enumerate(machine.joints)
    ]
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
    planned = planned_rows(fit, plan)
    if planned is None:
        return None
    return planned.o.q / [coordinate(fit.observations, j)[1] for j in range(len(fit.machine.joints))]
