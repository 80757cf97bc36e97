"""Whether a machine file and its data can be right, and which changes put them right.

Each change (`repairs`) is a candidate, and the files as they are the null hypothesis. A candidate costs -2 ln of its
probability, given the readings, in a fit that stays near the file::

    n ln s² + (ν + m) Σ ln(1 + r²/(ν s²)) + Σ (correction / usual correction)² + Σ ln(1 + λ)

The residuals r of a row, of m components, have a t distribution of few degrees of freedom ν, so that a wrong reading
costs the logarithm of its error. Its scale s is profiled, and no less than a floor. Corrections have a prior, as well
as drawings and assembly usually are, or as the file says: a fit may turn an axis by half a turn if the readings then
agree, but that is improbable. Where readings say what is right they cost little: a roughly known machine loses nothing.
Each eigenvalue λ is what the readings say of the corrections, over what the prior says: a fit that lowers the scale by
corrections has only the degrees of freedom that these leave (Laplace's approximation of the integral over them).

A change is named where it is many times as probable as the files as they are, and lowers the error; one that only makes
corrections needless, where those that are left are usual ones. Equally probable changes are named together. None is
tried where none could gain so much: the error is no larger than effects leave that a model lacks, and corrections are
usual.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import numpy as np
from scipy import special

from rodgen.array_types import Array, Mask
from rodgen.calibration.fit import fitted
from rodgen.calibration.fitted import Fit
from rodgen.calibration.misidentified import elsewhere, on_stars
from rodgen.calibration.possible_effects import catalogue_effects
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.problem.assembly_modes import other_mode
from rodgen.calibration.problem.binding import bind_once
from rodgen.calibration.repairs import (
    AS_IS,
    Repair,
    far_offsets,
    found_ratios,
    free_ratios,
    ratio_of_one_axis,
    repairs,
)
from rodgen.calibration.rows import wrong_rows
from rodgen.calibration.solve.least_squares import minimise
from rodgen.calibration.solve.staged_fit import FitError
from rodgen.calibration.solve.starting_values import nearest_frames, with_attitudes, with_zeros
from rodgen.calibration.words import capitalized, sized, three_digits
from rodgen.data.units import unit_factor
from rodgen.document import Bullets, Document, Documented, Paragraph
from rodgen.errors import RodgenError, joined
from rodgen.machines.machine import Machine
from rodgen.machines.model import Frame, Model
from rodgen.machines.mounts import mount_of
from rodgen.machines.observations import Observations
from rodgen.machines.parameters import parameters_of
from rodgen.machines.plausibility import plausibility
from rodgen.machines.plausible import relative_corrections, stated_deviations, tolerances
from rodgen.stages import each
from rodgen.statistics.columns import inverse_root, unit_diagonal
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.thresholds import CHECK, EVIDENCE
from rodgen.views import Result, plain

TAILS = 3.0
"""Degrees of freedom of the t distribution of errors: one reading in a hundred is farther out than six scales."""
UNSEEN = 1e-4
"""Part of the motion below which residuals are alike: wrong files do not show there."""

__all__ = ["Check", "check", "motion"]

ROUNDS, STEPS, LAST = 8, 3, 1e-3
"""Times that weights and scale are found anew, Gauss-Newton steps between, and the change of ln(scale) that ends it."""
FIRST_ROUNDS = 2
"""Rounds after which most repairs are seen to lead nowhere."""
SCALE_STEPS = 10
"""Steps that bring a scale to 1 % of its limit."""
FINALISTS, BEAM, ORDERS = 16, 5, 2
"""Repairs whose fits are carried to their end, those that are tried together with a second one, and the orders of
joints or columns with which all ratios are."""
FEWEST_ROWS, ROWS_A_PARAMETER = 60, 4
"""Rows on which repairs are compared, and for each parameter so many."""


def motion(problem: Problem, theta: Array) -> float:
    """Return how far the joints move what is measured, rms over rows; internal units of residuals.

    Each joint counts by itself: together they may hold a target in its place. Of readings that are places it is no less
    than these scatter. Where the joints move nothing, it is how large the machine is.

    Parameters
    ----------
    theta : ndarray, shape (parameters,)
        Internal units.
    """
    measurand, frame = problem.model.structure.measurand, Frame.identity()
    scatter = _scatter(problem.observations.reading) if measurand.is_place else 0.0
    if problem.is_closed_chain:
        return max(_scatter(problem.places(theta, frame)), scatter)
    only_turns = not measurand.moving and not measurand.is_direction
    o = problem.predicted_observations(theta, frame) if only_turns else problem.observations
    places, squares = problem.places(theta, frame), 0.0
    for j in range(o.q.shape[1]):
        held = o.q.copy()
        held[:, j] = held[:, j].mean()
        there = Problem(problem.model, replace(o, q=held))
        change = there.places(theta, frame) - places
        if only_turns:
            change = measurand.error(there.residuals(theta, frame))
        squares += float(np.mean(np.sum(change**2, axis=1)))
    moved = float(np.sqrt(squares))
    return max(moved if moved >= UNSEEN * _size(problem) else _size(problem), scatter)


def _scatter(places: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((places - places.mean(axis=0)) ** 2, axis=1))))


def _size(problem: Problem) -> float:
    """Return how far what is measured could move: by how far it is from the axes, or a radian."""
    return problem.model.farthest if problem.model.structure.measurand.moving else 1.0


@dataclass(frozen=True)
class NearFit:
    """A fit near the file; the weights of its problem contain the scale, and its prior is what corrections cost."""

    problem: Problem
    theta: Array
    frame: Frame
    moved: float
    """How far the joints move what is measured, rms, internal units."""
    enlarged: float = 1.0
    """By which the readings were multiplied, so that the probability is that of the readings as they were."""

    @property
    def model(self) -> Model:
        """Its model."""
        return self.problem.model

    @cached_property
    def is_of_target(self) -> Mask:
        """Which parameters are of targets."""
        return np.asarray(np.array(self.model.kinds) == "target")

    @cached_property
    def _of_a_reading(self) -> float:
        """A weighted residual of 1 is so small, in units of a reading."""
        return float(np.median(np.sqrt(np.mean(self.problem.base_weight**2, axis=1))))

    @cached_property
    def _weighted(self) -> tuple[Array, Array, float]:
        """Sums of the squared residuals of each row, its weight, and the scale, all relative to `base_weight`."""
        o, m = self.problem.observations, self.problem.components
        residual = self.problem.residuals(self.theta, self.frame) * self.problem.base_weight
        squares = np.sum(residual**2, axis=1)
        measurand = self.model.structure.measurand
        size = _scatter(o.reading) if measurand.is_place else float(np.sqrt(np.mean(o.reading**2)))
        size = self.moved if measurand.has_zero else size  # the zero of an angle may be anywhere
        least = max(float(o.sigma is not None), UNSEEN * size * self._of_a_reading)
        scale = max(float(np.sqrt(np.median(squares) / m)), least)
        for _ in range(SCALE_STEPS):
            weight = (TAILS + m) / (TAILS + squares / scale**2)
            scale = max(float(np.sqrt(np.mean(weight * squares) / m)), least)
        return squares, weight, scale

    @property
    def scale(self) -> float:
        """Of the residuals of most rows, internal units."""
        return self._weighted[2] / self._of_a_reading

    def weigh(self) -> None:
        """Give each row of the problem its weight."""
        _, weight, scale = self._weighted
        self.problem.set_weight(np.sqrt(weight) / scale)

    @cached_property
    def prices(self) -> Array:
        """What each correction of the file, or of the mean of its prior, costs, (parameters,)."""
        values = self.problem.file_values
        return np.asarray((values.precision * (self.theta - values.centre)) ** 2)

    @cached_property
    def cost(self) -> float:
        """-2 ln of the probability, up to a constant that all candidates have; what any value may have costs ln n."""
        squares, _, scale = self._weighted
        m = self.problem.components
        n = len(squares) * m
        tails = (TAILS + m) * np.sum(np.log1p(squares / (TAILS * scale**2)))
        error = 2 * n * np.log(self.scale / self.enlarged)
        return float(error + tails + self.prices.sum() + np.log1p(self.information).sum())

    @cached_property
    def information(self) -> Array:
        """What readings say of the adjusted parameters, relative to the prior: eigenvalues, (adjusted,).

        The prior of what may have any value is as good as one reading (Kass and Wasserman 1995).
        """
        free = _adjusted(self.model)
        square = self.problem.normal_equations(self.theta, self.frame)[1][np.ix_(free, free)]
        stated = self.problem.file_values.precision[free]
        unit = np.where(stated > 0, stated, np.sqrt(np.diag(square) / self.problem.base_weight.size))
        unit[unit == 0] = 1.0
        return np.asarray(np.maximum(eigh(square / np.multiply.outer(unit, unit))[0], 0.0))

    @cached_property
    def largest_scale(self) -> float:
        """What the scale may be; the degrees of freedom are those that the parameters leave."""
        n = self.problem.base_weight.size
        left = n - np.sum(self.information / (1 + self.information))
        return float(self.scale * np.sqrt(n / special.chdtri(max(left, 1.0), 1 - CHECK.chance)))

    @cached_property
    def rms(self) -> float:
        """Of the rows that are not outliers, internal units; turns count on an arm no longer than places are wide."""
        o, measurand = self.problem.observations, self.model.structure.measurand
        arm = min(o.arm, _scatter(o.reading)) if measurand.has_attitude else o.arm
        (squares, _, scale), m = self._weighted, self.problem.components
        near = squares <= m * scale**2 * special.fdtri(m, TAILS, 1 - CHECK.chance)
        residual = measurand.error(self.problem.residuals(self.theta, self.frame), arm)[near]
        return float(np.sqrt(np.mean(residual**2))) if near.any() else np.inf

    @cached_property
    def farthest(self) -> float:
        """The largest correction, relative to what is still plausible."""
        return float(np.abs(relative_corrections(self.model, self.theta, self.moved)).max(initial=0.0))

    @property
    def deviations(self) -> Array:
        """Standard deviations of the parameters, (parameters,), internal units."""
        square, size = unit_diagonal(self.problem.normal_equations(self.theta, self.frame)[1])
        root = inverse_root(square, relative=1e-14)
        return np.asarray(np.linalg.norm(root, axis=1) / size)

    @property
    def is_rough(self) -> bool:
        """Whether the error is larger than effects leave that a model lacks."""
        return self.scale >= CHECK.imperfect * self.moved

    @property
    def is_open(self) -> bool:
        """Whether more is remarkable than the places of targets, which may be guesses."""
        rough = self.largest_scale >= CHECK.imperfect * self.moved
        return rough or self.prices[~self.is_of_target].sum() >= CHECK.decisive

    @property
    def is_impossible(self) -> bool:
        """Whether files are wrong even if no repair is found: a rough point alone is not."""
        far = self.farthest >= CHECK.impossible_correction
        return far or self.scale >= CHECK.impossible_error * self.moved


def _adjusted(model: Model) -> list[int]:
    """Return the numbers of the parameters that are adjusted: of no effect that needs a search."""
    parameters = enumerate(model.parameters)
    return [i for i, p in parameters if p.hold is None and not (p.searched or p.optional)]


def _compliances(model: Model) -> list[int]:
    """Return the numbers of the parameters that weight or a load makes positive."""
    sizes = ((effect, plausibility(model.machine, effect).sizes) for effect in model.machine.effects)
    keys = (effect.key(name) for effect, those in sizes for name, size in those.items() if size.positive)
    return [model.keys[key] for key in keys if key in model.keys]


def _zeros(model: Model) -> list[int]:
    """Return the numbers of the estimated zeros of slides: where a slide counts from is a matter of convention."""
    machine = model.machine
    effects = [
        e for e in machine.effects if e.name == "zero_offset" and machine.kind_of(e.place) == "prismatic"
    ]
    keys = [model.keys[e.key("a")] for e in effects]
    return [i for i in keys if model.parameters[i].hold is None]


def fit_near(
    machine: Machine,
    observations: Observations,
    rounds: int,
    *,
    compiled: bool,
    enlarged: float,
    yielding: bool,
) -> NearFit | None:
    """Return the fit near the file; None where the model is not finite.

    Parameters
    ----------
    machine : Machine
        Without fitted values.
    observations : Observations
        Of this machine.
    rounds : int
        Times at most that weights and scale are found anew (expectation-maximisation: Lange, Little and Taylor 1989).
    compiled : bool
        Whether the model is compiled.
    enlarged : float
        As that of a `NearFit`.
    yielding : bool
        Whether compliances are positive: nothing moves against its weight.
    """
    model = Model(machine, observations.travel, observations.run_names, compiled=compiled)
    problem, free = Problem(model, observations), _adjusted(model)
    theta = model.start()
    if observations.attitude is not None:
        theta = with_attitudes(problem, theta, free)
    if model.structure.measurand.has_zero:
        theta = with_zeros(problem, theta, free)
    frames = nearest_frames(problem, theta)
    frame = min(frames, key=lambda frame: problem.cost(theta, frame)) if len(frames) > 1 else frames[0]
    if not np.isfinite(problem.residuals(theta, frame)).all():
        return None
    near = NearFit(problem, theta, frame, motion(problem, theta), enlarged)
    usual = tolerances(model, near.moved, usual=True)
    effects = [i for i in free if model.kinds[i] == "e"]
    square = np.diag(problem.normal_equations(theta, frame)[1])[effects]
    change = CHECK.usual_effect * near.moved * np.sqrt(np.sum(problem.weight**2) / problem.components)
    usual[effects] = np.divide(change, np.sqrt(square), out=np.ones(len(effects)), where=square > 0)
    usual[[i for i in _zeros(model) if i in free]] = np.inf
    stated, known = stated_deviations(model), model.known[1] > 0
    precision = 1 / np.where(known, stated, np.maximum(stated, usual))
    problem.knows_noise = True
    lowest = problem.file_values.lowest.copy()
    lowest[_compliances(model) if yielding else []] = 0.0
    problem.file_values = replace(
        problem.file_values, precision=precision, lowest=lowest, possible=np.zeros(len(theta))
    )
    for _ in range(rounds):
        before = near.scale
        near.weigh()
        ended = minimise(problem, near.theta, near.frame, free, max_iterations=STEPS)
        if not np.isfinite(ended.cost):
            break
        near = replace(near, theta=ended.theta, frame=ended.frame)
        if abs(np.log(near.scale / before)) < LAST and ended.converged:
            break
    return near


@dataclass(frozen=True, repr=False)
class Check(Documented, Result):
    """Whether a machine file and its data are plausible.

    Attributes
    ----------
    machine : Machine
    observations : Observations
    suspicions : tuple of str
        What is suspicious in a fit near the file; without any nothing was tried.
    wrong : bool
        Whether the files are wrong.
    before : float or None
        Error near the file as it is, rms of the rows that are not outliers, in `unit`; None where none was found.
    after : float or None
        The same with the first repair; None where none was found.
    unit : str
    repairs : tuple of Repair
        The smallest change first, then others that are equally probable.
    notes : tuple of str
        Sentences on what is remarkable, and no fault for certain.
    """

    machine: Machine
    observations: Observations
    suspicions: tuple[str, ...]
    wrong: bool
    before: float | None
    after: float | None
    unit: str
    repairs: tuple[Repair, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """What is wrong, in one sentence; empty where nothing is."""
        if not self.wrong:
            return ""
        if self.repairs:
            error = sized(self.after or 0.0, self.unit)
            error += "" if self.before is None else f" instead of {sized(self.before, self.unit)}"
            reason = f"{self.repairs[0].words}; with that the error is {error}"
            if self.before and self.after and self.after > self.before / CHECK.better:
                reason += f"; without that change {'; '.join(self.suspicions)}"
        elif self.before is None:
            reason = "; ".join(self.suspicions)
        else:
            reason = f"{'; '.join(self.suspicions)}, and no change that was tried explains that"
        return f"This looks like a wrong file: {reason}."

    @property
    def is_shown(self) -> bool:
        """Whether the data could show anything: there are more readings than parameters."""
        o, machine = self.observations, self.machine
        free = sum(p.hold is None for p in parameters_of(machine, machine.structure, o.run_names))
        return bool(o.n * len(machine.measurand.components) > free)

    def document(self) -> Document:
        """Return what is wrong, if anything, and notes."""
        name = f"{self.machine.name}, {self.observations.data.file}"
        verdict, others = [f"{name}: nothing looks wrong."], list[str]()
        if self.wrong:
            verdict = [f"{name}:", self.sentence]
            others = [f"Equally probable: {repair.words}." for repair in self.repairs[1:]]
        elif not self.is_shown:
            verdict = [
                f"{name}: too few readings, for as many parameters, to show whether something is wrong."
            ]
        lines = [Paragraph(text, "line") for text in (*self.observations.on_rows, *verdict)]
        notes = [Paragraph(text, "line") for text in self.notes]
        return Document([*lines, Bullets(others), *notes])

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, as ``rodgen check --json`` prints it."""
        return {
            **plain(self, "machine=machine.name data=observations.data.file"),
            **self.observations.not_here,
            **plain(self, "wrong suspicions error=before error_repaired=after unit notes"),
            "repairs": [repair.to_dict(self.observations) for repair in self.repairs],
        }


