"""Inputs for the kernels: ordinary ones, and ones at or near what a kernel decides by."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rodgen.generated.numpy import three_sps_s
from rodgen.kinematics import spatial

CHI_ROWS = 26
"""Rows of every input, so that inputs of one kernel go together."""


def attitudes() -> Rotation:
    """Attitudes: of all sizes, about coordinate axes, in their planes, half turns, and near all of these."""
    rng = np.random.default_rng(21)
    vectors = list(rng.normal(size=(8, 3)))
    axes = rng.normal(size=(4, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    vectors += [axes[0] * 1e-3, axes[1] * 1e-8, axes[2] * (np.pi - 1e-6), axes[3] * (np.pi - 1e-3)]
    vectors += [[0.7, 0, 0], [0, -2.5, 0], [0, 0, 1.2]]  # no ridge line about the axis
    vectors += [[0.7, 0.3, 0], [0, 2.1, 1.5], [1.3, 0, -0.4]]  # a face of the tetrahedron
    vectors += [[0, 0, np.pi], [1e-5, 0, 1.2], [0.4, 1e-4, 1e-4]]
    return Rotation.from_rotvec(np.array(vectors))


def _padded(good: np.ndarray, bad: list[object]) -> np.ndarray:
    found = np.concatenate([good, np.array(bad, float)])
    assert len(found) == CHI_ROWS
    return found


def matrices() -> np.ndarray:
    """The attitudes, no rotation, what is nearly orthogonal, a reflection, and no matrix at all."""
    good = attitudes().as_matrix()
    return _padded(
        good, [np.eye(3), 1.001 * good[0], np.diag([1.0, 1, -1]), np.full((3, 3), np.nan), np.zeros((3, 3))]
    )


def quaternions() -> np.ndarray:
    """The attitudes, some with the other sign, of other lengths, tiny parts, and none."""
    good = attitudes().as_quat(scalar_first=True)
    good[1] *= -1
    good[2] *= 1e150
    return _padded(
        good, [[1, 0, 0, 0], [1, 1e-200, 0, 3e-160], [0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 1, 0]]
    )


def angle_triples() -> np.ndarray:
    """Angles of rotations, of corners, edges and faces, outside, and no angles."""
    chi = np.arccos(np.clip(np.diagonal(attitudes().as_matrix(), axis1=1, axis2=2), -1, 1))[:12]
    pi = np.pi
    special = [
        [0, 0, 0],
        [pi, pi, 0],
        [0, pi, pi],
        [0.5, 0.5, 0],
        [2.0, pi, pi - 2.0],
        [1e-6, 1.2e-6, 0.9e-6],
        [pi - 1e-4, pi - 1.2e-4, 0.9e-4],
        [pi / 2, 0, 0],
        [1.0, 0.1, 0.2],
        [pi, pi, pi],
        [pi / 2, pi / 2, pi / 2],
        [0.3, 3.5, 0.3],
        [-0.1, 0.2, 0.2],
        [np.nan, 1, 1],
    ]
    return _padded(chi, special)


def chi_inputs(names: set[str]) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for the named inputs."""
    rng = np.random.default_rng(22)
    angles = rng.uniform(-4, 4, (CHI_ROWS, 3))
    angles[10:22] = attitudes().as_euler("ZYX")[9:21]
    angles[22] = [0, 0, 0]
    angles[23] = [1e-9, -2e-9, 3e-9]
    angles[24] = [300.0, -200.0, 100.0]
    vectors = rng.normal(size=(CHI_ROWS, 3))
    vectors[5] = 0
    points = 1e3 * rng.normal(size=(CHI_ROWS, 3))
    points[12:15] = [[0, 3, 4], [3, 0, 4], [3, 4, 0]]  # the planes coincide
    tolerance = np.zeros(CHI_ROWS)
    tolerance[[3, 18, 20]] = 1e-3, 1e-6, 0.9
    made = {
        "matrix": matrices(),
        "quaternion": quaternions(),
        "chi": angle_triples(),
        "tolerance": tolerance,
        "angles": angles,
        "angle_rates": vectors,
        "omega": vectors,
        "rate": vectors,
        "point": points,
        "joints": np.concatenate([angles, angles[::-1]], axis=1),
        "lengths": rng.uniform(0.1, 900, (CHI_ROWS, 4)),
    }
    return {name: made[name] for name in names}


