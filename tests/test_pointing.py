"""The pointing of a fitted mount: TPOINT's terms, and the error on the sky after the zeros and after the model."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rodgen
from rodgen.calibration.pointing import pointing
from rodgen.machines.imports.tpoint_model import machine_from_tpoint, mount_machine
from rodgen.machines.measured import Measured
from rodgen.machines.mounts import ALTAZ, EQUATORIAL, mount_of

DATA = Path(__file__).parent / "data"
ARCSEC = np.pi / 648000


def imported(run):
    made = machine_from_tpoint(str(DATA / run))
    return made.machine, rodgen.Measurements.from_frame(made.columns)


def fitted(machine, mount, q, seen):
    columns = {f"{name} [rad]": x for name, x in zip(mount.joints, q.T, strict=True)}
    columns |= dict(zip(("ux", "uy", "uz"), seen.T, strict=True))
    return machine.fit(rodgen.Measurements.from_frame(columns))


def test_the_mmt_s_errors_on_the_sky_are_those_published():
    """Of the run of 2021, in SOURCE.txt: 10.51 after IA and IE, 3.83 after the geometry, 0.93 with TF and TX."""
    machine, data = imported("mmt_2021/k_and_e.dat")
    fit = machine.fit(data)
    on_sky = pointing(fit)
    assert on_sky.after_zeros == pytest.approx(10.51, abs=0.005)
    assert on_sky.after_model == pytest.approx(3.83, abs=0.005)
    assert on_sky.terms.keys() == {"IA", "IE", "CA", "NPAE", "AN", "AW"}
    assert (
        "Pointing error on the sky: 10.5 arcsec rms without IA and IE alone, 3.83 with this" in fit.summary()
    )
    assert fit.to_dict()["pointing"]["terms"]["IA"]["value"] == on_sky.terms["IA"].value
    whole = pointing(machine.add("tube_flexure").add("refraction").fit(data))
    assert whole.after_zeros == on_sky.after_zeros
    assert whole.after_model == pytest.approx(0.93, abs=0.005)
    # published with azimuths from south, which turns the sign; the mean of the angle is known to 0.9 / sqrt 80
    assert whole.terms["TF"].value == pytest.approx(21.4118, abs=0.02)
    assert whole.terms["TX"].value == pytest.approx(-2.7165, abs=0.02)
    assert 0.1 < whole.terms["TF"].std < 2


def test_a_star_that_is_logged_again_is_one_pose():
    made = machine_from_tpoint(str(DATA / "mmt_2025" / "point_20250326.dat"))
    assert made.notes[0] == "point_20250326.dat: a pointing run, 16 stars, 22 records, alt-azimuth mount."
    on_sky = pointing(made.machine.fit(rodgen.Measurements.from_frame(made.columns)))
    assert (on_sky.records, on_sky.poses) == (22, 17)  # one star was visited twice
    assert on_sky.sentence().startswith("Pointing error on the sky (22 records, 17 poses): ")


@pytest.mark.parametrize("flipped", [False, True], ids=["east of the pier", "on both sides"])
def test_the_zeros_are_those_of_least_squares_on_the_sky(flipped):
    """Also where a mount points through the pole, as a German one does on the other side of its pier."""
    random = np.random.default_rng(3)
    star = np.stack([random.uniform(-0.9, 0.9, 60), random.uniform(-0.2, 1.2, 60)], -1)
    h, d = star.T
    east = (flipped & (np.arange(60) % 2 > 0))[:, None]
    q = np.where(east, np.stack([h - np.pi, np.pi - d], -1), star)
    # what the axes lack, in their own sense: zeros of 1200 and -300 arcsec, and a wave
    wave = 40 * ARCSEC * np.sin(3 * h)
    off = np.stack([1200 * ARCSEC + wave, np.full(60, -300 * ARCSEC)], -1)
    machine = mount_machine(EQUATORIAL, "m", 0.6)
    seen = EQUATORIAL.direction(*(q + off).T)
    on_sky = pointing(fitted(replace(machine, estimate=("target",)), EQUATORIAL, q, seen))
    # by hand: an hour angle counts by the cosine of the declination
    across = np.cos(q[:, 1] + off[:, 1])
    rest = across * (wave - np.sum(across**2 * wave) / np.sum(across**2))
    assert on_sky.zeros == ("IH", "ID")
    assert on_sky.after_zeros == pytest.approx(np.sqrt(np.mean(rest**2)) / ARCSEC, rel=1e-4)


def test_other_machines_have_no_terms():
    machine = mount_machine(ALTAZ, "m", 0.6)
    assert mount_of(machine) is ALTAZ
    first, second = machine.joints
    for other in (
        replace(machine, joints=(replace(first, axis=(0.0, 0.0, 1.0)), second)),
        replace(machine, joints=(replace(first, name="A"), second)),
        replace(machine, targets=(replace(machine.targets[0], point=(0.0, 0.0, 1.0)),)),
        replace(machine, measured=Measured("point", "machine")),
    ):
        assert mount_of(other) is None
        assert other.effect("zero_offset", other.joints[0].name).terms == {}
    q = np.random.default_rng(1).uniform(0.3, 1.2, (20, 2))
    free = replace(machine, measured=Measured("direction", "free"), estimate=())
    assert pointing(fitted(free, ALTAZ, q, ALTAZ.direction(*q.T))) is None


def test_effects_of_a_mount_have_tpoint_s_names():
    altaz, equatorial = mount_machine(ALTAZ, "m", 0.6), mount_machine(EQUATORIAL, "m", 0.6)
    titles = [
        altaz.effect("tube_flexure").title,
        altaz.effect("encoder_eccentricity", "EL").title,
        altaz.effect("axis_tilt", "AZ").title,
        altaz.effect("target_offset", "boresight").title,
        equatorial.effect("target_offset", "boresight").title,
        equatorial.effect("encoder_eccentricity", "HA").title,
        equatorial.effect("periodic_drive_error", "HA").title,
        altaz.effect("backlash", "AZ").title,
    ]
    assert titles == [
        "tube_flexure (TF)",
        "encoder_eccentricity at EL (ECEC, ECES)",
        "axis_tilt at AZ (AN, AW)",
        "target_offset at boresight (CA)",
        "target_offset at boresight (CH)",
        "encoder_eccentricity at HA (HCEC, HCES)",
        "periodic_drive_error at HA",
        "backlash at AZ",
    ]
    assert altaz.effect("refraction").label("a") == "a = -TX"
    assert altaz.effect("backlash", "AZ").label("b") == "b"


def run_of(seed, waves, count=120, sigma=0.7):
    """Commands and directions of a mount, by TPOINT's formulas on the sphere; `waves` are to the right and upwards."""
    random = np.random.default_rng(seed)
    a = random.uniform(0, 2 * np.pi, count)
    e = np.arcsin(random.uniform(np.sin(0.3), np.sin(1.45), count))
    right = -300 * np.cos(e) - 15 + 8 * np.sin(e) - 6 * np.sin(a) * np.sin(e) + 9 * np.cos(a) * np.sin(e)
    up = -100 - 6 * np.cos(a) - 9 * np.sin(a) - 20 * np.cos(e) + 3 / np.tan(e)
    off = (
        np.stack([right, up])
        + np.stack(np.broadcast_arrays(*waves(a, e), a)[:2])
        + random.normal(0, sigma, (2, count))
    )
    d = np.stack([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)], -1)
    to_right = np.stack([np.cos(a), -np.sin(a), 0 * a], -1)
    seen = d + ARCSEC * (off[0][:, None] * to_right + off[1][:, None] * np.cross(to_right, d))
    return np.stack([a, e], -1), seen / np.linalg.norm(seen, axis=1, keepdims=True)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("waves", "effect", "sizes"),
    [
        (
            lambda a, e: (8 * np.cos(2 * a) * np.cos(e), 0),
            ("encoder_ellipticity", "AZ"),
            {"HACA2": -8, "HASA2": 0},
        ),
        (
            lambda a, e: (0, 5 * np.sin(2 * a) - 4 * np.cos(3 * a)),
            ("bearing_waves", "EL"),
            {"HESA2": -5, "HECA2": 0, "HESA3": 0, "HECA3": 4},
        ),
        (
            lambda a, e: (6 * np.cos(3 * a) * np.cos(e), 0),
            ("encoder_harmonics", "AZ"),
            {"HACA3": 6, "HASA3": 0, "HACA4": 0},
        ),
        (lambda a, e: (5 * np.cos(3 * a + 1) * np.sin(e), 0), ("tilt_error_motion", "AZ"), {}),
    ],
    ids=["encoder", "bearing", "encoder, three", "lean, three"],
)
def test_waves_of_an_azimuth_axis_have_tpoint_s_names(waves, effect, sizes):
    q, seen = run_of(1, waves)
    found = fitted(mount_machine(ALTAZ, "m", 0.6), ALTAZ, q, seen).diagnose()
    assert {step.effect.identity for step in found.steps} == {
        effect,
        ("tube_flexure", None),
        ("refraction", None),
    }
    terms = pointing(found.final).terms
    for term, size in sizes.items():
        assert abs(terms[term].value - size) < 5 * terms[term].std < 1
    assert all(re.search(rf"= -?{term} ", str(found)) for term in sizes)