def check(machine: Machine | Fit, data: Any = None) -> Check:
    """Return whether a machine file and its data are plausible, and what is wrong where they are not.

    Parameters
    ----------
    machine : Machine or Fit
        Of a fit, its machine without the fitted values, and its observations.
    data : Measurements, Observations or a table in memory, optional
        Needed with a machine.

    Returns
    -------
    Check

    Raises
    ------
    InputFileError
        When the data do not fit the machine at all: a column is missing, say.
    FitError
        When a machine comes without data.
    """
    if isinstance(machine, Fit):
        search = _Search(machine.problem.model.machine, machine.observations)
    elif data is None:
        raise FitError("a machine without measurements; expected both, or a fit")
    else:
        search = _Search(machine, bind_once(machine, data))
    with one_thread_in_blas(), np.errstate(all="ignore"):
        return search.run()


class _Search:
    """The search for what is wrong with files."""

    def __init__(self, machine: Machine, observations: Observations) -> None:
        self.machine = replace(machine, values={})
        self.observations = replace(observations, machine=self.machine)
        parameters = len(parameters_of(self.machine, self.machine.structure, observations.run_names))
        self.rows = _some(self.observations, max(FEWEST_ROWS, ROWS_A_PARAMETER * parameters))
        self.unit = machine.measurand.unit(machine.length_unit)
        self.factor = unit_factor(self.unit, machine.length_unit)[0]

    def run(self) -> Check:
        right = Check(self.machine, self.observations, (), False, None, None, self.unit)
        # what is tried starts from the poses of the wrong mode, too
        if reason := other_mode(self.observations, self.machine) or self._unrecorded():
            return replace(right, suspicions=(reason,), wrong=True)
        if not np.ptp(self.observations.q, axis=0).any():
            return right
        null = self._fit(AS_IS, ROUNDS)
        if null is None:
            doubts: tuple[str, ...] = ("the model is not finite with the numbers of the file",)
        else:
            stars = self._misidentified(null)
            if stars and not wrong_rows(fitted(self.machine, self.observations)).any():
                return replace(right, suspicions=(stars,), wrong=True)
            doubts = tuple(self._doubts(null))
            notes = (*self._on_gravity(null), *([f"{capitalized(stars)}."] if stars else []))
            right = replace(right, before=null.rms / self.factor, notes=notes)
        alone = ratio_of_one_axis(self.machine, self.observations)
        if not doubts and abs(alone or 1) == 1:
            return right
        tried = self._searched(alone, np.inf if null is None else null.cost)
        named = [x for x in tried if x[1].cost - tried[0][1].cost < CHECK.equal]
        if not named or not _is_named(*named[0], null):
            wrong = null is None or null.is_impossible
            return replace(right, suspicions=doubts, wrong=wrong)
        doubts = doubts or (
            f"the readings follow {float(alone or 1):.6g} of what {self.machine.joints[0].name} reads",
        )
        named.sort(key=lambda x: (x[0].effort, x[1].cost))
        told = tuple(r.fitted(fit.model, fit.theta) if r.fitted else r for r, fit in named)
        after = named[0][1].rms / self.factor
        return replace(right, suspicions=doubts, wrong=True, after=after, repairs=told, notes=())

    def _misidentified(self, null: NearFit) -> str:
        """Return which stars of a mount were taken for others; a few stand out from a fit of all, many hide in it."""
        o = self.observations
        if mount_of(self.machine) is None or o.blocks is not None:
            return ""
        at, variance = Problem(null.model, o).places(null.theta, null.frame), null.scale**2
        square = np.sum((o.reading - at) ** 2, axis=1)
        rows = square > elsewhere(o.n, variance) * variance
        return on_stars(o, at, rows, variance) if rows.any() else ""

    def _doubts(self, fit: NearFit) -> Iterator[str]:
        """Yield why a repair could gain: the error is larger than missing effects leave, or corrections are."""
        if fit.is_rough:
            yield (
                f"with numbers near those of the file the error is {sized(fit.rms / self.factor, self.unit)}, while "
                f"the joints move what is measured by {sized(fit.moved / self.factor, self.unit)}"
            )
        if fit.prices.sum() >= CHECK.decisive:
            worst = int(np.argmax(fit.prices))
            parameter = fit.model.parameters[worst]
            yield f"{parameter.key} is {three_digits(fit.theta[worst] / parameter.factor)} {parameter.unit} off"

    def _unrecorded(self) -> str:
        """Return that no joint moves, but what is measured does; empty where it stays."""
        o = self.observations
        if np.ptp(o.q, axis=0).any():
            return ""
        problem = Problem(Model(self.machine, o.travel, o.run_names, compiled=False), o)
        around = self.machine.measurand.error(problem.residuals(problem.model.start(), Frame.identity()))
        for k in np.unique(o.target):
            around[o.target == k] -= around[o.target == k].mean(axis=0)
        moved = float(np.sqrt(np.mean(around**2)))
        if moved < CHECK.imperfect * _size(problem):
            return ""
        names = [joint.column for joint in self.machine.joints if joint.is_read]
        return (
            f"{joined(names)} {'have' if len(names) > 1 else 'has'} the same command in all {o.n} rows, but the "
            f"readings move by {sized(moved / self.factor, self.unit)}: the commands were not recorded"
        )

    def _on_gravity(self, null: NearFit) -> Iterator[str]:
        """Yield the question whether gravity has its direction, where weights lift."""
        o, search, base = self.observations, self, null
        if o.load is not None and np.ptp(o.load) > 0 and not self.machine.kinematics.is_closed:
            windups = (e for e in catalogue_effects(self.machine, o) if e.name == "load_windup")
            search = _Search(reduce(Machine.with_effect, windups, self.machine), o)
            base = search._fit(AS_IS, ROUNDS) or null
        below = [i for i in _compliances(base.model) if base.theta[i] < 0 < base.prices[i]]
        if not below:
            return
        tried = [AS_IS, *(r for r in repairs(search.machine, o) if r.kind == "gravity")]
        held, *fits = (search._fit(r, ROUNDS, yielding=True) for r in tried)
        costs = [(fit.cost, repair) for fit, repair in zip(fits, tried[1:], strict=True) if fit]
        cost, best = min(costs, key=lambda x: x[0], default=(np.inf, AS_IS))
        if held is None or held.cost - cost < CHECK.decisive:
            return
        most = base.model.parameters[max(below, key=lambda i: base.prices[i])]
        value = f"{most.key} = {three_digits(base.theta[base.model.keys[most.key]] / most.factor)}"
        yield (
            f"Is gravity the right way round? With that of the file weight lifts what it should lower, {value}; "
            f"more probably {best.words}."
        )

    def _searched(self, alone: Fraction | None, cost: float) -> list[tuple[Repair, NearFit]]:
        """Return the repairs, the most probable first; where none does alone, several, given the cost of none."""
        singles = repairs(self.machine, self.observations, alone)
        tried = self._tried(singles)
        if tried and tried[0][1].is_open:
            tried += self._tried(self._of_several_axes(singles, cost))
            tried.sort(key=lambda x: x[1].cost)
        if tried and tried[0][1].is_open:
            most = [first for first, _ in tried[:BEAM]]
            pairs = self._tried([a.then(b) for a in most for b in singles if a.kind != b.kind])
            if pairs and pairs[0][1].cost < tried[0][1].cost - CHECK.decisive:
                return pairs
        return tried

    def _of_several_axes(self, singles: Sequence[Repair], cost: float) -> Iterator[Repair]:
        """Yield senses and ratios of all joints at once, also in the likeliest other orders of joints or columns."""
        seen = {repair.words for repair in singles}
        orders = self._tried(repair for repair in singles if repair.is_order)
        # the order of slides, for one, changes nothing
        others = [repair for repair, fit in orders if abs(fit.cost - cost) > CHECK.equal]
        for order in (AS_IS, *others[:ORDERS]):
            tried = self._tried(order.then(r) for r in free_ratios(self.machine, self.observations))
            for fit in (fit for _, fit in tried[:BEAM] if not fit.is_rough):
                for ratios in found_ratios(self.observations, fit.model, fit.theta, fit.deviations):
                    repair = order.then(ratios)
                    if repair.words not in seen:
                        seen.add(repair.words)
                        yield repair
                    simple = self._fit(repair, ROUNDS)
                    if simple and simple.scale < CHECK.better * fit.scale:
                        break

    def _tried(self, candidates: Iterable[Repair]) -> list[tuple[Repair, NearFit]]:
        """Return the fits with repairs, best first: those that look best after a few steps, then carried on."""
        for rounds in (FIRST_ROUNDS, ROUNDS):
            those = each("looking for what is wrong", list(candidates))
            fits = [(repair, fit) for repair in those if (fit := self._fit(repair, rounds))]
            fits.sort(key=lambda x: x[1].cost)
            candidates = [repair for repair, _ in fits[:FINALISTS]]
        return fits

    def _fit(self, repair: Repair, rounds: int, *, yielding: bool = False) -> NearFit | None:
        try:
            machine, observations = repair.applied(self.machine, self.observations, self.rows)
            # others are fitted a few times only
            compiled = repair is not AS_IS and machine.structure == self.machine.structure and not yielding
            return fit_near(
                machine, observations, rounds, compiled=compiled, enlarged=repair.enlarges, yielding=yielding
            )
        except RodgenError:  # there is no such machine, or its legs do not close
            if repair is AS_IS:
                raise
            return None


