"""A model and observations as a least-squares problem, evaluated block by block.

Rows that see the same target in the same set-up share their geometry: they form a group. A kernel runs over blocks of a
group's rows and sums the normal equations up in its own slots, before they are brought to the parameters, so that
memory does not grow with rows times parameters.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import threadpoolctl
from numpy.typing import NDArray

from rodgen.calibration.problem.assembly_modes import far_apart, found_again
from rodgen.calibration.problem.file_values import FileValues
from rodgen.errors import InputFileError
from rodgen.machines.effects.catalogue import OFFSETS, SCALES
from rodgen.machines.measured import TURNS
from rodgen.machines.model import Frame, Model
from rodgen.machines.observations import Observations
from rodgen.machines.structure import row_effects
from rodgen.statistics.decompositions import svd
from rodgen.statistics.thresholds import DETERMINACY, NEGLIGIBLE_WEIGHT

LARGEST_TURN = 0.05
"""Largest deviation of an axis from its file, radians (3 degrees); a point or a target may move by as large a part
of the machine's size. Every file is better than that, and beyond it readings bend along a direction by more than
the noise: no standard deviation holds."""
LARGEST_EFFECT = 0.005
"""The same of an effect, in radians, or as a part of the machine's size, of a parameter or of what it does to
readings: gears and arms that give way by 0.3 degrees are worn out, or of plastic. Of a user's own formula nothing
is known."""
SHRUNK = 10.0
"""Usual sizes within which parameters that the data hardly determine are held when sizes are judged."""

__all__ = ["Group", "Problem", "one_thread_in_blas", "reduced"]

Array: TypeAlias = NDArray[np.float64]

BLOCK = 4096
"""Most rows of one call of a kernel."""
BLOCK_NUMBERS = 1 << 16
"""Numbers in the Jacobian of a block: half a megabyte stays in the second-level cache."""
THREADS_FROM = 4 * BLOCK
"""Number of rows from which on a second thread saves more time than it costs."""
TOGETHER = 512
"""Up to so many rows a call on NumPy costs more than its rows, and the groups are evaluated in one: three of 100 or 210
rows together in 0.45 of the time, of 400 in 0.75, of 1,000 in as much."""
OF_EACH = 200
"""So many rows of each of many groups, on average, are few, too: 85 groups of 35 rows take a fifth of the time."""
IN_CACHE = 1_000
"""Rows that are decomposed at once: a tall matrix takes six times as long outside the cache."""
MOST_TOGETHER = 50_000
"""Rows that are evaluated at once in any case: their derivatives are kept."""
SAMPLE = 10_000
"""Rows in which it is seen which combinations of parameters change nothing."""
EXACT, UNSEEN = 1e-8, 1e-13
"""Parts of the largest information: above the one, normal equations give any combination to eight digits, below the
other they are rounding."""


def one_thread_in_blas() -> Any:
    """Return a context in which the products of NumPy run in the thread that asks for them.

    The matrices here are small and many. Their blocks are spread over threads already, and where other programs use
    the processors, threads of the library that wait for each other take a hundred times as long.
    """
    return _threads().limit(limits=1, user_api="blas")


@functools.cache
def _threads() -> threadpoolctl.ThreadpoolController:
    return threadpoolctl.ThreadpoolController()


@dataclass(frozen=True)
class Group:
    """Rows that see the same target in the same set-up.

    Attributes
    ----------
    target, run : int
    rows : ndarray of int, or slice
        Their numbers, a slice where they follow each other.
    count : int
    """

    target: int
    run: int
    rows: NDArray[np.int_] | slice
    count: int

    def block(self, start: int, stop: int) -> Any:
        """Return the numbers of some of them."""
        if isinstance(self.rows, slice):
            return slice(self.rows.start + start, self.rows.start + stop)
        return self.rows[start:stop]


class Problem:
    """Residuals of a model on observations.

    Parameters
    ----------
    model : Model
    observations : Observations
        Bound to the model's machine.

    Attributes
    ----------
    weight : ndarray, shape (n, m)
        Factor of each residual: 1/σ, or 1 where no uncertainty is stated. Robust fitting multiplies it.
    knows_noise : bool
        Whether weighted residuals have variance 1, so that priors weigh by what they state.
    """

    def __init__(self, model: Model, observations: Observations) -> None:
        self.model = model
        self.observations = observations
        self.components = model.structure.components
        self.rows = observations.n
        self._check_columns()
        self.base_weight = self._base_weight()
        self.weight = self.base_weight
        self.knows_noise = observations.sigma is not None
        self.groups = list(self._groups())
        self._pairs = tuple((group.target, group.run) for group in self.groups)
        self._equations: dict[tuple[bytes, ...], tuple[float, Array, Array]] = {}
        self._constant_slots: list[tuple[NDArray[np.intp], Array]] | None = None

    @property
    def scale(self) -> float:
        """Sum of squares of the weighted readings, to which rounding errors are relative."""
        return (self._largest * self.total_weight) ** 2

    @property
    def spread(self) -> float:
        """Cost of a model that predicts the mean of the readings, by the mean weight: a bad fit is compared with it."""
        return self._around * self.total_weight**2 / (self.count * self.components)

    @property
    def _largest(self) -> float:
        """Largest number among the readings."""
        return float(self.model.structure.measurand.size(self.observations.reading))

    @functools.cached_property
    def _around(self) -> float:
        """Sum of the squares of the readings, their mean taken off: the frame is anywhere."""
        around = self.observations.reading - self.observations.reading.mean(axis=0)
        return float(np.vdot(around, around))

    @property
    def _travel(self) -> Array:
        """How far each joint moves, (J,)."""
        return np.ptp(self.observations.q, axis=0) if self.rows else np.zeros(self.observations.q.shape[1])

    @functools.cached_property
    def file_values(self) -> FileValues:
        """What the machine file says of the parameters, and how far the machine may be from it."""
        model = self.model
        distance = self._distance if model.structure.moving else 1.0
        # a coordinate may be as far off as the geometry
        coarse = OFFSETS | SCALES | {effect.name for effect in model.machine.effects if effect.definition.own}
        is_effect = np.array([kind == "e" for kind in model.kinds], bool)
        fine = is_effect & np.array([p.effect not in coarse for p in model.parameters], bool)
        part = np.where(fine, LARGEST_EFFECT, LARGEST_TURN)
        largest = part * np.where(model.turns, 1.0, np.where(model.ways, distance, np.inf))
        usual, largest_possible = model.effect_sizes
        largest = np.fmin(largest, np.where(fine, SHRUNK * usual, np.inf))
        change = np.where(is_effect, part * distance, np.inf)
        is_free = is_effect & (model.known[1] == 0.0) & np.isfinite(largest_possible)
        possible = np.divide(1.0, largest_possible, out=np.zeros(len(usual)), where=is_free)
        return FileValues(largest, change, model.anchored, *model.known, possible)

    def at_bounds(self, theta: Array) -> dict[int, str]:
        """Return the numbers of the parameters that are at a bound, and whether it is their lowest or highest."""
        file = self.file_values
        if not file.is_bounded:
            return {}
        return {int(i): "lowest" for i in np.flatnonzero(theta <= file.lowest)} | {
            int(i): "highest" for i in np.flatnonzero(theta >= file.highest)
        }

    @property
    def _distance(self) -> float:
        """How large the machine is: its travels, its readings, or how far targets are from axes; the largest."""
        machine = self.model.machine
        if machine.kinematics.is_closed:
            return machine.kinematics.size
        rms = math.sqrt(self._around / max(self.count, 1))
        slides = [j for j, joint in enumerate(machine.joints) if not joint.revolute]
        travel = float(self._travel[slides].max(initial=0.0))
        return max(rms, self.model.farthest, travel) or 1.0

    @property
    def total_weight(self) -> float:
        """Root of the sum of the squared weights."""
        # copies no weight that is one for all
        return float(np.sqrt(np.einsum("ij,ij->", self.weight, self.weight)))

    @property
    def count(self) -> int:
        """Number of rows that sums are over."""
        return self.rows

    def freedom(self, parameters: int) -> int:
        """Return how many more readings there are than parameters, 1 at least."""
        return max(self.count * self.components - parameters, 1)

    # the rows of the kernels ---------------------------------------------------------------------------------

    def _check_columns(self) -> None:
        """Refuse data without a column that an effect needs."""
        o = self.observations
        effects = row_effects(self.model.machine)
        for effect, term in zip(effects, self.model.structure.terms, strict=True):
            for name, (kind, of) in term.columns:
                column = self._missing(kind, of)
                if column:
                    expected = f"one, because the effect {effect.title} uses {name}"
                    raise InputFileError(o.data.file, o.data.header_place, f"no column {column!r}", expected)

    def _missing(self, kind: str, of: Any) -> str:
        """Return the name of the column where it is not in the data, else an empty string."""
        o = self.observations
        if kind == "T":
            joint = self.model.machine.joints[of].name
            return "" if joint in o.temperature else f"T_{joint} [degC]"
        if kind == "t":
            return "" if o.t is not None else "t [s]"
        if kind == "F":
            return "" if o.load is not None else "load [N]"
        return "" if kind != "x" or of in o.covariates else str(of)

    def _base_weight(self) -> Array:
        o = self.observations
        if o.sigma is None:
            return np.broadcast_to(1.0, (self.rows, self.components))
        measurand = self.model.structure.measurand
        basis = o.basis if measurand.is_direction else None
        sigma = measurand.component_sigma(o.sigma, basis)
        if not sigma.strides[0] and self.rows:
            return np.broadcast_to(1.0 / sigma[0], sigma.shape)
        return np.asarray(1.0 / sigma)

    @functools.cached_property
    def _arms(self) -> Array:
        """What makes lengths of the components of a residual in a kernel, (m,): the lever arm of turns."""
        arm = self.observations.arm
        return np.array([arm if name in TURNS else 1.0 for name in self.model.structure.measurand.components])

    def _groups(self) -> Iterator[Group]:
        o = self.observations
        runs = o.run if self.model.structure.by_run else np.zeros(self.rows, int)
        code = o.target * (int(runs.max(initial=0)) + 1) + runs
        if self.rows and np.all(code == code[0]):
            yield Group(int(o.target[0]), int(runs[0]), slice(0, self.rows), self.rows)
            return
        order = np.argsort(code, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(code[order])) + 1):
            if len(rows):
                yield Group(int(o.target[rows[0]]), int(runs[rows[0]]), rows, len(rows))

    def _column(self, kind: str, of: Any, rows: Any) -> Any:
        o = self.observations
        if kind in {"q", "s", "v"}:
            return getattr(o, kind)[rows, of]
        if kind == "T":
            return o.temperature[self.model.machine.joints[of].name][rows]
        if kind == "t":
            return o.t[rows]  # type: ignore[index]
        if kind == "F":
            return o.load[rows]  # type: ignore[index]
        if kind == "x":
            return o.covariates[of][rows]
        if kind == "start":
            return o.pose_start[rows, of]  # type: ignore[index]
        if kind == "whitening":
            return o.whitening[rows, of // self.components, of % self.components]  # type: ignore[index]
        if kind == "reading":
            if self.model.structure.measurand.has_zero:
                return (np.cos, np.sin)[of](o.reading[rows, 0] / 2)
            of_attitude = of - self.model.structure.measurand.inputs + 9
            if o.attitude is not None and of_attitude >= 0:
                return o.attitude[rows, of_attitude // 3, of_attitude % 3]
            if of < 3:
                return o.reading[rows, of]
            return o.basis[of // 3 - 1][rows, of % 3]
        return self.weight[rows, of] * self._arms[of]

    def _block(self, group: Group, start: int, stop: int) -> Array:
        """Return the rows of the kernels of a block of a group."""
        table = np.empty((stop - start, len(self.model.structure.columns)))
        rows = group.block(start, stop)
        for i, (kind, of) in enumerate(self.model.structure.columns):
            table[:, i] = self._column(kind, of, rows)
        return table

    def set_weight(self, factor: Array) -> None:
        """Multiply the weights that the data state by a factor for each row, (n,)."""
        self.weight = self.base_weight * factor[:, None]
        self._equations = {}

    def leave_out(self, rows: NDArray[np.bool_]) -> None:
        """Give some rows, (n,), a negligible weight, and the others what the data state."""
        self.set_weight(np.where(rows, NEGLIGIBLE_WEIGHT, 1.0))

    def take(self, rows: NDArray[np.int_]) -> Problem:
        """Return the problem of some rows, with the weights that they have."""
        some = Problem(self.model, self.observations.take(rows))
        if self.weight is not self.base_weight:
            some.set_weight((self.weight[rows] / self.base_weight[rows])[:, 0])
        return some

    def _blocks(self, step: int = 0) -> Iterator[tuple[int, Group, int, int]]:
        """Yield the parts of the groups, of so many rows that their Jacobian stays in the cache, or of `step` rows.

        On NumPy calls cost more than that saves.
        """
        if not step and self._on_numpy:
            step = BLOCK
        if not step:
            structure = self.model.structure
            a_row = self.components * max(1, len(structure.slots) + len(structure.parameters))
            step = min(BLOCK, max(256, BLOCK_NUMBERS // a_row))
        for number, group in enumerate(self.groups):
            for start in range(0, group.count, step):
                yield number, group, start, min(start + step, group.count)

    def _each(self, function: Any, step: int = 0) -> Iterator[Any]:
        """Apply a function to every block, in order, in two threads where that pays."""
        blocks = self._blocks(step)
        if self.rows < THREADS_FROM:
            yield from (function(*block) for block in blocks)
            return
        with ThreadPoolExecutor(2) as pool:
            yield from pool.map(lambda block: function(*block), blocks)

    # the poses of a closed chain -------------------------------------------------------------------------------

    @property
    def is_closed_chain(self) -> bool:
        """Whether the model solves for poses, from those that come with the rows."""
        return self.model.structure.kinematics.is_closed

    def follow(self, theta: Array, frame: Frame) -> bool:
        """Move the starts of a closed chain's poses to its poses with these values; return whether any moved far.

        A model is NaN where its own pose is far from the start, so the starts follow when a fit moves the geometry.
        """
        if not self.model.structure.kinematics.pose_numbers:
            return False
        start = self.observations.pose_start
        assert start is not None
        poses = self._by_row("pose", theta, frame, start.shape[1])
        lost = ~np.isfinite(poses).all(axis=1)
        if lost.any():
            numbers = {name: self.model.number(theta, name) for name in self.model.machine.kinematics.numbers}
            poses[lost] = found_again(self.observations.take(lost), numbers)
        if not np.any(far_apart(poses, start, self.model.machine)):
            return False
        self.start_from(poses)
        return True

    @property
    def starts(self) -> Array | None:
        """Where the poses of a closed chain start, (n, k); None for a chain of joints."""
        return self.observations.pose_start

    def start_from(self, poses: Array | None) -> None:
        """Set where the poses of a closed chain start; None, for a chain of joints, changes nothing."""
        if poses is None or poses is self.starts:
            return
        self.observations = replace(self.observations, pose_start=poses)
        self._equations = {}

    # evaluation ----------------------------------------------------------------------------------------------

    def _geometries(self, theta: Array, frame: Frame) -> Array:
        return self.model.geometries(theta, frame, self._pairs)

    @property
    def _few(self) -> bool:
        """Whether all rows are evaluated at once, on NumPy."""
        few = max(TOGETHER, min(OF_EACH * len(self.groups), MOST_TOGETHER))
        return self.rows <= few and self._on_numpy

    @property
    def _on_numpy(self) -> bool:
        return bool(self.model.kernels["residual"].target == "numpy")

    def _evaluation(self, name: str, theta: Array, frame: Frame) -> Callable[[int, Group, int, int], Any]:
        """Return a function from a block of a group to what a kernel gives for it."""
        kernel, e = self.model.kernels[name], self.model.parameters_of_effects(theta)
        geometries = self._geometries(theta, frame)
        if not self._few:
            return lambda number, group, start, stop: kernel(
                self._block(group, start, stop), geometries[number], e
            )
        counts = [group.count for group in self.groups]
        blocks = [self._block(group, 0, group.count) for group in self.groups]
        effects = np.broadcast_to(e, (len(counts), *e.shape))
        outputs = kernel.in_sets(np.concatenate(blocks), counts, geometries, effects)
        parts = [np.split(result, np.cumsum(counts)[:-1]) for result in outputs]

        def of_block(number: int, _: Group, start: int, stop: int) -> Any:
            results = [part[number][start:stop] for part in parts]
            return results[0] if len(results) == 1 else results

        return of_block

    def _by_row(self, name: str, theta: Array, frame: Frame, width: int) -> Array:
        """Return what a kernel gives for every row, (n, width), in the order of the data."""
        evaluation = self._evaluation(name, theta, frame)
        by_row = np.empty((self.rows, width))
        for block in self._blocks():
            _, group, start, stop = block
            by_row[group.block(start, stop)] = evaluation(*block)
        return by_row

    def cost(self, theta: Array, frame: Frame) -> float:
        """Return the sum of squares of the weighted residuals; infinite where one is not finite."""
        evaluation = self._evaluation("residual", theta, frame)

        def of_block(number: int, group: Group, start: int, stop: int) -> float:
            residual = evaluation(number, group, start, stop)
            return float(np.vdot(residual, residual))

        total = sum(self._each(of_block, BLOCK))
        return total if np.isfinite(total) else np.inf

    def normal_equations(self, theta: Array, frame: Frame) -> tuple[float, Array, Array]:
        """Return cost, JᵀJ and Jᵀr with respect to all parameters, at once and in bounded memory.

        The cost is infinite where a residual or a derivative is not finite. The last two results are kept: a stage of a
        fit begins where the one before ended.
        """
        at = _place(theta, frame)
        if at not in self._equations:
            self.keep_equations(theta, frame, self._summed(theta, frame))
        return self._equations[at]

    def keep_equations(self, theta: Array, frame: Frame, equations: tuple[float, Array, Array]) -> None:
        """Keep what :meth:`normal_equations` returns at a place, and what was kept last."""
        self._equations = dict([*list(self._equations.items())[-1:], (_place(theta, frame), equations)])

    def _summed(self, theta: Array, frame: Frame) -> tuple[float, Array, Array]:
        p = len(self.model.parameters)
        if "residual_and_jacobian" not in self.model.kernels:
            return self.cost(theta, frame), np.zeros((p, p)), np.zeros(p)
        return self._in_parameters(self._grams(theta, frame), self._own_slots(theta))

    @np.errstate(over="ignore", invalid="ignore")
    def _grams(self, theta: Array, frame: Frame) -> list[Array]:
        """Return the products of derivatives and residuals of each group, with respect to what the kernels have."""
        kernel, e = self.model.kernels["residual_and_jacobian"], self.model.parameters_of_effects(theta)
        geometries = self._geometries(theta, frame)
        evaluation = self._evaluation("residual_and_jacobian", theta, frame) if self._few else None

        def of_block(number: int, group: Group, start: int, stop: int) -> tuple[int, Array]:
            if evaluation is None:
                return number, kernel.gram(self._block(group, start, stop), geometries[number], e)
            residual, jacobian = evaluation(number, group, start, stop)
            joined = np.concatenate([jacobian, residual[..., None]], axis=-1).reshape(residual.size, -1)
            return number, joined.T @ joined

        grams: dict[int, Array] = {}  # of each group, in order
        for number, gram in self._each(of_block, BLOCK):
            grams[number] = grams[number] + gram if number in grams else gram
        return list(grams.values())

    @np.errstate(over="ignore", invalid="ignore")
    def _in_parameters(
        self, grams: Iterable[Array], slots: Iterable[tuple[NDArray[np.intp], Array]]
    ) -> tuple[float, Array, Array]:
        """Return cost, JᵀJ and Jᵀr from the products of some groups, with respect to what the kernels have."""
        p = len(self.model.parameters)
        cost, A, b = 0.0, np.zeros((p, p)), np.zeros(p)
        for gram, (slots_of, used) in zip(grams, slots, strict=True):
            cost += float(gram[-1, -1])
            A[slots_of[:, None], slots_of] += used.T @ gram[:-1, :-1] @ used
            b[slots_of] += used.T @ gram[:-1, -1]
        return cost if np.isfinite(cost) and np.isfinite(A).all() else np.inf, A, b

    def residuals(self, theta: Array, frame: Frame, *, weighted: bool = False) -> Array:
        """Return measured less predicted, (n, m), in the order of the data; internal units, or times the weight."""
        self.follow(theta, frame)
        residuals = self._by_row("residual", theta, frame, self.components)
        return residuals if weighted else self.coloured(residuals) / self.weight

    def coloured(self, whitened: Array) -> Array:
        """Return weighted residuals, (..., n, m), with their correlation, where one is stated."""
        colouring = self.observations.colouring
        return whitened if colouring is None else np.einsum("nij,...nj->...ni", colouring, whitened)

    def places(self, theta: Array, frame: Frame) -> Array:
        """Return the predicted points or directions, (n, 3): of attitudes alone z axes."""
        placed = self._placed(theta, frame)
        return placed[:, 2::3] if placed.shape[1] == 9 else placed[:, :3]

    def attitudes(self, theta: Array, frame: Frame) -> Array:
        """Return the predicted attitudes of poses, (n, 3, 3)."""
        return self._placed(theta, frame)[:, -9:].reshape(-1, 3, 3)

    def _placed(self, theta: Array, frame: Frame) -> Array:
        self.follow(theta, frame)
        return self._by_row("place", theta, frame, self.model.structure.measurand.place_numbers)

    def read_as_predicted(self, theta: Array, frame: Frame) -> Problem:
        """Return the problem with the predicted directions and attitudes as readings; residuals are angles from these.

        Of points and distances, whose residuals are differences, it stays as it is.
        """
        if self.model.structure.moving and not self.model.structure.measurand.has_attitude:
            return self
        return Problem(self.model, self.predicted_observations(theta, frame))

    def predicted_observations(self, theta: Array, frame: Frame) -> Observations:
        """Return the observations with what is predicted as readings."""
        if not self.model.structure.measurand.has_attitude:
            return replace(self.observations, reading=self.predicted(theta, frame))
        attitude = self.attitudes(theta, frame)
        return replace(self.observations, reading=self.predicted(theta, frame), attitude=attitude)

    def predicted(self, theta: Array, frame: Frame) -> Array:
        """Return the predicted readings, (n, 3) or (n, 1): of poses the points, of attitudes alone z axes."""
        measurand = self.model.structure.measurand
        if measurand.has_attitude and not measurand.is_pose:
            return np.ascontiguousarray(self.attitudes(theta, frame)[:, :, 2])
        if measurand.is_place:
            return self.places(theta, frame)
        off = measurand.error(self.residuals(theta, frame), self.observations.arm)
        return np.asarray(self.observations.reading - off)

    def jacobian(self, theta: Array, frame: Frame) -> Array:
        """Return the derivative of the weighted residuals, (n, m, parameters), all of it in memory."""
        jacobian = np.zeros((self.rows, self.components, len(self.model.parameters)))
        for rows, block in self.jacobian_blocks(theta, frame):
            jacobian[rows] = block
        return jacobian

    def jacobian_blocks(self, theta: Array, frame: Frame) -> Iterator[tuple[Any, Array]]:
        """Yield rows and the derivative of their weighted residuals, (rows, m, parameters), block by block."""
        if "residual_and_jacobian" not in self.model.kernels:
            return
        self.follow(theta, frame)
        evaluation = self._evaluation("residual_and_jacobian", theta, frame)
        slots = self._own_slots(theta)
        for number, group, start, stop in self._blocks():
            _, jacobian = evaluation(number, group, start, stop)
            slots_of, used = slots[number]
            block = np.tensordot(jacobian, used, 1)
            if len(slots_of) < len(self.model.parameters):
                few, block = block, np.zeros((*jacobian.shape[:2], len(self.model.parameters)))
                block[:, :, slots_of] = few
            yield group.block(start, stop), block

    def triangle(self, theta: Array, frame: Frame, index: NDArray[np.int_], further: Array) -> Array:
        """Return R of the QR decomposition of the weighted Jacobian and further rows, in bounded memory.

        Orthogonal transformations take twenty times as long as the normal equations, which are there already. So of
        many rows it is seen in a sample which combinations change nothing; where the others are far from that, the
        normal equations are good enough for them. Else all rows are decomposed.

        Parameters
        ----------
        theta, frame : ndarray, Frame
        index : ndarray of int, shape (k,)
            Numbers of the parameters.
        further : ndarray, shape (r, k)
        """
        triangle = None
        if self.count > MOST_TOGETHER:
            _, square, _ = self.normal_equations(theta, frame)
            square = square[index[:, None], index] + further.T @ further
            triangle = _root(square, self._sample._decomposed(theta, frame, index, further))
        return self._decomposed_whole(theta, frame, index, further) if triangle is None else triangle

    @property
    def _sample(self) -> Problem:
        """The problem of some rows, any."""
        return self.take(np.sort(np.random.default_rng(0).choice(self.rows, SAMPLE, replace=False)))

    def _decomposed(self, theta: Array, frame: Frame, index: NDArray[np.int_], further: Array) -> Array:
        waiting = [further]
        for _, block in self.jacobian_blocks(theta, frame):
            waiting.append(block.reshape(-1, block.shape[-1])[:, index])
            if sum(map(len, waiting)) > IN_CACHE + 4 * len(index):
                waiting = [reduced(waiting)]
        return reduced(waiting)

    def _decomposed_whole(self, theta: Array, frame: Frame, index: NDArray[np.int_], further: Array) -> Array:
        return self._decomposed(theta, frame, index, further)

    def _own_slots(self, theta: Array) -> list[tuple[NDArray[np.intp], Array]]:
        """Return, for each group, its parameters, few of many targets', and the derivative of the slots by these."""
        if self._constant_slots is not None:
            return self._constant_slots
        every = np.arange(len(self.model.parameters))
        pairs = []
        for slots in self.model.slots(theta, self._pairs):
            slots_of = np.flatnonzero(slots.any(axis=0)) if len(self._pairs) > 1 else every
            pairs.append((slots_of, slots[:, slots_of] if len(slots_of) < len(every) else slots))
        if self.model.has_constant_slots:
            self._constant_slots = pairs
        return pairs


