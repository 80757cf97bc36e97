"""A model and measurements that are read part by part: what a fit sums over rows is summed where the parts are.

Each part of a scan is read once by the worker that keeps it, checked as any measurements, and laid down as the numbers
that kernels take, in the order of targets and set-ups; large ones in a temporary file. What leaves a worker are sums,
and a sample: stretches of rows, spread evenly over all, on which is decided what is decided on a sample of
many rows in memory, too. A part whose worker was killed is read again by another.

What depends on rows before a part, the direction from which a joint came to its first rows, is known when all parts
have been read, and is sent with each question.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.problem.binding import bind, bind_once, names_of
from rodgen.calibration.problem.problem import BLOCK, Group, Problem, one_thread_in_blas, reduced
from rodgen.data.measurements import Measurements, Scan
from rodgen.data.tables.parts import Part
from rodgen.errors import InputFileError
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model, model_of
from rodgen.machines.observations import Observations
from rodgen.schedulers import Workers, workers

__all__ = ["BlockProblem", "Blocks", "observed", "problem_of"]

Place: TypeAlias = tuple[Array, Frame]
Rows: TypeAlias = tuple[Measurements, NDArray[np.int8], NDArray[np.intp]]
"""Some rows of a part or a scan, all columns of them; their directions of approach, (n, J), and their numbers, (n,)."""

STRETCHES, STRETCH = 20, 2_500
"""The sample: so many stretches of so many rows, which begin where those of `sample_of` do."""
KEPT_BYTES = 256 << 20
"""What a process keeps of parts in memory; beyond, parts are in files, which leave memory after each question."""
MOST_FILES = 400
"""Parts in files of a process at most; further ones are read anew for each question."""
MOST_FAR = 20_000
"""Rows of a part that are looked at one by one at most."""


# the parts, on their workers ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """How the joints move in a part, for directions of approach in the next.

    Attributes
    ----------
    rows : int
    first, last : ndarray, shape (J,)
        Commanded coordinates of the first and the last row, as they are in the file.
    began, ended : ndarray of int8, shape (J,)
        Directions of the first and the last motion of each joint; 0 of one that does not move.
    before : list of int
        How many rows of each joint are before its first motion; none where a column says the directions.
    """

    rows: int
    first: Array
    last: Array
    began: NDArray[np.int8]
    ended: NDArray[np.int8]
    before: list[int]

    @classmethod
    def of(cls, o: Observations) -> Motion:
        """Return it of the rows of a part."""
        joints = o.machine.joints
        began, ended = (np.zeros(len(joints), np.int8) for _ in range(2))
        first, last = np.zeros(len(joints)), np.zeros(len(joints))
        before = [0] * len(joints)
        for j, joint in enumerate(joints):
            column = o.data.columns[joint.column].values
            moves = column[1:] != column[:-1]
            if o.n:
                first[j], last[j] = column[[0, -1]]
            if f"dir_{joint.column}" not in o.columns_given:
                before[j] = int(np.argmax(moves)) + 1 if moves.any() else o.n
                if moves.any():
                    began[j], ended[j] = o.s[before[j], j], o.s[-1, j]
        return cls(o.n, first, last, began, ended, before)

    def enter(self, s: NDArray[np.int8], entry: NDArray[np.int8], start: int = 0) -> None:
        """Set the directions of rows before the first motion, those from `start`, (n, J), to those of entry, (J,)."""
        for column, direction, before in zip(s.T, entry, self.before, strict=True):
            column[: max(before - start, 0)] = direction


def entries(motions: Sequence[Motion]) -> list[NDArray[np.int8]]:
    """Return the directions from which the joints came to the first row of each part, (J,); see `approach`."""
    now, last = np.zeros_like(motions[0].began), None
    entries_of = []
    for motion in motions:
        if motion.rows:
            step = np.sign(motion.first - (motion.first if last is None else last)).astype(np.int8)
            now = np.where(step, step, now)
        entries_of.append(now)
        if motion.rows:
            now, last = np.where(motion.ended, motion.ended, now), motion.last
    first = np.zeros_like(now)  # of the first motion of each joint at all: rows before it take it
    for entry, motion in zip(entries_of, motions, strict=True):
        for known in (entry, motion.began):
            first = np.where(first, first, known)
    return [np.where(entry, entry, first).astype(np.int8) for entry in entries_of]


@dataclass(frozen=True)
class Survey:
    """What has to be known of a part before anything is fitted.

    Attributes
    ----------
    motion : Motion
    low, high : ndarray, shape (J,)
        Range of the coordinates, internal units.
    runs : tuple of str
        Names of the set-ups.
    sums, squares : ndarray, shape (k,)
        Of the readings, and of their squares.
    largest : float
        Largest number among the readings.
    weights : float
        Sum of the squared weights.
    stretches : list of Rows
        Those of the sample.
    """

    motion: Motion
    low: Array
    high: Array
    runs: tuple[str, ...]
    sums: Array
    squares: Array
    largest: float
    weights: float
    stretches: list[Rows]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.motion.rows


@dataclass(eq=False)
class _Store:
    """The rows of a part as kernels take them, sorted by target and set-up.

    Attributes
    ----------
    survey : Survey
    numbers : ndarray, shape (k, rows)
    at : dict of (kind, of) to int or float
        Where in `numbers` each column of the kernels is, or its only value.
    directions : ndarray of int8, shape (J, rows)
    early : list of ndarray of int
        Of each joint the rows before its first motion; none where a column says the directions.
    groups : list of (target, name of the set-up, first row, last row + 1)
    in_file : bool
        Whether `numbers` and `directions` are in a temporary file.
    """

    survey: Survey
    numbers: Array
    at: dict[tuple[str, Any], int | float]
    directions: NDArray[np.int8]
    early: list[NDArray[np.intp]]
    groups: list[tuple[int, str, int, int]]
    in_file: bool


_kept: weakref.WeakSet[_Store] = weakref.WeakSet()
"""What this process keeps of parts."""
_counting = threading.Lock()
"""Held while `_kept` is read or added to: threads read parts."""


class PartRows:
    """The rows of a part; read when they are asked for, and kept by the process that was asked.

    Parameters
    ----------
    part : Part
    machine : Machine
        By which they are checked.
    stretches : sequence of slice
        Rows that belong to the sample.
    """

    def __init__(self, part: Part, machine: Machine, stretches: Sequence[slice]) -> None:
        self.part, self.machine, self.stretches = part, machine, stretches
        self._store: _Store | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_store": None}  # rows stay where they are

    def store(self, model: Model | None = None) -> _Store:
        """Return the rows, with all columns that a model needs."""
        needed = {of for kind, of in model.structure.columns if kind == "x"} if model else set[Any]()
        store_of_part = self._store
        if store_of_part is None or not all(("x", name) in store_of_part.at for name in needed):
            store_of_part = self._read(frozenset(needed) | names_of(self.machine))
            with _counting:
                if not store_of_part.in_file or sum(store.in_file for store in _kept) < MOST_FILES:
                    self._store = store_of_part
                    _kept.add(store_of_part)
        return store_of_part

    def _read(self, names: frozenset[str]) -> _Store:
        o = bind(self.machine, Scan.load(self.part, None if self.stretches else names))
        with _counting:
            in_memory = sum(store.numbers.nbytes for store in _kept if not store.in_file)
        return _laid_down(o, self.stretches, in_memory < KEPT_BYTES)


def _laid_down(o: Observations, stretches: Sequence[slice], in_memory: bool) -> _Store:
    """Return observations as kernels take them."""
    model = model_of(o.machine, o.travel, o.run_names, compiled=False)
    problem = Problem(model, o)
    order = _order(o)
    code = np.stack([o.target[order], o.run[order]])
    starts = np.flatnonzero(np.any(np.diff(code, axis=1, prepend=-1), axis=0))
    groups = [(int(code[0, a]), o.run_names[code[1, a]], int(a), int(b)) for a, b in pairwise([*starts, o.n])]
    at: dict[tuple[str, Any], int | float] = {}
    columns: list[Array] = []
    for kind, of in _columns_of(problem):
        column = problem._column(kind, of, slice(None))
        if o.n and column[0] == column[-1] and (column == column[0]).all():
            at[kind, of] = float(column[0])
        else:
            at[kind, of] = len(columns)
            columns.append(column)
    size = 8 * len(columns) * o.n
    in_file = not in_memory and size > 0
    room = _in_file(size + o.s.size) if in_file else np.empty(size + o.s.size, np.int8)
    numbers = room[:size].view(float).reshape(len(columns), o.n)
    for row, column in zip(numbers, columns, strict=True):
        np.take(column, order, out=row)
    directions = room[size:].reshape(-1, o.n) if o.n else o.s.T.copy()
    directions[:] = o.s.T[:, order]
    place = np.empty(o.n, np.intp)
    place[order] = np.arange(o.n)
    survey = _survey(o, problem, stretches)
    early = [place[:rows].copy() for rows in survey.motion.before]  # a view would hold all of it
    return _Store(survey, numbers, at, directions, early, groups, in_file)


def _in_file(size: int) -> NDArray[np.int8]:
    """Return so many bytes in a temporary file without a name, which goes with them, even if the process is killed."""
    try:
        with tempfile.TemporaryFile() as file:
            # Writing to a mapped file with holes kills the process when the disk is full: reserve the room first.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            return np.memmap(file, np.int8, "w+", shape=(size,)).view(np.ndarray)
    except OSError as error:
        found = f"cannot be written ({error.strerror or error})"
        expected = "room for the columns of a large table (TMPDIR names another folder)"
        raise InputFileError(tempfile.gettempdir(), "file", found, expected) from None


def _release(array: Any) -> None:
    """Let the pages of an array in a file leave memory: the file keeps them."""
    while isinstance(array, np.ndarray):
        array = array.base
    if isinstance(array, mmap.mmap) and hasattr(array, "madvise"):
        array.madvise(mmap.MADV_DONTNEED)


def _order(o: Observations) -> NDArray[np.intp]:
    """Return the rows, (n,), in the order in which they are laid down."""
    return np.lexsort((o.run, o.target))


def _columns_of(problem: Problem) -> Iterator[tuple[str, Any]]:
    """Yield all columns that a model of these observations may need, but for directions of approach."""
    o = problem.observations
    for j, joint in enumerate(o.machine.joints):
        yield from (("q", j), ("v", j))
        if joint.name in o.temperature:
            yield "T", j
    yield from (("t", 0) for _ in [o.t] if o.t is not None)
    yield from (("F", 0) for _ in [o.load] if o.load is not None)
    yield from (("x", name) for name in o.covariates)
    yield from (column for column in problem.model.structure.columns if column[0] in {"reading", "whitening"})
    yield from (("weight", c) for c in range(problem.components))


def _survey(o: Observations, problem: Problem, stretches: Sequence[slice]) -> Survey:
    """Return what has to be known of a part."""
    return Survey(
        motion=Motion.of(o),
        low=o.q.min(axis=0, initial=np.inf),
        high=o.q.max(axis=0, initial=-np.inf),
        runs=o.run_names,
        sums=o.reading.sum(axis=0),
        squares=np.einsum("ij,ij->j", o.reading, o.reading),
        largest=problem.model.structure.measurand.size(o.reading),
        weights=float(np.einsum("ij,ij->", problem.weight, problem.weight)),
        stretches=[
            (_apart(o.data.take(rows)), o.s[rows].copy(), np.arange(rows.start, rows.stop))
            for rows in stretches
        ],
    )


@dataclass(frozen=True)
class _Shared:
    """What all parts have to know.

    Attributes
    ----------
    runs : dict of str to int
    entries : tuple of ndarray, each of shape (J,)
        Directions from which the joints came to the first row of each part.
    """

    runs: dict[str, int]
    entries: tuple[NDArray[np.int8], ...]


class PartProblem(Problem):
    """The residuals of a model on the rows of a part, for sums only."""

    def __init__(self, model: Model, rows: PartRows, shared: _Shared) -> None:
        self.model, self.components = model, model.structure.components
        self.store = store = rows.store(model)
        self.rows = store.survey.rows
        by_run = model.structure.by_run
        self.groups = [
            Group(target, shared.runs[run] if by_run else 0, slice(a, b), b - a)
            for target, run, a, b in store.groups
        ]
        self._pairs = tuple((group.target, group.run) for group in self.groups)
        self._equations, self._constant_slots = {}, None
        for j, entry in enumerate(shared.entries[rows.part.number]):
            store.directions[j, store.early[j]] = entry

    def _column(self, kind: str, of: Any, rows: Any) -> Any:
        if kind == "s":
            return self.store.directions[of, rows]
        at = self.store.at[kind, of]
        return at if isinstance(at, float) else self.store.numbers[at, rows]

    def _each(self, function: Any, step: int = 0) -> Iterator[Any]:
        return (function(*block) for block in self._blocks(step))  # parts are spread over threads already

    @property
    def _few(self) -> bool:
        return False

    def squares(self, theta: Array, frame: Frame) -> Array:
        """Return the sums of the squares of the errors, by component, in internal units."""
        evaluation, measurand = self._evaluation("residual", theta, frame), self.model.structure.measurand
        squares = np.zeros(self.components)
        for block in self._blocks():
            _, group, start, stop = block
            rows = group.block(start, stop)
            weight = np.stack([np.broadcast_to(self._column("weight", c, rows), stop - start)
                               for c in range(self.components)], axis=-1)  # fmt: skip
            error = measurand.error(self._uncoloured(evaluation(*block), rows) / weight)
            squares += np.einsum("ij,ij->j", error, error)
        return squares

    def beyond(self, theta: Array, frame: Frame, limit: float) -> NDArray[np.intp]:
        """Return the rows, in the order in which they are laid down, whose weighted residual is longer than a limit."""
        evaluation, rows = self._evaluation("residual", theta, frame), [np.zeros(0, np.intp)]
        for block in self._blocks(BLOCK):
            _, group, start, stop = block
            residual = self._uncoloured(evaluation(*block), group.block(start, stop))
            far = ~(np.einsum("ij,ij->i", residual, residual) <= limit**2)
            rows.append(group.block(start, stop).start + np.flatnonzero(far))
        return np.concatenate(rows)

    def _uncoloured(self, residual: Array, rows: Any) -> Array:
        """Return weighted residuals with the correlation that is stated, where one is."""
        m = self.components
        if ("whitening", 0) not in self.store.at:
            return residual
        whitening = np.empty((len(residual), m, m))
        for k in range(m * m):
            whitening[:, k // m, k % m] = self._column("whitening", k, rows)
        return np.asarray(np.linalg.solve(whitening, residual[..., None])[..., 0])


def _asked(rows: PartRows, shared: _Shared, model: Model, method: str, arguments: tuple[Any, ...]) -> Any:
    """Return what a method of the problem of a part returns; large parts leave memory then."""
    with one_thread_in_blas():
        problem = PartProblem(model, rows, shared)
        answer = getattr(problem, method)(*arguments)
    _release(problem.store.numbers)
    return answer


def _surveyed(rows: PartRows) -> Survey:
    store = rows.store()
    _release(store.numbers)
    return store.survey


def _rows_beyond(
    rows: PartRows, shared: _Shared, model: Model, theta: Array, frame: Frame, limit: float
) -> Rows | None:
    """Return the rows of a part that are far from a model, all columns of them, their directions, and their numbers."""
    far = _asked(rows, shared, model, "beyond", (theta, frame, limit))
    if not len(far):
        return None
    if len(far) > MOST_FAR:
        raise InputFileError(
            rows.part.file, "file", f"{len(far)} rows far from the model", "few wrong ones, or another model"
        )
    o = bind(rows.machine, Scan.load(rows.part))
    s, numbers = o.s.copy(), np.sort(_order(o)[far])
    Motion.of(o).enter(s, shared.entries[rows.part.number])
    return o.data.take(numbers), s[numbers], numbers


def _apart(table: Measurements) -> Measurements:
    """Return a stretch that does not hold the whole table."""
    columns = {name: column.take(np.arange(table.rows)) for name, column in table.columns.items()}
    return replace(table, columns=columns)


# all of them, from where the fit runs -------------------------------------------------------------------------------


@dataclass(eq=False)
class Blocks:
    """The parts of a scan on the workers, and what is known of all rows.

    Attributes
    ----------
    scan : Scan
    parts : list of PartRows
    surveys : list of Survey
    """

    scan: Scan
    parts: list[PartRows]
    surveys: list[Survey] = field(default_factory=list)
    _held: tuple[Workers, Sequence[Any]] | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_held": None}

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.scan.rows

    @cached_property
    def shared(self) -> _Shared:
        """What all parts have to know."""
        names = dict.fromkeys(name for survey in self.surveys if survey.rows for name in survey.runs)
        directions = entries([survey.motion for survey in self.surveys])
        return _Shared({name: k for k, name in enumerate(names)}, tuple(directions))

    def ask(self, what: str, function: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Return what a function of a part returns, of each part, in their order."""
        with workers() as some:
            if self._held is None or self._held[0] is not some:
                self._held = some, some.hold(self.parts)
            answers = dict(some.each(what, function, self._held[1], *arguments))
        return [answers[k] for k in range(len(answers))]

    def sum(self, method: str, model: Model, *arguments: Any) -> Any:
        """Return the sum over all parts of what a method of `PartProblem` returns, numbers or arrays, term by term."""
        parts = self.ask("all rows", _asked, self.shared, model, method, arguments)
        return _added(parts)

    def sample(self, machine: Machine, further: Sequence[Rows] = ()) -> Observations:
        """Return the rows of all parts that belong to the sample, and further ones behind them."""
        samples = list[Rows]()
        for survey, entry, begin in zip(self.surveys, self.shared.entries, self.begins, strict=True):
            for table, s, number in survey.stretches:
                survey.motion.enter(s, entry, int(number[0]))
                samples.append((table, s, number + begin))
        tables, directions, numbers = zip(*samples, *further, strict=True)
        rows = np.concatenate(numbers)
        stretch = np.cumsum(np.diff(rows, prepend=rows[0] - 1) != 1)
        return self._bound(machine, self.scan.joined(tables, rows), np.concatenate(directions), stretch)

    @property
    def begins(self) -> list[int]:
        """The number of the first row of each part."""
        counts = [part.rows for part in self.scan.parts]
        begins: list[int] = (np.cumsum(counts) - counts).tolist()
        return begins

    def with_rows_beyond(self, o: Observations, model: Model, solution: Place, limit: float) -> Observations:
        """Return a sample with all rows that are farther from a model than a limit, behind the others.

        Parameters
        ----------
        o
            The sample.
        model, solution
            The model, and the values and the frame of its fit.
        limit
            Length of a weighted residual.
        """
        there = o.given(np.arange(o.n))
        further = []
        far_rows = self.ask("rows far from the model", _rows_beyond, self.shared, model, *solution, limit)
        for some, begin in zip(far_rows, self.begins, strict=True):
            if some is None:
                continue
            table, s, rows = some
            new = ~np.isin(rows + begin, there)
            if new.any():
                further.append((table.take(new), s[new], rows[new] + begin))
        return self.sample(self.parts[0].machine, further) if further else o

    def _bound(
        self, machine: Machine, table: Measurements, s: NDArray[np.int8], stretch: NDArray[np.int_]
    ) -> Observations:
        """Return the sample in internal units, with ranges and directions as among all rows."""
        o = bind(machine, table)
        low = np.min([survey.low for survey in self.surveys], axis=0)
        high = np.max([survey.high for survey in self.surveys], axis=0)
        travel = [limits or (a, b) for limits, a, b in zip(machine.limits, low, high, strict=True)]
        runs = self.shared.runs
        number = np.array([runs[name] for name in o.run_names], np.int32)
        # a stretch begins with a new pose, and is no neighbour of the one before
        begins = np.diff(o.pose, prepend=-1) | np.diff(stretch, prepend=0)
        bound_blocks = replace(
            o,
            s=s,
            travel=np.array(travel, float).reshape(-1, 2),
            pose=(np.cumsum(begins + np.diff(stretch, prepend=0)) - 1).astype(np.int32),
            run=number[o.run] if len(runs) > 1 else o.run,
            run_names=tuple(runs),
            blocks=self,
        )
        for array in bound_blocks.arrays():
            array.flags.writeable = False
        return bound_blocks


