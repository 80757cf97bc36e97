"""The X-Y-Z notation and the laws of spherical polygons, and linkages that close, against rotation matrices.

The derivation proves the laws by a calculus on names. Here they hold exactly on polygons that close exactly, and at 50
digits on others; what names mean is compared with scalar products of vectors; the printed toolkit is read back.
Quadrilateral and pentagon are held to a numeric search, and to where they degenerate.
"""

from __future__ import annotations

import re
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from closed_polygons import exact, frames, many_digits, product, rotate_x, rotate_z, spatial
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kinematics_cases import rotations
from lazy import LazyDerivation
from scipy.optimize import fsolve

from rodgen.kinematics import spatial as sphere
from rodgen.kinematics.spatial import PolygonStatus
from rodgen.polygon_laws import FAMILIES, Law, laws
from rodgen.polygon_notation import Term
from rodgen.symbolic import errata

pytestmark = pytest.mark.xdist_group("spherical_polygons")
spherical_polygons = LazyDerivation("spherical_polygons")

EPS = float(np.finfo(float).eps)
SIZES = pytest.mark.parametrize("n", range(3, 8))
RNG = np.random.default_rng(41)
DIGITS = mpmath.mpf(10) ** -45
"""50 digits, less what a few hundred operations and a twist near 0 lose."""


def whole(n: int, angles: dict) -> list:
    factors = []
    for j in range(1, n + 1):
        factors += [rotate_z(*angles["theta", j]), rotate_x(*angles["alpha", j])]
    return product(*factors)


def tables(n: int) -> list[Law]:
    return [law for law in laws(n) if isinstance(law, Law)]


# The laws ------------------------------------------------------------------------------------------------


@SIZES
def test_there_are_as_many_laws_as_rows_of_subscripts(n: int) -> None:
    found = laws(n)
    by_family = {family: sum(law.family == family for law in found) for family in FAMILIES}
    rows = 6 * (n - 3) * n
    assert by_family == {
        "fundamental": 6 * n,
        "subsidiary": rows,
        "polar": 6 * n,
        "polar subsidiary": rows,
        "half tangent": 2 * n,
    }
    assert len({law.text() for law in found}) == len(found)


@SIZES
def test_every_law_holds_exactly_on_an_exactly_closed_polygon(n: int) -> None:
    angles = exact(n, n)
    assert all(x == int(i == j) for i, row in enumerate(whole(n, angles)) for j, x in enumerate(row))
    for law in tables(n):
        assert law.left.value(angles) == law.sign * law.right.value(angles), law.text()


@SIZES
def test_every_secondary_law_holds_exactly_on_a_loop_in_space(n: int) -> None:
    _, dual = spatial(n, exact(n, n), n)
    for law in tables(n) if n < 6 else laws(n, shifts=False)[:-2]:  # one shift of the longest: a second each
        assert law.left.value(dual).b == (law.sign * law.right.value(dual)).b, law.text()


@SIZES
def test_secondary_cosine_law_is_free_of_the_offset(n: int) -> None:
    lengths, dual = spatial(n, exact(n, n), n)
    angles = exact(n, n)
    for law in tables(n):
        if law.family == "fundamental" and law.kind == "cosine":
            ((_, twist),) = law.right.factors
            assert law.left.value(dual).b == -lengths[twist] * angles[twist][1]


def test_calculus_refuses_laws_that_are_wrong() -> None:
    """Signs, neighbours, and the misprint of the notes: each change of a law is detected."""
    for law in tables(5):
        assert not replace(law, sign=-law.sign).holds()
        turned = tuple(j % 5 + 1 for j in law.left.subscripts)
        assert not replace(law, left=replace(law.left, subscripts=turned)).holds()
    wrong = [law for law in tables(3) if law.text() == "Yb_2 = s31 c1"]
    (_, joint) = wrong[0].right.factors
    assert not replace(wrong[0], right=replace(wrong[0].right, factors=(("s", ("alpha", 2)), joint))).holds()


