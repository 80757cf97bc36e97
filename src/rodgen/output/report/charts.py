"""The pictures of a report: the falling error, what is left and where, the ranking, and what to measure next."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.compare.sentences import plain
from rodgen.calibration.diagnose.diagnosis import Diagnosis
from rodgen.calibration.fit import Fit
from rodgen.data.units import parse_unit
from rodgen.output.report.chart import Arrows, Bars, Chart, Line, Marks, Panel, Rule, View
from rodgen.output.report.rows import Against, Rows, coordinate
from rodgen.output.report.units import Shown, chance

if TYPE_CHECKING:
    from rodgen.calibration.plan import Plan

__all__ = ["LEVEL", "Rung", "charts", "rungs"]

Array: TypeAlias = NDArray[np.float64]

MOST_ARROWS = 300
MOST_RANKED = 10
MOST_NUMBERED = 24
LEVEL = 0.01
"""Probability of a false alarm among all candidates together."""
FLAT, TALL = 0.5, 1.1
"""Least and largest height of a map, in parts of its width."""
ARROW = 0.08
"""Length of the arrow of a residual of one rms before, in parts of the map's width."""
SKY_ARROW = 8.0
"""The same on a sky, in degrees."""
MARGIN = 1.12

Rung: TypeAlias = tuple[str, float, float | None, float | None]
"""Title, rms fitted, held out, on further measurements."""


def charts(diagnosis: Diagnosis, last: Fit, shown: Shown, plan: Plan | None = None) -> list[Chart]:
    """Make every picture of a diagnosis.

    Parameters
    ----------
    diagnosis : Diagnosis
    last : Fit
        With everything that was found.
    shown : Shown
        The unit of errors.
    plan : Plan, optional
    """
    rows = Rows(diagnosis, last, shown)
    made = [_ladder(diagnosis, shown)]
    made += [_against(rows, against) for against in rows.drivers()]
    made.append(_space(rows) if rows.base.machine.measurand.moving else _sky(rows))
    if diagnosis.ranking:
        made.append(_ranking(diagnosis))
    made += _planned(rows, plan)
    return made


# the ladder --------------------------------------------------------------------------------------------------------


def rungs(diagnosis: Diagnosis) -> list[Rung]:
    """Return the models from the base on, each with its errors in the diagnosis' unit."""
    rms = diagnosis.rms
    last = len(diagnosis.steps)
    found: list[Rung] = [
        ("as it was", rms.before, rms.before_held_out, rms.before_test),
    ]
    for i, step in enumerate(diagnosis.steps, 1):
        title = f"+ {plain(step.effect.title, 60)}"
        found.append((title, step.rms, step.rms_held_out, rms.after_test if i == last else None))
    for form in diagnosis.unexplained:
        where = f" at {plain(form.joint)}" if form.joint else ""
        found.append((f"+ {plain(form.form, 40)}{where}, outside the catalogue", form.rms, None, None))
    return found