LINK_POSES = 12


def link_poses(rng: np.random.Generator) -> np.ndarray:
    """Rotations and origins; the last ones have S6 along the first axis, on it, or are no link_poses."""
    found = np.tile(np.eye(4), (LINK_POSES + 8, 1, 1))
    found[:LINK_POSES, :3, :3] = Rotation.random(LINK_POSES, random_state=21).as_matrix()
    found[:LINK_POSES, :3, 3] = rng.normal(size=(LINK_POSES, 3)) * 10.0 ** rng.integers(
        -2, 4, size=(LINK_POSES, 1)
    )
    turned = Rotation.from_euler("z", 0.7).as_matrix()
    for row, (sign, origin) in enumerate([(1, [3, 4, 2]), (-1, [3, 4, 2]), (1, [0, 0, 2]), (-1, [0, 0, 0])]):
        found[LINK_POSES + row, :3, :3] = np.diag([1.0, sign, sign]) @ turned
        found[LINK_POSES + row, :3, 3] = origin
    found[LINK_POSES + 4, :3, :3] = Rotation.from_rotvec([1e-5, 0, 0]).as_matrix()
    found[LINK_POSES + 4, :3, 3] = [1.0, 2.0, 3.0]
    found[LINK_POSES + 5, :3, 0] *= -1
    found[LINK_POSES + 6, 0, 3] = np.nan
    found[LINK_POSES + 7, :3, :3] *= 1.01
    return found


def link_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(22)
    if name in ("link_forward_6r", "link_jacobian_6r"):
        right = rng.random((LINK_POSES, 5)) < 0.5
        alpha = np.where(
            right, rng.choice([0, np.pi / 2], (LINK_POSES, 5)), 3 * rng.normal(size=(LINK_POSES, 5))
        )
        return {
            "a": rng.normal(size=(LINK_POSES, 5)) * rng.integers(0, 2, size=(LINK_POSES, 5)),
            "cos_alpha": np.cos(alpha),
            "sin_alpha": np.sin(alpha),
            "offset": 100 * rng.normal(size=(LINK_POSES, 6)),
            "angle": rng.uniform(-7, 7, size=(LINK_POSES, 6)),
        }
    given = link_poses(rng)
    count = len(given)
    alpha = rng.uniform(-3, 3, size=count)
    return {
        "frame": given,
        "transform": given,
        "pose": given,
        "a": rng.normal(size=count),
        "cos_alpha": np.cos(alpha),
        "sin_alpha": np.sin(alpha),
        "offset": rng.normal(size=count),
        "angle": rng.uniform(-7, 7, size=count),
        # exactly parallel axes need the twist 0 and the length 0
        "a67": np.where(np.arange(count) < LINK_POSES, rng.normal(size=count), 0.0),
        "alpha67": np.where(
            np.arange(count) < LINK_POSES, rng.choice([np.pi / 2, np.pi / 4, 0.3], count), 0.0
        ),
        "tolerance": np.full(count, 1e-4),
    }


LOOPS = 10


