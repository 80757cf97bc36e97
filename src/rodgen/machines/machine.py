"""A machine: its joints, targets, what is measured, the effects that its model has, and what is done with it.

All numbers are in internal units: lengths in the unit of the machine file, angles in radians, times in seconds,
temperatures in kelvins from the reference, forces in newtons. Nothing changes a machine; what seems to returns
another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from rodgen.data.set_aside import RowsAside
from rodgen.errors import InputFileError, UnexpectedError, in_file, joined, shown
from rodgen.machines.coupling import Couplings, couplings_of
from rodgen.machines.known import read_known, read_tie
from rodgen.machines.measured import Measured
from rodgen.machines.parts import (
    Effect,
    Joint,
    MachineData,
    Target,
    belongs,
)
from rodgen.machines.rules import UnfitEffectError, catalogue_effect, check_effect
from rodgen.machines.structure import Structure, structure_of
from rodgen.methods import method
from rodgen.views import html_of_text

__all__ = ["Effect", "EffectBearer", "Joint", "Machine", "Measured", "Target"]


class EffectBearer(Protocol):
    """Anything that has an effect, such as a step of a diagnosis."""

    @property
    def effect(self) -> Effect:
        """The effect, in its place."""


@dataclass(frozen=True)
class Machine(MachineData):
    """A chain of joints, or a platform on legs, from the measuring frame to the measured point, with its errors.

    Attributes
    ----------
    name : str
    length_unit, angle_unit : str
        Of the plain numbers in the machine file.
    gravity : tuple of float, length 3
        Unit vector, in machine axes.
    reference_temperature : float
        In degrees Celsius.
    joints : tuple of Joint
        The base's first. Of a machine of two branches in the order from the instrument to the target: first those of
        the instrument's branch, that next to the bed last, then those of the other one.
    targets : tuple of Target
    measured : Measured
    estimate : tuple of str
        What a base fit adjusts: ``"target"``, ``"NAME.axis"``, ``"NAME.point"``; of a closed chain ``"target"``,
        ``"geometry"`` or its numbers by name.
    effects : tuple of Effect
    file : str or None
        Where it was read from; two machines may be equal from different files.
    values : mapping of str to float
        Fitted numbers, by the parameters' keys, such as ``"C.axis.a"``; empty as read: all are zero.
    kinematics : Kinematics
        How the joints carry the target: one after the other, or as the legs of a platform.
    known : mapping of str to Known
        What is known of parameters before they are measured, by their keys or by what they belong to; see `knowing`.
    plausible : mapping of str to StatedPlausibility
        What the file says of the plausibility of effects, by ``PLACE.EFFECT``, or ``EFFECT`` for every place.
    record : mapping of str to str
        What is noted of the measurements for reports: ``date``, ``instrument``, ``conditions``.
    ties : mapping of str to Combination
        Parameters, by their keys, that are combinations of others; see `tying`.
    column_sources : mapping of str to ColumnSource
        What the columns of other people's tables are, for ``rodgen import``.
    doubts : callable, optional
        Returns what is wrong with the files that the machine was fitted to, in one sentence, or an empty text; `emit`
        asks.

    Examples
    --------
    >>> machine = Machine(
    ...     "Rotary table", "mm", "deg", (0.0, 0.0, -1.0), 20.0,
    ...     joints=(Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     targets=(Target("ball", (120.0, 0.0, 40.0)),),
    ...     measured=Measured("point", "machine", noise=0.002),
    ...     estimate=("C.axis", "target"),
    ... )
    >>> print(machine.with_effect(machine.effect("backlash", "C", hold={"b": 0.01})).describe())
    Rotary table (mm, deg)
      C  revolute about [0, 0, 1] through [0, 0, 0]
    targets: ball [120, 0, 40]
    measured: point in machine axes, noise 0.002 mm
    estimated: C.axis, target
    effects: backlash at C (b = 36 arcsec held)
    """

    # implemented by modules above, as rodgen.facade says
    load = cast("Callable[..., Machine]", method(of_class=True))
    save = cast("Callable[..., None]", method())
    validate = cast("Callable[..., None]", method())
    describe = cast("Callable[..., str]", method())
    aside = cast("Callable[..., RowsAside | None]", method())
    setting_aside = cast("Callable[..., Machine]", method())
    bringing_back = cast("Callable[..., Machine]", method())
    fit = method()
    emit = cast("Callable[..., list[Path]]", method())

    @cached_property
    def structure(self) -> Structure:
        """What its kernels depend on."""
        return structure_of(self)

    def effect(
        self, name: str, place: str | None = None, *, hold: Mapping[str, float] | None = None
    ) -> Effect:
        """Return an effect of the catalogue at a place of this machine.

        Parameters
        ----------
        name : str
            As ``rodgen effects`` lists it.
        place : str, optional
            A joint or a target; left out: the whole machine.
        hold : mapping of str to float, optional
            Parameters that are not estimated, in the units of the machine file.

        Returns
        -------
        Effect
            For :meth:`with_effect`.

        Raises
        ------
        InputFileError
            When it cannot stand there.
        """
        try:
            return catalogue_effect(self, name, place, hold or {})
        except UnfitEffectError as error:
            raise self._unfit(f"{name} at {place}" if place else name, error) from None

    @cached_property
    def couplings(self) -> Couplings | None:
        """How the coordinates of joints follow from readings; None where each is the joint's reading."""
        return couplings_of(self)

    @cached_property
    def limits(self) -> tuple[tuple[float, float] | None, ...]:
        """Lowest and highest reading of each joint: stated, or what the coordinates' travels allow; else None."""
        if self.couplings is None:
            return tuple(joint.travel for joint in self.joints)
        stated = np.array([joint.travel or (np.nan, np.nan) for joint in self.joints])
        within = self.couplings.readings_within(stated)
        limits: list[tuple[float, float] | None] = []
        for joint, coupling, (low, high) in zip(self.joints, self.couplings.of, within.tolist(), strict=True):
            known = joint.is_read and math.isfinite(low) and math.isfinite(high)
            stated_travel = joint.travel if coupling is None else joint.reading_travel
            limits.append(stated_travel or ((low, high) if known else None))
        return tuple(limits)

    @property
    def quantities(self) -> dict[str, str]:
        """Names of joints, which are their coordinates, and of readings, each with the type of the joint."""
        return {name: joint.type for joint in self.joints for name in (joint.column, joint.name)}

    def coordinates(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coordinates of the joints that belong to readings, (..., J): the same without a coupling."""
        return q if self.couplings is None else self.couplings.coordinates(q)

    def followed(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return readings, (..., J), with the coordinate instead of each joint that has no reading."""
        if self.couplings is None:
            return q
        return np.where([joint.is_read for joint in self.joints], q, self.couplings.coordinates(q))

    def within_travel(self, q: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which readings, (n, J), leave coupled joints within their own travels, (n,)."""
        inside = np.ones(len(q), bool)
        for joint, values in zip(self.joints, self.coordinates(q).T, strict=True):
            if joint.coordinate is not None and joint.travel is not None:
                inside &= (values >= joint.travel[0]) & (values <= joint.travel[1])
        return inside

    def with_effect(self, effect: Effect) -> Self:
        """Return this machine with one more effect, after those that it has.

        Parameters
        ----------
        effect : Effect
            See :meth:`effect`.

        Raises
        ------
        InputFileError
            When it is there already, cannot stand at its place, changes no reading, or has the freedoms of another.
        """
        try:
            check_effect(self, effect)
        except UnfitEffectError as error:
            raise self._unfit(effect.title, error) from None
        return replace(self, effects=(*self.effects, effect))

    def _unfit(self, title: str, error: UnfitEffectError) -> InputFileError:
        place = f"{title}, {error.key}" if error.key.startswith("hold.") else title
        return InputFileError(self.file or self.name, place, error.found, error.expected)

    def without_effect(self, name: str, place: str | None = None) -> Self:
        """Return this machine without one of its effects, and without that effect's fitted numbers.

        Parameters
        ----------
        name : str
        place : str, optional
            The effect's joint or target; left out for the whole machine.

        Raises
        ------
        InputFileError
            When there is no such effect.
        """
        gone = [e for e in self.effects if e.identity == (name, place)]
        if not gone:
            there = joined(e.title for e in self.effects) or "none: this machine has no effects"
            title = f"{name} at {place}" if place else name
            raise InputFileError(self.file or self.name, "[[effect]]", f"no {shown(title)}", there)
        remaining = {k: v for k, v in self.values.items() if not gone[0].owns(k)}
        ties = {k: tie for k, tie in self.ties.items() if not gone[0].owns(k)}
        return replace(
            self, effects=tuple(e for e in self.effects if e is not gone[0]), values=remaining, ties=ties
        )

    def knowing(
        self, key: str, *, prior: str | None = None, bounds: tuple[float | str, float | str] | None = None
    ) -> Self:
        """Return this machine with a prior or bounds of some of its parameters.

        Parameters
        ----------
        key : str
            Of a parameter, such as ``"C.axis.a"``, or of what several belong to, such as ``"C.axis"``.
        prior : str, optional
            Value and standard deviation, such as ``"0 ± 20 arcsec"``.
        bounds : tuple, optional
            Lowest and highest value: numbers in the units of the machine file, or texts with a unit.

        Raises
        ------
        InputFileError
            When there is no such parameter, or the unit is of something else.
        """
        knowledge = {name: x for name, x in (("prior", prior), ("bounds", bounds)) if x is not None}
        with in_file(self.file or self.name, f"[known], {key}"):
            if tied := next((name for name in self.ties if belongs(name, key)), None):
                raise UnexpectedError(
                    f"{shown(tied)}, which is tied", "a free parameter: take that one out of [ties] first"
                )
            known = read_known(self, key, knowledge)
        return replace(self, known={**self.known, key: known})

    def tying(self, key: str, to: str) -> Self:
        """Return this machine with one more parameter tied to others.

        Parameters
        ----------
        key : str
            Of the parameter, such as ``"J2.gravity_windup.k"``.
        to : str
            A linear combination of others, such as ``"2 * J3.gravity_windup.k"``.

        Raises
        ------
        InputFileError
            When there is no such parameter, or one of the others is tied itself.
        """
        with in_file(self.file or self.name, f"[ties], {key}"):
            tie = read_tie(self, key, to)
        return replace(self, ties={**self.ties, key: tie})

    def freeing(self, key: str) -> Self:
        """Return this machine with nothing known of a parameter, and with it tied to no others.

        Parameters
        ----------
        key : str
            As of :meth:`knowing` and :meth:`tying`.
        """
        known = {k: x for k, x in self.known.items() if k != key}
        return replace(self, known=known, ties={k: x for k, x in self.ties.items() if k != key})

    def without_bounds(self, keys: Collection[str]) -> Self:
        """Return this machine without what it says of the bounds of some parameters.

        Parameters
        ----------
        keys : collection of str
            Of the parameters. Bounds that others have in common with them are left out, too.
        """
        concerned = {name for name in self.known if any(belongs(key, name) for key in keys)}
        known = {
            name: replace(known, bounds=None) if name in concerned else known
            for name, known in self.known.items()
            if name not in concerned or known.prior is not None
        }
        return replace(self, known=known)

    def add(
        self,
        effect: str | Effect | EffectBearer,
        *,
        joint: str | None = None,
        target: str | None = None,
        hold: Mapping[str, float] | None = None,
    ) -> Self:
        """Return this machine with one more effect.

        Parameters
        ----------
        effect : str, Effect or EffectBearer
            A name of the catalogue, as ``rodgen effects`` lists it; an effect in its place; or an object that has one
            as its ``effect``, such as a step of a diagnosis.
        joint, target : str, optional
            Where it is; left out: the whole machine.
        hold : mapping of str to float, optional
            Parameters that are not estimated, in the units of the machine file.

        Raises
        ------
        InputFileError
            When it cannot stand there, or is there already.

        Examples
        --------
        >>> table = Machine(
        ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
        ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"),
        ... )
        >>> [effect.title for effect in table.add("backlash", joint="C").effects]
        ['backlash at C']
        """
        if isinstance(effect, str):
            return self.with_effect(self.effect(effect, self._place(joint, target), hold=hold))
        return self.with_effect(effect if isinstance(effect, Effect) else effect.effect)

    def remove(self, effect: str, *, joint: str | None = None, target: str | None = None) -> Self:
        """Return this machine without one of its effects.

        Parameters
        ----------
        effect : str
            Its name.
        joint, target : str, optional
            Where it is; left out: the whole machine.

        Raises
        ------
        InputFileError
            When there is no such effect.
        """
        return self.without_effect(effect, self._place(joint, target))

    def _place(self, joint: str | None, target: str | None) -> str | None:
        if joint is not None and target is not None:
            found = f"joint {shown(joint)} and target {shown(target)}"
            raise InputFileError(self.file or self.name, "effect", found, "one of the two, or neither")
        return joint if joint is not None else target

    def _repr_html_(self) -> str:
        return html_of_text(self.describe())