def test_two_names_are_equal_for_the_calculus_only_where_they_are_in_numbers() -> None:
    with mpmath.workdps(30):
        angles = many_digits(5, 3)
        names = [
            Term(letter, tuple((first + step * k) % 5 + 1 for k in range(count)), 5, star=star)
            for first in range(5)
            for step in (1, -1)
            for count in (2, 3, 4)
            for letter, star in (*((letter, False) for letter in "XYZUVW"), ("X", True), ("U", True))
            if count < 4 or letter in "UVW"
        ]
        values = [name.value(angles) for name in names]
        entries = [name.entry().canonical() for name in names]
        equal = 0
        for i, a in enumerate(names):
            for j in range(i):
                same = entries[i] == entries[j]
                assert same == (abs(values[i] - values[j]) < 1e-25), (a.text(), names[j].text())
                equal += same
        assert equal > 50  # W_12 = W_21 and the like


# What the names mean -------------------------------------------------------------------------------------


def test_names_are_scalar_products_of_joints_and_links() -> None:
    """S_i · S_j, a · S, a · a, S · a in an open chain of seven: the products of the notes' table."""
    with mpmath.workdps(50):
        angles = many_digits(7, 5)
        chain = frames(7, angles)

        def column(j: int, k: int) -> list:
            return [row[k] for row in chain[j - 1]]

        def dot(u: list, v: list) -> object:
            return sum(a * b for a, b in zip(u, v, strict=True))

        def value(letter: str, high: int, low: int) -> object:
            row = tuple(range(high, low - 1, -1))
            return Term(letter, row, 7, bar=len(row) == 1).value(angles)

        for i in range(1, 6):
            for j in range(i + 2, 8):
                assert abs(dot(column(i, 2), column(j, 2)) - value("Z", j - 1, i + 1)) < DIGITS
                assert abs(dot(column(i, 0), column(j, 2)) - value("X", j - 1, i + 1)) < DIGITS
                assert abs(dot(column(i, 0), column(j, 0)) - value("W", j, i + 1)) < DIGITS
                if j < i + 6:  # S_1 · a_71 is no name
                    assert abs(dot(column(i, 2), column(j, 0)) - value("U", j, i)) < DIGITS


NAMES = [
    "X_3",
    "X*_3",
    "Xb*_3",
    "Xb_3",
    "Y_34",
    "Z_432",
    "X_71",
    "X_17",
    "X*_4321",
    "Y_12345",
    "U_21",
    "V_345",
    "U*_6712",
    "W_123456",
]


@pytest.mark.parametrize("name", NAMES)
def test_numbers_agree_with_many_digits(name: str) -> None:
    letter, mark, row = re.fullmatch(r"(\w)(b?\*?)_(\d+)", name).groups()
    alpha, theta, a, offset = RNG.uniform(-3, 3, size=(4, 20, 7))
    value, secondary = sphere.secondary_notation(name, alpha, theta, a, offset)
    assert np.array_equal(value, sphere.notation(name, alpha, theta))
    term = Term(letter, tuple(map(int, row)), 7, bar="b" in mark, star="*" in mark)
    with mpmath.workdps(40):
        step = mpmath.mpf(10) ** -15
        for k in range(len(alpha)):

            def at(h: object, k: int = k) -> object:
                both = (("alpha", alpha[k], a[k]), ("theta", theta[k], offset[k]))
                angles = {
                    (kind, j + 1): (mpmath.cos(x), mpmath.sin(x))
                    for kind, start, way in both
                    for j, x in enumerate(
                        mpmath.mpf(s) + h * mpmath.mpf(w) for s, w in zip(start, way, strict=True)
                    )
                }
                return term.value(angles)

            assert abs(at(0) - value[k]) < 8 * EPS
            slope = (at(step) - at(-step)) / (2 * step)
            assert abs(slope - secondary[k]) < 1e-13 * 33  # a sum of 11 lengths of at most 3


@pytest.mark.parametrize(
    "name",
    [
        "Q_2",
        None,
        "X",
        "X_24",
        "X_232",
        "X_6",
        "X_4321",
        "U_1",
        "Xb_21",
        "Ub_21",
        "Y*_21",
    ],
)
def test_what_is_no_name_is_refused(refuses, name: object) -> None:
    refuses(sphere.notation, name, np.zeros(5), np.zeros(5), raises=ValueError)  # type: ignore[arg-type]


def test_twists_and_angles_of_one_number_are_needed(refuses) -> None:
    refuses(sphere.notation, "X_2", np.zeros(4), np.zeros(5), raises=ValueError)
    refuses(sphere.notation, "X_123456", np.zeros(8), np.zeros(8), raises=ValueError)