def _ladder(diagnosis: Diagnosis, shown: Shown) -> Chart:
    steps = rungs(diagnosis)
    at = np.arange(len(steps), dtype=float)
    fitted = np.array([rung[1] for rung in steps]) * shown.factor
    unseen, test = (
        np.array([np.nan if rung[k] is None else rung[k] for rung in steps], float) * shown.factor
        for k in (2, 3)
    )
    noise = None if diagnosis.rms.noise is None else diagnosis.rms.noise * shown.factor
    known = np.concatenate([fitted, unseen, test, [noise or 0.0]])
    most = float(np.nanmax(known)) * 1.35 or 1.0
    rules, legend = [], [("fitted", "fitted"), ("held", "held out")]
    if noise is not None:
        floor = diagnosis.final.noise
        band = None
        if floor.source == "replicates" and floor.replicates is not None:
            band = (floor.replicates.low * shown.factor, floor.replicates.high * shown.factor)
        rules.append(Rule(noise, "x", "noise", band=band))
        legend.append(("noise", "noise"))
        if band:
            legend.append(("band", "95 % of it"))
    furthest = np.nanmax(np.stack([fitted, unseen, test]), axis=0)
    marks = [Marks(unseen, at, "held"), Marks(fitted, at, "fitted")]
    if np.isfinite(test).any():
        marks.insert(0, Marks(test, at, "test"))
        legend.append(("test", "on the test file"))
    panel = Panel(
        f"rms of a reading [{shown.unit}]",
        "",
        (0.0, most),
        (0.0, 1.0),
        marks=tuple(marks),
        lines=tuple(
            Line(np.array([0.0, v]), np.array([k, k]), "path-fitted") for k, v in zip(at, fitted, strict=True)
        ),
        rules=tuple(rules),
        rows=tuple(rung[0] for rung in steps),
        words=tuple(
            (
                float(x) + 0.025 * most,
                k + 0.1,
                shown.plain(v) if math.isnan(w) else f"{shown.plain(v)} / {shown.plain(w)}",
            )
            for x, k, v, w in zip(furthest, at, fitted, unseen, strict=True)
        ),
    )
    way = ", ".join(f"{rung[0]} {shown(rung[1])} (held out {shown(rung[2])})" for rung in steps)
    beside = "not known" if noise is None else f"{shown.plain(noise)}"
    return Chart(
        "ladder",
        "The error, model by model",
        f"Rms in {shown.unit}: {way}; noise {beside}.",
        (View("", (panel,)),),
        note="" if np.isnan(unseen).all() else "Numbers: fitted / held out.",
        legend=tuple(legend),
    )


# against what drives it --------------------------------------------------------------------------------------------


def _against(rows: Rows, against: Against) -> Chart:
    fits, driver = _fits(rows), against.driver
    categories = tuple(plain(name, 10) for name in driver.categories)
    sides = [_curves(rows, fit, against) for fit in fits]
    # The same scale before and after, or nothing could be compared.
    limits = [_limit(np.concatenate([side[k][1][~rows.bad] for side in sides])) for k in range(len(sides[0]))]
    views = []
    for after, (fit, curves) in enumerate(zip(fits, sides, strict=True)):
        panels = []
        for (label, y), limit in zip(curves, limits, strict=True):
            panels.append(
                Panel(
                    plain(driver.label),
                    label,
                    (-0.6, len(categories) - 0.4) if categories else _range(driver.noted),
                    (-limit, limit),
                    marks=tuple(_dots(rows, against, y, limit, bool(after))),
                    rules=(Rule(0.0, "y", "zero"),),
                    degrees=driver.unit == "deg",
                    xnames=categories,
                )
            )
        views.append(View(_said(rows, fit, after), tuple(panels), ("before", "after")[after]))
    looks = _looks(rows, against)
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in driver.name)[:40].strip("_") or "column"
    sizes = ", ".join(f"{view.key or 'left'} {view.title.rpartition('rms ')[2]}" for view in views)
    return Chart(
        f"residuals_by_{name}",
        f"What is left, over {plain(driver.text)}",
        f"Measured less predicted over {plain(driver.text)}; rms {sizes}.",
        tuple(views),
        note=" ".join(filter(None, [_scaled(rows), *_remarks(rows, against)])),
        legend=tuple(looks),
        tips=rows.tips,
    )


def _scaled(rows: Rows) -> str:
    return "Measured less predicted" + (", on the same scale before and after." if rows.two else ".")


def _remarks(rows: Rows, against: Against) -> Iterator[str]:
    if against.joint is not None:
        name = plain(rows.base.machine.joints[against.joint].name)
        yield f"Above: by how much the reading of {name} would have to be off to explain each residual best."
    yield rows.thinned
    if rows.bad.any():
        yield "Outliers are at the edge where they lie beyond it."


def _fits(rows: Rows) -> list[Fit]:
    return [rows.base, rows.final] if rows.two else [rows.base]


def _said(rows: Rows, fit: Fit, after: int) -> str:
    size = f"rms {rows.shown(fit.rms)} {rows.shown.unit}"
    if not rows.two:
        return f"The model as it is: {size}"
    if not after:
        return f"Before: {size}"
    return (
        f"After: {size}"
        if fit is rows.diagnosis.final
        else f"After, with the form outside the catalogue: {size}"
    )


