"""A chain of joints as rotary joints with rigid links between them, in which slides are unknown lengths.

A joint that keeps its angle (a P, or one whose angle is given) turns nothing: the links on both sides of it are one
link. The result is m rotary joints and m links between them, and the chain is

    Rz(theta_1) G_1 Rz(theta_2) G_2 ... Rz(theta_m) G_m,    G_k = (R_k, v_k + sum of S_i d_i)

with unknown lengths S_i along directions d_i that are fixed in the link. Frame k lies in link k: z along axis k, x as
after the rotation by theta_k.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rodgen.array_types import Array
from rodgen.kinematics.spatial.links.mechanism import Mechanism
from rodgen.kinematics.spatial.links.transforms import rx, rz


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
