"""Draw a comparison: residuals against each covariate, over the workspace, in order, and their distribution.

Every distinction is made by shape or position as well as by colour. Text from a user's file is drawn as it is: what
Matplotlib would read as mathematics in it is not. Large data are thinned, and what is drawn says so.
"""

from __future__ import annotations

import functools
import io
import os
import re
import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.compare.sentences import figure, plain
from rodgen.data.drivers import Driver
from rodgen.errors import InputFileError
from rodgen.files import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rodgen.calibration.compare.comparison import Comparison

__all__ = ["pictures", "save_plots"]

Array: TypeAlias = NDArray[np.float64]

MOST_DOTS, MOST_ARROWS, MOST_RUNS = 4000, 400, 20
PIECES = 40
"""Of the line that follows the residuals in the order of measurement."""
SMALL_MOTION = 0.1
"""Where a joint moves the target less than this part of what is usual, a residual says nothing of its reading."""
# Okabe and Ito: told apart with every common colour vision, and by lightness in grey.
_BLUE, _ORANGE, _RED, _GREY = "#0072b2", "#e69f00", "#b03000", "#777777"
_DOT: dict[str, Any] = {"marker": "o", "ls": "none", "mfc": "none", "mec": _BLUE, "mew": 0.7}


def save_plots(
    comparison: Comparison, folder: str | os.PathLike[str], progress: Callable[[str], object] | None = None
) -> list[str]:
    """Draw every picture into a folder, as PNG and SVG; see `Comparison.plot`."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise InputFileError(
            "command line", "--plot", "no module 'matplotlib'", "it: pip install 'rodgen[plot]'"
        ) from None
    folder = os.fspath(folder)
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        found = f"cannot be made ({error.strerror or error})"
        raise InputFileError(folder, "file", found, "a writable folder") from None
    files = []
    settings: Any = {"svg.hashsalt": "rodgen", "text.parse_math": False, "text.usetex": False}
    with mpl.rc_context(settings), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        for name, draw in pictures(comparison):
            if progress:
                progress(name)
            drawn = draw()
            for kind, metadata in ((".png", {}), (".svg", {"Date": None})):
                out = io.BytesIO()
                # No date and no random names: the same comparison gives the same bytes.
                drawn.savefig(out, format=kind[1:], dpi=110, metadata=metadata)
                drawn.set_layout_engine("none")  # everything has its place now, for the other format, too
                file = os.path.join(folder, name + kind)
                write_file(file, out.getvalue())
                files.append(file)
    return files


def pictures(comparison: Comparison) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Yield the name of each picture and what draws it."""
    used = set()
    yield "order", functools.partial(_order, comparison)
    yield "workspace", functools.partial(_workspace, comparison)
    yield "distribution", functools.partial(_distribution, comparison)
    for covariate in comparison.covariates:
        name = "by_" + (re.sub(r"[^A-Za-z0-9_.-]+", "_", covariate.name)[:60].strip(".") or "column")
        while name.casefold() in used:
            name += "_"
        used.add(name.casefold())
        yield name, functools.partial(_against, comparison, covariate)


def _panels(count: int, width: float = 7.0, height: float = 2.1) -> tuple[Figure, list[Any]]:
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, 1.2 + height * count), layout="constrained")
    panels = [drawn.add_subplot(count, 1, i + 1) for i in range(count)]
    for panel in panels:
        _bare(panel)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    return drawn, panels


def _bare(panel: Any) -> None:
    panel.grid(color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def _some(count: int, most: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp)) if count else np.arange(0)


def _thinned(chosen: int, count: int, what: str) -> str:
    return "" if chosen == count else f" ({chosen} of {count} {what} are drawn)"


def _size(count: int) -> float:
    return float(np.clip(60 / count**0.5, 1.5, 5)) if count else 5.0


# against a covariate -----------------------------------------------------------------------------------------------


