"""How the residuals of readings depend on each other, estimated beside everything that may be missing in the model.

A machine does not repeat a pose exactly, which all readings of the pose share, and a set-up wanders while it is
measured. To a test that takes readings for independent, both look like effects. So their variances are estimated, by
restricted maximum likelihood (Patterson and Thompson 1971) with the columns of the model and of all candidates as fixed
effects: a missing effect is not taken for a drift, and a drift that resembles an effect is known from how it wanders
beside the candidates. What `_whitening` calls u is the pose's part, x the wander.

A part stays where the restricted likelihood falls without it by more than chance alone makes of it in one of ten cases:
a drift that is overlooked makes false claims, one too many costs a little power.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.calibration.diagnose.whitening import Moments, Motion, Part, Poses
from rodgen.calibration.problem import one_thread_in_blas

if TYPE_CHECKING:
    from rodgen.calibration.diagnose.sensitivities import Carriers

__all__ = ["Correlation", "correlation", "covariance_of_estimates"]

Array: TypeAlias = NDArray[np.float64]

LEAST_POSES = 8
"""Of fewer poses nothing is said of how they depend on each other."""
MOST_POSES = 300
STRETCHES = 5
"""Of more poses so many stretches are looked at: neighbours tell of short times, stretches of long ones."""
CALLED_FOR = 0.01
"""An effect is taken for there, whatever wanders, where chance over all of them does as much so rarely."""
CAREFUL = 2 / 3
"""Of the logarithm of that probability where something wanders beside the effect, too: the rest is that of F with the
variances as they are without it. The likelihood ratio alone is too sure of slow effects then (in up to one of ten data
sets with drift), and F nearly blind to them."""
MOST_EFFECTS = 6
TRIED = 3
"""Effects that are held against wander alone, each time; those that are alike count as one."""
ALIKE = 0.9
GAIN = {"pose": 4.0, "wander": 5.0}
"""By how much twice the logarithm of the restricted likelihood grows by chance in one of ten cases."""
SMALLEST, LARGEST = 0.03, 300.0
"""Standard deviations beside a reading's own: less is nothing, and more leaves a reading's own unknown."""
LONGEST = 5.0
"""Of the correlation time, in durations of a run: beyond, it is a random walk."""
NO_READING = 1e-30
"""Weights below this part of the largest belong to readings that are not believed."""
NO_RESIDUAL = 1e-13
"""Residuals below this part of the readings are rounding."""
DETERMINED = 1e-9
"""Directions of the model's columns below this part of the largest, scaled alike, are gauge (see `determinacy`)."""
VISIBLE = 1e-3
"""Directions of the candidates' columns of which less is left beside others are not looked at by themselves."""


@dataclass(frozen=True)
class Correlation:
    """How errors of readings depend on each other.

    Attributes
    ----------
    white : float
        Standard deviation of a reading's own error, in units of a weighted residual: 1 where the noise that is stated
        is the readings' own.
    pose_t, pose_r : float
        What the readings of a pose share: the same of a translation and a turn of the frame, at the mean reading.
    wander_t, wander_r : float
        What changes slowly from pose to pose.
    time : float
        After which a wander has forgotten 63 % of what it was; seconds, or poses where there are no times.
    text : str
        The same for people; empty where readings are independent.
    """

    white: float
    pose_t: float
    pose_r: float
    wander_t: float
    wander_r: float
    time: float
    text: str
    _motion: Motion | None = field(default=None, repr=False, compare=False)
    _part: Part | None = field(default=None, repr=False, compare=False)

    @property
    def independent(self) -> bool:
        """Whether readings are taken for independent."""
        return self._part is None

    def whiten(self, columns: Array) -> Array:
        """Bring columns of weighted readings to where errors are independent, with the variance `white`².

        Parameters
        ----------
        columns : ndarray, shape (n, m, K)
            In the rows that the correlation was estimated on.

        Returns
        -------
        ndarray, shape (n, m, K)
        """
        if self._motion is None or self._part is None:
            return columns
        with one_thread_in_blas():
            return self._motion.whiten(self._part, columns)


