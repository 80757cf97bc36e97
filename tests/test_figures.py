"""Figures: what they show, the files they go into, and that they are legible in a browser at both widths."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import NormalDist
from typing import Any

import made_diagnoses
import numpy as np
import pytest
from browser import check_layouts, needs_browser

import rodgen
from rodgen import Machine, Measurements, figures, spatial, three_sps_s, tricept
from rodgen.calibration.fit import Fit
from rodgen.calibration.fleet.changes import Changes, Night
from rodgen.calibration.fleet.fleet import FleetParameter
from rodgen.calibration.ladder import Ladder, ladder
from rodgen.calibration.plan import Plan
from rodgen.data.tables import read_motions
from rodgen.kinematics.tricept import TriceptStatus
from rodgen.output.figures import files
from rodgen.output.figures.drawn_rows import DrawnRows
from rodgen.statistics.random_effects import population

EXAMPLES = Path(__file__).parent.parent / "examples"
U_PAPER = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)


def machine_and_data(name: str) -> tuple[Machine, Measurements]:
    folder = EXAMPLES / "machines" / name
    data = "mmt_2021.csv" if name == "mount" else "data.csv"
    return Machine.load(folder / "machine.toml"), Measurements.load(folder / data)


def comparison_of(name: str) -> list:
    machine, data = machine_and_data(name)
    return list(figures.comparison(machine.fit(data).compare()))


def axis() -> list:
    pairs = read_motions(EXAMPLES / "pairs.csv")
    return [figures.axis_fit(rodgen.fit_axis(pairs.rho, pairs.rho_prime, pairs.angle, loss="huber"), pairs)]


def telescope() -> list:
    machine, data = machine_and_data("mount")
    return [figures.ladder(ladder(machine, data, [machine.effect("refraction")]))]


def test_a_skeleton_has_axes_and_readings_where_they_are() -> None:
    machine, data = machine_and_data("robot_6r_tracker")
    figure = figures.skeleton(machine, machine.fit(data).observations)
    traces = {trace.name.partition(",")[0]: trace for trace in figure.data}
    joint = machine.joints[1]
    axes = np.stack([traces["revolute axes"][x] for x in "xyz"], -1).reshape(-1, 3, 3)
    along = axes[1, 1] - axes[1, 0]
    assert along / np.linalg.norm(along) == pytest.approx(joint.axis)
    assert (axes[1, 0] + axes[1, 1]) / 2 == pytest.approx(joint.point)
    assert traces["revolute axes"].text[4] == "J2"
    predicted, measured = (
        np.stack([traces[name][x] for x in "xyz"], -1) for name in ("where the file sees them", "readings")
    )
    # a free frame: the tracker stands metres away, the file is right to a few mm
    assert len(measured) == 200
    assert np.abs(measured - predicted).max() < 10
    assert "their frame is free" in figure.layout.meta["note"]
    mount = figures.skeleton(Machine.load(EXAMPLES / "machines/mount/machine.toml"))
    assert [trace.name.partition(",")[0] for trace in mount.data] == ["revolute axes", "targets at zero"]


def maps() -> list:
    found = tricept.uncertainty_map(tricept.PAPER, U_PAPER, "y", 0.0, tricept.LEG_LIMITS, n=41)
    machine = three_sps_s.Geometry(2.0, 1.0, 1.5)
    attitudes = three_sps_s.workspace(machine, (1.3, 2.7), samples=12)
    one = three_sps_s.workspace(machine, (1.3, 2.7), torsion=0.4, samples=12)
    loop = spatial.load_mechanism(EXAMPLES / "mechanisms/rrrcc.csv")
    return [
        figures.uncertainty_map(found),
        figures.orientation_workspace(attitudes),
        figures.orientation_workspace(one),
        figures.planar_representation(loop, "R5", "R1"),
        figures.planar_representation(spatial.PUMA_560, output=5),
    ]


def of_rows() -> list:
    machine, data = machine_and_data("gantry_rotary")
    before = fitted("gantry_rotary")
    after = machine.with_effect(machine.effect("encoder_eccentricity", "C")).fit(data)
    return [
        figures.residual_plot(after, "C", before=before, approach="C", selected=[3, 50], aside=[7]),
        figures.residual_plot(after, "Z", before=before, colour="C", whitened=True),
        figures.residual_plot(after, "dir_C", parts="C", colour="target"),
        figures.residual_plot(after, "target", parts="together"),
        figures.residual_map(after, before=before, selected=[3]),
        figures.quantiles_of_residuals(after, before=before, selected=[3]),
        figures.autocorrelation_of_residuals(after, before=before),
        figures.residual_map(fitted("mount")),
        figures.polar_plot(after, "C", before=before, selected=[3]),
        figures.polar_plot(fitted("mount"), "AZ"),
        figures.polar_plot(fitted("ballbar_gantry"), "xy"),
    ]


@dataclass(frozen=True)
class Robot:
    """A machine of a fleet on one night."""

    estimate: tuple[float, float, str]
    kind: str = "robots"
    model: str = "file"
    found: tuple[str, ...] = ()
    degrees_of_freedom: float = 200.0

    def estimates(self, which: str = "with_found") -> dict[str, tuple[float, float, str]]:
        return {"J2.gravity_windup.k": self.estimate}


def of_fleets() -> list:
    random = np.random.default_rng(3)
    values, std = 0.02 + 0.004 * random.normal(size=40), np.full(40, 0.003)
    values[7] = 0.09
    names = tuple(f"robot {i} of the hall <B>" for i in range(40))
    key, effect = "J2.gravity_windup.k", "gravity_windup at J2"
    parameter = FleetParameter(key, "mm", effect, names, values, std, population(values, std))
    nights = []
    for day in range(1, 12):
        read = 0.02 + 0.001 * random.normal(size=12)
        read[7] += 0.0005 * max(day - 5, 0) ** 2
        robots = {f"robot {i}": Robot((value, 0.001, "mm")) for i, value in enumerate(read.tolist())}
        nights.append(Night(f"2026-11-{day:02}", robots))
    changes = Changes(nights, 1.0)
    return [figures.fleet_parameter(parameter), figures.fleet_nights(changes, changes.found[0])]


def test_figures_of_a_fleet_show_each_machine_alone_and_given_the_others() -> None:
    parameter, nights = of_fleets()
    by_name = {trace.name: trace for trace in parameter.data}
    alone, given, odd = (by_name[name] for name in ("one machine alone", "given the others", "odd"))
    assert "7" in odd.text[0]
    np.testing.assert_allclose(odd.x, [90.0])  # micrometres
    assert list(alone.text) == list(given.text)
    mean = by_name["mean"].x[0]
    assert np.all(np.abs(np.array(given.x) - mean) < np.abs(np.array(alone.x) - mean))
    assert "&lt;B&gt;" in alone.text[0]
    assert [len(trace.x) for trace in nights.data] == [11]
    assert nights.layout.meta["title"] == "robot 7: J2.gravity_windup.k"
    assert nights.layout.meta["note"] == "An alarm."


@pytest.fixture(scope="module")
def every() -> list:
    return [
        *of_rows(),
        *axis(),
        *telescope(),
        *comparison_of("mount"),
        *comparison_of("ballbar_gantry"),
        *maps(),
        *of_fleets(),
    ]


@pytest.mark.slow
@needs_browser
def test_nothing_overlaps_or_is_cut_off(every: list, tmp_path: Path) -> None:
    figures.save_figures(every, tmp_path / "page.html")
    (measured,) = check_layouts([tmp_path / "page.html"])
    for found in measured:
        assert found["FIGURE"] == len(every)
        assert found["texts"] > 4 * len(every)


def test_same_figure_gives_the_same_page(tmp_path: Path) -> None:
    (figure,) = axis()
    for name in ("a.html", "b.htm"):
        figures.save_figure(figure, tmp_path / name)
    page = (tmp_path / "a.html").read_bytes()
    assert page == (tmp_path / "b.htm").read_bytes()
    assert page.count(b"Plotly, Inc.") == 1  # plotly.js is there, once


@pytest.mark.slow
@needs_browser
def test_images_have_the_same_bytes_again() -> None:
    figure = maps()[0]
    jobs = [(figure, kind) for kind in files.IMAGES]
    once, again = (files._images(jobs, "figure") for _ in range(2))
    assert [content[:4] for content in once] == [b"\x89PNG", b"<svg", b"%PDF"]
    assert once == again
    assert b"Standard uncertainty" in once[1]


def test_a_browser_that_does_not_start_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rodgen_command: Callable[..., tuple[int, str, str]]
) -> None:
    """It is asked to start without its sandbox, which root has none of in a container, and without shared memory."""
    pytest.importorskip("kaleido")
    browser = tmp_path / "chromium"
    browser.write_text('#!/bin/sh\necho "$@" > "$0.arguments"\nexit 1\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER_PATH", str(browser))
    pairs = Path(__file__).parent.parent / "examples" / "pairs.csv"
    code, out, err = rodgen_command("fit-axis", pairs, "--plot", tmp_path / "axis.png")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert (
        f"axis.png: file: {browser}, which images are drawn with, ends when it is started; expected " in err
    )
    assert not (tmp_path / "axis.png").exists()
    arguments = (tmp_path / "chromium.arguments").read_text().split()
    assert {"--headless", "--no-sandbox", "--disable-dev-shm-usage"} <= {*arguments}


def test_without_a_browser_one_sentence_says_what_to_do(
    refuses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from choreographer.browsers.chromium import Chromium

    monkeypatch.setattr(Chromium, "find_browser", lambda **_: None)
    (figure,) = axis()
    refuses(figures.save_figure, figure, tmp_path / "a.png")
    refuses(figures.check_place, tmp_path / "folder")
    figures.check_place(tmp_path / "a.html")
    figures.save_figure(figure, tmp_path / "a.html")
    assert list(tmp_path.iterdir()) == [tmp_path / "a.html"]


def test_name_that_asks_for_nothing_is_refused(refuses, tmp_path: Path) -> None:
    refuses(figures.save_figure, axis()[0], tmp_path / "a.bmp")


def test_folder_that_cannot_be_made_is_one_line(refuses, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    refuses(figures.save_figures, axis(), tmp_path / "file" / "plots")


# what they show ----------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_ladder_shows_models_and_noise() -> None:
    machine, data = machine_and_data("rotary_table")
    found = ladder(machine, data, [machine.effect("tilt_error_motion", "C")])
    figure = figures.ladder(found)
    titles = [note.text for note in figure.layout.annotations[::2]]
    assert titles == ["<b>the file</b>", "<b>+ tilt_error_motion at C</b>  odds more than a million"]
    first, last = (rung.held_out.rms * 1000 for rung in (found.rungs[0], found.rungs[-1]))
    assert figure.layout.annotations[1].text.endswith(f" / {first:#.3g}")
    assert figure.layout.annotations[3].text.endswith(f" / {last:#.3g}")
    by_name = {trace.name: trace for trace in figure.data}
    assert list(by_name) == ["95 % interval of the noise", "noise, by replicates", "held out", "fitted"]
    np.testing.assert_allclose(by_name["fitted"].x, [1000 * rung.fit.rms for rung in found.rungs])
    np.testing.assert_allclose(by_name["held out"].x, [1000 * rung.held_out.rms for rung in found.rungs])
    long = figures.ladder(Ladder(found.rungs + found.rungs[1:] * 19))
    marks = next(trace for trace in long.data if trace.name == "fitted")
    assert list(marks.customdata) == [0, *range(10, 21)]
    assert "9 steps after the first model are not drawn" in long.layout.meta["note"]
    assert len({trace.marker.symbol for trace in figure.data if trace.mode == "markers"}) == 3


def test_axis_view_is_right_handed() -> None:
    from rodgen.output.figures.axis import _view

    for direction in [*np.eye(3), *-np.eye(3), [0.6, 0.0, 0.8], [0.6, -0.64, -0.48]]:
        u, v, _ = _view(np.array(direction))
        np.testing.assert_allclose(np.cross(u, v), direction, atol=4e-16)
        np.testing.assert_allclose([u @ u, v @ v], 1, rtol=4e-16)
    assert _view(np.array([0.0, 0, 1]))[2] == ("x", "y")
    assert _view(np.array([0.0, 0, -1]))[2] == ("y", "x")


def test_axis_figure_shows_every_pair_and_marks_outliers() -> None:
    pairs = read_motions(EXAMPLES / "pairs.csv")
    fit = rodgen.fit_axis(pairs.rho, pairs.rho_prime, pairs.angle, loss="huber")
    figure = figures.axis_fit(fit, pairs)
    by_name = {(trace.name, trace.xaxis): trace for trace in figure.data}
    assert len(by_name["before", "x"].x) == len(by_name["after", "x"].x) == fit.pairs
    lines = np.flatnonzero(fit.outliers) + 2  # of the file, whose first has the names
    np.testing.assert_array_equal(by_name["outlier", "x3"].x, lines)
    assert figure.layout.yaxis.scaleanchor == "x"
    parts = [by_name[f"{way} the axis", "x3"].y for way in ("along", "away from", "around")]
    np.testing.assert_allclose(
        np.linalg.norm(parts, axis=0), np.linalg.norm(fit.residuals[~fit.outliers], axis=1), rtol=1e-9
    )


def test_map_is_blank_outside_the_workspace() -> None:
    found = tricept.uncertainty_map(tricept.PAPER, U_PAPER, "z", 700.0, tricept.LEG_LIMITS, n=21)
    figure = figures.uncertainty_map(found)
    outside = found.status != TriceptStatus.REACHABLE
    for n in range(3):
        values = np.array(figure.data[n].z, float)
        np.testing.assert_array_equal(np.isnan(values), outside)
        np.testing.assert_allclose(values[~outside], 1000 * found.u[..., n][~outside])


@pytest.mark.thorough
def test_map_of_attitudes_shows_the_cells() -> None:
    _, six, one, *_ = maps()
    assert sum(trace.type == "heatmap" for trace in six.data) == 6
    (cells,) = (trace for trace in one.data if trace.type == "heatmap")
    machine = three_sps_s.Geometry(2.0, 1.0, 1.5)
    found = three_sps_s.workspace(machine, (1.3, 2.7), torsion=0.4, samples=12)
    z, at = np.array(cells.z, float), np.array(cells.x)
    for azimuth, tilt in ((3, 2), (10, 7), (0, 11)):
        x, y = (np.degrees(found.tilt[tilt]) * f(found.azimuth[azimuth]) for f in (np.cos, np.sin))
        shown = z[np.abs(at - y).argmin(), np.abs(at - x).argmin()]
        status = found.status[0, azimuth, tilt]
        assert shown == (7 if found.joined[0, azimuth, tilt] else status)


# residuals of rows -------------------------------------------------------------------------------------------------


@cache
def fitted(name: str) -> Fit:
    machine, data = machine_and_data(name)
    return machine.fit(data)


def trace_of(figure: Any, panel: int, name: str) -> Any:
    """The trace of a panel, from 0, whose name begins so."""
    axis = f"x{panel + 1}" if panel else "x"
    return next(t for t in figure.data if t.xaxis == axis and str(t.name).startswith(name))


def test_residuals_stand_where_their_rows_are() -> None:
    fit = fitted("gantry_rotary")
    figure = figures.residual_plot(fit, "C", colour="Z", selected=[3], aside=[7])
    kept = np.setdiff1d(np.arange(fit.observations.n), 7)
    for panel in range(3):
        trace = trace_of(figure, panel, "residual")
        assert list(trace.x) == [None] if panel == 0 else trace.x is not None  # the legend's mark
        trace = [t for t in figure.data if t.xaxis == trace.xaxis and t.name == trace.name][-1]
        np.testing.assert_array_equal(trace.customdata, kept)
        np.testing.assert_allclose(trace.x, np.degrees(fit.observations.q[kept, 3]))
        np.testing.assert_allclose(trace.y, 1000 * fit.residuals[kept, panel])
        np.testing.assert_allclose(trace.marker.color, fit.observations.q[kept, 2])
        assert list(trace_of(figure, panel, "selected").customdata) == [3]
        assert list(trace_of(figure, panel, "excluded").customdata) == [7]
    assert trace.hovertext[0].startswith("line 2, ball_1<br>X ")
    assert figure.layout.coloraxis.colorbar.title.text == "Z [mm]"
    assert [note.text for note in figure.layout.annotations] == ["x [µm]", "y [µm]", "z [µm]"]


@pytest.mark.thorough
def test_residuals_before_and_after_whitened_and_in_parts() -> None:
    machine, data = machine_and_data("gantry_rotary")
    before = fitted("gantry_rotary")
    after = machine.with_effect(machine.effect("encoder_eccentricity", "C")).fit(data)
    sides = {"before": before, "after": after}
    together = figures.residual_plot(after, before=before, parts="together", whitened=True)
    apart = figures.residual_plot(after, before=before, whitened=True, approach="C")
    sigma = before.observations.sigma
    for name, fit in sides.items():
        size = np.linalg.norm(fit.residuals / sigma, axis=1)
        np.testing.assert_allclose(trace_of(together, 0, name).y, size, rtol=1e-9)
        forwards = trace_of(apart, 1, f"{name}, forwards")
        rows = np.flatnonzero(before.observations.s[:, 3] > 0)
        np.testing.assert_array_equal(forwards.customdata, rows)
        np.testing.assert_allclose(forwards.y, (fit.residuals / sigma)[rows, 1])
    ways = figures.residual_plot(after, "dir_C", before=before)
    drawn = [np.sort(trace_of(ways, 0, name).x - np.sign(trace_of(ways, 0, name).x)) for name in sides]
    assert drawn[0][-1] < 0 < drawn[1][0]  # before at the left of its direction, after at the right
    table = made_diagnoses.table(72).base
    along = figures.residual_plot(table, "C", parts="C")
    reading, across = (trace_of(along, k, "residual") for k in (0, 1))
    arm = np.linalg.norm(table.places(table.observations)[:, :2], axis=1) * np.pi / 648  # µm for an arcsec
    size = 1000 * np.linalg.norm(table.residuals, axis=1)
    np.testing.assert_allclose(np.hypot(reading.y * arm, across.y), size, rtol=1e-6)
    with pytest.raises(ValueError, match="'W' is none of X, Y"):
        figures.residual_plot(before, "W")
    with pytest.raises(ValueError, match="'W' is no joint: X, Y, Z and C"):
        figures.residual_plot(before, approach="W")


@pytest.mark.thorough
def test_many_rows_are_thinned_keep_their_extremes_and_say_so() -> None:
    fit = made_diagnoses.table(40_000).base
    figure = figures.residual_plot(fit, selected=[12_345])
    drawn = trace_of(figure, 0, "residual")
    assert f"{len(drawn.x)} of 40000 rows are drawn" in figure.layout.meta["note"]
    assert {12_345, *np.argsort(-np.abs(fit.residuals[:, 0]))[:10].tolist()} <= {*drawn.customdata.tolist()}
    assert len(drawn.x) < 1100
    mean = trace_of(figure, 0, "mean of neighbours")
    np.testing.assert_allclose(np.mean(mean.y), 1000 * fit.residuals[:, 0].mean(), atol=0.2)


def test_residuals_can_be_drawn_against_everything_that_varies() -> None:
    sky = DrawnRows(fitted("mount"))
    assert {"AZ", "EL", "altitude", "azimuth", "order"} <= sky.drivers.keys()
    x, y, z = sky.places.T
    np.testing.assert_allclose(sky.driver("altitude").noted, np.degrees(np.arcsin(z)), atol=1e-6)
    np.testing.assert_allclose(sky.driver("azimuth").noted, np.degrees(np.arctan2(x, y)) % 360, atol=1e-6)
    for name in sky.drivers:
        assert figures.residual_plot(fitted("mount"), name).data


def test_residuals_are_first_drawn_against_what_they_depend_on_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the telescope that is elevation, over which its tube bends; else known by construction."""
    assert DrawnRows(fitted("mount")).main_driver == "EL"
    rows = DrawnRows(fitted("gantry_rotary"))
    noise = np.random.default_rng(2).normal(size=rows.base.residuals.shape)
    for name in ("Y", "C"):
        values = rows.driver(name).values
        made = noise + 3 * np.sin(6 * values / np.ptp(values))[:, None]
        monkeypatch.setattr(DrawnRows, "every", lambda *_, made=made, **__: made)
        assert rows.main_driver == name
    monkeypatch.setattr(DrawnRows, "every", lambda *_, **__: noise)
    assert rows.main_driver == next(iter(rows.drivers))