def _against(comparison: Comparison, covariate: Driver) -> Figure:
    sample = comparison.sample
    values = [
        (f"{name} [{comparison.unit}]", r)
        for name, r in zip(comparison.components, sample.residual.T, strict=True)
    ]
    if covariate.number is not None:
        along, unit = _reading(comparison, covariate.number)
        if np.isfinite(along).any():
            joint = plain(comparison.fit.machine.joints[covariate.number].name)
            values.append((f"reading of {joint} [{unit}]", along))
    drawn, panels = _panels(len(values))
    x = covariate.values
    if covariate.turn is not None and np.ptp(x) > 1.01 * covariate.turn:
        x = x % covariate.turn
    chosen = _some(len(x), MOST_DOTS)
    groups = bool(covariate.categories) or covariate.kind == "approach" or covariate.levels <= 2
    for panel, (name, y) in zip(panels, values, strict=True):
        panel.axhline(0, color="black", lw=0.8)
        if groups:
            _groups(panel, sample.pose, covariate, y)
        else:
            panel.plot(x[chosen], y[chosen], ms=_size(len(chosen)), **_DOT)
            _curve(panel, sample.pose, covariate, x, y)
        panel.set_ylabel(name)
    panels[-1].set_xlabel(plain(covariate.label))
    shown = _thinned(len(chosen), len(x), "readings") if not groups else ""
    band = "means" if groups else "curve"
    drawn.suptitle(
        f"Residuals against {plain(covariate.text)}{shown}\n{band} with two standard errors, by pose",
        fontsize=10,
    )
    return drawn


def _reading(comparison: Comparison, joint: int) -> tuple[Array, str]:
    """Return what a joint's reading would have to be off by to explain each residual best, and the unit."""
    sample = comparison.sample
    motion = sample.motions[:, :, joint]
    square = np.sum(motion**2, axis=1)
    if comparison.fit.machine.joints[joint].type == "revolute":
        unit, factor = "arcsec", 648000 / np.pi
    else:
        unit, factor = comparison.fit.machine.length_unit, 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.sum(motion * sample.y, axis=1) / square * factor
    enough = square > SMALL_MOTION**2 * np.median(square)
    return np.where(enough, along, np.nan), unit


def _fitted(columns: Array, y: Array, pose: NDArray[np.intp], at: Array) -> tuple[Array, Array]:
    """Return a regression at rows `at` of columns, and its standard errors; poses are independent, rows are not."""
    known = np.isfinite(y)
    columns, y, pose = columns[known], y[known], pose[known]
    inverse = np.linalg.pinv(columns, rcond=1e-8)
    left = y - columns @ (inverse @ y)
    scores = np.zeros((int(pose.max(initial=0)) + 1, len(inverse)))
    np.add.at(scores, pose, (inverse * left).T)
    return at @ (inverse @ y), np.sqrt(np.sum((scores @ at.T) ** 2, axis=0))


def _curve(panel: Any, pose: NDArray[np.intp], covariate: Driver, x: Array, y: Array) -> None:
    grid = np.linspace(x.min(), x.max(), 201)
    columns = [np.column_stack([np.ones(len(v)), covariate.curve(v)]) for v in (x, grid)]
    if columns[0].shape[1] + 2 > len(np.unique(pose)):
        return
    line, error = _fitted(columns[0], y, pose, columns[1])
    panel.fill_between(grid, line - 2 * error, line + 2 * error, color="0.75", alpha=0.7, lw=0, zorder=1.5)
    panel.plot(grid, line, color="black", lw=1.4)
    # The band of a curve at an end without poses would push everything else together.
    size = float(np.nanmax(np.abs(np.concatenate([y, line])))) * 1.08
    panel.set_ylim(-size or None, size or None)


