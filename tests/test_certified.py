"""Bounds of rounding errors that hold for whole boxes of inputs: docs/science/certified.md."""

from __future__ import annotations

import itertools
import math
import re
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from test_axis import accuracy

import rodgen
from rodgen import tricept
from rodgen.generated.numpy import axis as axis_module
from rodgen.generated.numpy import rotations
from rodgen.generated.numpy import tricept as tricept_module

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "study"))

pytest.importorskip("flint")
import certify  # noqa: E402
import newton_program as newton  # noqa: E402
from rounding import EPS  # noqa: E402
from vector_programs import Floats, rotate, solve_axis, solve_axis_usual  # noqa: E402

pytestmark = pytest.mark.slow
CLAIMS = certify.claims()
every_claim = pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.kernel}: {c.where}")


@every_claim
def test_bound_holds_for_all_inputs_of_small_boxes(claim: certify.Claim) -> None:
    assert claim.small
    assert max(map(claim.measure, claim.small)) <= claim.bound


def test_page_has_every_claim() -> None:
    page = (ROOT / "docs/science/certified.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| ([\d.]+) .*?\| ([\d.]+) \|", page, re.MULTILINE)
    assert [(name, where, float(at_most)) for name, where, at_most, _ in rows] == [
        (c.kernel, c.where, c.bound) for c in CLAIMS
    ]
    assert all(float(found) <= float(at_most) for _, _, at_most, found in rows)


# Programs and kernels ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "family", ["generic", "χ negative", "χ ~ 1e-4", "χ = π - 1e-8", "lengths differ by 4e-4"]
)
def test_vector_programs_of_the_axis_are_the_kernels_bit_for_bit(family: str) -> None:
    rho, rho_prime, angle = accuracy.sample(family, 64, 200)[0]
    u, v, half = list(rho.T), list(rho_prime.T), 0.5 * angle
    given = (*u, *v, angle, 1e-8, EPS, np.finfo(float).max)
    sine, cosine = np.sin(half), np.cos(half)
    axes = solve_axis(Floats(), u, v, np.abs(sine), np.where(sine < 0, -cosine, cosine), {})[0]
    *expected, status = axis_module._solve_axis(np, *given)
    two = np.isin(status, (0, 3, 6))
    assert two.mean() > 0.9
    np.testing.assert_array_equal(np.ravel(axes, "C").reshape(6, -1)[:, two], np.array(expected)[:, two])
    axes, _ = solve_axis_usual(Floats(), u, v, np.tan(half), {})
    *expected, status, is_usual = axis_module._solve_axis_usual(np, *given)
    np.testing.assert_array_equal(np.ravel(axes).reshape(6, -1)[:, is_usual], np.array(expected)[:, is_usual])
    assert is_usual.any()


def test_vector_program_of_a_rotation_is_the_kernel_bit_for_bit() -> None:
    rng = np.random.default_rng(1)
    rho, theta = rng.normal(size=(2, 1000, 3)) * 10.0 ** rng.uniform(-3, 3, size=(2, 1000, 1))
    found = rotate(Floats(), list(rho.T), list(0.5 * theta.T))
    np.testing.assert_array_equal(np.stack(found, -1), rotations.rotate(rho, theta))


def drawn_rods(rows: int) -> np.ndarray:
    """Return the rods of poses in the certified boxes."""
    poses = np.random.default_rng(4).uniform([-0.4, -0.4, 550], [0.4, 0.4, 800], (rows, 3))
    return tricept.legs(poses, tricept.PAPER)


def test_the_steps_of_newtons_method_are_the_kernel_bit_for_bit() -> None:
    """Its pieces are executed one by one, as they are in the certificate."""
    rods = drawn_rods(300)
    names = {"xp": np, "eps": EPS, "largest": np.finfo(float).max, "r": 140.0, "R": 330.0}
    names |= {f"legs_{n}": rod for n, rod in enumerate(rods.T, 1)}
    exec(newton.BEFORE, names)
    for piece in newton.STEPS:
        exec(piece, names)
    exec(newton.RESULTS, names)
    pose, status = tricept_module.tricept_direct(rods, 140.0, 330.0)
    assert (status == 0).all()
    np.testing.assert_array_equal(np.stack([names[f"pose_{n}"] for n in (1, 2, 3)], axis=1), pose)