def loop_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input of a kernel."""
    rng = np.random.default_rng(41)
    if name.startswith("loop_pair_"):
        return ring_inputs(rng)
    links = 4 if name == "loop_rccc" else 5
    alpha = rng.uniform(-np.pi, np.pi, (LOOPS, links))
    a = rng.uniform(-2, 2, (LOOPS, links))
    angles = rng.uniform(-np.pi, np.pi, (LOOPS, 3))
    values = {"alpha": alpha, "a": a}
    if name == "loop_rccc":
        alpha[:4] = np.radians([40, 70, 85, 70])  # closes at every angle; most of the random ones do not
        alpha[4] = np.radians([90, 45, 45, 0])  # two axes parallel: a triangle, and theta_4 turns nothing
        alpha[5] = np.radians([0, 50, 50, 30])  # an equation that says nothing of theta_1
        a[6] *= 1e6
        values |= {"S_4": rng.uniform(-1, 1, LOOPS), "theta_4": angles[:, 0]}
        values["theta_4"][0] = np.radians(75.0)
        values["S_4"][9] = np.inf
        values["theta_4"][8] = np.nan
        return values
    alpha[0] = np.radians([90, 0, 90, 60, 90])
    a[1] *= 1e6
    a[2] = 0.0
    values |= {"S": rng.uniform(-2, 2, (LOOPS, 3)), "theta_5": angles[:, 0]}
    values["theta_5"][9] = np.nan
    if name == "loop_rrrcc_back":
        values |= {"theta_1": angles[:, 1], "theta_2": angles[:, 2]}
    return values


def ring_inputs(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rings of four links: any ones, one of right angles, one with parallel axes, and one that is not finite."""
    rotations = Rotation.random(4 * 5, random_state=8).as_matrix().reshape(5, 4, 3, 3)
    rotations[1] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    vectors, p, q = rng.normal(size=(5, 4, 3)), rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    rotations[3, 3] = np.eye(3)
    p[4, 1] = np.nan
    return {"rotation": rotations, "vector": vectors, "p": p, "q": q}


STARTS = np.array(
    [[0.5, 0.2], [-0.1, 0.6], [-0.5, -0.3], [0.2, -0.5], [1.2, 1.6], [-1.5, 1.3], [-1.3, -1.4], [1.6, -1.1]]
)


def trig_inputs(name: str) -> dict[str, np.ndarray]:
    """Coefficients of every kind: two angles, one, none, all; tiny and huge; not finite."""
    del name  # both kernels have the same inputs
    rng = np.random.default_rng(31)
    rows = [*rng.normal(size=(10, 3))]
    rows += [[1, 2, 1], [1, 2, 1 + 1e-12], [-1, 2, 1], [0, 1, 0.5], [1, 0, 0.5], [1, 1e-9, 1], [2, -1e-5, 2]]
    rows += [
        [3, 4, 5],
        [3, 4, -5],
        [1, 0, 1],
        [-2, 0, 2],
        [0, -3, 3],
        [3, 4, 5.1],
        [0, 0, 1],
        [0, 0, 0],
        [1, 0, 0],
    ]
    rows += [[2e36, -1e36, 3e35], [2e-36, 1e-36, 3e-37], [np.nan, 1, 1], [1, np.inf, 1], [1, 1, -np.inf]]
    table = np.array(rows, float)
    return {"A": table[:, 0].copy(), "B": table[:, 1].copy(), "D": table[:, 2].copy()}


def delta_inputs(name: str) -> dict[str, np.ndarray]:
    """Positions and joints of deltas: usual, far out, flat, with joints in a line, out of reach, not finite."""
    rng = np.random.default_rng(33)
    rows = 24
    radius = np.repeat([[140.0, 140, 140]], rows, axis=0) + rng.normal(size=(rows, 3))
    rod = np.repeat([[290.0, 290, 290]], rows, axis=0) + rng.normal(size=(rows, 3))
    arm = np.repeat([[180.0, 180, 180]], rows, axis=0) + rng.normal(size=(rows, 3))
    heading = np.radians([210.0, 330, 90]) + 0.01 * rng.normal(size=(rows, 3))
    carriage = rng.uniform(200, 320, (rows, 3))
    angle = rng.uniform(-0.8, 0.8, (rows, 3))
    position = np.column_stack([rng.uniform(-90, 90, (rows, 2)), rng.uniform(-200, -120, rows)])
    rod[16], radius[16], carriage[16] = 140.0, 140.0, 250.0  # flat, in the middle
    heading[17] = heading[17, 0]  # one above the other
    rod[18] = 20.0  # out of reach
    radius[19, 1], carriage[20, 2], rod[21, 0] = np.nan, np.inf, -1.0
    angle[20], position[20] = np.inf, np.nan
    position[22] = radius[22, 0] * np.cos(heading[22, 0]), radius[22, 0] * np.sin(heading[22, 0]), 0.0
    found = {
        "linear_delta_direct": {"carriage": carriage},
        "rotary_delta_direct": {"angle": angle, "arm": arm},
        "linear_delta_inverse": {"position": position},
        "rotary_delta_equations": {"position": position, "arm": arm},
    }[name]
    return found | {"radius": radius, "rod": rod, "heading": heading}