def _groups(panel: Any, pose: NDArray[np.intp], covariate: Driver, y: Array) -> None:
    codes = np.unique(covariate.values)
    shown = codes[:MOST_RUNS]
    random = np.random.default_rng(0)
    for place, code in enumerate(shown):
        inside = np.flatnonzero((covariate.values == code) & np.isfinite(y))
        some = inside[_some(len(inside), MOST_DOTS // len(shown))]
        panel.plot(place + random.uniform(-0.15, 0.15, len(some)), y[some], ms=_size(len(y)), **_DOT)
        if not len(inside):
            continue
        ones = np.ones((len(inside), 1))
        mean, error = _fitted(ones, y[inside], pose[inside], ones[:1])
        panel.errorbar(place + 0.3, mean, 2 * error, fmt="s", color="black", ms=5, capsize=4)
    panel.set_xticks(range(len(shown)))
    names = [plain(covariate.categories[int(c)], 16) if covariate.categories else f"{c:+g}" for c in shown]
    panel.set_xticklabels(names, rotation=0 if len(shown) < 9 else 60)


# over the workspace ------------------------------------------------------------------------------------------------


def _workspace(comparison: Comparison) -> Figure:
    return _sky(comparison) if comparison.unit == "arcsec" else _space(comparison)


def _space(comparison: Comparison) -> Figure:
    from matplotlib.figure import Figure

    sample, fit = comparison.sample, comparison.fit
    chosen = _some(len(sample.pose), MOST_ARROWS)
    place, residual = sample.places[chosen], sample.residual[chosen]
    if fit.machine.measured.frame == "free" and residual.shape[1] == 3:
        residual = residual @ fit.solution.frame.rotation
    drawn = Figure(figsize=(12, 4.6), layout="constrained")
    size = float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))) or 1.0
    wide = float(np.max(np.ptp(place, axis=0))) or 1.0
    for i, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
        panel = drawn.add_subplot(1, 3, i + 1)
        _bare(panel)
        x, y = place[:, a], place[:, b]
        if residual.shape[1] == 3:
            panel.plot(x, y, ".", ms=2, color=_GREY)
            scale = size / (0.07 * wide)
            arrows = panel.quiver(
                x,
                y,
                residual[:, a],
                residual[:, b],
                angles="xy",
                scale_units="xy",
                scale=scale,
                width=0.003,
                color=_BLUE,
            )
            tips = np.concatenate([place, place + residual / scale])
            panel.update_datalim(tips[:, [a, b]])
            panel.autoscale_view()
            if i == 0:
                label = f"{figure(2 * size)} {comparison.unit}"
                panel.quiverkey(arrows, 0.08, 1.05, 2 * size, label, labelpos="E", color="black")
        else:
            _signs(panel, x, y, residual[:, 0], size, comparison.unit if i == 0 else "")
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel(f"{'xyz'[a]} [{comparison.unit}]")
        panel.set_ylabel(f"{'xyz'[b]} [{comparison.unit}]")
    shown = _thinned(len(chosen), len(sample.pose), "readings")
    drawn.suptitle(f"Residuals over the workspace, in machine axes{shown}\n", fontsize=10)
    return drawn


def _signs(panel: Any, x: Array, y: Array, r: Array, size: float, unit: str) -> None:
    for sign, marker, colour in ((1, "^", _ORANGE), (-1, "v", _BLUE)):
        some = r * sign > 0
        area = 25 * np.minimum(np.abs(r[some]) / size, 4)
        panel.scatter(x[some], y[some], area, marker=marker, color=colour, edgecolors="black", linewidths=0.3)
    if unit:
        panel.set_title(
            f"▲ measured more, ▼ less than predicted; area by size, rms {figure(size)} {unit}", fontsize=8
        )


def _sky(comparison: Comparison) -> Figure:
    """Draw directions with the zenith in the middle, and what the model misses as arrows."""
    from matplotlib.figure import Figure

    sample, fit = comparison.sample, comparison.fit
    chosen = _some(len(sample.pose), MOST_ARROWS)
    up = -np.asarray(fit.machine.gravity)
    if fit.machine.measured.frame == "free":
        up = fit.solution.frame.rotation @ up
    x = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    left, above = fit.observations.basis
    u = fit.observations.reading[sample.first[chosen]]
    r = sample.residual[chosen]
    move = r[:, :1] * left[sample.first[chosen]] + r[:, 1:] * above[sample.first[chosen]]
    size = float(np.sqrt(np.mean(np.sum(r**2, axis=1)))) or 1.0
    start, tip = (_from_zenith(d, x, y, up) for d in (u, u + move * (np.radians(6.0) / size)))
    drawn = Figure(figsize=(7.2, 7.4), layout="constrained")
    panel = drawn.add_subplot()
    angle = np.linspace(0, 2 * np.pi, 181)
    for zenith_angle in (30, 60, 90):
        panel.plot(zenith_angle * np.cos(angle), zenith_angle * np.sin(angle), color="0.8", lw=0.8)
        panel.text(0, zenith_angle, f" {90 - zenith_angle} deg", color=_GREY, fontsize=8, va="bottom")
    panel.plot(*start.T, ".", ms=3, color=_GREY)
    arrows = panel.quiver(
        *start.T, *(tip - start).T, angles="xy", scale_units="xy", scale=1, width=0.0035, color=_BLUE
    )
    panel.quiverkey(
        arrows, 0.8, 0.98, 12.0, f"{figure(2 * size)} {comparison.unit}", labelpos="E", color="black"
    )
    panel.plot(0, 0, "+", color="black")
    panel.set_aspect("equal")
    far = max(95.0, 1.05 * float(np.max(np.abs(start), initial=0.0)))
    panel.set_xlim(-far, far)
    panel.set_ylim(-far, far)
    panel.axis("off")
    shown = _thinned(len(chosen), len(sample.pose), "readings")
    drawn.suptitle(
        f"Residuals on the sky: the zenith in the middle, circles of equal altitude,\nazimuth 0 to the right{shown}",
        fontsize=10,
    )
    return drawn


