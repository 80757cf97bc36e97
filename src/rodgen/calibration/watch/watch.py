"""Watch a fitted machine: readings as they arrive, against the model, until something is no longer as it was.

The statistics are in :mod:`rodgen.statistics.change_detector`. What is added here: the columns of the readings, rates
and times, what an alarm means in words and units, outliers, and a state that survives restarts.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.watch.changes import Change, what_changed
from rodgen.calibration.watch.columns import WatchedColumns
from rodgen.calibration.watch.events import Changed, Event, OutlierSeen
from rodgen.data.measurements import Measurements
from rodgen.data.units import TIME, UnitError, parse_unit
from rodgen.errors import InputFileError, UnexpectedError, UnfitArgumentError, counted, joined, shown
from rodgen.files import read_input
from rodgen.statistics.change_detector import ChangeDetector
from rodgen.statistics.thresholds import WATCH

if TYPE_CHECKING:
    from rodgen.machines.observations import Observations

SETTLED = 32
"""Blocks after an alarm until a change is named for good, and things are taken for what they are since."""
WAITED = 10
"""Blocks after which a reading that was far off is an outlier: a change as large would have raised an alarm."""
__all__ = ["Watch", "frequency"]

BLOCK_SECONDS = 10.0
"""Readings that come within so many seconds are looked at together, so that the time a year takes does not grow."""
MOST_ROWS = 1000
"""The same, at most."""
FORMAT = 4
"""Of a state."""
KEPT = ("rows", "alarms", "_last_t", "_settling", "_outliers")
"""What a state keeps of a watch besides arrays."""
LARGEST_STATE = 500_000_000
"""Bytes of a state that is read: that of a robot has 10 MB."""


def frequency(text: str) -> float:
    """Return how often something happens, per second, as ``"100/h"`` or ``"1/year"`` says it.

    Raises
    ------
    UnexpectedError

    Examples
    --------
    >>> round(frequency("100/h") * 3600, 9), round(1 / frequency("1/year"))
    (100.0, 31557600)
    """
    number, _, unit = text.partition("/")
    try:
        of = parse_unit(unit.strip())
        rate = float(number) / of.factor()
        if of.dimension == TIME and 0 < rate < math.inf:
            return rate
    except (UnitError, ValueError):
        pass
    raise UnexpectedError(shown(text), "a number above 0 per time, such as 100/h or 1/year")


def per_second(argument: str, value: str | float) -> float:
    """Return how often something happens, per second, as an argument says it.

    Raises
    ------
    UnfitArgumentError
    """
    with contextlib.suppress(TypeError, ValueError):
        rate = frequency(value) if isinstance(value, str) else float(value)
        if 0 < rate < math.inf:
            return rate
    expected = "a number above 0, per second, or with a time, such as '100/h' or '1/year'"
    raise UnfitArgumentError(argument, repr(value), expected)


class Watch:
    """New readings of a machine, compared with a fit as they arrive.

    Parameters
    ----------
    fit : Fit
        The reference: a model fitted to readings of the machine as it should stay.
    rate : str or float, optional
        How often readings come, such as ``"100/h"``, or per second. Left out: by the column ``t``, or 100 an hour.
    false_alarms : str or float
        How often an alarm may come while nothing changes.

    Attributes
    ----------
    rows : int
        That were taken in.
    alarms : int
        That were raised.

    Examples
    --------
    >>> import numpy as np
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     "Table", "mm", "deg", (0.0, 0.0, -1.0), 20.0, (Joint("C", "revolute", (0.0, 0.0, 1.0)),),
    ...     (Target("ball", (100.0, 0.0, 0.0)),), Measured("point", "machine"), estimate=("target",),
    ... )
    >>> random = np.random.default_rng(1)
    >>> def measured(n, ball=100.0):
    ...     C = random.uniform(0, 360, n)
    ...     place = ball * np.cos(np.radians(C)), ball * np.sin(np.radians(C)), np.zeros(n)
    ...     read = (x + random.normal(0, 0.002, n) for x in place)
    ...     return {"C [deg]": C} | dict(zip(("x [mm]", "y [mm]", "z [mm]"), read))
    >>> watch = Watch(table.fit(Measurements.from_frame(measured(60))), rate="100/h")
    >>> watch.update(measured(100))
    []
    >>> alarm, named = watch.update(measured(50, ball=100.01))
    >>> alarm.after, named.settled
    (99, True)
    """

    def __init__(
        self, fit: Fit, *, rate: str | float | None = None, false_alarms: str | float = "1/year"
    ) -> None:
        self._rate = None if rate is None else per_second("rate", rate)
        self._limit = 1 / per_second("false_alarms", false_alarms)
        self.fit = fit
        self._demand(fit.degrees_of_freedom)
        self._watched = WatchedColumns(fit)
        self.alternatives = self._watched.alternatives
        self.detector = ChangeDetector(
            self._watched.rows[..., :-1],
            self._watched.rows[..., -1],
            self._watched.free,
            [alternative.columns for alternative in self.alternatives],
            self._limit,
            np.array([-1.0, np.nan, -1.0, -1.0]),
        )
        self._demand(self.detector.dof_of(self.detector.sums))
        self._whitener = self._watched.whitener()
        self.rows = self.alarms = 0
        self._counted = "line"
        self._row_time = self._time_of_a_row()
        self._per_block = int(min(max(1.0, BLOCK_SECONDS / self._row_time), MOST_ROWS))
        self._pending = [self._watched.rows[:0], np.empty((0, 4))]
        self._context: Measurements | None = None
        self._last_t = math.nan
        self._settling = 0
        self._outliers: list[Sequence[Any]] = []  # number, distance, block, count

    def _demand(self, degrees: float) -> None:
        """Refuse a reference that leaves too few degrees of freedom."""
        if degrees < WATCH.fewest:
            rows, file = self.fit.observations.n, self.fit.observations.data.file
            left = math.floor(max(degrees, 0))
            expected = f"a reference that leaves {WATCH.fewest:.0f}: more rows"
            found = f"{counted(rows, 'row')}, which leave {left} degrees of freedom"
            raise InputFileError(file, "file", found, expected)

    def _time_of_a_row(self) -> float:
        """Return the time from one reading to the next, seconds; the usual one of the reference."""
        t = self.fit.observations.t
        if self._rate is None and t is not None and (gaps := np.abs(np.diff(t))).any():
            return float(np.median(gaps[gaps > 0]))
        return 1 / (self._rate or frequency("100/h"))

    @property
    def evidence(self) -> float:
        """Logarithm of the sum that raises an alarm, less that of its limit: an alarm is raised above 0."""
        return self.detector.log_sum - math.log(self._limit)

    @property
    def text(self) -> str:
        """A sentence on what is watched, and how."""
        every = "each row" if self._per_block == 1 else f"every {self._per_block} rows"
        timed = self._rate is not None or self.fit.observations.t is not None
        assumed = "" if timed else ", 100 rows an hour assumed (--rate)"
        o = self.fit.observations
        return (
            f"Reference: {o.n} rows of {o.data.file}. Watched: {len(self.alternatives)} parameters and effects, "
            f"and the noise, after {every}; an alarm by chance once in {_duration(self._limit)} at most{assumed}."
            f"{self._shared}{self._left_out}"
        )

    @property
    def _left_out(self) -> str:
        """What is said of rows that the machine file sets aside."""
        rules = joined(entry.named() for entry in self._watched.rules if not entry.back)
        return f" Readings that the machine file sets aside are left out: {rules}." if rules else ""

    @property
    def _shared(self) -> str:
        """What is said of errors that readings share."""
        correlation = self._watched.correlation
        if correlation.independent:
            return ""
        text = f" {correlation.text}" if correlation.text else " Readings may share errors."
        text += " That is allowed for."
        if correlation.wanders and correlation.time > self._watched.duration / 2:
            text += " How it wanders in a longer time than the reference took is unknown, and may look like a change."
        return text

    def update(self, data: Any) -> list[Event]:
        """Take new readings in, and return what they show.

        Parameters
        ----------
        data : Measurements, or a table in memory
            With the columns of a measurement file; the rows that came since the last update.

        Returns
        -------
        list of Event
            Alarms and what they are named, and outliers; in order, mostly none.

        Raises
        ------
        InputFileError
            When a row does not fit the machine; then no row was taken in.
        """
        frame = not isinstance(data, Measurements)
        data = Measurements.of(data)
        if not data.rows:
            return []
        numbers = data.numbers(np.arange(data.rows)).astype(float) + (self.rows if frame else 0)
        self._counted = data.counted
        before = self._context
        follows = before is not None and _texts(before) == _texts(data)
        whole = data.after(before) if before is not None and follows else data
        bound, old = self._watched.bound(whole), whole.rows - data.rows
        new = np.flatnonzero(self._watched.counts(data))
        if not len(new):
            self._count(whole, bound, data.rows)
            return []
        o = bound.take(old + new)
        rows = self._watched.at(o)
        if self._whitener is not None:
            gap = self._watched.gaps(bound.take(np.append(np.arange(old), old + new)))[old:]
            rows = self._whitener(rows, self._watched.motion(o), gap, self.detector.mean * self.detector.unit)
        time = np.full(o.n, np.nan) if o.t is None else o.t
        # numbers of another file begin anew, counts do not
        marks = np.column_stack([numbers[new], time, self.rows + new, self._watched.outside(o)])
        self._count(whole, bound, data.rows)
        events = list[Event]()
        self._pending = [np.concatenate(parts) for parts in zip(self._pending, (rows, marks), strict=True)]
        while len(self._pending[0]) >= self._per_block:
            rows, marks = (part[: self._per_block] for part in self._pending)
            self._pending = [part[self._per_block :] for part in self._pending]
            with one_thread_in_blas():
                events += self._block(rows[..., :-1], rows[..., -1], marks)
        return sorted(events, key=lambda event: event.at)

    def finish(self) -> list[Event]:
        """Return what the readings since an alarm say of it, where these are all that come."""
        if not self._settling:
            return []
        self._settling = 0
        with one_thread_in_blas():
            return [self._settled(int(self.detector.recent[2][-1, 0]))]

    def _settled(self, at: int) -> Changed:
        """Name a change for good; how things are since is how they should be."""
        change = what_changed(self.detector, self._watched)
        event = self._changed(change, at, settled=True)
        self.detector.go_on(change.before, change.since, change.moved, change.noise)
        return event

    def _count(self, whole: Measurements, o: Observations, new: int) -> None:
        """Count new rows; keep those that tell directions: between which each joint moved last, and the last."""
        self.rows += new
        moves = [np.flatnonzero(moved) for moved in (np.diff(o.q, axis=0) != 0).T]
        rows = {o.n - 1, *(int(each[-1]) + k for each in moves if len(each) for k in (0, 1))}
        self._context = whole.take(np.array(sorted(rows)))

    # blocks ------------------------------------------------------------------------------------------------------

    def _block(self, columns: Array, readings: Array, marks: Array) -> Iterator[Event]:
        far = self.detector.update(columns, readings, self._passed(marks), marks)
        at, blocks = int(marks[-1, 0]), self.detector.blocks
        if self._settling:
            self._settling -= 1
            if not self._settling:
                yield self._settled(at)
            return
        bound = self.detector.distance_of(max(self._row_time / self._limit, 1e-12))
        self._outliers += [
            (int(mark[0]), float(x), blocks, int(mark[2]))
            for mark, x in zip(marks, far, strict=True)
            if x > bound
        ]
        if self.detector.alarm:
            self.alarms += 1
            self._settling = max(SETTLED // self._per_block, 1)
            change = what_changed(self.detector, self._watched)
            yield from self._released(lambda block, row: row <= change.first[2])
            self._outliers = []
            yield self._changed(change, at, settled=False)
        elif self.detector.suspected < 0:
            yield from self._released(lambda block, row: block <= blocks - WAITED)
            self._outliers = [one for one in self._outliers if one[2] > blocks - WAITED]

    def _released(self, when: Callable[[int, int], bool]) -> list[Event]:
        """Return outliers that no change explains."""
        return [OutlierSeen(n, self._counted, far) for n, far, *place in self._outliers if when(*place)]

    def _passed(self, marks: Array) -> float:
        """Return the time that passed since the block before, seconds.

        A clock that stands still, or is set back, does not stop the watch; a pause, or a clock that is set forward, is
        no more time than such readings usually take: else it alone would be as much as a false alarm takes.
        """
        t, usual = float(marks[-1, 1]), len(marks) * self._row_time
        if self._rate is not None or math.isnan(t):
            return usual
        gap = t - (float(marks[0, 1]) if math.isnan(self._last_t) else self._last_t)
        self._last_t = t
        return min(gap, usual) if gap > 0 else usual

    # what it means -----------------------------------------------------------------------------------------------

    def _changed(self, change: Change, at: int, *, settled: bool) -> Changed:
        marks = self.detector.recent[2]
        return Changed(
            at,
            self._counted,
            int(change.first[0]),
            int(change.last[0]),
            tuple(change.likely),
            change.noise if change.likely[0].is_noise else 1.0,
            settled,
            self.evidence,
            bool(np.mean(marks[marks[:, 2] > change.first[2], 3]) > 0.5),
        )

    # kept in a file ----------------------------------------------------------------------------------------------

    def state(self, place: Mapping[str, Any] | None = None) -> bytes:
        """Return everything that a later watch of the same fit needs to go on, for a file.

        Parameters
        ----------
        place : mapping, optional
            How far the file of the readings was read; kept with it.
        """
        about = {
            "format": FORMAT,
            "fit": self._fingerprint,
            "place": place,
            "context": _as_dict(self._context),
            "kept": {name: getattr(self, name) for name in KEPT},
        }
        arrays = self.detector.state() | dict(zip(("rows", "marks"), self._pending, strict=True))
        if self._whitener is not None:
            arrays |= self._whitener.state()
        arrays["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
        stream = io.BytesIO()
        np.savez(stream, **arrays)  # type: ignore[arg-type]
        return stream.getvalue()

    def restore(self, file: str) -> dict[str, Any] | None:
        """Go on from what :meth:`state` returned; return how far the file of the readings was read.

        Raises
        ------
        InputFileError
            When the file has no state, or that of another fit.
        """
        content = read_input(file, "a state as --state writes it", largest=LARGEST_STATE)
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
                about = json.loads(arrays["about"].tobytes())
                if about["format"] != FORMAT:
                    expected = f"{FORMAT}: a new file, as this one is of another version of rodgen"
                    raise InputFileError(file, "format", str(about["format"]), expected)
                if about["fit"] != self._fingerprint:
                    found = "the state of a watch with another machine, reference or rate"
                    raise InputFileError(file, "file", found, "the same as before, or another name")
                self._pending = [arrays["rows"], arrays["marks"]]
                self.detector.restore(arrays)
                if self._whitener is not None:
                    self._whitener.restore(arrays)
                for name in KEPT:
                    setattr(self, name, about["kept"][name])
                self._context = _from_dict(about["context"])
                place: dict[str, Any] | None = about["place"]
                return place
        except InputFileError:
            raise
        except (ValueError, LookupError, TypeError, AttributeError, OSError, EOFError, zipfile.BadZipFile):
            expected = "one that --state wrote, or another name"
            raise InputFileError(file, "file", "no state of a watch", expected) from None

    @property
    def _fingerprint(self) -> str:
        digest = hashlib.sha256(json.dumps([self._per_block, self._rate, self._limit]).encode())
        digest.update(np.ascontiguousarray(self._watched.rows.astype(np.float32)).tobytes())
        return digest.hexdigest()


def _duration(seconds: float) -> str:
    """Return a time in words."""
    for size, name in ((31557600.0, "year"), (86400.0, "day"), (3600.0, "hour")):
        if seconds > 0.99 * size:
            count = seconds / size
            return f"a {name}" if abs(count - 1) < 0.01 else f"{count:.3g} {name}s"
    return f"{seconds:.3g} seconds"


def _as_dict(data: Measurements | None) -> dict[str, Any] | None:
    if data is None:
        return None
    columns = {column.text: column.values.tolist() for column in data.columns.values()}
    numbers = data.numbers(np.arange(data.rows)).tolist()
    return {"file": data.file, "columns": columns, "numbers": numbers}


def _from_dict(content: Mapping[str, Any] | None) -> Measurements | None:
    if content is None:
        return None
    return Measurements.from_frame(content["columns"], name=content["file"]).placed(content["numbers"])


def _texts(data: Measurements) -> list[str]:
    return [column.text for column in data.columns.values()]