def pair_inputs(name: str) -> dict[str, np.ndarray]:
    """Two random equations, and for what comes after them, what comes before."""
    rng = np.random.default_rng(32)
    one, two = rng.normal(size=(2, 8, 3, 3))
    if name == "pair_prepared":
        near = one[:2] + 1e-3 * two[:2]
        zero = np.zeros((2, 3, 3))
        bad = np.stack([np.full((3, 3), np.nan), np.diag([1.0, np.inf, 1])])
        large = np.array([1e30, 1e-30])[:, None, None]
        first = np.concatenate([one, one[:2], zero[:1], one[:1], one[:2], bad])
        second = np.concatenate([two, near, two[:1], zero[:1], large * two[:2], two[:2]])
        return {"first": first, "second": second}
    if name in ("pair_octic", "pair_angles"):
        angle = rng.uniform(-3, 3, size=8)
        tangent = rng.normal(size=8) * 10.0 ** np.arange(-3, 5)
        return {
            "one": one,
            "two": two,
            "turn": np.stack([np.cos(angle), np.sin(angle)], -1),
            "tangent": tangent,
        }
    if name == "pair_polish":
        # so far off that the residual is no rounding after the steps, some of which are cut short
        off = 2.0 * rng.choice([-1, 1], size=(8, 2)) + 0.3 * rng.normal(size=(8, 2))
        planted = rng.uniform(-3, 3, size=(8, 2))
        u, v = (np.stack([np.ones(8), np.cos(a), np.sin(a)], -1) for a in planted.T)
        for m in (one, two):
            m[:, 0, 0] -= np.einsum("nij,ni,nj->n", m, u, v)
        one[6], two[6] = 0.0, 0.0
        one[6, 0, 0], one[6, 0, 1], two[6, 0, 0] = (
            1.0,
            0.5,
            1.0,
        )  # no derivative with respect to the first angle
        return {"one": one, "two": two, "angles": planted + off}
    octic = rng.normal(size=(8, 9))
    near = np.stack([np.roots(row[::-1]) for row in octic])
    if name == "pair_real_roots":
        octic[6] = np.poly([0.5, 0.5 + 1e-9, -0.7, 1.3, -2.0, 0.1j, -0.1j, 3.0])[
            ::-1
        ].real  # two that are not distinguished
        near[6] = [0.5, 0.5 + 1e-9, -0.7, 1.3, -2.0, 0.1j, -0.1j, 3.0]
        octic[7, 8] = 0.0
        near = near * (1 + 1e-12 * rng.normal(size=near.shape))
    else:
        near[:4] += 0.3 * (rng.normal(size=(4, 8)) + 1j * rng.normal(size=(4, 8)))
        near[4:6] = STARTS @ [1, 1j]
    return {"octic": octic, "size": np.full(8, 3.0), "roots": np.stack([near.real, near.imag], -1)}


RIGHT = np.pi / 2


