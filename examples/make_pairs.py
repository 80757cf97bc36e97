"""Write the simulated example ``pairs.csv``: three balls on a rotary table, measured before and after ten turns.

The true axis, the noise and the one gross error are stated here, for comparison with the result of rodgen.
"""

from pathlib import Path

import numpy as np

import rodgen

AXIS = np.array([0.02, -0.01, 1.0]) / np.linalg.norm([0.02, -0.01, 1.0])
POINT = np.array([250.0, 120.0, 0.0])  # mm; the axis goes through it
NOISE = 0.004  # mm, standard uncertainty of every coordinate of every reading
BALLS = {"a": [330.0, 120.0, 60.0], "b": [210.0, 190.0, 85.0], "c": [230.0, 40.0, 110.0]}  # mm, table at zero
GROSS_ERROR = (17, 0.08)  # row of the table, from 0, and mm along x: one reading of a dirty ball


def rows() -> list[str]:
    """Return the rows: every turn starts from zero, and each ball is measured before and after it."""
    random = np.random.default_rng(2)
    made = []
    for move, degrees in enumerate(range(15, 165, 15)):
        theta, _ = rodgen.rodrigues_vector(AXIS, np.radians(degrees))
        for ball, place in BALLS.items():
            before = place + random.normal(0, NOISE, 3)
            after = POINT + rodgen.rotate(place - POINT, theta) + random.normal(0, NOISE, 3)
            if len(made) == GROSS_ERROR[0]:
                after[0] += GROSS_ERROR[1]
            made.append(",".join([*(f"{x:.4f}" for x in (*before, *after)), str(degrees), str(move), ball]))
    return made


if __name__ == "__main__":
    columns = [f"{point}_{axis} [mm]" for point in ("rho", "rho_prime") for axis in "xyz"]
    header = ",".join([*columns, "angle [deg]", "move", "target"])
    Path(__file__).with_name("pairs.csv").write_text("\n".join([header, *rows()]) + "\n")