def _is_named(repair: Repair, fit: NearFit, null: NearFit | None) -> bool:
    """Return whether a repair makes the data so much more probable that the file is wrong.

    What it saves must be errors of most rows, or corrections where usual ones are left: a little of both may be chance.
    Several changes, which are chosen among very many, must leave no more than effects do. Readings that are hardly more
    than the parameters and the changes fit some change whatever is wrong.
    """
    largest = CHECK.impossible_error if repair.changes < 2 else CHECK.imperfect
    readings = fit.problem.observations.n * fit.problem.components
    if readings - len(_adjusted(fit.model)) - repair.changes < EVIDENCE.fewest_residual_dof:
        return False
    if fit.largest_scale >= largest * fit.moved or fit.farthest >= 1:
        return False
    if null is None:
        return True
    usual = special.chdtri(max(np.count_nonzero(fit.problem.file_values.precision), 1), CHECK.chance)
    saved = null.prices.sum() - fit.prices.sum() > CHECK.decisive and fit.prices.sum() <= usual
    lower = fit.scale < null.scale / CHECK.better
    return bool(null.cost - fit.cost > CHECK.decisive and (lower or saved or null.is_impossible))


def _some(o: Observations, most: int) -> Any:
    """Return numbers of rows, of those whose neighbours are there, too, unless there are few."""
    far = max(far_offsets(o))
    rows = np.arange(o.n) if o.n <= 4 * far else np.arange(far, o.n - far)
    return rows if len(rows) <= most else np.sort(np.random.default_rng(0).choice(rows, most, replace=False))