def test_an_axis_ends_where_that_of_another_figure_does_unless_residuals_need_more() -> None:
    figure = figures.residual_plot(fitted("mount"), least=[50.0, 1.0])
    own = figures.residual_plot(fitted("mount"))
    assert figure.layout.yaxis.range == (-50.0, 50.0)
    assert figure.layout.yaxis2.range == own.layout.yaxis2.range


def test_arrows_are_as_many_times_too_long_as_the_note_says() -> None:
    fit = fitted("gantry_rotary")
    figure = figures.residual_map(fit, exaggeration=5000.0, selected=[3])
    assert "Arrows are 5,000 times as long as the residuals." in figure.layout.meta["note"]
    arrows, dots = [t for t in figure.data if t.xaxis == "x" and t.name == "residual"][:2]
    row = dots.customdata
    start, tip = (np.column_stack([arrows.x[k::6], arrows.y[k::6]]) for k in (0, 1))
    np.testing.assert_array_equal(start, np.column_stack([dots.x, dots.y]))
    np.testing.assert_allclose(start, fit.places(fit.observations)[row][:, :2])
    np.testing.assert_allclose(tip - start, 5000 * fit.residuals[row][:, :2], atol=1e-9)
    assert list(trace_of(figure, 0, "selected").customdata) == [3]
    sky = figures.residual_map(fitted("mount"))
    words = {note.text: (note.x, note.y) for note in sky.layout.annotations if note.text.startswith("az ")}
    for azimuth, at in (("az 0°", (0, 1)), ("az 90°", (1, 0)), ("az 180°", (0, -1)), ("az 270°", (-1, 0))):
        np.testing.assert_allclose(np.array(words[azimuth]) / 101, at, atol=1e-12)
    arrows = trace_of(sky, 0, "residual")
    drivers = DrawnRows(fitted("mount")).drivers
    seen = np.degrees(np.arctan2(arrows.x[::6], arrows.y[::6])) % 360
    np.testing.assert_allclose(
        seen, drivers["azimuth"].noted, atol=0.01
    )  # read and predicted differ by arcsec
    times = float(re.search(r"Arrows are (\S+) times", sky.layout.meta["note"])[1].replace(",", ""))
    start, tip = (np.column_stack([arrows.x[k::6], arrows.y[k::6]]) for k in (0, 1))
    outwards = np.sum((tip - start) * start, axis=1) / np.linalg.norm(start, axis=1)
    np.testing.assert_allclose(outwards * 3600, -times * fitted("mount").residuals[:, 1], rtol=0.1, atol=2000)


