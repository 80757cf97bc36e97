"""TPOINT's terms that the catalogue lacks: the block that is shown does what TPOINT says of the term."""

import json
from pathlib import Path

import numpy as np
import pytest

import rodgen
from rodgen.calibration.problem import Problem
from rodgen.calibration.problem.binding import bind
from rodgen.cli.main import main
from rodgen.machines.effects.symbols import own_term, symbols
from rodgen.machines.files.read import machine_of
from rodgen.machines.model import Frame, Model

MOUNTS = {
    "altaz": (("AZ", [0, 0, -1]), ("EL", [1, 0, 0]), [0, 1, 0]),
    "equatorial": (("HA", [0, 0, -1]), ("DEC", [0, -1, 0]), [1, 0, 0]),
}
SMALL = 1e-6
EXAMPLE = Path(__file__).parent.parent / "examples" / "machines" / "mount" / "machine.toml"


def moved(name, mount, first, second):
    """Return by how much a term moves the first and the second coordinate of what is seen, per unit of its a."""
    (one, along), (other, across), target = MOUNTS[mount]
    joints = "".join(
        f'[[joint]]\nname = "{joint}"\ntype = "revolute"\naxis = {axis}\n'
        for joint, axis in ((one, along), (other, across))
    )
    text = (
        f'name = "m"\n[units]\nlength = "mm"\nangle = "rad"\n{joints}[[target]]\nname = "p"\npoint = {target}\n'
        f'[measured]\nkind = "direction"\nframe = "machine"\n{own_term(name).block}\n'
    )
    machine = machine_of(text, "m.toml")
    columns = {f"{one} [rad]": first, f"{other} [rad]": second}
    columns |= dict(zip(("ux", "uy", "uz"), np.tile([[1.0], [0.0], [0.0]], len(first)), strict=True))
    o = bind(machine, rodgen.Measurements.from_frame(columns))
    model = Model(machine, o.travel, o.run_names, compiled=False)
    seen = [Problem(model, o).places(np.array([a]), Frame.identity()) for a in (SMALL, -SMALL)]
    x, y, _ = (seen[0] + seen[1]).T / 2
    dx, dy, dz = (seen[0] - seen[1]).T / (2 * SMALL)
    clockwise = (y * dx - x * dy) / (x**2 + y**2)  # of azimuth from y, or hour angle from x, about -z
    return clockwise, dz / np.sqrt(x**2 + y**2)


TERMS = {
    ("X2HC", "equatorial"): lambda h, d: (np.cos(2 * h) / np.cos(d), 0),
    ("D2HS", "equatorial"): lambda h, d: (0, np.sin(2 * h)),
    ("HDSH5", "equatorial"): lambda h, d: (0, np.sin(5 * h)),
    ("HHCD1SH2", "equatorial"): lambda h, d: (np.cos(d) * np.sin(2 * h), 0),
    ("DNP", "equatorial"): lambda h, d: (np.sin(h) * np.tan(d), 0),
    ("HACA5", "altaz"): lambda a, e: (np.cos(5 * a), 0),
    ("HASA5", "altaz"): lambda a, e: (-np.sin(5 * a), 0),
    ("HVSA2", "altaz"): lambda a, e: (np.sin(2 * a) * np.tan(e), 0),
    ("HVCA2", "altaz"): lambda a, e: (-np.cos(2 * a) * np.tan(e), 0),
    ("HSSE2", "altaz"): lambda a, e: (-np.sin(2 * e) / np.cos(e), 0),
    ("HESA1", "altaz"): lambda a, e: (0, np.sin(a)),
    ("FLOP", "altaz"): lambda a, e: (0, np.ones_like(a)),
}


@pytest.mark.parametrize(("name", "mount"), TERMS)
def test_the_block_does_what_the_term_says(name, mount):
    random = np.random.default_rng(5)
    first, second = random.uniform(-2, 2, 20), random.uniform(0.2, 1.2, 20)
    found = moved(name, mount, first, second)
    for got, wanted in zip(found, TERMS[name, mount](first, second), strict=True):
        np.testing.assert_allclose(got, np.broadcast_to(wanted, 20), atol=1e-6)


def test_the_command_shows_the_block_and_knows_no_other_name(refuses, capsys):
    assert main(["effects", "x2hc"]) == 0
    assert 'formula = "a*cos(2*q)/cos(DEC)"' in capsys.readouterr().out
    assert main(["effects", "HDSH5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["effect"]["formula"] == "a*sin(5*HA)"
    refuses(rodgen.Machine.load(EXAMPLE).effect, "X2HC")
    assert main(["effects", "X0HC"]) != 0
    assert "X0HC" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["TF", "HCES", "HGES", "EBZ", "ACEC"])
def test_what_the_catalogue_has_is_no_term_of_one_s_own(name):
    assert symbols(name)
    assert own_term(name) is None


def test_a_term_that_the_latitude_is_in_is_no_parameter_itself():
    """FO is a cos(latitude), so that a is FO/cos(latitude); the effect is called FO."""
    joints = "".join(
        f'[[joint]]\nname = "{name}"\ntype = "revolute"\naxis = {axis}\n'
        for name, axis in MOUNTS["equatorial"][:2]
    )
    text = (
        f'name = "m"\n[units]\nlength = "mm"\nangle = "deg"\n{joints}[[target]]\nname = "p"\npoint = [1, 0, 0]\n'
        '[measured]\nkind = "direction"\nframe = "machine"\n'
    )
    fork = machine_of(text, "m.toml").effect("fork_flexure", "DEC")
    assert fork.label("a") == "a = FO/cos(latitude)"
    assert fork.title == "fork_flexure at DEC (FO)"
