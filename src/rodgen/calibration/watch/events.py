"""What a watch reports: a change, an outlier, or a reading that is stuck; as a sentence and as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rodgen.calibration.fitted import Estimate
from rodgen.errors import joined
from rodgen.views import with_html

LARGE = 3.0
"""Factor of the noise beyond which it may as well be that several effects have changed: instruments seldom do that."""
FEW = 4
"""Parameters that are all given; of more, those that are beyond two standard deviations."""
MOST = 8
"""Alternatives that are listed."""


@with_html
@dataclass(frozen=True)
class Event:
    """Something that a watch reports.

    Attributes
    ----------
    at : int
        Number of the row after which it is reported, as messages count: a line of a CSV file from 1, a row of a table
        in memory from 0.
    counted : str
        ``"line"`` or ``"row"``.
    """

    at: int
    counted: str

    @property
    def is_alarm(self) -> bool:
        """Whether the machine, or its instrument, is no longer as it was."""
        return False

    @property
    def since(self) -> int:
        """Number of the last row before it."""
        return self.at

    @property
    def settles(self) -> bool:
        """Whether it says for good what changed."""
        return False

    @property
    def text(self) -> str:
        """The event as sentences."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        raise NotImplementedError


@dataclass(frozen=True)
class Range:
    """What the reference covers of a coordinate, a temperature or a load.

    Attributes
    ----------
    column : str
    low, high : float
    unit : str
    """

    column: str
    low: float
    high: float
    unit: str

    @property
    def text(self) -> str:
        """A sentence on readings beyond it."""
        span = f"{self.low:.4g}" if self.low == self.high else f"{self.low:.4g} to {self.high:.4g}"
        return (
            f"Most of these readings have {self.column} outside of {span} {self.unit}, where the reference is: "
            "the model may be wrong there, and the machine as it was."
        )


@dataclass(frozen=True)
class Likely:
    """One alternative.

    Attributes
    ----------
    title : str
        An effect and its place, the parameters of the model that changed, or ``"noise"``.
    effect, place : str or None
        Of an effect of the catalogue.
    probability : float
        If one of the alternatives is true, and all were equally likely before.
    changes : tuple of Estimate
        By how much its parameters changed.
    """

    title: str
    effect: str | None
    place: str | None
    probability: float
    changes: tuple[Estimate, ...]

    @property
    def is_noise(self) -> bool:
        """Whether readings scatter more, and no effect is named."""
        return not self.changes

    @property
    def text(self) -> str:
        """It with the size, such as ``"scale at EL (97 %): k = 12.1 ± 0.8 arcsec/rad"``."""
        seen = [e for e in self.changes if len(self.changes) <= FEW or abs(e.value) > 2 * (e.std or 0.0)]
        sizes = joined(f"{e.key} = {e.text}" for e in seen)
        return f"{self.title} ({100 * self.probability:.0f} %)" + (f": {sizes}" if sizes else "")

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "title": self.title,
            "effect": self.effect,
            "joint": self.place,
            "probability": self.probability,
            "changes": {e.key: {"value": e.value, "std": e.std, "unit": e.unit} for e in self.changes},
        }


@dataclass(frozen=True)
class Changed(Event):
    """The machine is no longer what it was.

    Attributes
    ----------
    after, by : int
        It began, with a probability of 90 %, after the row `after` and no later than after the row `by`.
    likely : tuple of Likely
        What changed, the likeliest first, down to a probability of 5 %.
    noise : float
        Factor by which readings scatter more, where that is what changed; else 1.
    settled : bool
        Whether enough readings have come since to name it for good; from there on, further changes are looked for.
    evidence : float
        Logarithm of the sum that exceeded its limit, less that of the limit.
    t_after, t_by : float or None
        Times of `after` and `by`, seconds.
    outside : Range or None
        What the reference covers, where most readings since are beyond it.
    """

    after: int = 0
    by: int = 0
    likely: tuple[Likely, ...] = ()
    noise: float = 1.0
    settled: bool = False
    evidence: float = 0.0
    t_after: float | None = None
    t_by: float | None = None
    outside: Range | None = None

    @property
    def is_alarm(self) -> bool:
        """Whether it is reported for the first time."""
        return not self.settled

    @property
    def since(self) -> int:
        """Number of the last row by which it began."""
        return self.by

    @property
    def settles(self) -> bool:
        """Whether it says for good what changed."""
        return self.settled

    @property
    def text(self) -> str:
        """The event as sentences."""
        first, *others = self.likely
        when = f"after {self.counted} {self.after}"
        if self.by < 0:
            when = "before the first row"
        elif self.after < 0:
            when = f"before {self.counted} {self.by + 1}"
        elif self.by > self.after:
            when = f"between {self.counted}s {self.after} and {self.by + 1}"
        said = "the change" if self.settled else "alarm: the machine has changed. It"
        found = f"{self.counted} {self.at}: {said} began {when} (90 %) and looks like {first.text}"
        if first.is_noise:
            how = f"readings scatter {self.noise:.2g} times as much"
            if self.noise > LARGE:
                how = f"readings are {self.noise:.2g} times as far off, in no way that one effect explains"
            found = f"{self.counted} {self.at}: {said} began {when} (90 %): {how}"
        found += "."
        if others:
            names = joined([f"{one.title} ({100 * one.probability:.0f} %)" for one in others], most=MOST)
            found += f" The readings do not tell it apart from {names}."
        return f"{found} {self.outside.text}" if self.outside else found

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "event": "named" if self.settled else "alarm",
            self.counted: self.at,
            "after": self.after,
            "by": self.by,
            "t_after": self.t_after,
            "t_by": self.t_by,
            "likely": [one.to_dict() for one in self.likely],
            "noise": self.noise,
            "evidence": self.evidence,
            "outside": None if self.outside is None else dict(self.outside.__dict__),
        }


@dataclass(frozen=True)
class OutlierSeen(Event):
    """A reading that is far from what was expected, while those after it are not.

    Attributes
    ----------
    row : int
        Its number.
    distance : float
        In standard deviations.
    """

    row: int = 0
    distance: float = 0.0

    @property
    def text(self) -> str:
        """The event as a sentence."""
        far = f"{self.distance:.3g} standard deviations from what was expected"
        return f"{self.counted} {self.row}: an outlier, {far}; the readings after it are as before."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"event": "outlier", self.counted: self.row, "distance": self.distance}


@dataclass(frozen=True)
class Stuck(Event):
    """A column of readings that repeats its last value while the machine moves.

    Attributes
    ----------
    column : str
    from_row : int
        Number of the row with that value.
    """

    column: str = ""
    from_row: int = 0

    @property
    def is_alarm(self) -> bool:
        """An instrument that is stuck measures nothing."""
        return True

    @property
    def text(self) -> str:
        """The event as a sentence."""
        return (
            f"{self.counted} {self.at}: alarm: the reading {self.column!r} is stuck since {self.counted} "
            f"{self.from_row}, while the machine moves."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"event": "stuck", self.counted: self.at, "column": self.column, "since": self.from_row}