@pytest.mark.thorough
def test_planned_readings_are_marked_where_they_are_to_be_taken() -> None:
    def planned(figure: Any) -> Any:
        return next(trace for trace in figure.data if trace.name == "planned")

    mount = fitted("mount")
    ahead = Plan({"AZ [deg]": [10.0, 200.0], "EL [deg]": [80.0, 30.0]}, (), (), None)
    against = figures.residual_plot(mount, "EL", planned=ahead)
    np.testing.assert_allclose(planned(against).x, ahead.rows["EL [deg]"])
    assert np.all(np.asarray(planned(against).y) < -0.9 * np.abs(against.layout.yaxis.range[0]))
    assert "at the lower edge" in against.layout.meta["note"]
    order = planned(figures.residual_plot(mount, planned=ahead))
    assert order.x[0] == mount.observations.n + 2  # line 1 has the names
    sky = planned(figures.residual_map(mount, planned=ahead))
    zenith = 90 - np.asarray(ahead.rows["EL [deg]"])
    np.testing.assert_allclose(np.hypot(sky.x, sky.y), zenith, atol=0.5)  # but for the boresight's error
    ring = planned(figures.polar_plot(mount, "AZ", planned=ahead))
    turn = np.radians(ahead.rows["AZ [deg]"])
    np.testing.assert_allclose(np.arctan2(ring.y, ring.x), np.arctan2(np.sin(turn), np.cos(turn)), atol=1e-9)
    # in space, at a place that no reading was taken at
    table = fitted("gantry_rotary")
    rows = {"X [mm]": [900.0], "Y [mm]": [10.0], "Z [mm]": [-200.0], "C [deg]": [0.0], "target": ["ball_1"]}
    beyond = Plan(rows, (), (), None)
    there = planned(figures.residual_vectors(table, planned=beyond))
    flat = planned(figures.residual_map(table, planned=beyond))
    assert there.x[0] == pytest.approx(900 + table.machine.targets[0].point[0], abs=1)
    assert (flat.x[0], flat.y[0]) == pytest.approx((there.x[0], there.y[0]))
    low, high = figures.residual_map(table, planned=beyond).layout.xaxis.range
    assert low < 900 < high
    other = Plan({"A [deg]": [1.0]}, (), (), None)  # of another machine
    assert "planned" not in {trace.name for trace in figures.residual_plot(table, planned=other).data}