def quadrilaterals() -> dict[str, np.ndarray]:
    """Twists and the given angle: closed in two ways, in one, in none, and with axes that coincide."""
    rng = np.random.default_rng(31)
    alpha = rng.uniform(0.6, 1.3, size=(8, 4)) * rng.choice([-1, 1], size=(8, 4))
    theta = rng.uniform(-3, 3, size=8)
    special = [
        ([0.5, 0.7, 0.9, 1.1], 0.0),
        ([0.3, 0.2, 1.5, 1.5], 3.0),  # out of reach
        ([0.6, 0.8, 0.5, 0.9], 0.0),  # stretched: 0.6 + 0.8 = 0.5 + 0.9
        ([0.6, 0.8, 0.5, 0.9 + 1e-9], 0.0),
        ([RIGHT, RIGHT, RIGHT, RIGHT], RIGHT),
        ([0.0, 0.7, 0.9, 0.4], 2.0),  # the first two axes coincide, and it does not close
        ([0.8, 0.8, 0.6, 0.6], np.pi),  # the first and the third axis may coincide
        ([np.pi, 0.7, 0.9, 0.4], 2.0),
        ([0.5, np.nan, 0.9, 1.1], 1.0),
        ([0.5, 0.7, 0.9, 1.1], np.inf),
    ]
    return {
        "alpha": np.concatenate([alpha, [row for row, _ in special]]),
        "theta_4": np.concatenate([theta, [angle for _, angle in special]]),
    }


def pentagons() -> dict[str, np.ndarray]:
    """Twists and the two given angles: closed in two ways, in one, in none, and with axes that coincide."""
    rng = np.random.default_rng(32)
    alpha = rng.uniform(0.6, 1.4, size=(8, 5)) * rng.choice([-1, 1], size=(8, 5))
    theta = rng.uniform(-3, 3, size=(8, 2))
    special = [
        ([1.2, 1.0, 0.3, 0.4, 0.5], [0.3, -0.4]),
        ([0.2, 0.3, 1.5, 0.4, 1.0], [0.3, 0.4]),
        ([0.6, 0.8, 0.5, 0.2, 0.7], [0.0, 0.0]),
        ([0.6, 0.0, 0.5, 0.2, 0.7], [0.1, 0.2]),
        ([0.8, 0.8, 0.5, 0.2, 0.3], [0.0, np.pi]),
        ([RIGHT, RIGHT, RIGHT, RIGHT, RIGHT], [RIGHT, RIGHT]),
        ([0.5, np.nan, 0.9, 1.1, 1.0], [1.0, 1.0]),
        ([0.5, 0.7, 0.9, 1.1, 1.0], [1.0, -np.inf]),
    ]
    return {
        "alpha": np.concatenate([alpha, [row for row, _ in special]]),
        "theta_45": np.concatenate([theta, [angles for _, angles in special]]),
    }


def polygon_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    if name == "polygon_quadrilateral":
        return quadrilaterals()
    if name == "polygon_pentagon":
        return pentagons()
    rng = np.random.default_rng(33)
    size = 2 * int(name[-1]) + 1
    angles = rng.uniform(-7, 7, size=(8, size))
    angles = np.concatenate([angles, rng.integers(-2, 3, size=(4, size)) * RIGHT, np.full((1, size), np.nan)])
    lengths = rng.normal(size=angles.shape) * 10.0 ** rng.integers(-3, 4, size=(len(angles), 1))
    return {"angles": angles, "lengths": lengths}


WRISTS = (spatial.PUMA_560, spatial.T3_776)
PARALLEL = (spatial.GE_P60,)


def free_arms(wrist: bool, rng: np.random.Generator, count: int) -> list[spatial.Mechanism]:
    """Arms of a family whose other lengths, twists and offsets are anything."""
    arms = []
    for _ in range(count):
        a, alpha, offset = rng.uniform(1, 3, 5), rng.uniform(0.5, 2.5, 5), rng.uniform(-2, 2, 6)
        alpha[1] = 0
        if wrist:
            a[3] = a[4] = offset[4] = 0
        else:
            alpha[2] = a[4] = 0
        arms.append(spatial.Mechanism("R" * 6, a, alpha, offset))
    return arms


def folded_arm(wrist: bool) -> spatial.Mechanism:
    """An arm whose elbow can fold onto its shoulder, and whose wrist's centre can lie on S1."""
    a = [0.0, 2.0, 2.0, 0.0, 0.0]
    alpha = np.radians([90.0, 0.0, 0.0 if not wrist else 30.0, 90.0, 90.0])
    return spatial.Mechanism("R" * 6, a, alpha, [0.5, 0.0, 0.0, 0.0, 0.0, 1.0])


