"""``rodgen import`` of TPOINT's files: runs, models, and what these do on the sky, by the formulas of TPOINT."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.fit import fit
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.data.measurements import Measurements
from rodgen.machines.effects.formula import Formula
from rodgen.machines.imports.tpoint_data import read_pointings
from rodgen.machines.imports.tpoint_model import (
    machine_from_tpoint,
    model_text,
    mount_machine,
    read_model,
    terms_of,
)
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.mounts import ALTAZ, EQUATORIAL

Run = Callable[..., tuple[int, str, str]]
ROOT = Path(__file__).parent.parent
DATA = ROOT / "tests" / "data"
MOUNT = ROOT / "examples" / "machines" / "mount"
LATITUDE = np.radians(32.0)
RNG = np.random.default_rng(12)

RUN = """A mount ! not a comment
! a comment
: EQUAT
: NODA
+31 41 19.6 2021 8 21
2 0 0.0 +10 0 0  1 59 50.0 +10 0 20.0  3 30.0
5 0 0.0 -0 30 0  4 59 50.0 -0 29 40.0  3 40.0
END
"""


def sexagesimal(degrees: float) -> str:
    sign, size = "-" if degrees < 0 else "+", abs(degrees)
    return f"{sign}{int(size)} {int(size * 60) % 60} {size * 3600 % 60:.6f}"


# what a term does -------------------------------------------------------------------------------------------


def altaz(A, E):
    """To the right and up on the sky, of azimuth from north through east: the star less what the axes say.

    Signs are those of TPOINT, which counts azimuth from south through east and calls left positive: with S = 180 deg -
    A a harmonic HAfAn moves by -f(nS), HEfAn by f(nS). The pointing software of APEX has the same signs.
    """
    sin, cos, one, none = np.sin, np.cos, np.ones_like(A), np.zeros_like(A)
    S = np.pi - A
    return {
        "IA": (-cos(E), none), "IE": (none, one), "CA": (-one, none), "NPAE": (-sin(E), none),
        "AN": (-sin(A) * sin(E), -cos(A)), "AW": (-cos(A) * sin(E), sin(A)),
        "ACES": (-sin(A) * cos(E), none), "ACEC": (cos(A) * cos(E), none),
        "ECES": (none, sin(E)), "ECEC": (none, cos(E)),
        "NRX": (-cos(E), sin(E)), "NRY": (sin(E), cos(E)),
        "TF": (none, -cos(E)), "TX": (none, -1 / np.tan(E)),
        "FLOP": (none, one), "HACA3": (cos(3 * A) * cos(E), none), "HESE2": (none, sin(2 * E)),
        "HASA3": (-sin(3 * S) * cos(E), none), "HASA2": (-sin(2 * S) * cos(E), none),
        "HACA2": (-cos(2 * A) * cos(E), none), "HACA4": (-cos(4 * S) * cos(E), none),
        "HACA8": (-cos(8 * S) * cos(E), none), "HASA8": (-sin(8 * S) * cos(E), none),
        "HESA": (none, sin(A)), "HECA": (none, -cos(A)), "HESA2": (none, -sin(2 * A)), "HECA2": (none, cos(2 * A)),
        "HESA3": (none, sin(3 * A)), "HECA3": (none, -cos(3 * A)), "HESA4": (none, sin(4 * S)),
        "HVSA2": (-sin(2 * S) * sin(E), none), "HVCA": (-cos(S) * sin(E), none),
        "HASA2CE": (-sin(2 * S) * cos(E) ** 2, none), "HASE2": (-sin(2 * E) * cos(E), none),
        "PEE2": (none, E**2), "PSE": (-E, none), "PZZ3": (none, -((np.pi / 2 - E) ** 3)),
        "HASA12": (sin(12 * A) * cos(E), none),
        "HSCA2": (-cos(2 * S), none), "HZSZ4": (none, -sin(4 * (np.pi / 2 - E))), "HZCA": (none, -cos(S)),
    }  # fmt: skip


def equatorial(h, d):
    """To the west and to the north."""
    sin, cos, one, none = np.sin, np.cos, np.ones_like(h), np.zeros_like(h)
    sl, cl = np.sin(LATITUDE), np.cos(LATITUDE)
    zenith = sl * sin(d) + cl * cos(d) * cos(h)  # cosine of the zenith angle
    west, north = cl * sin(h), cl * cos(h) * sin(d) - sl * cos(d)
    return {
        "IH": (cos(d), none), "ID": (none, one), "CH": (one, none), "NP": (sin(d), none),
        "ME": (sin(h) * sin(d), cos(h)), "MA": (-cos(h) * sin(d), sin(h)),
        "HCES": (sin(h) * cos(d), none), "HCEC": (cos(h) * cos(d), none),
        "DCES": (none, sin(d)), "DCEC": (none, cos(d)),
        "HGES": (sin(40 * h) * cos(d), none), "HGEC": (cos(40 * h) * cos(d), none),
        "DGES": (none, sin(40 * d)), "DGEC": (none, cos(40 * d)),
        "FO": (none, cos(h)), "DAF": (-(cl * cos(h) * cos(d) + sl * sin(d)), none),
        "TF": (west, north), "TX": (west / zenith, north / zenith),
        "DNP": (sin(h) * sin(d), none), "HDSH3": (none, sin(3 * h)), "X2HC": (cos(2 * h), none),
        "HHSH2CD1": (sin(2 * h) * cos(d) * cos(d), none), "PHH": (h * cos(d), none), "PDD": (none, d),
        "PDD3": (none, d**3), "PHD": (d * cos(d), none), "PXHD2": (h * d**2, none),
        "FLOP": tuple(-x / np.sqrt(1 - zenith**2) for x in (west, north)),
        "HZCZ2": tuple(cos(2 * np.arccos(zenith)) / np.sqrt(1 - zenith**2) * x for x in (west, north)),
    }  # fmt: skip


FORMULAS = {ALTAZ: altaz, EQUATORIAL: equatorial}
SKY = {
    # up to 80 degrees of elevation and of declination; a star stands 15 degrees high at least
    ALTAZ: np.stack([RNG.uniform(-3, 3, 80), RNG.uniform(0.27, 1.4, 80)], -1),
    EQUATORIAL: np.stack([RNG.uniform(-0.9, 0.9, 80), RNG.uniform(-0.2, 1.2, 80)], -1),
}
SINGLE = [(mount, term) for mount, formulas in FORMULAS.items() for term in formulas(*np.ones((2, 1)))]


def model_file(folder: Path, terms: dict[str, float]) -> str:
    path = folder / "model.mod"
    path.write_text(model_text("Mount", terms, rows=80, rms=0.7))
    return str(path)


def places(machine: Machine, o) -> np.ndarray:
    model = Model(machine, o.travel, o.run_names, compiled=False)
    return Problem(model, o).places(model.start(), Frame.identity())


def shift(machine: Machine, mount, q) -> np.ndarray:
    """To the right, or west, and up, or north, arcsec: what the machine sees less what its axes say."""
    columns = {f"{name} [rad]": x for name, x in zip(mount.joints, q.T, strict=True)}
    columns |= dict(zip(("ux", "uy", "uz"), mount.direction(*q.T).T, strict=True))
    o = bind(machine, Measurements.from_frame(columns))
    seen = places(machine, o)
    x, y, z = mount.direction(*q.T).T
    level = np.stack([y, -x, 0 * x], -1) / np.hypot(x, y)[:, None]  # about -z
    up = np.stack([-x * z, -y * z, x * x + y * y], -1) / np.hypot(x, y)[:, None]
    moved = (seen - mount.direction(*q.T)) * 206264.806247
    return np.stack([np.sum(moved * level, -1), np.sum(moved * up, -1)])


@pytest.mark.parametrize(("mount", "term"), SINGLE, ids=[f"{m.name} {t}" for m, t in SINGLE])
def test_a_term_does_on_the_sky_what_tpoint_says_and_comes_back(mount, term, tmp_path):
    name = model_file(
        tmp_path, {term: 3.0, ("IA" if mount is ALTAZ else "IH"): 1.0 + 2.0 * (term in ("IA", "IH"))}
    )
    machine = machine_from_tpoint(None, name, latitude=LATITUDE).machine
    terms = read_model(name).terms
    formulas = FORMULAS[mount](*SKY[mount].T)
    expected = sum(value * np.stack(formulas[each]) for each, value in terms.items())
    # terms are of first order: what remains is the square of some arcsec
    np.testing.assert_allclose(shift(machine, mount, SKY[mount]), expected, atol=1e-3)
    # NRX and NRY are sums of others
    back = {"NRX": {"IA": 4.0, "ECES": 3.0}, "NRY": {"IA": 1.0, "ECEC": 3.0, "NPAE": -3.0}}.get(term, terms)
    assert terms_of(machine, mount, LATITUDE) == pytest.approx(back, abs=1e-6)


@pytest.mark.parametrize("mount", FORMULAS, ids=lambda mount: mount.name)
def test_a_whole_model_does_what_tpoint_says_and_comes_back(mount, tmp_path):
    formulas = FORMULAS[mount](*SKY[mount].T)
    # NRX, NRY and FLOP are sums of others; the waves of gears come with a period, one at an axis
    terms = {t: float(RNG.uniform(-2, 2)) for t in formulas if t not in ("NRX", "NRY")}
    name = model_file(tmp_path, terms)
    machine = machine_from_tpoint(None, name, latitude=LATITUDE).machine
    read = read_model(name).terms
    assert read == pytest.approx(terms, abs=5e-5)
    expected = sum(value * np.stack(formulas[each]) for each, value in read.items())
    np.testing.assert_allclose(shift(machine, mount, SKY[mount]), expected, atol=1e-3)
    assert terms_of(machine, mount, LATITUDE) == pytest.approx(read, abs=1e-6)


# pointing runs ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("run", "by_hand", "records"),
    [
        (DATA / "mmt_2021" / "k_and_e.dat", MOUNT / "mmt_2021.csv", range(80)),
        (DATA / "mmt_2025" / "point_20250326.dat", DATA / "mmt_2025" / "data.csv", [*range(30, 46), *range(70, 76)]),
    ],
)  # fmt: skip
def test_the_mmt_s_files_are_what_was_made_of_them_by_hand(run, by_hand, records):
    made = machine_from_tpoint(str(run))
    expected = np.loadtxt(by_hand, delimiter=",", skiprows=1)[records]
    columns = np.stack([made.columns[name] for name in ("AZ [deg]", "EL [deg]", "ux", "uy", "uz")], -1)
    np.testing.assert_allclose(columns, expected, atol=1e-10)  # directions are written to 11 digits there
    assert ("t [s]" in made.columns) == (run.parent.name == "mmt_2025")


@pytest.mark.thorough
def test_the_mmt_s_model_is_tpoint_s(tmp_path, rodgen_command: Run):
    run = DATA / "mmt_2021" / "k_and_e.dat"
    code, out, err = rodgen_command("import", run, "-o", tmp_path / "m.toml", "-d", tmp_path / "d.csv")
    assert (code, err) == (0, "")
    assert "k_and_e.dat: a pointing run, 80 stars, alt-azimuth mount." in out
    assert "nothing looks wrong" in out
    machine, data = Machine.load(tmp_path / "m.toml"), Measurements.load(tmp_path / "d.csv")
    found = diagnose(machine, data)
    assert [(step.effect.name, step.effect.place) for step in found.steps] == [
        ("tube_flexure", None),
        ("refraction", None),
    ]
    # Published with the data (SOURCE.txt), of azimuths from south, which turns the signs of IA, CA, NPAE and AN; terms
    # are of first order, and IA is 1209 arcsec: 0.006 of what is a few arcsec
    published = {
        "IA": -1209.2612, "IE": -2.9933, "NPAE": 3.4724, "CA": 5.9455, "AN": -2.4950, "AW": -10.3347,
        "TF": 21.4118, "TX": -2.7165,
    }  # fmt: skip
    terms = terms_of(found.machine, ALTAZ, 0.0)
    assert terms == pytest.approx(published, abs=0.1)
    assert terms["TF"] == pytest.approx(21.4118, abs=0.02)
    assert terms["TX"] == pytest.approx(-2.7165, abs=0.02)


@pytest.mark.parametrize("form", [2, 3, 4])
def test_each_format_gives_the_same_run(form, tmp_path):
    h, d = RNG.uniform(-50, 50, 20), RNG.uniform(-30, 80, 20)
    raw = np.stack([h + 0.02, d - 0.01], -1)
    lines = []
    for k in range(20):
        sidereal = 3.0 + 0.1 * k
        star, axes = (h[k], d[k]), raw[k]
        if form == 4:
            lines.append(" ".join(f"{x:.9f}" for x in (*star, *axes)))
            continue
        at = [(15 * sidereal - a, b) if form == 2 else (a, b) for a, b in (star, axes)]
        record = [f"{sexagesimal(a / 15)} {sexagesimal(b)}" for a, b in at]
        record += [f"{int(sidereal)} {sidereal % 1 * 60:.8f}"] if form == 2 else []
        lines.append(" ".join(record))
    path = tmp_path / "run.dat"
    path.write_text("Run\n:EQUAT\n:NODA\n31 41 19.6 2021 8 21\n" + "\n".join(lines) + "\nEND\n")
    run = read_pointings(path)
    np.testing.assert_allclose(np.degrees(run.commanded), raw, atol=2e-8)
    np.testing.assert_allclose(run.seen, EQUATORIAL.direction(*np.radians([h, d])), atol=1e-9)
    if form == 2:
        # a tenth of a sidereal hour is 359.0170 s
        np.testing.assert_allclose(run.time, 359.0170 * np.arange(20), atol=0.01)
        assert any("refraction is left to the model" in note for note in run.notes)


@pytest.mark.parametrize(
    ("extra", "given", "form", "auxiliary"),
    [
        ("3 30.0", None, 2, 0),
        ("3 30.0 -7", None, 2, 1),
        ("-3 30.0", None, 3, 2),  # no sidereal time
        ("3 75.0 1", None, 3, 3),
        ("3 30.0", 3, 3, 2),
        ("3 30.0 1 2 3", None, 2, 3),  # 2000 is no equinox here
    ],
)
def test_a_format_is_known_by_what_numbers_can_be(refuses, extra, given, form, auxiliary, tmp_path):
    lines = RUN.replace("  3 30.0", f" {extra}").replace("  3 40.0", f" {extra}")
    (tmp_path / "run.dat").write_text(lines)
    run = read_pointings(tmp_path / "run.dat", form=given)
    assert any(note.startswith(f"Observations are of format {form}:") for note in run.notes)
    assert run.auxiliary.shape == (2, auxiliary)
    assert any("--format says otherwise" in note for note in run.notes) == (given is None)
    hours = np.array([2.0, 5.0]) if form == 3 else 3.5 - np.array([2.0, 5.0])
    np.testing.assert_allclose(
        run.seen, EQUATORIAL.direction(*np.radians([15 * hours, [10, -0.5]])), atol=1e-9
    )
    refuses(read_pointings, tmp_path / "run.dat", form=4)


def test_an_alt_azimuth_run_may_have_right_ascensions(tmp_path):
    """The same directions, and the same encoders, as azimuths and elevations by spherical trigonometry."""
    text = RUN.replace("EQUAT", "ALTAZ")
    (tmp_path / "a.dat").write_text(text)
    run = read_pointings(tmp_path / "a.dat")
    phi = np.radians(31.688778)
    h, d = (
        np.radians([[22.5, 22.5 + 1 / 24], [-20.0, -20 + 1 / 24]]),
        np.radians([[10, 10 + 20 / 3600], [-0.5, -0.5 + 20 / 3600]]),
    )
    el = np.arcsin(np.sin(phi) * np.sin(d) + np.cos(phi) * np.cos(d) * np.cos(h))
    az = np.arctan2(-np.cos(d) * np.sin(h), np.cos(phi) * np.sin(d) - np.sin(phi) * np.cos(d) * np.cos(h))
    np.testing.assert_allclose(run.commanded, np.stack([az[:, 1], el[:, 1]], -1), atol=1e-8)
    np.testing.assert_allclose(run.seen, ALTAZ.direction(az[:, 0], el[:, 0]), atol=1e-8)


@pytest.mark.parametrize(
    ("comment", "option", "place", "reason"),
    [
        ("", None, "north", ", as TPOINT's do; --azimuth south says otherwise."),
        ("! N=0, E=90, unlike our own, which is S=0", None, "north", ", as line 2 says."),
        ("! Azimuth: South = 0, East = 90", None, "south", ", as line 2 says."),
        ("! seeing S=0.8 arcsec", None, "north", ", as TPOINT's do; --azimuth south says otherwise."),
        ("! Azimuth: South = 0, East = 90", "north", "north", "."),
        ("", "south", "south", "."),
    ],
)
def test_where_azimuths_begin(comment, option, place, reason, tmp_path, rodgen_command: Run):
    (tmp_path / "a.dat").write_text(
        f"Run\n{comment}\n:ALTAZ\n31 41 19.6\n10 20 10.1 20.2\n100 40 100.1 40.2\n"
    )
    run = read_pointings(tmp_path / "a.dat", azimuth=option)
    first = [10.1, 100.1] if place == "north" else [169.9, 79.9]
    np.testing.assert_allclose(np.degrees(run.commanded), np.stack([first, [20.2, 40.2]], -1))
    files = ("-o", tmp_path / "m.toml", "-d", tmp_path / "d.csv")
    options = ("--azimuth", option) if option else ()
    _, out, _ = rodgen_command("import", tmp_path / "a.dat", *options, *files)
    assert f"Azimuths of the file run from {place} through east{reason}\n" in out


def test_a_run_from_north_has_the_signs_of_tpoint_s_own_fit(tmp_path):
    """A run by the formulas of TPOINT, azimuths of which are from north: its six geometric terms come back."""
    A, E = SKY[ALTAZ].T
    terms = {"IA": -27.0, "IE": -28.0, "CA": 6.0, "NPAE": -5.0, "AN": 4.4, "AW": 7.0}
    right, up = sum(value * np.stack(altaz(A, E)[each]) for each, value in terms.items()) / 3600
    A, E = np.degrees([A, E])
    rows = np.stack([A, E, A - right / np.cos(np.radians(E)), E - up], -1) % 360
    lines = [" ".join(f"{x:.7f}" for x in row) for row in rows]
    (tmp_path / "run.dat").write_text("\n".join(["Run", ": ALTAZ", "-30 14 40.2", *lines, "END\n"]))
    made = machine_from_tpoint(str(tmp_path / "run.dat"))
    found = fit(made.machine, Measurements.from_frame(made.columns))
    # terms are of first order: the product of two of 30 arcsec is 0.004 arcsec, and 0.03 at 80 degrees, by the tangent
    assert terms_of(found.machine, ALTAZ, 0.0) == pytest.approx(terms, abs=0.05)


def test_a_mean_place_needs_the_date(refuses, tmp_path):
    star = "2 0 0.0 +10 0 0 0 0 2000.0 1 59 50.0 +10 0 20.0 3 30.0"
    (tmp_path / "a.dat").write_text(f"Run\n:EQUAT\n31 41 19.6\n{star}\nEND\n")
    pytest.importorskip("erfa")
    refuses(read_pointings, tmp_path / "a.dat")


def test_refraction_is_that_of_an_independent_formula(tmp_path):
    pytest.importorskip("erfa")
    (tmp_path / "a.dat").write_text(RUN.replace("2021 8 21", "2021 8 21 13.0 741 2608 0.2"))
    (tmp_path / "b.dat").write_text(RUN)
    zenith = -np.array(EQUATORIAL.gravity(np.radians(31.688778)))
    lifted, plain = (
        np.degrees(np.arccos(read_pointings(tmp_path / name).seen @ zenith)) for name in ("a.dat", "b.dat")
    )
    # Bennett's formula at 741 hPa and 13 degrees: good to 0.1 arcmin x 0.7
    bennett = 1 / np.tan(np.radians(90 - lifted + 7.31 / (94.4 - lifted))) * 741 / 1010 * 283 / 286
    np.testing.assert_allclose(60 * (plain - lifted), bennett, atol=0.07)


def test_diurnal_aberration_is_towards_the_east(tmp_path):
    (tmp_path / "a.dat").write_text(RUN.replace(": NODA\n", ""))
    (tmp_path / "b.dat").write_text(RUN)
    moved, plain = (read_pointings(tmp_path / name).seen for name in ("a.dat", "b.dat"))
    # 0.3195 arcsec at the equator (Explanatory Supplement, 7.2.3.4), less what is along the line of sight
    east = np.array([0.0, 1.0, 0.0])
    expected = 0.3195 * np.cos(np.radians(31.688778)) * (east - plain[:, 1:2] * plain)
    np.testing.assert_allclose((moved - plain) * 206264.8, expected, atol=2e-4)


def test_mean_places_are_reduced_as_the_almanac_does(tmp_path):
    pytest.importorskip("erfa")
    # theta Persei, 2028 November 13.19 TT: Meeus, Astronomical Algorithms, example 23.a (apparent place
    # 2h46m14.390s, +49 deg 21' 07.45"); reduced at 0 h, so that a fifth of a day is missing: 0.1 arcsec
    star = "2 44 11.986 +49 13 42.48 0.03425 -0.0895 2000.0"
    (tmp_path / "a.dat").write_text(
        f"Run\n:EQUAT\n:NODA\n40 0 0 2028 11 13\n{star} 2 46 14.390 +49 21 7.45 3 0.0 -2 7\n"
    )
    run = read_pointings(tmp_path / "a.dat")
    seen, axes = run.seen[0], EQUATORIAL.direction(*run.commanded[0])
    assert np.arccos(seen @ axes) * 206264.8 < 0.2
    assert run.auxiliary.tolist() == [[-2.0, 7.0]]


@pytest.mark.parametrize("second", ["S  186 2248.2854    0.000   0.0000", "T 42 1.13 0.0 0.0 extra", ""])
def test_a_model_is_known_by_its_terms(second, tmp_path, rodgen_command: Run):
    (tmp_path / "model.dat").write_text(
        f"ROTSE-III\n{second}\nIH -320.4815 0.1\n= ID -15.07\n&CH  -56.0 9\nEND\n"
    )
    code, out, err = rodgen_command(
        "import", tmp_path / "model.dat", "--latitude", "35.9deg", "-o", tmp_path / "m.toml"
    )
    assert (code, err) == (0, "")
    assert "model.dat: a model, whose terms are held effects: IH, ID and CH" in out
    held = {effect.title: dict(effect.hold) for effect in Machine.load(tmp_path / "m.toml").effects}
    assert held["zero_offset at HA (IH)"]["a"] == pytest.approx(np.radians(-320.4815 / 3600))


def test_a_model_and_a_run_make_one_machine(tmp_path, rodgen_command: Run):
    (tmp_path / "run.dat").write_text(RUN)
    name = model_file(tmp_path, {"IH": -10.0, "TF": 5.0})
    machine, data = tmp_path / "m.toml", tmp_path / "d.csv"
    _, out, _ = rodgen_command("import", tmp_path / "run.dat", name, "-o", machine, "-d", data)
    assert "model.mod: a model, whose terms are held effects: IH and TF" in out
    made = Machine.load(machine)
    assert made.gravity == pytest.approx((-np.cos(0.55307353), 0, -np.sin(0.55307353)))
    assert [effect.title for effect in made.effects] == ["zero_offset at HA (IH)", "tube_flexure (TF)"]
    assert list(Measurements.load(data).columns) == ["HA", "DEC", "ux", "uy", "uz", "t"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (": EQUAT\n", ""),
        ("+31 41 19.6 2021 8 21", "31.7"),
        ("2021 8 21", "8 21 2021"),
        ("-0 30 0", "-O 30 0"),
        ("  3 40.0", ""),
        ("3 40.0", "3 40.0 5"),
        ("-0 30 0 ", "-95 30 0 "),
        (RUN[RUN.index("2 0 0.0") :], ""),
    ],
)
def test_what_is_wrong_with_a_run_is_said_in_one_sentence(refuses, old, new, tmp_path):
    assert old in RUN
    (tmp_path / "run.dat").write_text(RUN.replace(old, new))
    refuses(read_pointings, tmp_path / "run.dat")


def test_a_star_beyond_the_zenith_is_refused(refuses, tmp_path):
    (tmp_path / "run.dat").write_text("Mount\n:ALTAZ\n+31 41 19.6 2021 8 21\n10 20 10 20\n10 95 10 85\nEND\n")
    refuses(read_pointings, tmp_path / "run.dat")


@pytest.mark.parametrize(
    "terms",
    [
        "  IA 1.0\n  QQ 2.0",
        "  IA 1.0\n  NPEA 2.0",
        "  IA 1.0\n  ME 2.0",
        "  IA 1.0\n  PAA2 2.0",
        "  IA 1.0\n  HDSH5 2.0",
        "  IA 1.0\n  IA 2.0",
        "  IA 1.0\n  IE x",
        "  IH 1.0",
        "",
    ],
)
def test_what_is_wrong_with_a_model_is_said_in_one_sentence(refuses, terms, tmp_path):
    (tmp_path / "m.mod").write_text(f"Mount\nT 10 1.0 0 0\n{terms}\nEND\n")
    refuses(machine_from_tpoint, None, str(tmp_path / "m.mod"))


def test_an_effect_without_a_term_has_no_model(refuses, tmp_path):
    machine = mount_machine(ALTAZ, "m", 0.0)
    found = machine.with_effect(machine.effect("scale", "EL", hold={"k": 1e-4}))
    refuses(terms_of, found, ALTAZ, 0.0)


def test_an_effect_of_another_formula_is_no_term_of_that_name(refuses, tmp_path):
    machine = machine_from_tpoint(None, model_file(tmp_path, {"IA": 10.0, "HASA5": 5.0})).machine
    (term,) = (effect for effect in machine.effects if effect.definition.own)
    doubled = Formula.parse(f"2*{term.definition.formula.text}", file="", place="")
    other = replace(term, definition=replace(term.definition, formula=doubled))
    machine = replace(machine, effects=tuple(other if each is term else each for each in machine.effects))
    refuses(terms_of, machine, ALTAZ, 0.0)


def test_a_fit_comes_back_as_the_terms_that_were_simulated(tmp_path):
    terms = {"IA": 30.0, "IE": -20.0, "CA": 15.0, "NPAE": -12.0, "AN": 9.0, "AW": 7.0, "TF": 11.0}
    truth = machine_from_tpoint(None, model_file(tmp_path, terms)).machine
    q = SKY[ALTAZ]
    columns = {"AZ [rad]": q[:, 0], "EL [rad]": q[:, 1]}
    columns |= dict(zip(("ux", "uy", "uz"), ALTAZ.direction(*q.T).T, strict=True))
    o = bind(truth, Measurements.from_frame(columns))
    seen = places(truth, o)
    columns |= dict(zip(("ux", "uy", "uz"), seen.T, strict=True))
    machine = mount_machine(ALTAZ, "m", 0.0)
    found = fit(machine.with_effect(machine.effect("tube_flexure")), Measurements.from_frame(columns))
    # the terms are of first order: products of some tens of arcsec
    assert terms_of(found.machine, ALTAZ, 0.0) == pytest.approx(terms, abs=0.02)