class BlockProblem(Problem):
    """The residuals of a model on all rows of a scan, for sums; what is asked of single rows is of the sample.

    Parameters
    ----------
    model : Model
    observations : Observations
        A sample, with `blocks`.
    """

    def __init__(self, model: Model, observations: Observations) -> None:
        super().__init__(model, observations)
        self.blocks: Blocks = observations.blocks
        self._aside: Problem | None = None

    @property
    def count(self) -> int:
        """Number of rows that sums are over."""
        return self.blocks.rows

    @property
    def _largest(self) -> float:
        return max(survey.largest for survey in self.blocks.surveys)

    @property
    def total_weight(self) -> float:
        """Root of the sum of the squared weights."""
        return float(np.sqrt(sum(survey.weights for survey in self.blocks.surveys)))

    @cached_property
    def _around(self) -> float:
        sums, squares = (
            np.sum([getattr(s, name) for s in self.blocks.surveys], axis=0) for name in ("sums", "squares")
        )
        return float(np.sum(squares - sums**2 / self.count))

    def set_weight(self, factor: Array) -> None:
        """Multiply the weights of the sample by a factor for each row, (n,); the other rows keep theirs."""
        super().set_weight(factor)
        aside = np.flatnonzero(factor != 1.0)
        self._aside = None
        if len(aside):  # their part of each sum is taken off, and added as it is weighted now
            self._aside = Problem(self.model, self.observations.take(aside))
            self._aside.set_weight(np.sqrt(np.maximum(1 - factor[aside] ** 2, 0.0)))

    def _less_aside(self, method: str, *arguments: Any) -> Any:
        """Return a sum over all rows, as they are weighted."""
        whole = self.blocks.sum(method, self.model, *arguments)
        if self._aside is None:
            return whole
        part = getattr(self._aside, method)(*arguments)
        return (
            tuple(a - b for a, b in zip(whole, part, strict=True))
            if isinstance(whole, tuple)
            else whole - part
        )

    def cost(self, theta: Array, frame: Frame) -> float:
        """Return the sum of squares of the weighted residuals; infinite where one is not finite."""
        return float(self._less_aside("cost", theta, frame))

    def _summed(self, theta: Array, frame: Frame) -> tuple[float, Array, Array]:
        sums: tuple[float, Array, Array] = self._less_aside("_summed", theta, frame)
        return sums

    @property
    def _sample(self) -> Problem:
        return self

    def _decomposed_whole(self, theta: Array, frame: Frame, index: NDArray[np.int_], further: Array) -> Array:
        none = np.zeros((0, len(index)))
        parts = self.blocks.ask(
            "all rows", _asked, self.blocks.shared, self.model, "_decomposed", (theta, frame, index, none)
        )
        return reduced([further, *parts])

    def squares(self, theta: Array, frame: Frame) -> Array:
        """Return the sums of the squares of the errors, by component, (m,); internal units."""
        whole = np.asarray(self.blocks.sum("squares", self.model, theta, frame))
        return whole if self._aside is None else whole - _squares(self._aside, theta, frame)

    @property
    def _travel(self) -> Array:
        return np.asarray(np.ptp(self.model.travel, axis=1))


