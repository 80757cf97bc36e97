"""The derivation of the 3-SPS-S machine: complete, closed, and right in numbers as well.

The proofs are exact. Here the same statements are held against points moved in space, against differences, and against
exact real-root counts and a Groebner basis, none of which the proofs use.
"""

import numpy as np
import pytest
import sympy as sp
from lazy import LazyDerivation
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.xdist_group("three_sps_s")
paper = LazyDerivation("three_sps_s")

R, r, h = 2.0, 1.0, 1.5
BASE = np.array([[np.cos(a), np.sin(a), 0] for a in np.radians([-30, 90, 210])])


def by_hand(matrix):
    """Squares of the legs from points, without the derivation."""
    return np.square(r * BASE @ matrix.T + [0, 0, h] - R * BASE).sum(axis=1)


def octic_at(squares, rho, dims=(R, r, h)):
    """The octic as the facts print it, written anew."""
    R, r, h = dims
    q = np.sqrt(3)
    K = R * R + r * r + h * h
    A = (3 * K - squares.sum()) / (3 * r * R)
    Z = (2 * squares[1] - squares[0] - squares[2]) / (3 * r) + 1j * (squares[0] - squares[2]) / (q * r)
    M, k = abs(Z) ** 2, 4 * R * R + 16 * h * h
    y, g = M + k * rho**2 - 16 * h * h * rho, k * rho - 16 * h * h
    P = y * (g * g - 12 * R * R * M) + 16 * R * R * M * M
    Z3 = Z**3
    return (P - 32 * A * h * h * R * Z3.real) ** 2 - 1024 * R * R * h**4 * Z3.imag**2 * (
        4 * (1 - rho) ** 2 - A * A
    )


@pytest.mark.thorough
def test_every_equation_of_the_section_is_an_entry():
    assert {"21", "22", "23-expanded", "23-changes", "angles-from-legs", "home-is-regular"} <= set(
        paper.derivation.entries
    )
    assert paper.derivation.open == []
    refuted = [entry.id for entry in paper.derivation if entry.verdict == "refuted"]
    assert refuted == ["23-changes", "angles-from-legs", "home-is-regular"]


def test_every_rotation_is_on_the_octic_and_no_other_tilt_is():
    for turn in Rotation.random(50, random_state=2):
        squares = by_hand(turn.as_matrix())
        rho = (1 - turn.as_matrix()[2, 2]) / 2
        # the octic has the leading coefficient k⁶ = 52⁶ in [0, 1]
        assert abs(octic_at(squares, rho)) < 1e-11 * 52**6
        assert abs(octic_at(squares, rho + 0.01)) > 1e-9 * abs(octic_at(squares, rho))


def test_the_kernel_s_coefficients_are_the_octic_s():
    kernel = paper.kernel_octic
    for turn in Rotation.random(5, random_state=3):
        squares = by_hand(turn.as_matrix())
        inputs = {"legs": np.sqrt(squares), "base_radius": R, "platform_radius": r, "height": h}
        octic = np.array(kernel.evaluate(inputs)["octic"], float)
        for rho in (-0.3, 0.0, 0.4, 1.2):
            wanted = octic_at(squares / R**2, rho, (1, r / R, h / R))
            assert np.isclose(np.polyval(octic[::-1], rho), wanted, rtol=1e-9, atol=1e-9)


def exact_octic(squares, R, r, h):
    """The octic with rational coefficients, from rational squares of the legs."""
    rho = sp.Symbol("rho")
    s1, s2, s3 = map(sp.Rational, squares)
    K = R**2 + r**2 + h**2
    A = (3 * K - s1 - s2 - s3) / (3 * r * R)
    C, B2 = (2 * s2 - s1 - s3) / (3 * r), (s1 - s3) ** 2 / (3 * r**2)
    M, k = C**2 + B2, 4 * R**2 + 16 * h**2
    y, g = M + k * rho**2 - 16 * h**2 * rho, k * rho - 16 * h**2
    P = y * (g**2 - 12 * R**2 * M) + 16 * R**2 * M**2
    Re3, Im3_squared = C**3 - 3 * C * B2, B2 * (3 * C**2 - B2) ** 2
    return sp.Poly(
        sp.expand(
            (P - 32 * A * h**2 * R * Re3) ** 2
            - 1024 * R**2 * h**4 * Im3_squared * (4 * (1 - rho) ** 2 - A**2)
        ),
        rho,
    )


RATIONAL = [  # squares of legs, and the number of real modes
    (("29/2", 7, 13), 0),
    ((15, "15/2", "3/2"), 0),
    ((5, 9, "35/4"), 2),
    (("41/4", "17/4", 9), 2),
    (("39/4", 6, "27/4"), 4),
    (("17/4", 7, "41/4"), 4),
    (("21/4", 8, "35/4"), 6),
    (("35/4", "29/4", 5), 6),
    (("23/4", "17/2", "13/2"), 8),
    (("33/4", 7, "27/4"), 8),
]


@pytest.mark.parametrize(("squares", "modes"), RATIONAL)
def test_exact_real_roots_are_the_modes(squares, modes):
    from rodgen.kinematics import three_sps_s

    octic = exact_octic(squares, sp.Integer(2), sp.Integer(1), sp.Rational(3, 2))
    assert octic.degree() == 8
    assert octic.LC() == 52**6
    assert sp.gcd(octic, octic.diff()).degree() == 0  # simple roots: each real one is a mode
    assert octic.count_roots() == octic.count_roots(0, 1) == modes
    legs = np.sqrt([float(sp.Rational(s)) for s in squares])
    _, count, _ = three_sps_s.direct_all(legs, three_sps_s.Geometry(2, 1, 1.5))
    assert count == modes