def test_quantiles_are_those_of_all_rows() -> None:
    fit = fitted("gantry_rotary")
    figure = figures.quantiles_of_residuals(fit)
    trace = trace_of(figure, 0, "residual")
    r = 1000 * fit.residuals[:, 0]
    np.testing.assert_allclose(trace.y, r[trace.customdata])
    n, at = len(r), np.argsort(trace.x)
    assert (np.diff(trace.y[at]) >= 0).all()
    np.testing.assert_allclose(
        [NormalDist().cdf(x) for x in trace.x[at]], (np.arange(n) + 0.5) / n, rtol=1e-9
    )
    band = trace_of(figure, 0, "95 %")
    half = len(band.x) // 2
    low, high = np.array(band.y[:half]), np.array(band.y[half:][::-1])
    middle = half // 2  # of the median: 1.253 sigma/sqrt(n) on both sides
    assert (high - low)[middle] == pytest.approx(2 * 1.96 * 1.253 * np.std(r) / np.sqrt(n), rel=0.02)
    assert np.all(high > low)


def test_correlation_in_time_is_seen_and_independence_is_within_its_bounds() -> None:
    random = np.random.default_rng(2)
    n, keeps = 2000, 0.8
    wander = np.zeros(n)
    for k in range(1, n):
        wander[k] = keeps * wander[k - 1] + random.normal()
    angle = 137.5 * np.arange(n) % 360  # each pose far from the one before
    z = 0.001 * wander
    data = {
        "C [deg]": angle,
        "x [mm]": 100 * np.cos(np.radians(angle)),
        "y [mm]": 100 * np.sin(np.radians(angle)),
    }
    data |= {"z [mm]": z, "t [s]": 60.0 * np.arange(n)}
    data["x [mm]"] = data["x [mm]"] + random.normal(size=n) * 0.001
    machine = made_diagnoses.table(8, hidden=()).base.machine
    fit = machine.fit(Measurements.from_frame(data))
    figure = figures.autocorrelation_of_residuals(fit, against="t")
    found = trace_of(figure, 2, "residual")
    np.testing.assert_allclose(found.x, 60 * np.arange(1, 41))
    np.testing.assert_allclose(found.y[:5], keeps ** np.arange(1, 6), atol=0.15)
    independent, bound = trace_of(figure, 0, "residual"), trace_of(figure, 0, "95 %")
    assert bound.y[0] == pytest.approx(1.96 / np.sqrt(n - 1))
    assert np.mean(np.abs(independent.y) < bound.y) > 0.85
    order = figures.autocorrelation_of_residuals(fit)
    np.testing.assert_array_equal(trace_of(order, 2, "residual").x, np.arange(1, 41))
    with pytest.raises(ValueError, match="no column t"):
        figures.autocorrelation_of_residuals(fitted("gantry_rotary"), against="t")