def test_no_error_of_a_direct_pose_exceeds_its_bound() -> None:
    """Against Newton's method with 50 digits."""
    claim = next(c for c in CLAIMS if c.kernel == "tricept_direct")
    rods = drawn_rods(25)
    found, _ = tricept_module.tricept_direct(rods, 140.0, 330.0)
    errors = []
    with mpmath.workdps(50):
        ends = [(mpmath.cos(t), mpmath.sin(t)) for t in (0, 2 * mpmath.pi / 3, -2 * mpmath.pi / 3)]
        for pose, given in zip(found, rods, strict=True):
            lengths = [mpmath.mpf(float(x)) for x in given]

            def off(a: object, b: object, z: object, lengths: list[mpmath.mpf] = lengths) -> list[mpmath.mpf]:
                (sa, ca), (sb, cb) = ((mpmath.sin(t), mpmath.cos(t)) for t in (a, b))
                rows = ((cb, -sb * sa, sb * ca), (0, ca, sa), (-sb, -cb * sa, cb * ca))
                places = [[140 * (row[0] * x + row[1] * y) + row[2] * z for row in rows] for x, y in ends]
                return [
                    (p[0] - 330 * x) ** 2 + (p[1] - 330 * y) ** 2 + p[2] ** 2 - length**2
                    for p, (x, y), length in zip(places, ends, lengths, strict=True)
                ]

            exact = mpmath.findroot(off, pose.tolist(), tol=1e-60)
            sizes = (1, 1, float(exact[2]))
            errors.append(
                max(abs(float(x) - y) / s for x, y, s in zip(pose, exact, sizes, strict=True)) / EPS
            )
    assert claim.bound / 100 < max(errors) <= claim.bound


def exactly(name: str, *given: np.ndarray) -> list[mpmath.mpf]:
    """Textbook formulas with 50 digits."""
    mp = [[mpmath.mpf(float(x)) for x in values] for values in given]
    if name == "rotate":
        rho, t = mp[0], [x / 2 for x in mp[1]]
        cross = lambda a, b: [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]  # noqa: E731
        inner = [x + y for x, y in zip(rho, cross(t, rho), strict=True)]
        square = 1 + sum(x * x for x in t)
        return [x + 2 * y / square for x, y in zip(rho, cross(t, inner), strict=True)]
    if name == "quaternion_from_matrix":
        (a, b, c), (d, e, f), (g, h, i) = (mp[0][:3], mp[0][3:6], mp[0][6:])
        columns = [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
        best = max(range(4), key=lambda n: columns[n][n])
        size = mpmath.sqrt(sum(x * x for x in columns[best])) * mpmath.sign(columns[best][0])
        return [x / size for x in columns[best]]
    w, *v = mp[0]
    length = mpmath.sqrt(sum(x * x for x in v))
    if name == "axis_angle_from_quaternion":
        return [x / length for x in v]
    n = w * w + length**2
    return [
        (2 * (v[i] * v[j] + w * sum(v[k] * ((j - i) * (k - j) * (k - i)) for k in range(3)) / -2) / n)
        if i != j
        else (w * w + 2 * v[i] ** 2 - length**2) / n
        for i in range(3)
        for j in range(3)
    ]


@pytest.mark.parametrize(
    "name", ["rotate", "matrix_from_quaternion", "axis_angle_from_quaternion", "quaternion_from_matrix"]
)
def test_no_error_exceeds_its_bound(name: str) -> None:
    """Errors against 50 digits at random inputs: a bound that one exceeds was computed wrongly."""
    claim = next(c for c in CLAIMS if c.kernel == name)
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(300):
        angle, axis = rng.uniform(0.1, 3), np.abs(rng.normal(size=3))
        axis /= np.linalg.norm(axis)
        given = [np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])]
        if name == "rotate":
            given = [rng.normal(size=3), 2 * math.tan(angle / 2) * axis]
        elif name == "quaternion_from_matrix":
            given = [rotations.matrix_from_quaternion(*given)[0]]
        found = getattr(rotations, name)(*given)
        with mpmath.workdps(50):
            values = np.ravel(found[0] if isinstance(found, tuple) else found)
            expected = exactly(name, *map(np.ravel, given))
            off = [float(mpmath.mpf(float(a)) - b) for a, b in zip(values, expected, strict=True)]
        error = (
            max(map(abs, off)) if name.startswith(("matrix", "quaternion")) else float(np.linalg.norm(off))
        )
        sizes = {"rotate": np.linalg.norm(given[0]), "axis_angle_from_quaternion": 1 / math.sin(angle / 2)}
        size = sizes.get(name, 1)
        errors.append(error / size / EPS)
    assert claim.bound / 30 < max(errors) <= claim.bound


def test_signs_of_components_change_no_error() -> None:
    """So conversions are certified for axes with components of one sign only."""
    rng = np.random.default_rng(3)
    quaternion = rng.normal(size=(500, 4))
    matrix = rodgen.matrix_from_quaternion(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))[0]
    for signs in itertools.product((1, -1), repeat=3):
        if np.prod(signs) < 0:
            continue  # the matrix of a rotation about the mirrored axis is the transposed one
        flip = np.array(signs)
        four = np.array([1, *flip])
        np.testing.assert_array_equal(
            rotations.matrix_from_quaternion(quaternion * four)[0],
            rotations.matrix_from_quaternion(quaternion)[0] * np.outer(flip, flip),
        )
        found, expected = (
            rotations.quaternion_from_matrix(m)[0] for m in (matrix * np.outer(flip, flip), matrix)
        )
        np.testing.assert_array_equal(found, expected * four)
    np.testing.assert_array_equal(
        rotations.matrix_from_quaternion(quaternion * [1, -1, -1, -1])[0],
        rotations.matrix_from_quaternion(quaternion)[0].swapaxes(1, 2),
    )