def robot_pair_inputs() -> dict[str, np.ndarray]:
    """Any arm and any pose: the equations are polynomials in all of them."""
    rng = np.random.default_rng(32)
    n = 6
    alpha = rng.uniform(-3, 3, (n, 5))
    pose = np.tile(np.eye(4), (n, 1, 1))
    pose[:, :3, :3] = Rotation.random(n, random_state=33).as_matrix()
    pose[:, :3, 3] = rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-2, 3, size=(n, 1))
    a, offset = rng.normal(size=(n, 5)), rng.normal(size=(n, 6))
    return {"pose": pose, "a": a, "cosine": np.cos(alpha), "sine": np.sin(alpha), "offset": offset}


def robot_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input."""
    if name.startswith("robot_pair_"):
        return robot_pair_inputs()
    wrist = name == "robot_wrist_reverse"
    rng = np.random.default_rng(31)
    arms: list[spatial.Mechanism] = []
    poses: list[np.ndarray] = []

    def add(arm: spatial.Mechanism, angles: object) -> None:
        arms.append(arm)
        poses.append(spatial.forward(arm, angles))

    robots = WRISTS if wrist else PARALLEL
    for arm in (*robots, *robots, *free_arms(wrist, rng, 3)):
        add(arm, rng.uniform(-3, 3, 6))
    singular = rng.uniform(-3, 3, 6)
    for fifth in (0.0, np.pi, 1e-3):
        add(robots[-1], [*singular[:4], fifth, singular[5]])
    folded = folded_arm(wrist)
    for third in (0.0, np.pi):  # the elbow straight, and folded onto the shoulder
        add(folded, [0.3, 0.4, third, 0.5, 0.6, 0.7])
    add(folded, [0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    poses[-1][:3, 3] = [0, 0, 1.5] + poses[-1][:3, 2]  # the wrist's centre on S1
    ordinary = poses[0]
    for change in ("far", "nan", "mirrored", "no rotation"):
        pose = ordinary.copy()
        if change == "far":
            pose[:3, 3] *= 100
        elif change == "nan":
            pose[1, 3] = np.nan
        elif change == "mirrored":
            pose[:3, 0] *= -1
        else:
            pose[:3, :3] = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix() * 1.01
        arms.append(arms[0])
        poses.append(pose)
    alpha = np.array([arm.alpha for arm in arms])
    return {
        "pose": np.array(poses),
        "a": np.array([arm.a for arm in arms]),
        "cosine": np.round(np.cos(alpha), 15),
        "sine": np.round(np.sin(alpha), 15),
        "offset": np.array([arm.offset for arm in arms]),
    }


SPS_DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([-30, 90, 210])])


def legs_of(matrices: np.ndarray, dims: np.ndarray) -> np.ndarray:
    """Lengths of the legs, from points."""
    R, r, h = (dims[:, n, None, None] for n in range(3))
    platform = np.einsum("nij,kj->nki", matrices, SPS_DIRECTIONS)
    return np.linalg.norm(r * platform + h * np.array([0, 0, 1]) - R * SPS_DIRECTIONS, axis=-1)


def sps_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(11)
    turns = Rotation.random(14, random_state=7)
    dims = np.array(
        [[2, 1, 1.5]] * 8 + [[330, 140, 600], [1, 3, 0.2], [1, 0.2, -4], [2, 1, 1.5], [1, 1, 1], [5, 4, 3]]
    )
    dims[11] *= 1e3
    matrices, quaternions = turns.as_matrix(), turns.as_quat(scalar_first=True)
    if name == "sps_polish":
        # starts so far off that four steps do not reach where rounding decides, and so near that they do
        off = np.where(np.arange(14) % 2, 0.4, 0.05)[:, None] * rng.normal(size=(14, 3)) / np.sqrt(3)
        near = (Rotation.from_rotvec(off) * turns).as_quat(scalar_first=True)
        near[3] *= -7
        trust = np.full(14, 0.5)
        trust[4] = 0.01
        return {"quaternion": near, "trust": trust, **_sps_machine(matrices, dims)}
    if name == "sps_mode":
        shared = _sps_machine(matrices, dims)
        root = rng.uniform(-1.2, 1.1, size=14)
        root[2], root[5] = 40.0, -40.0  # beyond a tilt of π, and below none
        octics = three_sps_s.sps_octic_scaled(*shared.values())[0]
        for row in (0, 4, 7, 9, 13):  # no guess, but a root; most guesses lie where w² is clipped to Z's side
            roots = np.roots(octics[row, ::-1])
            root[row] = roots[np.argmin(np.abs(roots.imag))].real
        return {**shared, "root": root, "sign": np.where(np.arange(14) % 3, 1.0, -1.0)}
    special = np.concatenate(
        [np.eye(3)[None], Rotation.from_rotvec([[0, 0, 0.7]]).as_matrix(), np.full((1, 3, 3), np.nan)]
    )
    more = np.concatenate([matrices, special])
    more_dims = np.concatenate([dims, dims[:3]])
    shared = _sps_machine(more, more_dims)
    if name in ("sps_invariants", "sps_octic_scaled"):
        equal = np.full((1, 3), 2.578759391645525)
        shared["legs"] = np.concatenate([shared["legs"], equal, [[1.0, 2, np.inf]]])
        for key in ("base_radius", "platform_radius", "height"):
            shared[key] = np.concatenate([shared[key], shared[key][:2]])
        return shared
    q = np.concatenate([quaternions, [[1, 0, 0, 0], [3, 0, 0, 4], [np.nan, 0, 0, 1]]])
    return {
        **shared,
        "matrix": more,
        "quaternion": q,
    }


def _sps_machine(matrices: np.ndarray, dims: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "legs": legs_of(matrices, dims),
        "base_radius": dims[:, 0].copy(),
        "platform_radius": dims[:, 1].copy(),
        "height": dims[:, 2].copy(),
    }


R, SMALL = 330.0, 140.0  # the paper's machine
LIMITS = (568.0, 858.0)


def tricept_poses() -> np.ndarray:
    """Poses in the workspace, beyond it, upside down, at and near singular ones."""
    rng = np.random.default_rng(11)
    inside = np.column_stack([rng.uniform(-0.4, 0.4, (12, 2)), rng.uniform(560, 780, 12)])
    far = np.column_stack([rng.uniform(-3, 3, (6, 2)), rng.uniform(-900, 900, 6)])
    special = [
        [0, 0, 600],
        [0, 0, -600],
        [np.pi / 2, 0.3, 600],
        [0.2, np.pi / 2, 500],
        [1.2, -1.1, 40],
        [1e-9, -1e-9, 650],
        [np.nan, 0, 600],
        [0, 0, np.inf],
    ]
    return np.concatenate([inside, far, special])


def tricept_points() -> np.ndarray:
    """Points in the workspace and beyond it, and where roots vanish or are imaginary."""
    rng = np.random.default_rng(12)
    inside = np.column_stack([rng.uniform(-250, 250, (12, 2)), rng.uniform(560, 780, 12)])
    special = [
        [30, 20, 600],
        [30, -20, -600],
        [-250, 300, 650],
        [0, 700, 0],  # beta is not determined
        [0, 0, 0],
        [0.25, 600, 0.125],
        [30, 100, 40],  # with q_x = 50 a double root
        [30, 100, 39],  # and none
        [10, 0, 0],
        [np.nan, 0, 600],
        [0, -np.inf, 600],
    ]
    return np.concatenate([inside, special])


def tricept_covariances(n: int) -> np.ndarray:
    """Covariance matrices: diagonal, full, of rank one, nothing; and what is none."""
    rng = np.random.default_rng(13)
    full = rng.normal(size=(n, 5, 5)) * np.array([3e-3, 3e-3, 3e-3, 6e-3, 6e-3])[:, None]
    U = full @ full.swapaxes(1, 2)
    U[0] = np.diag([0.005**2 / 3] * 3 + [0.01**2 / 3] * 2)
    U[1] = np.outer(np.arange(1, 6), np.arange(1, 6)) * 1e-6
    U[2] = 0
    U[3] = np.diag([1e-6, 0, 1e-6, 0, 1e-6])
    U[4] = U[5]
    U[4, 0, 1] *= 1.5  # not symmetric
    U[6] = np.diag([1e-6, 1e-6, -1e-6, 1e-6, 1e-6])
    U[7] = np.diag([1.0, 1, 1, 1, 1]) * 1e-6
    U[7, 0, 1] = U[7, 1, 0] = 1.1e-6  # a correlation above 1
    U[8] = np.full((5, 5), np.nan)
    return U


def tricept_inputs(names: set[str]) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input of a kernel with these tricept_inputs."""
    if "pose" in names:
        values = {"pose": tricept_poses()}
    elif "legs" in names:
        rng = np.random.default_rng(14)
        special = [
            [600, 600, 600],
            [190, 190, 190],  # z = 0: a singular pose
            [200, 201, 199],
            [100, 100, 100],
            [2000, 2001, 1999],
            [600, 600, -600],
            [0, 600, 600],
            [np.nan, 600, 600],
            [600, np.inf, 600],
        ]
        values = {"legs": np.concatenate([rng.uniform(568, 858, (16, 3)), special])}
    else:
        values = {"point": tricept_points()}
    n = len(next(iter(values.values())))
    values |= {"r": np.full(n, SMALL), "R": np.full(n, R)}
    values |= {"q_x": np.zeros(n), "q_y": np.zeros(n), "q_z": np.zeros(n)}
    with_q = np.arange(n) % 3 == 1
    for name, value in (("q_x", 20.0), ("q_y", -30.0), ("q_z", 50.0)):
        values[name][with_q] = value
    if "point" in names:
        for name, value in (("q_x", 50.0), ("q_y", 0.0), ("q_z", 0.0)):
            values[name][18:20] = value
        values["R"][2] = values["r"][2]
        values["r"][21] = -1.0
    values |= {"shortest": np.full(n, LIMITS[0]), "longest": np.full(n, LIMITS[1])}
    values["U_x"] = tricept_covariances(n)
    return values