def test_polar_plot_shows_what_is_away_from_the_axis() -> None:
    """A ball on a table whose axis wanders: 5 µm outwards at C = 0, ahead at 90°."""
    machine = made_diagnoses.table(8, hidden=()).base.machine
    angle = np.radians(np.arange(0, 360, 5.0))
    radial, ahead, axial = 0.005 * np.cos(2 * angle), 0.003 * np.sin(3 * angle), 0.002 * np.cos(4 * angle)
    c, s = np.cos(angle), np.sin(angle)
    data = {
        "C [deg]": np.degrees(angle),
        "x [mm]": (100 + radial) * c - ahead * s,
        "y [mm]": (100 + radial) * s + ahead * c,
        "z [mm]": axial,
    }
    fit = machine.fit(Measurements.from_frame(data))
    assert figures.joints_that_go_round(fit) == ["C"]
    figure = figures.polar_plot(fit, "C", selected=[5])
    limits = [float(note.text.split()[0]) for note in figure.layout.annotations if note.text.startswith("+")]
    for panel, (size, limit) in enumerate(zip((radial, ahead, axial), limits, strict=True)):
        drawn = {}
        for name in ("residual, forwards", "residual, backwards"):
            with suppress(StopIteration):
                trace = trace_of(figure, panel, name)
                places = zip(trace.x, trace.y, trace.text, strict=True)
                drawn |= dict(zip(trace.customdata.tolist(), places, strict=True))
        x, y, said = np.array([drawn[row] for row in range(len(angle))]).T
        np.testing.assert_allclose(np.arctan2(y, x) % (2 * np.pi), angle, atol=1e-9)
        np.testing.assert_allclose((np.hypot(x, y) - 1) * 2 * limit, 1000 * size, atol=0.01)
        np.testing.assert_allclose(said, 1000 * size, atol=0.01)
        assert list(trace_of(figure, panel, "selected").customdata) == [5]
    with pytest.raises(ValueError, match="'X' is no revolute joint: C"):
        figures.polar_plot(fit, "X")