def covariance_of_estimates(correlation: Correlation, jacobian: Array) -> Array:
    """Return the covariance of what an ordinary least-squares fit estimates where errors are correlated.

    Parameters
    ----------
    correlation : Correlation
    jacobian : ndarray, shape (n, m, p)
        Derivatives of the weighted residuals.

    Returns
    -------
    ndarray, shape (p, p)
        (JᵀJ)⁺ JᵀVJ (JᵀJ)⁺, V as estimated; zero along directions that change no reading.
    """
    p = jacobian.shape[2]
    if not p:
        return np.zeros((0, 0))
    size = np.linalg.norm(jacobian.reshape(-1, p), axis=0)
    size[size == 0.0] = 1.0
    scaled = jacobian / size
    with one_thread_in_blas():
        triangle = np.linalg.qr(scaled.reshape(-1, p), mode="r")
        _, values, vt = np.linalg.svd(triangle)
        kept = values > DETERMINED * max(values.max(initial=0.0), 1e-300)
        v = vt[: len(values)][kept].T / values[kept]  # scaled @ v is orthonormal
        motion, part = correlation._motion, correlation._part
        middle = np.eye(v.shape[1])
        if motion is not None and part is not None:
            middle = motion.covariance_of(part, scaled @ v)
        v = v / values[kept]
        return np.asarray(
            correlation.white**2 * (v * values[kept] @ middle @ (v * values[kept]).T)
        ) / np.outer(size, size)


def correlation(carriers: Carriers, nuisance: Array | Sequence[Array]) -> Correlation:
    """Estimate how the residuals of a fit depend on each other.

    Parameters
    ----------
    carriers : Carriers
    nuisance : sequence of ndarray, each of shape (n, m, k), or ndarray, shape (n, m, K)
        Columns of each candidate, or of all, each by itself; those of the fit's own parameters are taken out anyhow.
    """
    with one_thread_in_blas():
        return _correlation(carriers, nuisance)


