"""A form of the residuals, in the words of users' formulas, as an effect of a machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rodgen.array_types import Array
from rodgen.machines.effects.catalogue import NAMES
from rodgen.machines.effects.custom import own_effect
from rodgen.machines.effects.definition import EffectDefinition
from rodgen.machines.machine import Effect, Machine
from rodgen.statistics.f_tests import p_of_log10


@dataclass(frozen=True, eq=False)
class Form:
    """A form of what no effect of the catalogue explains."""

    place: str | None
    """The joint; None for the whole machine."""
    component: str
    """``reading``, or one of ``tx ty tz rx ry rz``."""
    driver: str
    """The joint or column that it follows; several with "and" between them."""
    formula: str
    parameters: Mapping[str, tuple[float, str]]
    """Values with units, of what was searched for too."""
    log10_p: float
    """Logarithm of the probability that chance does as much for any of the terms tried."""
    explains: float
    """Part of the whitened sum of squares that it takes away."""
    columns: Array = field(repr=False)
    """Derivatives of the weighted residuals with respect to its coefficients, (n, m, k)."""
    units: Mapping[str, str] = field(repr=False)
    """Of all parameters."""
    hold: Mapping[str, float] = field(repr=False)
    """What was searched for and has a unit, internal units: it is not estimated by a fit."""
    name: str = ""
    """Of the effect."""
    in_catalogue: bool = False
    """Whether an effect of the catalogue has the same form."""
    terms: int = 1
    searched: int = 0
    """Number of its terms, and of the values that were searched for."""

    @property
    def p_value(self) -> float:
        """Probability that chance does as much for any of the terms tried; at least 1e-300."""
        return p_of_log10(self.log10_p)

    @property
    def where(self) -> str:
        """Component and place in a sentence."""
        return f"{self.component} at {self.place}" if self.place else f"{self.component} of the whole machine"

    def effect_definition(self, machine: Machine) -> EffectDefinition:
        """Return it as an effect that a user could have written.

        Parameters
        ----------
        machine : Machine
            Which it is for.
        """
        return own_effect(
            self._free_name(machine),
            self.component,
            self.formula,
            self.units,
            f"Found by a diagnosis: {self.where} follows {self.driver}.",
            at=machine.kind_of(self.place),
            joints=machine.quantities,
            measurand=machine.measurand,
            file=machine.file or machine.name,
            place=f"form at {self.place}",
        )

    def effect(self, machine: Machine) -> Effect:
        """Return it as an effect in its place, for :meth:`Machine.add`."""
        return Effect(self.effect_definition(machine), self.place, dict(self.hold))

    def _free_name(self, machine: Machine) -> str:
        taken = {effect.name for effect in machine.effects}
        taken |= {joint.name for joint in machine.joints} | {target.name for target in machine.targets}
        name, number = self.name, 1
        while name in taken or name in NAMES:
            number += 1
            name = f"{self.name}_{number}"
        return name
