"""What measurements are to settle, and what they are expected to bring."""

from __future__ import annotations

from dataclasses import dataclass

from rodgen.errors import UnexpectedError
from rodgen.views import Result

MOST_READINGS = 500
"""No plan is made of more readings, and none is promised by more."""


class PlanError(UnexpectedError):
    """A plan that cannot be made, in one sentence: what was found, and what was expected."""


@dataclass(frozen=True)
class Gain(Result):
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
        The chi-square at which effects count as distinguished; None for a parameter.
    probability : float or None
        That it is reached, if the fitted sizes are true.
    unit : str
        Of a standard deviation; empty for chi-square.
    determined : bool
        Whether a parameter is determined then; its standard deviation is None even so where the noise is not known.
    """

    what: str
    of: str
    now: float | None
    after: float | None
    needed: float | None = None
    probability: float | None = None
    unit: str = ""
    determined: bool = True


@dataclass(frozen=True)
class Goal(Result):
    """Something that measurements are to settle.

    Attributes
    ----------
    kind : str
        ``"separate"`` (effects that look the same), ``"show"`` (parameters of which the data do not determine some),
        or ``"sharpen"`` (parameters that the data determine).
    effects : tuple of str
        Titles of the effects to distinguish.
    parameters : tuple of str
        Keys of the parameters that are to be determined or sharpened.
    sentences : tuple of str
        What the readings decide, how well, and what they cannot decide.
    resolvable : bool
        Whether any reading within the travel could.
    reached : bool
        Whether the planned ones do, with a probability of 95 %.
    gains : tuple of Gain
    """

    kind: str
    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    sentences: tuple[str, ...]
    resolvable: bool
    reached: bool
    gains: tuple[Gain, ...]

    _keys = "kind effects parameters sentence resolvable reached gain=gains"

    @property
    def sentence(self) -> str:
        """All sentences as one text."""
        return " ".join(self.sentences)