def test_directions_of_a_chains_frames_are_direction_cosines() -> None:
    alpha, theta = RNG.uniform(-3, 3, size=(2, 10, 7))
    for twists, angles in zip(alpha, theta, strict=True):
        chain = sphere.frames(sphere.Mechanism("R" * 7, np.zeros(6), twists[:6]), [0.0, *angles[1:]])
        for j in range(4, 8):
            row = "".join(map(str, range(j - 1, 1, -1)))
            xyz = [sphere.notation(f"{letter}_{row}", twists, angles) for letter in "XYZ"]
            assert np.abs(chain[j - 1, :3, 2] - np.stack(xyz, axis=-1)).max() < 16 * EPS


# The printed toolkit -------------------------------------------------------------------------------------


def read_back(formula: str, angles: dict, lengths: dict, n: int) -> object:
    """Evaluate a side of a printed equation."""

    def factor(found: re.Match[str]) -> str:
        letter, mark, zero, row = found.groups()
        if letter in "XYZUVW":
            term = Term(letter, tuple(map(int, row)), n, bar=mark == "b", star=mark == "*")
            values[len(values)] = term.value(lengths if zero else angles)
            if zero:
                values[len(values) - 1] = values[len(values) - 1].b
        else:
            key = ("alpha" if len(row) == 2 else "theta", int(row[0]))
            if letter in "aS":
                dual_cosine, dual_sine = lengths[key]
                cosine, sine = angles[key]
                values[len(values)] = cosine * dual_sine.b - sine * dual_cosine.b
            else:
                values[len(values)] = angles[key]["cs".index(letter)]
        return f"values[{len(values) - 1}]"

    values: dict[int, object] = {}
    text = re.sub(r"([A-Zacs])([b*]?)(0?)_?(\d+)", factor, formula)
    return eval(re.sub(r"\] (?=values)", "] * ", text), {"values": values})  # made of factors alone


@SIZES
def test_printed_equations_hold_as_they_stand(n: int) -> None:
    with mpmath.workdps(50):
        angles = many_digits(n, n + 7)
        _, dual = spatial(n, angles, n)
        text = sphere.toolkit(n)
        assert int(re.search(r"(\d+) equations", text)[1]) == len(laws(n))
        found = 0
        for line in text.partition("laws\n")[2].splitlines():
            for equation in re.split(r" {3,}", line.strip()):
                left, _, right = equation.partition(" = ")
                if not right or re.search(r"_(j|ab)\b", left):  # a heading, words, or a rule in letters
                    continue
                found += 1
                if left.startswith("x_"):
                    cosine, sine = angles["theta", int(left[2:])]
                    for side in right.split(" = "):
                        assert (
                            abs(read_back(side, angles, dual, n) - sine / (1 + cosine))
                            < mpmath.mpf(10) ** -40
                        )
                    continue
                off = read_back(left, angles, dual, n) - read_back(right, angles, dual, n)
                assert abs(off) < mpmath.mpf(10) ** -40, equation  # offsets are of order 1e3
        assert found == len(laws(n)) + 6 * n


def test_toolkit_refuses_what_it_has_not(refuses) -> None:
    refuses(sphere.toolkit, 8, raises=ValueError)


# The derivation ------------------------------------------------------------------------------------------


def test_derivation_is_closed_and_its_errata_are_listed() -> None:
    derivation = spherical_polygons.derivation
    assert derivation.open == []
    refuted = {entry.refutation.label: entry for entry in derivation if entry.refutation}
    assert {label: entry.origin for label, entry in refuted.items()} == {"N1": "said", "N2": "printed"}
    text = errata(derivation)
    assert "double-subscripts" in text
    assert text.count("right:") == 2
    assert all(entry.place for entry in derivation if entry.origin != "own")


@pytest.mark.parametrize("id", ["S1-S2-S3", "single-bar", "single", "step", "triangle-X"])
def test_what_the_notes_print_right_is_proved(id: str) -> None:
    entry = spherical_polygons.derivation.entries[id]
    assert (entry.origin, entry.verdict) == ("printed", "proved")


CLOSED = 16 * EPS
"""Some forty products and sums in the joint angles and in the product of all rotations; measured 6 on 2e5 polygons."""
LINKAGES = pytest.mark.parametrize("n", [4, 5])