def _correlation(carriers: Carriers, nuisance: Array | Sequence[Array]) -> Correlation:
    fit = carriers.fit
    weight = np.broadcast_to(carriers.weight, carriers.residual.shape)
    believed = weight > NO_READING * weight.max(initial=0.0)
    poses = Poses.among(carriers.observations)
    motion, groups = _motion(poses, carriers.frame, believed)
    rows, some = poses.taken(_chosen(poses.count))
    residual = np.where(believed, carriers.residual, 0.0)[rows].ravel()
    readings = int(believed[rows].sum())
    own = _own(_flat(carriers.model[rows]))
    residual = _off(own, residual)
    freedoms = readings - own.shape[1]
    scatter = float(residual @ residual)
    rounding = NO_RESIDUAL**2 * fit.problem.scale * len(some.of) / max(fit.observations.n, 1)
    if freedoms < 1 or scatter <= rounding:
        return Correlation(0.0, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    white = float(np.sqrt(scatter / freedoms))
    known = np.bincount(poses.of[believed.any(axis=1)], minlength=poses.count)
    if np.count_nonzero(known) < LEAST_POSES or freedoms < LEAST_POSES:
        return Correlation(white, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    effects = (
        [nuisance[:, :, [i]] for i in range(nuisance.shape[2])]
        if isinstance(nuisance, np.ndarray)
        else nuisance
    )
    columns = [_flat(effect[rows]) for effect in effects]
    sample = Motion(some, motion.columns[rows])
    several = int(np.count_nonzero(known > 1)) >= LEAST_POSES
    found, part = _Beside(sample, groups, poses, own, columns, residual / white, readings).best(pose=several)
    if part is None:
        return Correlation(white, 0.0, 0.0, 0.0, 0.0, np.inf, "")
    white *= float(np.sqrt(found.variance))
    sizes = {name: white * size for name, size in zip(found.names, found.sizes, strict=True)}
    pose_t, pose_r, wander_t, wander_r = (
        sizes.get(name, 0.0) for name in ("pose t", "pose r", "wander t", "wander r")
    )
    time = found.time if wander_t or wander_r else np.inf
    typical = 1 / (float(np.median(weight[believed])) * fit.unit_factor)
    text = _text([typical * x for x in (white, pose_t, pose_r, wander_t, wander_r)], fit.unit, time, poses)
    return Correlation(white, pose_t, pose_r, wander_t, wander_r, time, text, motion, part)


def _motion(poses: Poses, frame: Array, believed: NDArray[np.bool_]) -> tuple[Motion, dict[str, slice]]:
    """Return the frame's motion in units of what it does to the mean reading, and its freedoms by name."""
    H = np.where(believed[:, :, None], frame, 0.0)
    named = {"r": slice(0, 3)} if H.shape[2] == 3 else {"t": slice(0, 3), "r": slice(3, 6)}
    groups = {}
    for name, of in named.items():
        size = np.sqrt(np.sum(H[:, :, of] ** 2) / max(int(believed.sum()), 1))
        if size > 0:
            H[:, :, of] /= size
            groups[name] = of
    return Motion(poses, H), groups


def _chosen(count: int) -> NDArray[np.bool_]:
    """Return which poses are looked at."""
    kept = np.ones(count, np.bool_)
    if count > MOST_POSES:
        kept[:] = False
        length = MOST_POSES // STRETCHES
        for start in np.linspace(0, count - length, STRETCHES).astype(int):
            kept[start : start + length] = True
    return kept


def _flat(columns: Array) -> Array:
    """Return columns, (n m, K), of length 1, without those of length 0."""
    n, m, K = columns.shape
    flat = columns.reshape(n * m, K)
    size = np.linalg.norm(flat, axis=0)
    return np.asarray(flat[:, size > 0] / size[size > 0])


def _own(J: Array) -> Array:
    """Return an orthonormal basis of the model's columns."""
    if not J.shape[1]:
        return J
    triangle = np.linalg.qr(J, mode="r")
    _, values, vt = np.linalg.svd(triangle)
    kept = values > DETERMINED * max(values[0], 1e-300)
    return np.asarray(np.linalg.qr(J @ (vt[: len(values)][kept].T / values[kept]))[0])


def _off(basis: Array, columns: Array) -> Array:
    for _ in range(2):
        columns = columns - basis @ (basis.T @ columns)
    return columns


def _seen(basis: Array, columns: Array) -> Array:
    """Return an orthonormal basis of what columns of length 1 do beside another basis."""
    u, values, _ = np.linalg.svd(_off(basis, columns), full_matrices=False)
    return np.asarray(_off(basis, u[:, values > VISIBLE]))


class _Beside:
    """Estimates variances beside the effects that the data call for whatever wanders.

    Parameters
    ----------
    motion : Motion
    groups : mapping of str to slice
        Freedoms that share a variance.
    poses : Poses
        All of them.
    own : ndarray, shape (N, q)
        Orthonormal basis of the model's columns.
    effects : sequence of ndarray, each of shape (N, k)
        Columns of candidates, of length 1.
    residual : ndarray, shape (N,)
    readings : int
    """

    def __init__(
        self,
        motion: Motion,
        groups: dict[str, slice],
        poses: Poses,
        own: Array,
        effects: Sequence[Array],
        residual: Array,
        readings: int,
    ) -> None:
        self.motion, self.groups, self.poses = motion, groups, poses
        self.own, self.effects, self.residual, self.readings = own, effects, residual, readings

    def best(self, *, pose: bool) -> tuple[_Found, Part | None]:
        """Return the variances; no part where readings are independent."""
        basis, effects = self.own, list(self.effects)
        search = self._search(basis)
        found = search.best(pose=pose)
        for _ in range(MOST_EFFECTS):
            if not found.names:
                return found, None
            called = self._called_for(basis, effects, found)
            if called is None:
                break
            basis = np.concatenate([basis, _seen(basis, effects.pop(called))], axis=1)
            search = self._search(basis)
            found = search.best(pose=pose)
        return found, search.part(found) if found.names else None

    def _search(self, fixed: Array, further: Array | None = None) -> _Search:
        columns = (
            [fixed, self.residual[:, None]] if further is None else [fixed, further, self.residual[:, None]]
        )
        whole = np.concatenate(columns, axis=1).reshape(*self.motion.columns.shape[:2], -1)
        return _Search(Moments(self.motion, whole), self.readings, fixed.shape[1], self.groups, self.poses)

    def _called_for(self, basis: Array, effects: Sequence[Array], now: _Found) -> int | None:
        """Return the effect that is there whatever wanders, None where there is none.

        Wander and effect are held against wander alone, each with the variances that suit it best. The restricted
        likelihood is that of the residuals beside the model's columns alone, or two of them could not be compared.
        """
        seen = [_seen(basis, effect) for effect in effects]
        count = sum(1 for u in seen if u.shape[1])
        order = self._promising(basis, seen, now)
        best, found = np.log(CALLED_FOR), None
        for i, log_now in order:
            k = seen[i].shape[1]
            search = self._search(basis, seen[i])
            there = search.again(now)
            gain = max(2 * (there.likelihood - now.likelihood), 0.0)
            fall = -np.expm1(-gain / search.freedoms)
            log = _log_p(fall, k, search.freedoms - k) + np.log(count)
            if any(name.startswith("wander") for name in there.names):
                log = CAREFUL * log + (1 - CAREFUL) * (log_now + np.log(count))
            if log < best:
                best, found = log, i
        return found

    def _promising(self, basis: Array, seen: Sequence[Array], now: _Found) -> list[tuple[int, float]]:
        """Return the effects that explain most, if readings were independent or as they are taken to be now.

        With the logarithm of the probability of the latter.
        """
        columns = np.concatenate([basis, *seen, self.residual[:, None]], axis=1)
        moments = Moments(self.motion, columns.reshape(*self.motion.columns.shape[:2], -1))
        part = _part(now.names, now.sizes, now.time, self.groups, self.motion.freedoms)
        chosen: dict[int, float] = {}
        both = [_log_ps(moments.inverse(part)[0], basis.shape[1], seen, self.readings)]
        both.append(_log_ps(moments.square, basis.shape[1], seen, self.readings))
        for logs in both:
            some: list[int] = []
            for i in sorted(logs, key=lambda i: logs[i]):
                if len(some) < TRIED and not any(_alike(seen[i], seen[j]) for j in some):
                    some.append(i)
                    chosen[i] = both[0].get(i, 0.0)
        return list(chosen.items())


def _alike(one: Array, other: Array) -> bool:
    """Tell whether two orthonormal bases are nearly of the same space, as those of one effect with two periods are."""
    return one.shape == other.shape and float(np.sum((one.T @ other) ** 2)) > ALIKE * one.shape[1]


def _log_ps(products: Array, q: int, seen: Sequence[Array], readings: int) -> dict[int, float]:
    """Return the logarithm of the probability of F of each effect, from products of [fixed, effects, residual]."""
    A, B = products[:q, :q], products[:q, q:]
    left = products[q:, q:] - (B.T @ np.linalg.solve(A, B) if q else 0.0)
    total, found, start = float(left[-1, -1]), {}, 0
    for i, u in enumerate(seen):
        k = u.shape[1]
        of = slice(start, start + k)
        start += k
        if not k or readings - q - k < 1 or total <= 0:
            continue
        along = left[of, -1]
        fall = float(along @ np.linalg.lstsq(left[of, of], along, rcond=1e-10)[0])
        found[i] = _log_p(fall / total, k, readings - q - k)
    return found


def _log_p(fall: float, k: int, spare: int) -> float:
    """Return the logarithm of the probability that k columns explain such a part of what there is by chance."""
    from scipy.special import betainc

    p = float(betainc(max(spare, 1) / 2, k / 2, min(max(1 - fall, 0.0), 1.0)))
    return float(np.log(max(p, 1e-300)))


@dataclass(frozen=True)
class _Found:
    """A maximum of the restricted likelihood."""

    names: tuple[str, ...]
    sizes: tuple[float, ...]
    time: float
    likelihood: float
    variance: float


def _part(
    names: Sequence[str], sizes: Sequence[float], time: float, groups: dict[str, slice], freedoms: int
) -> Part:
    by = {"pose": np.zeros(freedoms), "wander": np.zeros(freedoms)}
    for name, size in zip(names, sizes, strict=True):
        what, group = name.split()
        by[what][groups[group]] = size
    return Part(by["pose"], by["wander"], time)


class _Search:
    """Finds which variances are there.

    Parameters
    ----------
    moments : Moments
        Of an orthonormal basis of fixed effects, of further ones, and of the residuals last.
    readings : int
    fixed : int
        Number of fixed effects that are not further ones: what they explain is no evidence of anything.
    groups : mapping of str to slice
        Freedoms that share a variance.
    poses : Poses
    """

    def __init__(
        self, moments: Moments, readings: int, fixed: int, groups: dict[str, slice], poses: Poses
    ) -> None:
        self.moments = moments
        self.fixed = fixed
        self.freedoms = readings - fixed
        self.groups = groups
        self.poses = poses
        self.count = moments.gram.shape[1]

    def part(self, found: _Found) -> Part:
        """Return variances by freedom."""
        return _part(found.names, found.sizes, found.time, self.groups, self.count)

    def at(self, names: Sequence[str], sizes: Sequence[float], time: float) -> _Found:
        """Evaluate the restricted likelihood, of which the variance of the readings' own errors is the best."""
        none = _Found(tuple(names), tuple(sizes), time, -np.inf, 1.0)
        try:
            products, logarithm = self.moments.inverse(_part(names, sizes, time, self.groups, self.count))
            triangle = np.linalg.cholesky(products)  # its last entry: what the fixed effects leave
        except np.linalg.LinAlgError:
            return none
        diagonal = np.diagonal(triangle)
        variance = float(diagonal[-1] ** 2) / self.freedoms
        if not variance > 0:
            return none
        of_fixed = float(np.sum(np.log(diagonal[: self.fixed])))
        likelihood = -0.5 * (self.freedoms * np.log(variance) + logarithm) - of_fixed
        return replace(none, likelihood=likelihood, variance=variance)

    def best(self, *, pose: bool) -> _Found:
        """Add the part that is worth more, then the other, while they are worth it."""
        now = self.at((), (), np.inf)
        waiting: dict[str, Callable[[_Found], _Found]] = {"wander": self._with_wander}
        if pose:
            waiting["pose"] = self._with_pose
        while waiting:
            tried = {name: add(now) for name, add in waiting.items()}
            gains = {
                name: 2 * (there.likelihood - now.likelihood) - GAIN[name] for name, there in tried.items()
            }
            name = max(gains, key=lambda x: gains[x])
            if not gains[name] > 0:
                break
            now = tried[name]
            del waiting[name]
        return now

    def again(self, now: _Found) -> _Found:
        """Climb with the parts that there are, from where they are, and from nearly nothing."""
        starts = [self.at(now.names, now.sizes, now.time)]
        starts.append(self.at(now.names, [min(size, 4 * SMALLEST) for size in now.sizes], now.time))
        return max((self._climbed(start) for start in starts), key=lambda x: x.likelihood)

    def _with_pose(self, now: _Found) -> _Found:
        names = tuple(f"pose {group}" for group in self.groups)
        started = [
            self.at((*now.names, *names), (*now.sizes, *[size] * len(names)), now.time) for size in (0.5, 2.0)
        ]
        return self._climbed(max(started, key=lambda x: x.likelihood))

    def _with_wander(self, now: _Found) -> _Found:
        names = tuple(f"wander {group}" for group in self.groups)
        started = [
            self.at((*now.names, *names), (*now.sizes, *[size] * len(names)), time)
            for time in np.geomspace(self.shortest, self.longest, 6)[1:]
            for size in (0.4, 1.5)
        ]
        return self._climbed(max(started, key=lambda x: x.likelihood))

    @property
    def shortest(self) -> float:
        """The least correlation time."""
        return self.poses.spacing

    @property
    def longest(self) -> float:
        """The greatest correlation time."""
        return max(LONGEST * self.poses.duration, 4 * self.shortest)

    def _climbed(self, start: _Found) -> _Found:
        """Climb to a maximum; what is next to nothing there is nothing."""
        from scipy.optimize import minimize

        timed = any(name.startswith("wander") for name in start.names)
        low = np.log([*[SMALLEST / 3] * len(start.sizes), *[self.shortest] * timed])
        high = np.log([*[LARGEST] * len(start.sizes), *[self.longest] * timed])
        x = np.clip(np.log([*start.sizes, *[start.time] * timed]), low, high)
        simplex = np.vstack([x, x + np.diag(np.where(x < (low + high) / 2, 0.7, -0.7))])
        best = start

        def cost(x: Array) -> float:
            nonlocal best
            sizes = np.exp(np.clip(x, low, high))
            there = self.at(
                start.names, sizes[: len(start.sizes)].tolist(), float(sizes[-1]) if timed else np.inf
            )
            if there.likelihood > best.likelihood:
                best = there
            return -there.likelihood

        limits = {"maxfev": 30 * len(x), "xatol": 0.02, "fatol": 0.01, "initial_simplex": simplex}
        minimize(cost, x, method="Nelder-Mead", options=limits)
        kept = [i for i, size in enumerate(best.sizes) if size > SMALLEST]
        if len(kept) == len(best.sizes):
            return best
        return self.at([best.names[i] for i in kept], [best.sizes[i] for i in kept], best.time)


def _text(sizes: Sequence[float], unit: str, time: float, poses: Poses) -> str:
    """Say it in a sentence; sizes in the fit's unit: a reading's own, those of a pose, those that wander."""
    shared, wander = float(np.linalg.norm(sizes[1:3])), float(np.linalg.norm(sizes[3:5]))
    said = []
    if shared:
        said.append(f"readings of one pose share an error of {shared:.2g} {unit}")
    if wander:
        over = _time(time, poses)
        said.append(f"the set-up wanders by {wander:.2g} {unit} {over}")
    if not said:
        return ""
    text = ", and ".join(said)
    return f"{text[0].upper()}{text[1:]}, beside {sizes[0]:.2g} {unit} of each reading's own."


def _time(time: float, poses: Poses) -> str:
    if time > 2 * poses.duration:
        return "from beginning to end, as a random walk does"
    if not poses.timed:
        return f"within some {time:.2g} poses" if time < 100 else f"within some {time:.0f} poses"
    for size, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if time >= 2 * size:
            return f"within some {time / size:.2g} {name}"
    return f"within some {time:.2g} seconds"