TRICEPT_DIRECTIONS = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([0, 120, -120])])


def parameter_inputs(name: str) -> dict[str, np.ndarray]:
    """Arrays (n, ...) for every input that a kernel of the module has."""
    rng = np.random.default_rng(12)
    n = 12
    pose = np.column_stack([rng.uniform(-0.6, 0.6, (n, 2)), rng.uniform(400, 900, n)])
    pose[3] = 0, 0, 700
    pose[4] = 0, 0, 2e-3
    pose[5] = 1.2, -1.3, 650
    fixed = 330 * TRICEPT_DIRECTIONS + rng.normal(scale=3, size=(n, 3, 3))
    moving = 140 * TRICEPT_DIRECTIONS + rng.normal(scale=3, size=(n, 3, 3))
    fixed[3], moving[3] = 330 * TRICEPT_DIRECTIONS, 140 * TRICEPT_DIRECTIONS
    rods = rng.uniform(568, 858, (n, 3))
    guide = rng.normal(scale=0.05, size=(n, 14))
    guide[3] = 0
    if name == "tricept_parameter_sensitivity":
        pose[6] = 0, 0, 0  # the rods lie in one plane with the joints: the closures do not determine the pose
        fixed[6], moving[6] = 330 * TRICEPT_DIRECTIONS, 140 * TRICEPT_DIRECTIONS
    pose[7, 1] = np.nan
    return {
        "pose": pose,
        "fixed": fixed,
        "moving": moving,
        "tool": rng.normal(scale=50, size=(n, 3)),
        "rods": rods,
        "guide": guide,
        "alpha": pose[:, 0],
        "beta": pose[:, 1],
        "R": rng.uniform(100, 500, n),
        "r": rng.uniform(50, 200, n),
    }