def close(alpha: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The function for as many twists; given are the last joint angles."""
    if np.shape(alpha)[-1] == 4:
        return sphere.spherical_quadrilateral(alpha, given[..., 0])
    return sphere.spherical_pentagon(alpha, given[..., 0], given[..., 1])


def misfit(alpha: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """How far the product of all rotations is from the unit matrix."""
    whole = np.eye(3)
    for j in range(alpha.shape[-1]):
        whole = whole @ rotations(theta[..., j], 2) @ rotations(alpha[..., j], 0)
    return np.abs(whole - np.eye(3)).max(axis=(-2, -1))


def closed(n: int, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Twists of either sign and joint angles of polygons that are closed."""
    rng = np.random.default_rng(seed)
    alpha, theta = rng.uniform(-np.pi, np.pi, size=(2, count, n))
    chain = rotations(alpha[:, 0], 0)
    for j in range(1, n - 1):
        chain = chain @ rotations(theta[:, j], 2) @ rotations(alpha[:, j], 0)
    sign = rng.choice([-1, 1], size=count)
    sine = sign * np.hypot(chain[:, 0, 2], chain[:, 1, 2])
    alpha[:, n - 1] = np.arctan2(sine, chain[:, 2, 2])
    theta[:, 0] = np.arctan2(chain[:, 0, 2] * sign, chain[:, 1, 2] * sign)
    rest = rotations(alpha[:, n - 1], 0) @ rotations(theta[:, 0], 2) @ chain
    theta[:, n - 1] = np.arctan2(-rest[:, 1, 0], rest[:, 0, 0])
    assert (misfit(alpha, theta) < 1e-13).all()
    return alpha, theta


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@LINKAGES
def test_both_ways_close_and_one_is_the_polygon_they_are_made_of(n: int) -> None:
    alpha, theta = closed(n, 20_000, n)
    found, status = close(alpha, theta[:, 3:])
    assert (status <= PolygonStatus.DOUBLE).all()
    assert np.array_equal(found[..., 3:], np.repeat(theta[:, None, 3:], 2, axis=1))
    assert (np.abs(found[..., :3]) <= np.pi).all()
    assert misfit(alpha[:, None], found).max() < CLOSED
    off = apart(found, theta[:, None]).min(axis=1)
    assert np.median(off) < 8 * EPS
    assert off.max() < np.sqrt(
        64 * EPS
    )  # where the two ways all but meet, an angle takes the root of the rounding


@LINKAGES
def test_fsolve_from_many_starts_finds_no_third_way(n: int) -> None:
    alpha, theta = closed(n, 12, 10 + n)
    found, status = close(alpha, theta[:, 3:])
    assert (status == PolygonStatus.TWO).all()
    rng = np.random.default_rng(n)
    for k in range(len(alpha)):

        def equations(x: np.ndarray, k: int = k) -> np.ndarray:
            angles, whole = np.append(x, theta[k, 3:]), np.eye(3)
            for t, a in zip(angles, alpha[k], strict=True):
                whole = whole @ rotations(t, 2) @ rotations(a, 0)
            return np.array([whole[2, 1] - whole[1, 2], whole[0, 2] - whole[2, 0], whole[1, 0] - whole[0, 1]])

        seen = set()
        for number, start in enumerate(rng.uniform(-np.pi, np.pi, size=(300, 3))):
            x, _, success, _ = fsolve(equations, start, xtol=1e-13, full_output=True)
            angles = np.append(x, theta[k, 3:])
            if success == 1 and misfit(alpha[k], angles) < 1e-9:  # a half turn satisfies the equations, too
                distance = apart(found[k], angles)
                assert distance.min() < 1e-6
                seen.add(int(distance.argmin()))
            if number > 25 and len(seen) == 2:
                break
        assert seen == {0, 1}


def test_worked_example() -> None:
    """The course's figures for alpha = 40, 70, 85, 70 and theta_4 = 75 degrees."""
    alpha = np.radians([40, 70, 85, 70])
    A, B = (np.sin(alpha[0]) * sphere.notation(f"{x}_4", alpha, [0, 0, 0, np.radians(75)]) for x in "YX")
    D = np.cos(alpha[0]) * sphere.notation("Z_4", alpha, [0, 0, 0, np.radians(75)]) - np.cos(alpha[1])
    assert np.abs(np.array([A, B, D]) - [-0.1093, 0.6185, -0.5048]).max() < 5e-5
    theta, status = sphere.spherical_quadrilateral(alpha, np.radians(75))
    assert status == PolygonStatus.TWO
    assert np.abs(np.degrees(theta[1, :3]) - [63.5047, 38.2302, 87.7179]).max() < 5e-5
    assert np.abs(np.degrees(theta[0, :3]) - [136.5430, -38.2302, 135.7593]).max() < 5e-5


HALF = np.pi / 2
DEGENERATE = [
    # twists, given angles, status
    ([0.3, 0.2, 1.5, 1.5], [0.0], PolygonStatus.NONE),  # joints 1 and 3 are 3 rad apart
    ([0.2, 0.3, 1.5, 0.4, 1.0], [0.3, 0.4], PolygonStatus.NONE),
    ([0.6, 0.8, 0.5, 0.9], [0.0], PolygonStatus.DOUBLE),  # stretched, 0.6 + 0.8 = 0.5 + 0.9
    ([0.6, 0.2, 0.5, 0.1, 0.2], [0.0, 0.0], PolygonStatus.DOUBLE),
    ([0.8, 0.8, 0.6, 0.6], [np.pi], PolygonStatus.FAMILY),  # joint 3 lies on joint 1
    ([HALF, HALF, HALF, HALF], [np.pi], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.3, 0.4], [0.0], PolygonStatus.FAMILY),  # joint 2 lies on joint 1
    ([np.pi, 0.7, np.pi - 0.3, -0.4], [0.0], PolygonStatus.FAMILY),
    ([0.7, 0.0, 0.3, 0.4], [0.0], PolygonStatus.FAMILY),  # joint 3 lies on joint 2
    ([0.7, np.pi, 0.3, 0.4 - np.pi], [0.0], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.9, 0.4], [2.0], PolygonStatus.NONE),
    ([0.0, 0.0, 0.4, 0.4], [np.pi], PolygonStatus.FAMILY),
    ([0.0, 0.7, 0.4, 0.1, 0.2], [0.0, 0.0], PolygonStatus.FAMILY),
    ([0.7, 0.0, 0.4, 0.1, 0.2], [0.0, 0.0], PolygonStatus.FAMILY),
    ([0.8, 0.8, 0.5, 0.2, 0.7], [0.0, np.pi], PolygonStatus.FAMILY),  # joint 3 on joint 1: folded back
    ([0.5, np.nan, 0.9, 1.1], [1.0], PolygonStatus.INVALID),
    ([0.5, 0.7, 0.9, 1.1], [np.inf], PolygonStatus.INVALID),
    ([0.5, 0.7, 0.9, 1.1, 1.0], [1.0, np.nan], PolygonStatus.INVALID),
]


