"""Spatial mechanisms: joints in a row, and the rigid links between them.

Joint j lies on the axis S_j; link jk, from joint j to the next, lies on the common perpendicular a_jk of their axes. A
link has a length a_jk and a twist alpha_jk; a joint has an offset S_j, along its axis from the link before to the link
after, and an angle theta_j about its axis, between the same two. From one link to the next the transform is
Tx(a_ij) Rx(alpha_ij) Tz(S_j) Rz(theta_j): Crane and Duffy's, which is also called modified Denavit-Hartenberg.

Reverse analysis works on rotary joints with rigid links between them, in which slides are unknown lengths. A joint that
keeps its angle (a P, or one whose angle is given) turns nothing: the links on both sides of it are merged into one. The
result is m rotary joints and m links between them, and the chain is

    Rz(theta_1) G_1 Rz(theta_2) G_2 ... Rz(theta_m) G_m,    G_k = (R_k, v_k + sum of S_i d_i)

with unknown lengths S_i along directions d_i that are fixed in the link. Frame k lies in link k: z along axis k, x as
after the rotation by theta_k.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.array_types import Array
from rodgen.errors import RodgenError
from rodgen.kinematics.arrays import real_array
from rodgen.kinematics.spatial.transforms import rx, rz
from rodgen.views import with_html

FREEDOMS = {"R": 1, "P": 1, "H": 1, "C": 2, "T": 2, "S": 3, "E": 3}
"""Freedoms of each kind of joint: revolute, prismatic, screw, cylindric, Hooke, spherical, plane."""

_RIGHT_ANGLE = np.pi / 2
_OFFSET_VARIES, _ANGLE_VARIES = "PCE", "RCHTSE"
_VARIABLES: dict[str, tuple[Literal["theta", "S"], ...]] = {
    "R": ("theta",),
    "P": ("S",),
    "C": ("theta", "S"),
    "H": ("theta",),
}


@with_html
@dataclass(frozen=True, eq=False)
class Mechanism:
    """Joints in a row and the links between them: an open chain, such as a robot, or a closed loop.

    Parameters
    ----------
    joints : str or sequence of str, length n
        Kinds of the joints, the base's first: R, P, C, H, and for mobility E, T, S; see :meth:`expanded`.
    a, alpha : array_like (n - 1) or (n)
        Length and twist (rad) of the link after each joint. n - 1 of them make an open chain; with n of them the last
        leads back to the first joint, and the loop is closed.
    offset : array_like (n), optional
        S_j; NaN where it is the joint's variable (P, C, E); of a screw S_j at theta_j = 0. Left out: zero where it is
        constant.
    angle : array_like (n), optional
        theta_j in rad; NaN where it is the joint's variable (all but P). Left out: zero.
    pitch : array_like (n), optional
        Of a screw (H): length per rad; zero for all other joints.
    unit : str, optional
        Of the lengths.
    name : str, optional
        Its name.
    names : sequence of str (n), optional
        Names of the joints; left out: the kind and the number, such as ``R1``.

    Raises
    ------
    RodgenError
        When the arrays do not fit the joints, or a number is not finite or stands where a variable is.

    Notes
    -----
    An open chain stands on the fixed frame F, with z along S_1 and its origin where a_12 meets S_1 (at S_1 = 0);
    theta_1 is measured from its x axis (phi_1 of Crane and Duffy). The last joint's frame, x along the next a and z
    along the joint, is the end frame.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen import spatial
    >>> slider = spatial.Mechanism("RP", a=[100.0], alpha=[np.pi / 2])
    >>> slider.closed, slider.variables
    (False, ((0, 'theta'), (1, 'S')))
    """

    joints: tuple[str, ...]
    a: NDArray[np.float64]
    alpha: NDArray[np.float64]
    offset: NDArray[np.float64]
    angle: NDArray[np.float64]
    pitch: NDArray[np.float64]
    unit: str
    name: str
    names: tuple[str, ...]

    def __init__(
        self,
        joints: str | Sequence[str],
        a: ArrayLike,
        alpha: ArrayLike,
        offset: ArrayLike | None = None,
        angle: ArrayLike | None = None,
        pitch: ArrayLike | None = None,
        unit: str = "mm",
        name: str = "",
        names: Iterable[str] = (),
    ) -> None:
        kinds = tuple(joints)
        if not kinds:
            raise RodgenError("the mechanism has no joints; expected at least one")
        for number, kind in enumerate(kinds, 1):
            if kind not in FREEDOMS:
                raise RodgenError(f"joint {number} is {kind!r}; expected one of {', '.join(FREEDOMS)}")
        n = len(kinds)
        length, twist = _numbers("a", a), _numbers("alpha", alpha)
        if len(length) != len(twist) or len(length) not in (n - 1, n):
            raise RodgenError(
                f"there are {len(length)} lengths a and {len(twist)} angles alpha for {n} joints; expected "
                f"{n - 1} of both for an open chain, or {n} for a closed loop"
            )
        if not (np.isfinite(length).all() and np.isfinite(twist).all()):
            raise RodgenError(
                "a length a or an angle alpha is not finite; expected the geometry of every link"
            )
        fixed = {
            "joints": kinds,
            "a": length,
            "alpha": twist,
            "offset": _constants("offset", offset, kinds, _OFFSET_VARIES),
            "angle": _constants("angle", angle, kinds, _ANGLE_VARIES),
            "pitch": _pitches(pitch, kinds),
            "unit": unit,
            "name": name,
            "names": _joint_names(names, kinds),
        }
        for key, value in fixed.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, key, value)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mechanism):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[Any, ...]:
        arrays = (self.a, self.alpha, self.offset, self.angle, self.pitch)
        numbers = (tuple(None if np.isnan(x) else float(x) for x in array) for array in arrays)
        return (self.joints, *numbers, self.unit, self.name, self.names)

    @property
    def closed(self) -> bool:
        """Whether the last link leads back to the first joint."""
        return len(self.a) == len(self.joints)

    @property
    def freedoms(self) -> tuple[int, ...]:
        """Freedoms of each joint."""
        return tuple(FREEDOMS[kind] for kind in self.joints)

    @property
    def variables(self) -> tuple[tuple[int, Literal["theta", "S"]], ...]:
        """Joint (counted from 0) and "theta" or "S" of each variable, in the order of the joints; of a C both.

        Raises
        ------
        RodgenError
            When there are joints E, T or S: these have variables only when expanded.
        """
        for kind in self.joints:
            if kind not in _VARIABLES:
                raise RodgenError(
                    f"a joint {kind} has no variables in this convention; call expanded() first"
                )
        return tuple((j, which) for j, kind in enumerate(self.joints) for which in _VARIABLES[kind])

    def length_in(self, unit: str) -> float:
        """Return the factor from the mechanism's unit of length to another.

        Parameters
        ----------
        unit : str
            A unit of length that Pint knows.

        Returns
        -------
        float

        Raises
        ------
        RodgenError
            When it, or the mechanism's, is not a unit of length.
        """
        from rodgen.data.units import conversion_factor

        return conversion_factor(self.unit, "length", unit)

    def in_unit(self, unit: str) -> Mechanism:
        """Return the same mechanism with its lengths in another unit.

        Parameters
        ----------
        unit : str
            A unit of length that Pint knows.

        Returns
        -------
        Mechanism

        Raises
        ------
        RodgenError
            When it is not a unit of length.

        Examples
        --------
        >>> from rodgen import spatial
        >>> spatial.GE_P60.in_unit("mm").a
        array([  0., 700., 900.,   0.,   0.])
        """
        if unit == self.unit:
            return self
        k = self.length_in(unit)
        return replace(self, a=self.a * k, offset=self.offset * k, pitch=self.pitch * k, unit=unit)

    def expanded(self) -> Mechanism:
        """Return the mechanism with joints E, T and S replaced by joints R and P.

        Returns
        -------
        Mechanism
            T is R, R at right angles; S is R, R, R, each at right angles to the next; E is two P at right angles and an
            R across both. The lengths between them are zero. A given offset stands at the first R.

        Examples
        --------
        >>> from rodgen import spatial
        >>> "".join(spatial.Mechanism("RSET", [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]).expanded().joints)
        'RRRRPPRRR'
        """
        if not set(self.joints) & set("TSE"):
            return self
        rows: list[tuple[str, float, float, float, float, float, str]] = []
        for j, kind in enumerate(self.joints):
            last = (float(self.a[j]), float(self.alpha[j])) if j < len(self.a) else (np.nan, np.nan)
            between = (0.0, _RIGHT_ANGLE)
            offset, name = float(self.offset[j]), self.names[j]
            if kind in "TS":
                parts = {"T": 2, "S": 3}[kind]
                for part in range(parts):
                    link = last if part == parts - 1 else between
                    here = offset if part == 0 else 0.0
                    rows.append(("R", *link, here, np.nan, 0.0, f"{name}.{part + 1}"))
            elif kind == "E":
                # the second P is turned by a right angle, so that the R is across both
                rows.append(("P", *between, np.nan, 0.0, 0.0, f"{name}.1"))
                rows.append(("P", *between, np.nan, _RIGHT_ANGLE, 0.0, f"{name}.2"))
                rows.append(("R", *last, 0.0, np.nan, 0.0, f"{name}.3"))
            else:
                rows.append((kind, *last, offset, float(self.angle[j]), float(self.pitch[j]), name))
        kinds, lengths, twists, offsets, angles, pitches, names = zip(*rows, strict=True)
        links = len(rows) if self.closed else len(rows) - 1
        return Mechanism(
            kinds,
            lengths[:links],
            twists[:links],
            offsets,
            angles,
            pitches,
            unit=self.unit,
            name=self.name,
            names=names,
        )


def check_mechanism(given: object) -> None:
    """Raise a TypeError for anything but a mechanism, such as a placement."""
    if not isinstance(given, Mechanism):
        kind = type(given).__name__
        hint = ": its .mechanism, or the placement's own functions" if kind == "Placement" else ""
        raise TypeError(f"a {kind} was given; expected a Mechanism{hint}")


def _numbers(what: str, values: ArrayLike, joints: int | None = None) -> NDArray[np.float64]:
    """Return a row of numbers, one for each joint where their number is given."""
    numbers = real_array(what, values).copy()
    if numbers.ndim != 1:
        raise RodgenError(f"{what} has the shape {numbers.shape}; expected one row of numbers")
    if joints not in (None, len(numbers)):
        raise RodgenError(f"{what} has {len(numbers)} numbers for {joints} joints; expected one for each")
    return numbers


def _constants(
    what: str, values: ArrayLike | None, kinds: tuple[str, ...], varying: str
) -> NDArray[np.float64]:
    varies = np.array([kind in varying for kind in kinds])
    if values is None:
        return np.where(varies, np.nan, 0.0)
    constants = _numbers(what, values, len(kinds))
    for number, (kind, value, variable) in enumerate(zip(kinds, constants, varies, strict=True), 1):
        if variable and not np.isnan(value):
            raise RodgenError(
                f"{what} of joint {number} is {value:g}; expected NaN, since it is the variable of a joint {kind}"
            )
        if not variable and not np.isfinite(value):
            raise RodgenError(
                f"{what} of joint {number} is {value:g}; expected a number, since a joint {kind} keeps it"
            )
    return constants


def _pitches(values: ArrayLike | None, kinds: tuple[str, ...]) -> NDArray[np.float64]:
    pitches = np.zeros(len(kinds)) if values is None else _numbers("pitch", values, len(kinds))
    for number, (kind, value) in enumerate(zip(kinds, pitches, strict=True), 1):
        if kind == "H" and not (np.isfinite(value) and value):
            raise RodgenError(
                f"pitch of joint {number} is {value:g}; expected the length per rad of a screw, not zero"
            )
        if kind != "H" and value:
            raise RodgenError(
                f"pitch of joint {number} is {value:g}; expected 0, since a joint {kind} is not a screw"
            )
    return pitches


def _joint_names(names: Iterable[str], kinds: tuple[str, ...]) -> tuple[str, ...]:
    joint_names = tuple(names) or tuple(f"{kind}{number}" for number, kind in enumerate(kinds, 1))
    if len(joint_names) != len(kinds):
        raise RodgenError(
            f"there are {len(joint_names)} names for {len(kinds)} joints; expected one for each"
        )
    for name in joint_names:
        if joint_names.count(name) > 1:
            raise RodgenError(f"two joints are called {name!r}; expected a name of its own for each")
    return joint_names


PUMA_560 = Mechanism(
    "RRRRRR",
    a=[0.0, 17.0, 0.8, 0.0, 0.0],
    alpha=np.radians([90.0, 0.0, 270.0, 90.0, 90.0]),
    offset=[0.0, 5.9, 0.0, 17.0, 0.0, 4.0],
    unit="in",
    name="Puma 560",
)
"""The Puma 560, in inches; S_6 = 4 to the point that is followed."""

GE_P60 = Mechanism(
    "RRRRRR",
    a=[0.0, 70.0, 90.0, 0.0, 0.0],
    alpha=np.radians([270.0, 0.0, 0.0, 270.0, 90.0]),
    offset=[0.0, 0.0, 0.0, 9.8, 14.5, 15.24],
    unit="cm",
    name="GE P60",
)
"""The General Electric P60, in cm; S_6 = 15.24 to the point that is followed."""

T3_776 = Mechanism(
    "RRRRRR",
    a=[0.0, 44.0, 0.0, 0.0, 0.0],
    alpha=np.radians([90.0, 0.0, 90.0, 61.0, 61.0]),
    offset=[0.0, 0.0, 0.0, 55.0, 0.0, 6.0],
    unit="in",
    name="Cincinnati T3-776",
)
"""The Cincinnati Milacron T3-776, in inches; S_6 = 6 to the point that is followed."""


@dataclass(frozen=True)
class Link:
    """A link between two rotary joints, in the frame at its first one."""

    R: Array
    """From the frame at its second joint, before that joint's rotation, to the frame at its first, (..., 3, 3)."""
    v: Array
    """From the first origin to the second, without the slides, (..., 3)."""
    slides: tuple[tuple[int, Array], ...]
    """Index of each unknown length among the mechanism's variables, and its direction."""

    def each(self, change: Callable[[Array], Array]) -> Link:
        """Return the link with every array changed."""
        return Link(change(self.R), change(self.v), tuple((i, change(d)) for i, d in self.slides))


