"""Where a machine is by the kernels that a fit evaluates: what emitted code is compared with.

They are derived on a tape from the machine as it was measured, with its instrument and its frame, and run on NumPy. The
emitted code is derived with SymPy from the part of the machine that is emitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.machines.kinematics import OnLegs
from rodgen.machines.measured import ANGLE_ABOUT
from rodgen.machines.model import Frame, Model
from rodgen.machines.rigid import rotation_vector

if TYPE_CHECKING:
    from rodgen.machines.emit._scope import Scope
    from rodgen.machines.machine import Machine

_OF_ROWS = frozenset("svTtFx")
"""Kinds of columns that conditions are, other than coordinates."""


class Reference:
    """The model of a machine, in the frame of the machine.

    Parameters
    ----------
    machine : Machine
        Without effects of the instrument. An inclination is read of the same body as an angle, whose kernel has the
        attitude.
    travel : array_like, optional
        As of :class:`Model`.
    """

    def __init__(self, machine: Machine, travel: Any = None) -> None:
        self.machine = machine
        if machine.measurand.line == "vertical":
            up = (-machine.gravity[0], -machine.gravity[1], -machine.gravity[2])
            measured = replace(machine.measured, kind=ANGLE_ABOUT.kind, about=up)
            machine = replace(machine, measured=measured)
        self.model = Model(machine, travel, compiled=False)
        self.theta = self.model.start()

    @classmethod
    def of(cls, machine: Machine, scope: Scope, travel: Any = None) -> Reference:
        """Return that of a fitted machine, of which the scope leaves out effects that belong to no part of it."""
        own = tuple(e for e in machine.effects if e.place is not None or e in scope.machine.effects)
        return cls(replace(machine, effects=own), travel)

    def nominal(self) -> Reference:
        """Return that of the nominal machine, with targets as they are mounted: directions as in the file."""
        machine, model = self.machine, self.model
        targets = machine.targets
        if machine.measurand.moving:
            points = [tuple(model.target(self.theta, k)[0].tolist()) for k in range(len(targets))]
            targets = tuple(replace(t, point=x) for t, x in zip(targets, points, strict=True))
        if machine.measurand.has_attitude:
            turns = [
                tuple(rotation_vector(model.attitude(self.theta, k)).tolist()) for k in range(len(targets))
            ]
            targets = tuple(replace(t, attitude=x) for t, x in zip(targets, turns, strict=True))
        return Reference(replace(machine, targets=targets, effects=(), estimate=(), values={}, ties={}))

    @property
    def conditions(self) -> list[tuple[str, int | str]]:
        """The columns of a row other than coordinates, as in `Structure.columns`."""
        return [column for column in self.model.structure.columns if column[0] in _OF_ROWS]

    @cached_property
    def _on_legs(self) -> OnLegs | None:
        """The legs of a platform as they were fitted, None of a chain."""
        kinematics = self.machine.kinematics
        if not isinstance(kinematics, OnLegs):
            return None
        numbers = {name: self.model.number(self.theta, name) for name in kinematics.numbers}
        return replace(kinematics, **{n: x if len(x) > 1 else x[0] for n, x in numbers.items()})

    def poses(self, q: Array) -> Array:
        """Return the poses of a platform that emitted code finds without effects, (n, numbers); of a chain (n, 0)."""
        return np.zeros((len(q), 0)) if self._on_legs is None else self._on_legs.found_by_code(q)

    def is_regular(self, q: Array, least: float) -> NDArray[np.bool_]:
        """Return where a platform is held with at least this singular value, (n,): everywhere of a chain."""
        if self._on_legs is None:
            return np.ones(len(q), bool)
        return self._on_legs.least_singular_value(self.poses(q)) > least

    def places(
        self,
        q: Array,
        targets: Sequence[int],
        conditions: Mapping[tuple[str, int | str], Array] | None = None,
    ) -> Array:
        """Return where targets are: points, directions or attitudes, row by row, (n, numbers).

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        targets : sequence of int, length n
        conditions : mapping of column to ndarray, shape (n,), optional
            Of :attr:`conditions`; zero where there is none.
        """
        known = {("q", j): x for j, x in enumerate(q.T)} | dict(conditions or {})
        known |= {("start", i): x for i, x in enumerate(self.poses(q).T)}
        rows = np.stack([known.get(x, np.zeros(len(q))) for x in self.model.structure.columns], axis=1)
        g = self.model.geometries(self.theta, Frame.identity(), [(target, 0) for target in targets])
        e = self.model.parameters_of_effects(self.theta)
        e = np.broadcast_to(e, (len(q), len(e)))
        found: Array = self.model.kernels["place"].in_sets(rows, [1] * len(q), g, e)[0]
        return found
