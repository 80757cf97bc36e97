"""An arm with six joints and a Z-Y-X wrist, as in section 5.2 of Zhou and Zhu."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rodgen.kinematics.backend import kernels
from rodgen.kinematics.kernel_call import call_kernel


def arm_pose(joints: ArrayLike, lengths: ArrayLike) -> tuple[Any, Any, Any]:
    """Return the pose of an arm with six joints whose wrist turns about z, y and x.

    At zero the upper arm stands upright and the forearm points along x. Joint 1 turns about z, joints 2 and 3 about
    y, in the shoulder and the elbow, joints 4, 5 and 6 about the z, y and x axes of the wrist, through one point.

    Parameters
    ----------
    joints : array_like (..., 6)
        Joint angles, rad.
    lengths : array_like (..., 4)
        Height of the shoulder, upper arm, forearm, and from the wrist's centre to the tool point; one length unit.

    Returns
    -------
    matrix : array (..., 3, 3)
        Rotation of the tool in axes of the base.
    point : array (..., 3)
        Tool point, in the unit of `lengths`.
    wrist : array (..., 3)
        Centre of the wrist.

    Notes
    -----
    The paper gives neither lengths nor joint parameters of its arm, so there are no default ones. In the axes of the
    forearm the instantaneous Euler angles are those of the last three joints as Z-Y-X angles, whatever the lengths:
    derivation ``instantaneous_euler_arm``.

    Examples
    --------
    >>> from rodgen import instantaneous_euler as ie
    >>> matrix, point, wrist = ie.arm_pose([0.0] * 6, [0.4, 0.5, 0.45, 0.15])
    >>> point, wrist
    (array([0.6, 0. , 0.9]), array([0.45, 0.  , 0.9 ]))
    """
    return call_kernel(kernels.chi_arm_pose, (joints, lengths))  # type: ignore[no-any-return]