@dataclass(frozen=True)
class Merged:
    """Rotary joints and the links after them."""

    rotary: tuple[int, ...]
    """Index of each unknown angle among the mechanism's variables."""
    joints: tuple[int, ...]
    """The joint of each."""
    links: tuple[Link, ...]
    """The link after each; the last leads back to the first joint."""

    @property
    def slides(self) -> tuple[int, ...]:
        """Indices of the unknown lengths, in the order of the links."""
        return tuple(i for link in self.links for i, _ in link.slides)


def merge(
    mechanism: Mechanism, known: Mapping[int, Array], closing: tuple[Array, Array] | None = None
) -> Merged:
    """Return a mechanism of joints R, P, C and H as rotary joints with links between them.

    `known` has the values (...) of given variables by index, and all others are unknown; `closing`, a rotation
    (..., 3, 3) and a vector (..., 3), leads from the end of an open chain back to its first joint.
    """
    index = {variable: i for i, variable in enumerate(mechanism.variables)}
    n = len(mechanism.joints)
    shape = np.broadcast_shapes(
        *(np.shape(value) for value in known.values()), () if closing is None else closing[1].shape[:-1]
    )
    steps = []
    for j in range(n):
        turn, slide = index.get((j, "theta")), index.get((j, "S"))
        angle = mechanism.angle[j] if turn is None else known.get(turn)
        offset = mechanism.offset[j] if slide is None else known.get(slide)
        steps.append((j, angle, offset))
    starts = [i for i, step in enumerate(steps) if step[1] is None]
    first = starts[0] if starts else 0
    rotary: list[int] = []
    joints: list[int] = []
    links: list[Link] = []
    R, v = np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3))
    slides: list[tuple[int, Array]] = []
    for j, angle, offset in (*steps[first:], *steps[:first]):
        if angle is None:
            if rotary:
                links.append(Link(R, v, tuple(slides)))
                R, v, slides = np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.zeros((*shape, 3)), []
            rotary.append(index[j, "theta"])
            joints.append(j)
        if offset is None:
            slides.append((index[j, "S"], R[..., 2]))
        else:
            v = v + R[..., 2] * np.asarray(offset)[..., None]
        if angle is not None:
            R = R @ rz(np.broadcast_to(angle, shape))
        if j < len(mechanism.a):
            v = v + R[..., 0] * mechanism.a[j]
            R = R @ rx(np.float64(mechanism.alpha[j]))
        elif closing is not None:
            v = v + np.einsum("...ij,...j->...i", R, closing[1])
            R = R @ closing[0]
    links.append(Link(R, v, tuple(slides)))
    return Merged(tuple(rotary), tuple(joints), tuple(links))