def _curves(rows: Rows, fit: Fit, against: Against) -> list[tuple[str, Array]]:
    found = []
    if against.joint is not None:
        along, unit = rows.along_reading(fit, against.joint)
        if np.isfinite(along[~rows.bad]).any():
            name = plain(fit.machine.joints[against.joint].name, 12)
            found.append((f"reading of {name} [{unit}]", along))
    residuals = rows.residuals(fit)
    for name, r in zip(rows.names, residuals.T, strict=True):
        found.append((f"{name} [{rows.shown.unit}]", r))
    return found


def _dots(rows: Rows, against: Against, y: Array, limit: float, after: bool) -> Iterator[Marks]:
    good = ~rows.bad & np.isfinite(y)
    tail = "-after" if after else ""
    x = np.asarray(against.driver.noted, float)
    size = float(np.clip(1.5 - 0.11 * math.sqrt(max(len(x), 1) / 10), 0.55, 1.15))

    def some(mask: NDArray[np.bool_], look: str) -> Marks:
        at = np.flatnonzero(mask)
        return Marks(x[at], y[at], look, at, np.full(len(at), size))

    if against.approach is None:
        yield some(good, "after" if after else "before")
    else:
        yield some(good & (against.approach >= 0), f"forward{tail}")
        yield some(good & (against.approach < 0), f"backward{tail}")
    bad = np.flatnonzero(rows.bad & np.isfinite(y))
    if len(bad):
        yield Marks(x[bad], np.clip(y[bad], -0.95 * limit, 0.95 * limit), "outlier", bad)


def _looks(rows: Rows, against: Against) -> Iterator[tuple[str, str]]:
    if against.approach is not None:
        yield "forward", "reached forwards"
        yield "backward", "reached backwards"
    else:
        yield "before", "before" if rows.two else "a reading"
        if rows.two:
            yield "after", "after"
    if rows.bad.any():
        yield "outlier", "outlier, taken out"


def _limit(y: Array) -> float:
    known = np.abs(y[np.isfinite(y)])
    return float(known.max(initial=0.0)) * MARGIN or 1.0