def reduced(blocks: Sequence[Array]) -> Array:
    """Return R of the QR decomposition of rows, (k, p) each."""
    return np.asarray(np.linalg.qr(np.concatenate(blocks), mode="r"))


def _root(square: Array, triangle: Array) -> Array | None:
    """Return R of RᵀR = `square`, (k, k), without the rounding of `square` along what a sample's triangle does not see.

    None where `square` sees that after all, or is too inexact for what is hardly seen.
    """
    size = np.linalg.norm(triangle, axis=0)
    size[size == 0.0] = 1.0
    _, values, vt = svd(triangle / size, full_matrices=True)
    seen = np.pad(values, (0, len(vt) - len(values))) > DETERMINACY.nothing * values[0]
    square = vt @ (square / np.outer(size, size)) @ vt.T
    known = square[np.ix_(seen, seen)]
    if not np.isfinite(square).all() or not seen.any():
        return None
    least, largest = np.linalg.eigvalsh(known)[[0, -1]]
    if least < EXACT * largest or square[~seen, ~seen].max(initial=0.0) > UNSEEN * largest:
        return None
    return np.asarray(np.linalg.cholesky(known).T @ (vt[seen] * size))


def _place(theta: Array, frame: Frame) -> tuple[bytes, ...]:
    return theta.tobytes(), frame.rotation.tobytes(), frame.position.tobytes()
