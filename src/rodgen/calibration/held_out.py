"""How well a fit predicts poses that it did not see.

The fit without the poses of one fold predicts these; so every pose is predicted once by a fit that did not know it.
Where several joints move, a fold is a group of neighbouring postures. A robot works in postures unlike those measured:
many joints have more postures than any calibration visits, and those of a smooth program have neighbours that share
whatever the model lacks. Poses of one axis, and stars, are dealt into folds that are spread over the whole run instead:
there a calibration covers the travel, or the sky, and what is used later lies between its readings.

Which weights at later joints were taken in, which rows are outliers, and where the machine stands along directions of
which its file says more than the readings, is as in the full fit: elsewhere the noise of a few poses would lead far.
Where a fold alone settles what its file leaves open, the others cannot predict it, and there is no error.

In coordinates in which all information is the identity, a fold has a share S of it and pulls at the full fit by
g = Bᵀr, B the derivative of its residuals r. Without it the fit is, to first order, (1 - S)⁻¹ g away. Where the others
agree with that point less than with the full fit, the model is fitted anew. Along an eigenvector of S with eigenvalue 1
the other folds know nothing. A pose that alone determines something, such as the only one of its set-up, is predicted
by nothing, and left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rodgen.array_types import Array, Ints, Mask
from rodgen.calibration.dependence import as_one_body
from rodgen.calibration.fitted import Fit
from rodgen.calibration.problem import Problem, one_thread_in_blas
from rodgen.calibration.solve.least_squares import NearFile, Solution, minimise, moved
from rodgen.calibration.whitened import Whitened
from rodgen.calibration.words import sized
from rodgen.data.poses import groups, positions
from rodgen.errors import RodgenError, counted, joined
from rodgen.machines.model import Frame
from rodgen.machines.observations import Observations
from rodgen.stages import each, stage
from rodgen.statistics.decompositions import eigh
from rodgen.statistics.leave_out import ALONE, deal, neighbours, undo_leverage
from rodgen.statistics.thresholds import EVIDENCE
from rodgen.views import Result

ONE_AT_A_TIME = 100
"""Up to so many poses each is a fold of its own."""
FOLDS, FEW_FOLDS, MANY_ROWS = 10, 5, 50_000
"""Folds of more poses; groups of neighbouring postures, and folds of so many rows that a fit takes long."""
SETTLED = 10.0
"""Times that readings tell a parameter better than its machine file from which on they settle it."""
FEWEST_APART = 5
"""Replicates are kept together where the poses are at so many different places at least."""
NAMED = 3
ENOUGH = 100
"""Readings for each parameter at which the error on poses left out is that of the fit to half a per cent."""
MOVED = 0.01
"""Standard deviations by which a fit to the readings of the fit before moves a number at most."""


@dataclass(frozen=True, repr=False)
class HeldOut(Result):
    """The error on poses that the fit did not see.

    Attributes
    ----------
    rms : float or None
        Per scalar reading, in `unit`, without outliers; None where poses cannot be predicted from others.
    unit : str
    folds : int
        How many fits were made.
    poses : int
        How many poses were dealt.
    by : {"posture", "pose"}
        Whether a fold is a group of neighbouring postures, or has poses of the whole run.
    unpredicted : tuple of int
        Rows that are left out, because only their own fold determines something that they depend on.
    because : tuple of str
        Keys of the parameters that this is; where there is no error, of those that need every fold.
    converged : bool
        Whether every fit ended.
    squares : ndarray, shape (n,), or None
        Mean of the squares of each row's readings, in `unit`; NaN of a row that is not predicted, or an outlier.
    """

    rms: float | None
    unit: str
    folds: int
    poses: int
    by: str
    unpredicted: tuple[int, ...] = ()
    because: tuple[str, ...] = ()
    converged: bool = True
    squares: Array | None = field(default=None, repr=False, compare=False)

    _keys = "rms unit folds poses by unpredicted because converged reason text"

    @property
    def reason(self) -> str | None:
        """Why there is no error, or None: "one_pose", "each_fold_needed" or "each_pose_needed"; the text says it."""
        if self.rms is not None:
            return None
        if self.folds < 2:
            return "one_pose"
        return "each_pose_needed" if self.unpredicted or not self.because else "each_fold_needed"

    @property
    def text(self) -> str:
        """One or two sentences."""
        return " ".join(self._sentences())

    def rises_from(self, before: HeldOut) -> bool:
        """Return whether it is no smaller than before on the rows that both predict; False where these are none."""
        now, earlier = self._with(before)
        return now is not None and earlier is not None and not now < earlier

    def compares_with(self, second: HeldOut) -> bool:
        """Return whether there are rows that both predict."""
        return None not in self._with(second)

    def predicts_no_better_than(self, before: HeldOut) -> bool:
        """Return whether it rises from before, or does not predict rows that were predicted before."""
        lost = before.rms is not None and (
            self.rms is None or bool({*self.unpredicted} - {*before.unpredicted})
        )
        return lost or self.rises_from(before)

    def _with(self, before: HeldOut) -> tuple[float | None, float | None]:
        """Return this error and the one before on the rows that both predict; None where that is not known."""
        if self.squares is None or before.squares is None or len(self.squares) != len(before.squares):
            same = self.unpredicted == before.unpredicted
            return (self.rms, before.rms) if same else (None, None)
        rows = np.isfinite(self.squares + before.squares)
        if not rows.any():
            return None, None
        return float(np.sqrt(self.squares[rows].mean())), float(np.sqrt(before.squares[rows].mean()))

    @property
    def how(self) -> str:
        """How the poses were held out."""
        if self.folds == self.poses:
            return "one posture at a time" if self.by == "posture" else "one at a time"
        if self.by == "posture":
            return f"by posture ({self.folds} groups of neighbouring postures)"
        return f"in {self.folds} folds"

    @property
    def note(self) -> str:
        """What stands below a table of such errors; empty where poses of the whole run are all predicted."""
        sentences = [] if self.rms is None or self.by == "pose" else [f"Held out {self.how}."]
        return " ".join([*sentences, *self._restrictions()])

    def _sentences(self) -> Iterator[str]:
        if self.rms is not None:
            rms = sized(self.rms, self.unit, ".3g")
            yield f"On {self.poses} poses held out {self.how} the rms is {rms}."
        yield from self._restrictions()

    def _restrictions(self) -> Iterator[str]:
        names = joined(self.because, most=NAMED)
        if self.reason == "each_fold_needed":
            parts = "poses" if self.folds == self.poses else "groups" if self.by == "posture" else "folds"
            without = f"without one of these {parts} the readings do not determine {names}"
            yield f"The poses cannot be held out {self.how}: {without}."
        elif self.reason is not None:
            yield "No pose can be predicted from the others, so that there is no held-out error."
        if self.unpredicted:
            rows = counted(len(self.unpredicted), "row")
            yield f"Left out: {rows} without which nothing determines {names}."
        if not self.converged:
            yield "Not all of these fits converged."


@dataclass(frozen=True)
class HeldOutGeometry(Result):
    """The error on poses that the fit did not see, with the estimated axes and points of joints and without."""

    fitted: HeldOut
    nominal: HeldOut

    _keys = "fitted=fitted.rms nominal=nominal.rms unit=fitted.unit lowers reason text"

    @property
    def lowers(self) -> bool | None:
        """Whether it falls by what is estimated; None where that is not known."""
        return None if self.reason else not self.fitted.rises_from(self.nominal)

    @property
    def reason(self) -> str | None:
        """Why that is not known: that of the fit without an error, or "no_common_rows"; None where it is known."""
        missing = self.fitted.reason or self.nominal.reason
        return missing or (None if self.fitted.compares_with(self.nominal) else "no_common_rows")

    @property
    def text(self) -> str:
        """A sentence."""
        with_, without = (
            "unknown" if each.rms is None else sized(each.rms, each.unit, ".3g")
            for each in (self.fitted, self.nominal)
        )
        estimated = "Axes and points of joints are estimated, and"
        rms = "the rms on poses that the fit did not see"
        if self.reason:
            return f"{estimated} the data do not show whether {rms} falls by that: {with_} with it, {without} without."
        falls = "falls" if self.lowers else "does not fall"
        return f"{estimated} {rms} {falls} by that: {with_} with it, {without} without."


def held_out_geometry(fit: Fit) -> HeldOutGeometry | None:
    """Compare a fit with one to the same readings whose joints are where the file has them.

    None where no axis or point is estimated, or all are where the file has them, as in a file that a fit wrote; and
    where there are so many readings that no parameter can follow their noise.
    """
    machine = fit.machine
    parts = {entry for entry in machine.estimate if entry.rpartition(".")[2] in ("axis", "point")}
    if not parts or fit.problem.count * fit.problem.components > ENOUGH * len(fit.free):
        return None
    geometry = [estimate for key, estimate in fit.estimates.items() if key.rpartition(".")[0] in parts]
    if not any(abs(one.value) > (MOVED * one.std if one.std else 0.0) for one in geometry if not one.held):
        return None

    def without_geometry(by_key: Any) -> Any:
        return {key: x for key, x in by_key.items() if key.rpartition(".")[0] not in parts}

    nominal = replace(
        machine,
        estimate=tuple(entry for entry in machine.estimate if entry not in parts),
        values=without_geometry(machine.values),
        ties=without_geometry(machine.ties),
        known=without_geometry(machine.known),
    )
    if any(f"{part}." in str(tie) for part in parts for tie in nominal.ties.values()):
        return None
    return HeldOutGeometry(fit.held_out(), fit.refit(nominal).held_out())


@stage("error on poses left out")
def held_out(fit: Fit, *, folds: int | None = None) -> HeldOut:
    """Predict every pose by a fit to others.

    Parameters
    ----------
    fit : Fit
        To all poses.
    folds : int, optional
        Into how many parts the poses are dealt, 2 or more; as many as there are poses, if that is fewer. Left out: 5
        groups of neighbouring postures; where these are none, each of up to 100 poses alone where the fit converged,
        else 10, or 5 of more than 50 000 rows.

    Raises
    ------
    RodgenError
        For fewer than two folds.
    """
    if folds is not None and folds < 2:
        raise RodgenError(f"held out in {folds} folds; expected 2 or more")
    o = fit.observations
    if o.blocks is not None:  # it rises from the rms as in the sample
        some = fit.refit(observations=replace(o, blocks=None), outliers=fit.outliers)
        errors = held_out(some, folds=folds)
        if not errors.rms or errors.squares is None:
            return errors
        factor = fit.rms / some.rms
        return replace(errors, rms=errors.rms * factor, squares=errors.squares * factor**2)
    places = _postures(o)
    by, pose, poses = (
        ("pose", *_poses_to_deal(o)) if places is None else ("posture", places[0], len(places[1]))
    )
    if folds is None:
        many = FEW_FOLDS if places is not None or o.n > MANY_ROWS else FOLDS
        alone = places is None and poses <= ONE_AT_A_TIME and fit.solution.converged
        folds = poses if alone else many
    folds = min(folds, poses)
    if folds < 2:
        return HeldOut(None, fit.unit, 0, poses, by)
    fold = (deal(poses, folds) if places is None else neighbours(places[1], folds))[pose]
    problem = Problem(fit.problem.model, o)
    squares, converged = np.full(o.n, np.nan), True
    with one_thread_in_blas():
        without = _Without(fit, fold, folds)
        if without.unheld:
            return HeldOut(None, fit.unit, folds, poses, by, because=without.unheld)
        wanted = ~fit.outliers & ~without.unpredicted
        shared = fit.dependence.correlation if fit.weighed else None
        predicted = [k for k in range(folds) if (wanted & (fold == k)).any()]
        for k in each("error on poses left out", predicted):
            out = (fold == k) | fit.outliers
            problem.leave_out(out)
            solution = without.fitted(problem, k)
            converged &= solution.converged
            others = replace(fit, problem=problem, solution=solution, outliers=out)
            residuals = (as_one_body(others, shared) if shared else others).residuals
            rows = wanted & (fold == k)
            squares[rows] = np.sum(residuals[rows] ** 2, axis=1) / problem.components
    return HeldOut(
        float(np.sqrt(squares[wanted].mean())) if wanted.any() else None,
        fit.unit,
        folds,
        poses,
        by,
        tuple(fit.observations.given(np.flatnonzero(without.unpredicted)).tolist()),
        without.because,
        converged,
        squares,
    )


def _postures(o: Observations) -> tuple[Ints, Array] | None:
    """Return the number of each row's posture, (n,), and the postures in parts of the travels, (postures, J).

    None where they do not form a cloud: one joint moves, or all move together, or they are few; and of stars.
    """
    if o.machine.measurand.is_direction:
        return None
    place = groups([positions(column) for column in o.q.T], o.n)
    travel = np.ptp(o.travel, axis=1)
    points = o.q[np.unique(place, return_index=True)[1]] / np.where(travel > 0, travel, 1.0)
    spread = np.linalg.eigvalsh(np.atleast_2d(np.cov(points.T, bias=True)))
    if (
        len(points) < FEWEST_APART
        or len(spread) < 2
        or not spread[-2] > EVIDENCE.same_position**2 * spread[-1]
    ):
        return None
    return place, points


def _poses_to_deal(o: Observations) -> tuple[Ints, int]:
    """Return the number of each row's pose, (n,), and how many there are; replicates of a pose count as that pose.

    Equal commands and load are those of the first row of a pose. Both directions of approach to a place are held out
    together, because they share its error.
    """
    _, first, pose = np.unique(o.pose, return_index=True, return_inverse=True)
    load = [] if o.load is None else [o.load[first]]
    place = groups([*o.q[first].T, *load], len(first))
    if int(place.max(initial=0)) + 1 < min(FEWEST_APART, len(first)):
        return pose, len(first)
    _, seen, number = np.unique(place, return_index=True, return_inverse=True)
    rank = np.empty(len(seen), int)
    rank[np.argsort(seen)] = np.arange(len(seen))  # in the order in which they were taken
    return rank[number][pose], len(seen)


class _Without:
    """A fit without one of its folds, to first order.

    Attributes
    ----------
    left : ndarray, shape (folds,)
        Sum of squares of the weighted residuals without each fold.
    shares, pulls : ndarray, shape (folds, r, r), (folds, r)
        What each fold adds to the information, and how it pulls, in coordinates in which the whole is the identity.
    unpredicted : ndarray of bool, shape (n,)
        Rows that depend on what only their own fold determines.
    because : tuple of str
        Keys of the parameters that this is.
    unheld : tuple of str
        Keys of the parameters that all readings settle, and of which the file says more than those without some fold.
    """

    def __init__(self, fit: Fit, fold: Ints, folds: int) -> None:
        self.fit, self.fold = fit, fold
        _, square, _ = fit.problem.normal_equations(fit.solution.theta, fit.solution.frame)
        near = NearFile(fit.problem, np.asarray(fit.free, int))
        variance = fit.solution.cost / fit.problem.freedom(len(fit.free))
        self.flat = near.idle(square, variance)
        self.largest = near.largest(square)
        self.whitened = Whitened(fit)
        r = self.whitened.root.shape[1]
        self.shares, self.pulls = np.zeros((folds, r, r)), np.zeros((folds, r))
        residuals = fit.problem.residuals(fit.solution.theta, fit.solution.frame, weighted=True)
        squares = np.sum(residuals**2, axis=1)
        self.left = squares.sum() - np.bincount(fold, squares, folds)
        for rows, jacobian in self.whitened.jacobian_blocks():
            for k in np.unique(fold[rows]):
                here = fold[rows] == k
                left = residuals[rows[here]].ravel()
                part = jacobian[here].reshape(len(left), r)
                self.shares[k] += part.T @ part
                self.pulls[k] += part.T @ left
        self.unpredicted, self.because = self._alone(fold)
        self.unheld = self._unheld(near, variance)

    def _unheld(self, near: NearFile, variance: float) -> tuple[str, ...]:
        keys, square = dict[str, None](), self.whitened.inverse.T @ self.whitened.inverse
        loose = len(near.idle(square, SETTLED**2 * variance))
        for share in self.shares:
            rest = np.eye(len(share)) - share
            idle = near.idle(self.whitened.inverse.T @ rest @ self.whitened.inverse, variance)
            if len(idle) > loose + np.count_nonzero(eigh(rest)[0] < ALONE):
                parts = [np.sum((rows * self.largest) ** 2, axis=0) for rows in (idle, self.flat)]
                keys[self.fit.parameters[near.index[np.argmax(parts[0] - parts[1])]].key] = None
        return tuple(keys)

    def fitted(self, problem: Problem, k: int) -> Solution:
        """Return the fit without a fold, to a problem from which its rows are left out.

        To first order, unless the full fit is better there.
        """
        solution, near = self.fit.solution, self._near(problem, k)
        cost = problem.cost(*near)
        if cost <= self.left[k]:
            return Solution(*near, cost)
        return minimise(problem, solution.theta, solution.frame, self.fit.free, kept=self.flat)

    def _near(self, problem: Problem, k: int) -> tuple[Array, Frame]:
        """Return where the fit without a fold is to first order."""
        away = undo_leverage(self.shares[k], self.pulls[k], 1.0)
        solution = self.fit.solution
        step = self.whitened.root @ away
        if len(self.flat):
            free = np.asarray(self.fit.free)
            step[free] -= (self.flat * self.largest**2).T @ (self.flat @ step[free])
        return moved(problem, solution.theta, solution.frame, step)

    def _alone(self, fold: Ints) -> tuple[Mask, tuple[str, ...]]:
        known: dict[int, Array] = {}
        for k, share in enumerate(self.shares):
            values, vectors = eigh(share)
            if (values > 1 - ALONE).any():
                known[k] = vectors[:, values > 1 - ALONE]
        alone = np.zeros(len(fold), bool)
        if not known:
            return alone, ()
        for rows, jacobian in self.whitened.jacobian_blocks():
            for k, direction in known.items():
                felt = np.linalg.norm(jacobian @ direction, axis=(1, 2)) ** 2 > ALONE
                alone[rows[felt & (fold[rows] == k)]] = True
        # of its variance, or, where that rests on a choice of coordinates, of what it does to the readings
        chosen = self.fit.determinacy.undetermined[:, None]
        parts_of = np.where(chosen, self.whitened.inverse.T, self.whitened.root)
        size = np.linalg.norm(parts_of, axis=1)
        size[size == 0.0] = 1.0
        parts = np.max([np.linalg.norm(parts_of @ d, axis=1) / size for d in known.values()], axis=0)
        parameters = zip(self.fit.parameters, parts, strict=True)
        return alone, tuple(parameter.key for parameter, part in parameters if part**2 > 0.5)
