"""What a watch reports: a change or an outlier; as a sentence and as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from rodgen.calibration.fitted import Estimate
from rodgen.calibration.words import percent
from rodgen.document import Document, Documented, Paragraph
from rodgen.errors import joined
from rodgen.views import plain

LARGE = 3.0
"""Factor of the noise beyond which it may as well be that several effects have changed: instruments seldom do that."""
FEW = 4
"""Parameters that are all given; of more, those that are beyond two standard deviations."""
MOST = 8
"""Alternatives that are listed."""
OUTSIDE = (
    "Most of these readings are beyond the coordinates, temperatures or loads of the reference: the model may be "
    "wrong there, and the machine as it was."
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
        return f"{self.title} ({percent(self.probability, 1)})" + (f": {sizes}" if sizes else "")

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        changes = {e.key: plain(e, "value std unit") for e in self.changes}
        return plain(self, "title effect joint=place probability") | {"changes": changes}


class _Event(Documented):
    """What stands on one line, as it comes."""

    @property
    def text(self) -> str:
        """The event as sentences."""
        raise NotImplementedError

    def document(self) -> Document:
        """Return the sentences as a document."""
        return Document([Paragraph(self.text, "line")])


@dataclass(frozen=True)
class Changed(_Event):
    """The machine has changed.

    Attributes
    ----------
    at : int
        Number of the row after which it is reported, as messages count: a line of a CSV file from 1, a row of a table
        in memory from 0.
    counted : str
        ``"line"`` or ``"row"``.
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
    outside : bool
        Whether most readings since are beyond the coordinates, temperatures or loads of the reference.
    """

    at: int
    counted: str
    after: int
    by: int
    likely: tuple[Likely, ...]
    noise: float
    settled: bool
    evidence: float
    outside: bool

    @property
    def is_alarm(self) -> bool:
        """Whether it is reported for the first time."""
        return not self.settled

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
        what = "the change" if self.settled else "alarm: the machine has changed. It"
        how = f" and looks like {first.text}"
        if first.is_noise:
            how = f": readings scatter {self.noise:.2g} times as much"
            if self.noise > LARGE:
                how = f": readings are {self.noise:.2g} times as far off, in no way that one effect explains"
        text = f"{self.counted} {self.at}: {what} began {when} (90 %){how}."
        if others:
            names = joined([f"{one.title} ({percent(one.probability, 1)})" for one in others], most=MOST)
            text += f" The readings do not tell it apart from {names}."
        return f"{text} {OUTSIDE}" if self.outside else text

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        name = "named" if self.settled else "alarm"
        keys = "after by likely noise evidence outside"
        return {"event": name, self.counted: self.at, **plain(self, keys)}


@dataclass(frozen=True)
class OutlierSeen(_Event):
    """A reading that is far from what was expected, while those after it are not.

    Attributes
    ----------
    at, counted : int and str
        Its number, as of `Changed`.
    distance : float
        In standard deviations.
    """

    at: int
    counted: str
    distance: float

    is_alarm: ClassVar[bool] = False

    @property
    def text(self) -> str:
        """The event as a sentence."""
        far = f"{self.distance:.3g} standard deviations from what was expected"
        return f"{self.counted} {self.at}: an outlier, {far}; the readings after it are as before."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"event": "outlier", self.counted: self.at, "distance": self.distance}


Event = Changed | OutlierSeen
"""Something that a watch reports."""