def _squares(problem: Problem, theta: Array, frame: Frame) -> Array:
    """Return the sums of the squares of the errors, by component, internal units."""
    error = problem.model.structure.measurand.error(problem.residuals(theta, frame))
    return np.asarray(np.einsum("ij,ij->j", error, error))


def observed(machine: Machine, data: Any) -> Observations:
    """Return the observations to fit a machine to: of a scan a sample, with all of them as `blocks`.

    A scan of no more rows than the sample has is read whole, and is as any table in memory.

    Raises
    ------
    InputFileError
        As of `bind_once`; and where the machine stands on legs, its attitudes are measured, or its file sets rows
        aside, for which scans are not read.
    """
    if not isinstance(data, Scan):
        return bind_once(machine, data)
    everything = replace(machine, measured=replace(machine.measured, set_aside=()))
    bind(everything, data.empty)  # columns and units are wrong before anything is read
    if data.rows <= STRETCHES * STRETCH:
        return bind_once(machine, data.whole())
    if machine.measured.set_aside:
        found, expected = (
            f"rows of {data.file}, which is read in parts",
            "none, or one file that is read whole",
        )
        raise InputFileError(machine.file or machine.name, "[measured], set_aside", found, expected)
    if machine.kinematics.is_closed or machine.measurand.has_attitude:
        what = "a machine on legs" if machine.kinematics.is_closed else "attitudes"
        expected = (
            "a chain of joints and points, directions or distances; one file of these is read in memory"
        )
        raise InputFileError(data.file, "file", f"measurements of {what} in parts", expected)
    parts = zip(data.parts, _stretches(data), strict=True)
    blocks = Blocks(data, [PartRows(part, machine, stretches) for part, stretches in parts])
    blocks.surveys = blocks.ask("reading", _surveyed)
    return blocks.sample(machine)


def _stretches(scan: Scan) -> list[list[slice]]:
    """Return the rows of each part that belong to the sample: stretches, spread evenly over all."""
    starts = np.linspace(0, scan.rows, STRETCHES, endpoint=False).astype(int).tolist()
    stretches, begin = [], 0
    for part in scan.parts:
        inside = [(max(a - begin, 0), min(a + STRETCH - begin, part.rows)) for a in starts]
        stretches.append([slice(a, b) for a, b in inside if a < b])
        begin += part.rows
    return stretches


def problem_of(model: Model, observations: Observations) -> Problem:
    """Return the problem of all rows that observations stand for."""
    return BlockProblem(model, observations) if observations.blocks else Problem(model, observations)


def _added(parts: Sequence[Any]) -> Any:
    """Return the sum of numbers or arrays, or of each term of lists of these."""
    if isinstance(parts[0], list | tuple):
        return type(parts[0])(_added(terms) for terms in zip(*parts, strict=True))
    return sum(parts[1:], start=parts[0])
