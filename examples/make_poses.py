"""Write the simulated example ``poses.csv``: a door on a hinge, seen by a camera while it opens.

The true axis, the slide and the noise are stated here, for comparison with the result of rodgen.
"""

from pathlib import Path

import numpy as np

import rodgen

AXIS = np.array([0.01, 0.02, 1.0]) / np.linalg.norm([0.01, 0.02, 1.0])
POINT = np.array([400.0, -50.0, 0.0])  # mm; the axis goes through it
PITCH = 0.5  # mm for each radian: the hinge lifts the door a little
NOISE, TURN_NOISE = (
    0.03,
    1e-4,
)  # mm and rad, standard uncertainties of every coordinate and of every attitude about an axis
TARGET = np.array([900.0, 30.0, 1000.0])  # mm, what the camera follows, door closed


def rows() -> list[str]:
    """Return a pose every twentieth of a second; the door opens by 80 degrees in three seconds."""
    random = np.random.default_rng(5)
    made = []
    for t in np.arange(61) / 20:
        angle = np.radians(80) * (t / 3) ** 2 * (3 - 2 * t / 3)
        opened, _ = rodgen.matrix_from_axis_angle(AXIS, angle)
        error = random.normal(0, TURN_NOISE, 3)
        wrong, _ = rodgen.matrix_from_axis_angle(error / np.linalg.norm(error), np.linalg.norm(error))
        place = POINT + opened @ (TARGET - POINT) + PITCH * angle * AXIS + random.normal(0, NOISE, 3)
        attitude, _ = rodgen.quaternion_from_matrix(wrong @ opened)
        made.append(",".join([f"{t:.2f}", *(f"{x:.4f}" for x in place), *(f"{x:.6f}" for x in attitude)]))
    return made


if __name__ == "__main__":
    header = "t [s],x [mm],y [mm],z [mm],qw,qx,qy,qz"
    Path(__file__).with_name("poses.csv").write_text("\n".join([header, *rows()]) + "\n")
