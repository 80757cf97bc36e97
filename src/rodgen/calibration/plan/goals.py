"""What measurements are planned for, and what they are expected to bring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

__all__ = ["Gain", "Goal"]


@dataclass(frozen=True)
class Gain:
    """What one goal has now, and is expected to have with the planned readings.

    Attributes
    ----------
    what : str
        ``"chi_square"`` (by how much the wrong effect fits worse than the right one) or ``"std"`` of a parameter.
    of : str
        If which effect is the right one, and which the wrong; or the parameter's key.
    now, after : float or None
        None where it cannot be said: the standard deviation of what is not determined.
    needed : float or None
        The chi-square at which effects count as told apart; None for a parameter.
    probability : float or None
        That it is reached, if the fitted sizes are true.
    unit : str
        Of a standard deviation; empty for chi-square.
    """

    what: str
    of: str
    now: float | None
    after: float | None
    needed: float | None = None
    probability: float | None = None
    unit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "what": self.what,
            "of": self.of,
            "now": self.now,
            "after": self.after,
            "needed": self.needed,
            "probability": self.probability,
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Goal:
    """Something that measurements are to settle.

    Attributes
    ----------
    kind : str
        ``"separate"`` (effects that look the same), ``"show"`` (parameters that the data do not determine), or
        ``"sharpen"`` (parameters that were asked for).
    effects : tuple of str
        Titles of the effects that are to be told apart.
    parameters : tuple of str
        Keys of the parameters that are to be determined or sharpened.
    sentence : str
    resolvable : bool
        Whether any reading within the travel could.
    reached : bool
        Whether the planned ones do, with a probability of 95 %.
    gains : tuple of Gain
    """

    kind: str
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    sentence: str
    resolvable: bool
    reached: bool
    gains: tuple[Gain, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "kind": self.kind,
            "effects": list(self.effects),
            "parameters": list(self.parameters),
            "sentence": self.sentence,
            "resolvable": self.resolvable,
            "reached": self.reached,
            "gain": [gain.to_dict() for gain in self.gains],
        }
