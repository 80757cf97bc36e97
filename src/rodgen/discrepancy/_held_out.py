"""How well a fit predicts poses that it did not see.

The poses are dealt into folds, each spread over the whole run. The model is fitted anew, from the values of the full
fit, without the poses of one fold, and predicts these; so every pose is predicted once by a fit that did not know it.
Which weights at later joints were taken in, and which rows are outliers, is as in the full fit.

A pose that alone tells of something (the only one of its set-up, or of its target) is predicted by nothing. The part of
what is known of a combination of parameters that a fold holds is an eigenvalue of the fold's share of the
information, in coordinates in which all of it is the identity; where it is 1, the other folds know nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.discrepancy._least_squares import minimise
from rodgen.discrepancy._noise import figure
from rodgen.discrepancy._poses import groups
from rodgen.discrepancy._problem import Problem, one_thread_in_blas
from rodgen.discrepancy._whitened import Whitened
from rodgen.errors import RodgenError

if TYPE_CHECKING:
    from rodgen.discrepancy._bind import Observations
    from rodgen.discrepancy.fit import Fit

__all__ = ["HeldOut", "held_out"]

Array: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int_]
Mask: TypeAlias = NDArray[np.bool_]

ONE_AT_A_TIME = 100
"""Up to so many poses each is a fold of its own."""
FOLDS, FOLDS_OF_MANY, MANY_ROWS = 10, 5, 100_000
"""Folds of more poses, and of so many rows that every fit takes seconds."""
FEWEST_APART = 5
"""Replicates are kept together while so many places are left to tell apart."""
ALONE = 1e-6
"""A fold that leaves the others less than this part of what is known of something is alone in knowing it."""
NO_SAY = 1e-100
"""Weight of a row that a fit does not see, instead of zero, so that its residual can be had from the weighted one."""
NAMED = 3


@dataclass(frozen=True)
class HeldOut:
    """The error on poses that the fit did not see.

    Attributes
    ----------
    rms : float or None
        Per scalar reading, in `unit`, without outliers; None where no pose can be predicted from others.
    unit : str
    folds : int
        How many fits were made.
    poses : int
        How many poses were dealt.
    unpredicted : tuple of int
        Rows that are left out, because nothing but their own fold tells of something that they depend on.
    because : tuple of str
        Keys of the parameters that this is.
    converged : bool
        Whether every fit ended.
    """

    rms: float | None
    unit: str
    folds: int
    poses: int
    unpredicted: tuple[int, ...] = ()
    because: tuple[str, ...] = ()
    converged: bool = True

    @property
    def text(self) -> str:
        """One or two sentences."""
        return " ".join(self._sentences())

    def _sentences(self) -> Iterator[str]:
        if self.rms is None:
            yield "No pose can be predicted from the others, so that there is no held-out error."
        else:
            how = "one at a time" if self.folds == self.poses else f"in {self.folds} folds"
            poses = f"{self.poses} poses, {how}"
            yield f"On poses that the fit did not see the rms is {figure(self.rms)} {self.unit} ({poses})."
        if self.unpredicted:
            names = ", ".join(self.because[:NAMED]) + (" …" if len(self.because) > NAMED else "")
            rows = f"{len(self.unpredicted)} row{'s' * (len(self.unpredicted) != 1)}"
            yield f"Left out: {rows} without which nothing tells of {names}."
        if not self.converged:
            yield "Not all of these fits converged."

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "rms": self.rms,
            "unit": self.unit,
            "folds": self.folds,
            "poses": self.poses,
            "unpredicted": list(self.unpredicted),
            "because": list(self.because),
            "converged": self.converged,
            "text": self.text,
        }


def held_out(
    fit: Fit, *, folds: int | None = None, progress: Callable[[str, int, float], object] | None = None
) -> HeldOut:
    """Predict every pose by a fit to others.

    Parameters
    ----------
    fit : Fit
        To all poses.
    folds : int, optional
        Into how many parts the poses are dealt, 2 or more; as many as there are poses, if that is fewer. Left out:
        each of up to 100 poses alone, else 10, or 5 of more than 100 000 rows.
    progress : callable, optional
        Called with what is done, the iteration and the cost.

    Raises
    ------
    RodgenError
        For fewer than two folds.
    """
    if folds is not None and folds < 2:
        raise RodgenError(f"held out in {folds} folds; expected 2 or more")
    o = fit.observations
    pose, poses = _dealt(o)
    if folds is None:
        many = FOLDS_OF_MANY if o.n > MANY_ROWS else FOLDS
        folds = poses if poses <= ONE_AT_A_TIME else many
    folds = min(folds, poses)
    if folds < 2:
        return HeldOut(None, fit.unit, 0, poses)
    fold = _folds(poses, folds)[pose]
    unpredicted, because = _alone(fit, fold, folds)
    wanted = ~fit.outliers & ~unpredicted
    problem = Problem(fit.problem.model, o)
    squares, converged = 0.0, True
    with one_thread_in_blas():
        for k in range(folds):
            held = fold == k
            if not (held & wanted).any():
                continue
            tell = None if progress is None else _told(progress, f"held out {k + 1} of {folds}")
            problem.set_weight(np.where(held | fit.outliers, NO_SAY, 1.0))
            start = fit.solution
            solution = minimise(problem, start.theta, start.frame, fit.free, progress=tell)
            converged &= solution.converged
            residuals = replace(fit, problem=problem, solution=solution).residuals[held & wanted]
            squares += float(np.sum(residuals**2))
    count = int(wanted.sum()) * problem.components
    return HeldOut(
        float(np.sqrt(squares / count)) if count else None,
        fit.unit,
        folds,
        poses,
        tuple(np.flatnonzero(unpredicted).tolist()),
        because,
        converged,
    )


def _told(progress: Callable[[str, int, float], object], what: str) -> Callable[[int, float], object]:
    return lambda iteration, cost: progress(what, iteration, cost)


def _dealt(o: Observations) -> tuple[Ints, int]:
    """Return the number of what is dealt, for each row, and how many these are: replicates of a pose go with it.

    Equal commands, directions of approach and load are told by the first row of a pose.
    """
    _, first, pose = np.unique(o.pose, return_index=True, return_inverse=True)
    load = [] if o.load is None else [o.load[first]]
    together = groups([*o.q[first].T, *o.s[first].T, *load], len(first))
    if int(together.max(initial=0)) + 1 < min(FEWEST_APART, len(first)):
        return pose, len(first)
    _, seen, number = np.unique(together, return_index=True, return_inverse=True)
    rank = np.empty(len(seen), int)
    rank[np.argsort(seen)] = np.arange(len(seen))  # in the order in which they were taken
    return rank[number][pose], len(seen)


def _folds(poses: int, folds: int) -> Ints:
    """Deal poses so that every fold has one of each stretch; at random, because commands may repeat in any period."""
    random = np.random.default_rng(0)
    stretches = -(-poses // folds)
    return np.concatenate([random.permutation(folds) for _ in range(stretches)])[:poses]


def _alone(fit: Fit, fold: Ints, folds: int) -> tuple[Mask, tuple[str, ...]]:
    """Return the rows that depend on what only their own fold tells, and the parameters that this is."""
    whitened = Whitened(fit)
    root = whitened.root
    shares = np.zeros((folds, root.shape[1], root.shape[1]))
    for rows, jacobian in whitened.jacobian_blocks():
        for k in np.unique(fold[rows]):
            part = jacobian[fold[rows] == k].reshape(-1, root.shape[1])
            shares[k] += part.T @ part
    known: dict[int, Array] = {}
    for k, share in enumerate(shares):
        values, vectors = np.linalg.eigh(share)
        if (values > 1 - ALONE).any():
            known[k] = vectors[:, values > 1 - ALONE]
    alone = np.zeros(fit.observations.n, bool)
    if not known:
        return alone, ()
    for rows, jacobian in whitened.jacobian_blocks():
        for k, direction in known.items():
            felt = np.linalg.norm(jacobian @ direction, axis=(1, 2)) ** 2 > ALONE
            alone[rows[felt & (fold[rows] == k)]] = True
    spread = np.linalg.norm(root, axis=1)
    spread[spread == 0.0] = 1.0
    parts = np.max([np.linalg.norm(root @ d, axis=1) / spread for d in known.values()], axis=0)
    return alone, tuple(p.key for p, part in zip(fit.parameters, parts, strict=True) if part**2 > 0.5)