def test_ball_bar_is_drawn_in_the_planes_that_it_swept() -> None:
    fit = fitted("ballbar_gantry")
    assert figures.joints_that_go_round(fit) == ["xy", "yz", "zx"]
    figure = figures.polar_plot(fit, "yz")
    assert figure.layout.meta["title"] == "Residuals in the plane yz"
    trace = trace_of(figure, 0, "residual")
    arm = fit.places(fit.observations) - np.array(fit.machine.measured.origin)
    flat = np.abs(arm[:, 0]) < 0.02 * np.linalg.norm(arm, axis=1)
    assert set(trace.customdata.tolist()) <= set(np.flatnonzero(flat).tolist())
    assert len(trace.customdata) >= flat.sum() - 1
    angle = np.arctan2(arm[:, 2], arm[:, 1])[trace.customdata]
    np.testing.assert_allclose(np.cos(np.arctan2(trace.y, trace.x) - angle), 1, atol=1e-12)
    np.testing.assert_allclose(trace.text, 1000 * fit.residuals[trace.customdata, 0])
    limit = next(
        float(note.text.split()[0]) for note in figure.layout.annotations if note.text.startswith("+")
    )
    np.testing.assert_allclose((np.hypot(trace.x, trace.y) - 1) * 2 * limit, trace.text, atol=1e-9)


