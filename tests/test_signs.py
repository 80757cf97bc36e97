"""A drive that yields the wrong way says that gravity is the wrong way round; a preferred effect is answered."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.remarks import lifted, on_preferred
from rodgen.calibration.selection import select
from rodgen.machines.machine import Machine

AXES = np.array([(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], float)
POINTS = np.array(
    [(0, 0, 0), (0, 0, 400), (0, 0, 1000), (300, 0, 1100), (900, 0, 1100), (950, 0, 1100)], float
)
TOOL = np.array([1100.0, 0.0, 1120.0])
MASSES = (0, 120, 60, 25, 10, 8)
GIVES_WAY = (0, 4e-9, 9e-9, 0, 0, 0)
"""Radians per newton and millimetre."""


def motions(q):
    """Return the motion of each link, as rotation and translation, of the bed first."""
    turn, at = np.eye(3), np.zeros(3)
    found = [(turn, at)]
    for n, p, angle in zip(AXES, POINTS, q, strict=True):
        rotation = Rotation.from_rotvec(angle * n).as_matrix()
        at = at + turn @ (p - rotation @ p)
        turn = turn @ rotation
        found.append((turn, at))
    return found


def sagging(folder: Path, gravity: float):
    """Write a robot whose second and third drive yield to weights in the middle of its links, and fit it."""
    rng = np.random.default_rng(1)
    middles = (POINTS + np.vstack([POINTS[1:], TOOL])) / 2
    rows = []
    for _ in range(60):
        q = np.radians(rng.uniform(-1, 1, 6) * [150, 60, 70, 150, 100, 150])
        links, off = motions(q), np.zeros(6)
        for i in np.flatnonzero(GIVES_WAY):
            turn, at = links[i]
            for mass, middle, (turn_k, at_k) in list(zip(MASSES, middles, links[1:], strict=True))[i:]:
                arm = turn_k @ middle + at_k - (turn @ POINTS[i] + at)
                off[i] += GIVES_WAY[i] * (turn @ AXES[i]) @ np.cross(arm, [0, 0, gravity * 9.81 * mass])
        turn, at = motions(q + off)[-1]
        rows.append([*np.degrees(q), *(turn @ TOOL + at + rng.normal(0, 0.05, 3))])
    joints = "\n".join(
        f'  {{ name = "J{i}", type = "revolute", axis = {n.tolist()}, point = {p.tolist()} }},'
        for i, (n, p) in enumerate(zip(AXES, POINTS, strict=True), 1)
    )
    (folder / "machine.toml").write_text(
        f'name = "Robot"\nunits = {{ length = "mm", angle = "deg" }}\njoint = [\n{joints}\n]\n'
        f'target = [{{ name = "tool", point = {TOOL.tolist()} }}]\n'
        'measured = { kind = "point", frame = "free" }\nestimate = { parameters = ["target"] }\n'
    )
    header = ",".join([*(f"J{i} [deg]" for i in range(1, 7)), "x [mm]", "y [mm]", "z [mm]"])
    np.savetxt(folder / "data.csv", rows, "%.5f", ",", header=header, comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


@pytest.mark.parametrize("gravity", [-1.0, 1.0])
def test_weight_that_lifts_asks_for_gravity(gravity, tmp_path):
    base = sagging(tmp_path, gravity)
    evidence = Evidence.of(base)
    chosen = select(evidence)
    assert {c.key for c in chosen} == {("gravity_windup", "J2"), ("gravity_windup", "J3")}
    machine = base.machine
    for c in chosen:
        machine = machine.with_effect(c.effect)
    final = base.refit(machine)
    found = list(lifted(final.machine, [c.effect for c in chosen], final.estimates))
    assert found == ["weight lifts J2 and J3: is gravity the right way round?"] * (gravity > 0)
    scale, nothing = on_preferred(evidence, chosen, [("scale", "J2"), ("tube_flexure", None)])
    assert scale.startswith("scale at J2 was preferred: it is ")
    assert scale.endswith("times less probable than what was chosen.")
    assert nothing == "tube_flexure was preferred, but no such effect can be seen in this machine or table."
    assert list(on_preferred(evidence, chosen, [("gravity_windup", None)])) == []