@pytest.mark.parametrize(("alpha", "given", "expected"), DEGENERATE)
def test_degenerate_polygons_have_a_status_and_what_is_given_closes(
    alpha: list[float], given: list[float], expected: PolygonStatus
) -> None:
    theta, status = close(np.array(alpha), np.array(given))
    assert PolygonStatus(int(status)) == expected
    nothing = expected in (PolygonStatus.NONE, PolygonStatus.INVALID)
    assert np.isnan(theta).all() == np.isnan(theta).any() == nothing
    if not nothing:
        assert misfit(np.array(alpha), theta).max() < CLOSED
    if expected == PolygonStatus.DOUBLE:
        assert apart(theta[0], theta[1]) < 1e-12


numbers = st.one_of(
    st.floats(-7, 7),
    st.integers(-4, 4).map(lambda k: k * HALF),
    st.sampled_from([0.0, 1e-300, 1e-9, 1e-16, np.pi]),
)


@LINKAGES
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_any_finite_input_has_a_status_and_what_is_given_closes(n: int, data: st.DataObject) -> None:
    alpha = data.draw(arrays(float, n, elements=numbers))
    angles = data.draw(arrays(float, n - 3, elements=numbers))
    theta, status = close(alpha, angles)
    assert status in (PolygonStatus.TWO, PolygonStatus.DOUBLE, PolygonStatus.FAMILY, PolygonStatus.NONE)
    assert np.isnan(theta).any() == (status == PolygonStatus.NONE)
    if status != PolygonStatus.NONE:
        # a fold that is open by less than the kernel can tell is taken for closed
        assert misfit(alpha, theta).max() < 128 * EPS