def test_residuals_stand_in_space_with_the_machine() -> None:
    fit = fitted("gantry_rotary")
    figure = figures.residual_vectors(fit, exaggeration=1000.0, selected=[3])
    by_name = {trace.name: trace for trace in figure.data}
    assert {"revolute axes, positive towards the name", "residual", "selected"} <= by_name.keys()
    lines = by_name["residual"]
    ends = np.stack([lines[x] for x in "xyz"], -1).reshape(-1, 3, 3)
    row = lines.customdata[::3]
    np.testing.assert_allclose(ends[:, 0], fit.places(fit.observations)[row])
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], 1000 * fit.residuals[row], atol=1e-9)
    assert "1,000 times as long" in figure.layout.meta["note"]
    free = fitted("robot_6r_tracker")
    lines = next(t for t in figures.residual_vectors(free, exaggeration=10.0).data if t.name == "residual")
    ends = np.stack([lines[x] for x in "xyz"], -1).reshape(-1, 3, 3)
    turned = free.residuals[lines.customdata[::3]] @ free.solution.frame.rotation
    np.testing.assert_allclose((ends[:, 1] - ends[:, 0]) / 10, turned, atol=1e-9)
    sky = next(t for t in figures.residual_vectors(fitted("mount")).data if t.name == "residual")
    np.testing.assert_allclose(np.linalg.norm([sky[x][::3] for x in "xyz"], axis=0), 1)
    assert figures.residual_vectors(fitted("ballbar_gantry")) is None
