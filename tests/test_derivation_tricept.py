"""The derivation of the Tricept: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against vectors and matrices in floating point with 40 digits,
differences, and SciPy's rotations, none of which the proofs use.
"""

import mpmath
import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.spatial.transform import Rotation

from rodgen.kinematics import tricept as public

pytestmark = [pytest.mark.xdist_group("tricept"), pytest.mark.thorough]
paper = LazyDerivation("tricept")

DIGITS = 40

PRINTED = [*(f"eq-{n}" for n in range(1, 24) if n not in (6, 11, 22)), "W33", "W35", "inverse", "table-1"]
SAID = ["Ox", "changes", "dimensionless", "vector-of-4", "after-multiplying-3", "cannot-be-derived"]
TACIT = ["usual-Ox", "units"]


@pytest.mark.thorough("eq-2", "eq-3", "eq-4")
@pytest.mark.parametrize("id", PRINTED)
def test_every_printed_formula_is_an_entry_with_its_place(id):
    entry = paper.derivation.entries[id]
    assert (entry.origin, entry.words) == ("printed", "")
    assert entry.place
    assert entry.verdict == ("refuted" if id in ("eq-8", "table-1") else "proved")


def test_equations_that_share_an_entry_are_named_in_its_place():
    places = " ".join(entry.place for entry in paper.derivation)
    for number in range(1, 24):
        assert f"({number})" in places, number


def test_what_is_said_or_taken_for_granted_is_marked_and_refuted():
    for ids, origin in ((SAID, "said"), (TACIT, "tacit")):
        assert [e.id for e in paper.derivation if e.origin == origin] == [
            e.id for e in paper.derivation if e.id in ids
        ]
        for id in ids:
            assert paper.derivation.entries[id].verdict == "refuted"
            assert bool(paper.derivation.entries[id].words) == (origin == "said")


def test_nothing_is_open_and_all_kernels_carry_the_prefix():
    assert paper.derivation.open == []
    assert len(paper.derivation.kernels) == 10
    assert all(name.startswith("tricept_") for name in paper.derivation.kernels)


def numbers(seed):
    rng = np.random.default_rng(seed)
    values = {
        paper.alpha: rng.uniform(-0.6, 0.6),
        paper.beta: rng.uniform(-0.6, 0.6),
        paper.z: rng.uniform(400, 900),
        paper.R: rng.uniform(200, 400),
        paper.r: rng.uniform(80, 180),
    }
    return values | dict(zip(paper.q, rng.uniform(-60, 60, 3), strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_rods_are_distances_of_joints_turned_by_scipy(seed):
    """Ox as printed is the right-handed rotation by −α; Oy is that by β."""
    values = numbers(seed)
    a, b, z, R, r = (values[s] for s in (paper.alpha, paper.beta, paper.z, paper.R, paper.r))
    turn = Rotation.from_euler("y", b) * Rotation.from_euler("x", -a)
    for k, printed in ((0, paper.length_0), (1, paper.length_1), (-1, paper.length_m)):
        angle = 2 * np.pi * k / 3
        e = np.array([np.cos(angle), np.sin(angle), 0])
        distance = np.linalg.norm(turn.apply(r * e + [0, 0, z]) - R * e)
        assert float(printed.subs(values)) == pytest.approx(distance, rel=1e-13)  # some 50 roundings


@pytest.mark.parametrize("seed", range(4))
def test_a35_of_eq_20_is_the_derivative_of_the_point_by_differences(seed):
    """The pose of changed rods and radii is found by mpmath's own solver with 40 digits, from (2) to (4)."""
    values = numbers(10 + seed)
    with mpmath.workdps(DIGITS):
        pose0 = [mpmath.mpf(values[s]) for s in paper.pose]
        q = [mpmath.mpf(values[s]) for s in paper.q]

        def rods(a, b, z, R, r):
            ca, sa, cb, sb = mpmath.cos(a), mpmath.sin(a), mpmath.cos(b), mpmath.sin(b)
            lengths = []
            for k in (0, 1, -1):
                c, s = mpmath.cos(2 * mpmath.pi * k / 3), mpmath.sin(2 * mpmath.pi * k / 3)
                y, h = ca * r * s + sa * z, -sa * r * s + ca * z
                lengths.append(mpmath.norm([cb * r * c + sb * h - R * c, y - R * s, -sb * r * c + cb * h]))
            return lengths

        def point(parameters):
            *lengths, r, R = parameters
            found = mpmath.findroot(
                lambda a, b, z: [x - y for x, y in zip(rods(a, b, z, R, r), lengths, strict=True)], pose0
            )
            a, b, z = found
            ca, sa, cb, sb = mpmath.cos(a), mpmath.sin(a), mpmath.cos(b), mpmath.sin(b)
            y, h = ca * q[1] + sa * (q[2] + z), -sa * q[1] + ca * (q[2] + z)
            return mpmath.matrix([cb * q[0] + sb * h, y, -sb * q[0] + cb * h])

        R, r = (mpmath.mpf(values[s]) for s in (paper.R, paper.r))
        parameters = [*rods(*pose0, R, r), r, R]
        step = mpmath.mpf(10) ** -12
        geometry = public.Geometry(float(R), float(r), tuple(map(float, q)))
        A = public.sensitivity(np.array(pose0, float), geometry)
        for j in range(5):
            up, down = list(parameters), list(parameters)
            up[j], down[j] = up[j] + step, down[j] - step
            slope = (point(up) - point(down)) / (2 * step)
            # the central difference is off by about step² times a third derivative: nothing in float64
            np.testing.assert_allclose(A[:, j], np.array(list(slope), float), rtol=1e-11, atol=1e-12)


@pytest.mark.thorough
def test_the_resultant_has_the_machines_exact_solutions():
    """Each positive root, isolated by exact arithmetic, is z² of a pose, and the other way round."""
    isolated = paper.resultant.intervals(eps=sp.Rational(1, 10**8), inf=0)
    roots = [float((low + high) / 2) for (low, high), _ in isolated]
    poses, count = public.direct_all([650.0, 700.0, 760.0], public.PAPER)
    np.testing.assert_allclose(np.sort(poses[: count // 2, 2] ** 2), roots, rtol=1e-12)  # of 4e5, by 1e-8


def test_the_elimination_has_degree_14_elsewhere_too():
    values = dict(zip((paper.R, paper.r, paper.A0, paper.A1, paper.Am), (5, 3, 7, 8, 6), strict=True))
    resultant, linear = paper.exact_resultant(values)
    resultant, powers_of_w = paper.without(resultant, sp.Poly(resultant.gen, resultant.gen))
    resultant, powers_of_e = paper.without(resultant, linear)
    assert (powers_of_w, powers_of_e, resultant.degree()) == (2, 4, 14)