def _from_zenith(direction: Array, x: Array, y: Array, up: Array) -> Array:
    """Return directions as points, (n, 2): degrees from the zenith, at their azimuth."""
    level = np.column_stack([direction @ x, direction @ y])
    size = np.linalg.norm(level, axis=1, keepdims=True)
    angle = np.degrees(np.arctan2(size[:, 0], direction @ up))[:, None]
    return np.asarray(angle * np.divide(level, size, out=np.zeros_like(level), where=size > 0))


# in order, and as a distribution -----------------------------------------------------------------------------------


def _order(comparison: Comparison) -> Figure:
    fit, o = comparison.fit, comparison.fit.observations
    drawn, panels = _panels(len(comparison.components), width=9.0)
    rows = np.flatnonzero(~fit.outliers)
    chosen = rows[_some(len(rows), MOST_DOTS)]
    bad = np.flatnonzero(fit.outliers)[:MOST_DOTS]
    starts = np.flatnonzero(np.diff(o.run)) + 1
    for c, panel in enumerate(panels):
        r = fit.residuals[:, c]
        panel.axhline(0, color="black", lw=0.8)
        panel.plot(chosen, r[chosen], ms=_size(len(chosen)), **_DOT)
        pieces = [part for part in np.array_split(rows, min(PIECES, max(len(rows) // 4, 1))) if len(part)]
        panel.plot(
            [part.mean() for part in pieces],
            [r[part].mean() for part in pieces],
            color="black",
            lw=1.4,
            label="mean",
        )
        limit = 1.15 * float(np.max(np.abs(r[rows]), initial=0.0)) or 1.0
        if len(bad):
            panel.plot(
                bad,
                np.clip(r[bad], -limit, limit),
                "X",
                ms=7,
                mfc=_RED,
                mec="black",
                mew=0.5,
                label="outlier",
            )
        panel.set_ylim(-1.1 * limit, 1.1 * limit)
        if len(starts) < MOST_RUNS:
            for start in starts:
                panel.axvline(start - 0.5, color=_GREY, ls="--", lw=1)
        panel.set_ylabel(f"{comparison.components[c]} [{comparison.unit}]")
    if 0 < len(starts) < MOST_RUNS:
        for start in (0, *starts):
            name = plain(o.run_names[int(o.run[start])], 16)
            panels[0].text(
                start, 1.02, f"run {name}", transform=panels[0].get_xaxis_transform(), fontsize=8, color=_GREY
            )
    panels[-1].legend(loc="lower right", fontsize=8, ncols=2)
    panels[-1].set_xlabel("row, in the order of the file (from 0)")
    shown = _thinned(len(chosen), len(rows), "readings")
    drawn.suptitle(f"Residuals in the order of measurement{shown}\n", fontsize=10)
    return drawn


def _distribution(comparison: Comparison) -> Figure:
    from matplotlib.figure import Figure
    from scipy.special import ndtri

    fit, m = comparison.fit, len(comparison.components)
    drawn = Figure(figsize=(9, 1 + 2.5 * m), layout="constrained")
    for c, name in enumerate(comparison.components):
        r = np.sort(fit.residuals[~fit.outliers, c])
        sigma = float(np.std(r)) or 1.0
        left, right = (drawn.add_subplot(m, 2, 2 * c + i) for i in (1, 2))
        bins = int(np.clip(np.sqrt(len(r)), 8, 60))
        left.hist(r, bins, density=True, histtype="stepfilled", facecolor="0.85", edgecolor=_BLUE)
        x = np.linspace(-4 * sigma, 4 * sigma, 201) + r.mean()
        left.plot(
            x, np.exp(-0.5 * ((x - r.mean()) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)), color="black"
        )
        left.set_xlabel(f"{name} [{comparison.unit}]")
        left.set_ylabel(f"share per {comparison.unit}")
        some = _some(len(r), MOST_DOTS)
        normal = ndtri((some + 0.5) / max(len(r), 1))
        right.plot(normal, r[some], ms=_size(len(some)), **_DOT)
        right.axline((0.0, float(r.mean())), slope=sigma, color="black", lw=1)
        right.set_xlabel("normal errors would be at [standard deviations]")
        right.set_ylabel(f"{name} [{comparison.unit}]")
        for panel in (left, right):
            _bare(panel)
    drawn.suptitle("Distribution of the residuals; the line is what normal errors would have", fontsize=10)
    return drawn