def _range(x: Array) -> tuple[float, float]:
    known = x[np.isfinite(x)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    pad = 0.03 * (high - low) or 0.5
    return low - pad, high + pad


# where -------------------------------------------------------------------------------------------------------------


def _space(rows: Rows) -> Chart:
    """Draw residuals where they were measured: arrows of points, signs of distances."""
    fits, places = _fits(rows), rows.places
    some = _evenly(np.flatnonzero(~rows.bad & np.isfinite(places).all(axis=1)), MOST_ARROWS)
    at = places[some]
    spread = np.ptp(at, axis=0) if len(at) else np.ones(3)
    order = np.argsort(-spread, kind="stable")
    first = tuple(sorted(int(k) for k in order[:2]))
    planes = [first]
    if spread[order[2]] > 0.02 * spread[order[0]] or rows.components == 3:
        planes.append((first[0], int(order[2])))
    unit = rows.base.machine.length_unit
    vectors = [
        rows.in_space(fit)[some] if rows.components == 3 else rows.residuals(fit)[some] for fit in fits
    ]
    rms = float(np.sqrt(np.mean(np.sum(vectors[0] ** 2, axis=1)))) if len(some) else 1.0
    size = rms or 1.0
    views = []
    for after, (fit, r) in enumerate(zip(fits, vectors, strict=True)):
        panels = []
        for k, (a, b) in enumerate(planes):
            xlim, ylim = _frame(at[:, a], at[:, b])
            wide = xlim[1] - xlim[0]
            labels = f"{'xyz'[a]} [{unit}]", f"{'xyz'[b]} [{unit}]"
            if rows.components == 3:
                scale = ARROW * wide / size
                arrows = [
                    Arrows(
                        at[:, a],
                        at[:, b],
                        r[:, a] * scale,
                        r[:, b] * scale,
                        "after" if after else "before",
                        some,
                    )
                ]
                words: tuple[tuple[float, float, str], ...] = ()
                if k == 0:
                    x, y = xlim[0] + 0.04 * wide, ylim[1] - 0.07 * (ylim[1] - ylim[0])
                    key, length = _round_size(size)
                    ends = np.array([[x], [y], [length * scale], [0.0]])
                    arrows.append(Arrows(ends[0], ends[1], ends[2], ends[3], "keyarrow"))
                    words = (
                        (x + length * scale + 0.02 * wide, y - 0.012 * wide, f"{key} {rows.shown.unit}"),
                    )
                panels.append(Panel(*labels, xlim, ylim, arrows=tuple(arrows), words=words, equal=True))
            else:
                panels.append(
                    Panel(
                        *labels, xlim, ylim, marks=tuple(_signs(at, r, a, b, size, some, after)), equal=True
                    )
                )
        views.append(View(_said(rows, fit, after), tuple(panels), ("before", "after")[after]))
    arrow = rows.components == 3
    legend = (
        [("arrow before", "before" if rows.two else "residual")] + [("arrow after", "after")] * rows.two
        if arrow
        else [("up", "longer than predicted"), ("down", "shorter")]
    )
    notes = [f"{_scaled(rows)} Places are in machine axes."]
    if not arrow:
        notes.append("Area by size.")
    notes += _few(rows, some)
    return Chart(
        "residuals_in_space",
        "Where it is left, in space",
        f"Residuals over the workspace in {'two projections' if len(planes) > 1 else 'one projection'}.",
        tuple(views),
        note=" ".join(notes),
        legend=tuple(legend),
        tips=rows.tips,
    )


def _signs(at: Array, r: Array, a: int, b: int, size: float, some: Any, after: int) -> Iterator[Marks]:
    tail = "-after" if after else ""
    for sign, look in ((1, "up"), (-1, "down")):
        mask = r[:, 0] * sign > 0
        area = np.sqrt(np.minimum(np.abs(r[mask, 0]) / size, 4.0))
        yield Marks(at[mask, a], at[mask, b], f"{look}{tail}", some[mask], np.maximum(area, 0.25))


def _frame(x: Array, y: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return limits of a map, with room around, neither too flat nor too tall."""
    (x0, x1), (y0, y1) = ((float(v.min()), float(v.max())) if len(v) else (0.0, 1.0) for v in (x, y))
    wide, high = x1 - x0, y1 - y0
    room = 0.13 * (max(wide, high) or 1.0)
    wide, high = wide + 2 * room, high + 2 * room
    if high < FLAT * wide:
        high = FLAT * wide
    if high > TALL * wide:
        wide = high / TALL
    mx, my = (x0 + x1) / 2, (y0 + y1) / 2
    return (mx - wide / 2, mx + wide / 2), (my - high / 2, my + high / 2)


def _round_size(size: float) -> tuple[str, float]:
    """Return a round number near a size, as text, too."""
    power = 10.0 ** math.floor(math.log10(size))
    value = min((1.0, 2.0, 5.0, 10.0), key=lambda v: abs(math.log(v * power / size))) * power
    return f"{value:.6g}", value


def _sky(rows: Rows) -> Chart:
    """Draw directions with the zenith in the middle, and what the model misses as arrows."""
    fits = _fits(rows)
    some = _evenly(np.flatnonzero(~rows.bad), MOST_ARROWS)
    up = rows.up
    x, y = _level(up)
    left, above = (basis[some] for basis in rows.o.basis)
    u = rows.o.reading[some]
    size = float(np.sqrt(np.mean(rows.residuals(fits[0])[some] ** 2)) * math.sqrt(2)) or 1.0
    angle = np.linspace(0, 2 * np.pi, 73)
    rings = tuple(Line(z * np.cos(angle), z * np.sin(angle), "grid") for z in (30.0, 60.0, 90.0))
    cross = tuple(
        Line(np.array([-90 * c, 90 * c]), np.array([-90 * s, 90 * s]), "grid") for c, s in ((1, 0), (0, 1))
    )
    views = []
    for after, fit in enumerate(fits):
        r = rows.residuals(fit)[some]
        move = (r[:, :1] * left + r[:, 1:] * above) * (np.radians(SKY_ARROW) / size)
        start, tip = (_from_zenith(d, x, y, up) for d in (u, u + move))
        far = max(99.0, 1.05 * float(np.max(np.abs(start), initial=0.0)))
        key, length = _round_size(size)
        ends = np.array([[-far + 4], [far - 5], [length / size * SKY_ARROW], [0.0]])
        names = ("y", "−y", "x", "−x")
        words = [
            (-far + 6 + length / size * SKY_ARROW, far - 7.5, f"{key} {rows.shown.unit}"),
            *((1.5, z - 5.0, f"{90 - z:.0f}°") for z in (30.0, 60.0)),
            (1.5, 84.0, names[0]),
            (1.5, -88.0, names[1]),
            (74.0, 1.5, names[2]),
            (-89.0, 1.5, names[3]),
        ]
        panel = Panel(
            "",
            "",
            (-far, far),
            (-far, far),
            lines=(*rings, *cross),
            arrows=(
                Arrows(
                    start[:, 0],
                    start[:, 1],
                    (tip - start)[:, 0],
                    (tip - start)[:, 1],
                    "after" if after else "before",
                    some,
                ),
                Arrows(ends[0], ends[1], ends[2], ends[3], "keyarrow"),
            ),
            words=tuple(words),
            equal=True,
            bare=True,
        )
        views.append(View(_said(rows, fit, after), (panel,), ("before", "after")[after]))
    thinned = "".join(f" {note}" for note in _few(rows, some))
    return Chart(
        "residuals_on_the_sky",
        "Where it is left, on the sky",
        "Residuals as arrows on the sky, the zenith in the middle, the horizon outside.",
        tuple(views),
        note=f"{_scaled(rows)} The zenith is in the middle, circles are of equal altitude.{thinned}",
        legend=tuple(
            [("arrow before", "before" if rows.two else "residual")] + [("arrow after", "after")] * rows.two
        ),
        tips=rows.tips,
    )


def _level(up: Array) -> tuple[Array, Array]:
    """Return what is drawn to the right and upwards, both level: east and north where the axes are so."""
    y = np.array([0.0, 1.0, 0.0]) if abs(up[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    y = y - (y @ up) * up
    y /= np.linalg.norm(y)
    return np.cross(y, up), y


def _from_zenith(direction: Array, x: Array, y: Array, up: Array) -> Array:
    """Return directions as points, (n, 2): degrees from the zenith, at their azimuth."""
    level = np.column_stack([direction @ x, direction @ y])
    size = np.linalg.norm(level, axis=1, keepdims=True)
    angle = np.degrees(np.arctan2(size[:, 0], direction @ up))[:, None]
    return np.asarray(angle * np.divide(level, size, out=np.zeros_like(level), where=size > 0))


def _few(rows: Rows, some: NDArray[np.intp]) -> list[str]:
    """Say which rows are not on a map."""
    if len(some) < rows.total - int(rows.outlier.sum()):
        return [f"{len(some)} of {rows.total} rows are drawn, evenly spread."]
    return ["Outliers are left out."] if rows.outlier.any() else []


def _evenly(index: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    if len(index) <= most:
        return index
    return np.asarray(index[np.unique(np.linspace(0, len(index) - 1, most).astype(np.intp))])


# the ranking -------------------------------------------------------------------------------------------------------


def _ranking(diagnosis: Diagnosis) -> Chart:
    best = diagnosis.ranking[:MOST_RANKED]
    taken = {(s.effect.name, s.effect.place) for s in diagnosis.steps}
    strength = np.array([min(-r.log10_p, 300.0) for r in best])
    most = max(float(strength.max()), -math.log10(LEVEL)) * 1.08
    at = np.arange(len(best), dtype=float)
    panel = Panel(
        "−log10 p, for any of the candidates: longer is surer",
        "",
        (0.0, most),
        (0.0, 1.0),
        bars=(Bars(strength, at, tuple((r.effect.name, r.effect.place) in taken for r in best)),),
        rules=(Rule(-math.log10(LEVEL), "x", "limit"),),
        rows=tuple(f"{plain(r.effect.title, 50)}   p {chance(r.log10_p)}" for r in best),
    )
    said = "; ".join(f"{plain(r.effect.title)} p {chance(r.log10_p)}" for r in best[:5])
    return Chart(
        "ranking",
        "Candidates, on the model as it was",
        f"The best of {len(diagnosis.ranking)}: {said}.",
        (View("", (panel,)),),
        note=f"Dark: taken into the model. Dashed: p = {LEVEL:g}, below which chance is not believed.",
    )


# what to measure next ----------------------------------------------------------------------------------------------


def _planned(rows: Rows, plan: Plan | None) -> list[Chart]:
    """Draw planned poses among those that are there, over the two joints that the plan moves most."""
    commands = planned_commands(rows.base, plan)
    if commands is None or not len(commands):
        return []
    machine, o = rows.base.machine, rows.base.observations
    factors = np.array([coordinate(machine, j)[1] for j in range(len(machine.joints))])
    there, new = o.q[rows.chosen] / factors, commands
    whole = np.concatenate([there, new])
    size = np.ptp(whole, axis=0)
    moved = [int(j) for j in np.flatnonzero(size > 0)]
    if not moved:
        return []
    outside = [float(np.ptp(new[:, j]) / (size[j] or 1.0)) for j in range(len(size))]
    # The joints that the question is about come first.
    asked = {step.effect.place for step in rows.diagnosis.steps}
    moved.sort(key=lambda j: (machine.joints[j].name not in asked, -outside[j]))
    a, b = (*sorted(moved[:2]),) if len(moved) > 1 else (moved[0], None)
    name_a = _joint_label(machine, a)
    if b is None:
        y_there, y_new, label = np.zeros(len(there)), np.ones(len(new)), ""
        ylim = (0.0, 1.0)
    else:
        y_there, y_new, label = there[:, b], new[:, b], _joint_label(machine, b)
        ylim = _range(whole[:, b])
    numbers = (
        tuple(str(i + 1) for i in range(len(new))) if len(new) <= MOST_NUMBERED and b is not None else ()
    )
    panel = Panel(
        name_a,
        label,
        _range(whole[:, a]),
        ylim,
        marks=(
            Marks(there[:, a], y_there, "there"),
            Marks(new[:, a], y_new, "planned", labels=numbers),
        ),
        degrees=machine.joints[a].type == "revolute" and machine.angle_unit == "deg",
        rows=("measured", "planned") if b is None else (),
    )
    return [
        Chart(
            "plan",
            "What to measure next, among what was measured",
            f"{len(new)} planned poses over {plain(machine.joints[a].name)}"
            + (f" and {plain(machine.joints[b].name)}" if b is not None else "")
            + ".",
            (View("", (panel,)),),
            legend=(("there", "measured"), ("planned", "planned")),
        )
    ]


def planned_commands(fit: Fit, plan: Plan | None) -> Array | None:
    """Return the commanded coordinates of a plan, (poses, joints), in the units of the machine file; None without."""
    if plan is None or not plan.rows:
        return None
    machine, found = fit.machine, []
    for j, joint in enumerate(machine.joints):
        header = next((name for name in plan.rows if name.partition(" [")[0] == joint.name), None)
        if header is None:
            return None
        unit = header.rpartition("[")[2].rstrip("]") if "[" in header else ""
        factor = parse_unit(unit).factor(machine.length_unit) if unit else 1.0
        found.append(np.asarray(plan.rows[header], float) * factor / coordinate(machine, j)[1])
    return np.stack(found, axis=1)


def _joint_label(machine: Any, j: int) -> str:
    return f"{plain(machine.joints[j].name)} [{coordinate(machine, j)[0]}]"
