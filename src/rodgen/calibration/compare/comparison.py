"""What a comparison of model and measurements found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.compare.dependence import Dependence, Search, Trial, search
from rodgen.calibration.compare.explained import ProjectedResiduals
from rodgen.calibration.compare.regions import Region, Worst, quarters, worst_regions
from rodgen.calibration.compare.sample import Sample, compared
from rodgen.calibration.compare.serial_correlation import Drift, drift
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.data.drivers import Driver
from rodgen.data.poses import stretches
from rodgen.statistics.robust import kurtosis_of, kurtosis_tail
from rodgen.statistics.thresholds import SMALLEST_P
from rodgen.views import Records, Result

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit

Progress: TypeAlias = Callable[[str], object]

ROUNDING = 64 * np.finfo(float).eps
"""Residuals below this part of the largest reading are rounding, of which nothing is said."""
WORST_ROWS = 5


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Result):
    """What the residuals of a fit depend on, and where the model is worst; made by :func:`compare`.

    ``print(comparison)`` shows sentences, the most important first, and a table. Every claim in the sentences is beyond
    chance: data of which nothing is missing make a claim of any kind in about one of a hundred comparisons.

    Attributes
    ----------
    fit : Fit
    sample : Sample
        What was looked at: residuals by target and pose.
    search : Search
        The tests of them, and what was found.
    worst : tuple of Worst
        The worst region of each joint and place, the clearest first.
    drifts : tuple of Drift or None
        Linear trend of each component.
    uneven : tuple of Uneven
        How the remaining scatter follows each driver.
    tails : tuple of Tails
    """

    fit: Fit
    sample: Sample
    search: Search
    worst: tuple[Worst, ...]
    drifts: tuple[Drift | None, ...]
    uneven: tuple[Uneven, ...]
    tails: tuple[Tails, ...]

    @property
    def exact(self) -> bool:
        """Whether the residuals are rounding."""
        reading = np.abs(self.fit.observations.reading)
        return bool(self.fit.rms * self.fit.unit_factor <= ROUNDING * np.max(reading, initial=0.0))

    @property
    def unit(self) -> str:
        """What residuals are in."""
        return self.fit.unit

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components of a residual."""
        return self.fit.machine.measurand.components

    @property
    def covariates(self) -> tuple[Driver, ...]:
        """What varies in the data and was compared with the residuals."""
        return tuple(d.driver for d in self.search.table if isinstance(d.driver, Driver))

    @property
    def rms(self) -> NDArray[np.float64]:
        """Root mean square of each component, (m,), in the fit's `units`, without outliers."""
        squares = np.mean(self.fit.residuals[~self.fit.outliers] ** 2, axis=0)
        return np.sqrt(squares) * self.fit.in_units  # type: ignore[no-any-return]

    @property
    def worst_rows(self) -> NDArray[np.intp]:
        """Rows with the largest residuals, outliers left out, the largest first."""
        size = np.linalg.norm(self.fit.sizes, axis=1)
        size[self.fit.outliers | ~np.isfinite(size)] = -1.0
        rows = _largest(size)
        return np.asarray(rows[size[rows] >= 0])

    @property
    def worst_poses(self) -> NDArray[np.intp]:
        """Poses with the largest residuals in the mean, by the first row of each, the largest first."""
        rows = np.flatnonzero(~self.fit.outliers)
        starts, sizes = stretches(self.fit.observations.pose[rows])
        square = np.sum(self.fit.sizes[rows] ** 2, axis=1)
        mean = np.add.reduceat(square, starts) / sizes
        return np.asarray(rows[starts[_largest(mean)]])

    def component(self, trial: Trial) -> str:
        """Name what a trial is about: a component, or the motion of a joint."""
        if trial.component is not None:
            return self.components[trial.component]
        return f"along {self.fit.machine.joints[trial.joint or 0].name}"

    def p_value(self, log10_p: float, tests: int = 1) -> float:
        """Return a p-value times a number of tests, at least 1e-300 and at most 1."""
        return float(10 ** np.clip(log10_p + np.log10(max(tests, 1)), -300.0, 0.0))

    @property
    def table(self) -> Records[dict[str, Any]]:
        """What each quantity explains alone, as dicts with the keys of :meth:`to_dict`, or as a DataFrame."""
        return Records([row for d in self.search.table for row in self._rows(d)], dict)

    @property
    def claims(self) -> list[str]:
        """The sentences that say that something is there; empty when these data show nothing."""
        from rodgen.calibration.compare.sentences import claims

        return list(claims(self))

    @property
    def sentences(self) -> list[str]:
        """What an engineer needs to know, the most important first."""
        from rodgen.calibration.compare.sentences import sentences

        return list(sentences(self))

    def __str__(self) -> str:
        from rodgen.calibration.compare.sentences import text

        return text(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, as ``rodgen compare --json`` prints it.

        Returns
        -------
        dict
            ``machine``, ``data``, ``rows``, ``copies``, ``set_aside``, ``poses``, ``outliers`` (numbers of rows,
            from 0), ``unit``, ``rms``; of ``set_aside`` how many ``rows``, and the ``entries`` of the machine file;
            ``gross``: readings that are grossly wrong: ``row``, ``component``, ``off``, ``others`` (what others are off
            at most);
            ``rows_looked_at``: fewer where there are very many;
            ``components``: ``name``, ``rms`` and ``unit`` of each;
            ``sentences``: those that are printed; ``claims``: those of them that say that something is there;
            ``depends_on``: what was found beyond chance, each given those before: ``covariate``, ``components`` (what
            it was found in: components, or ``"along JOINT"`` for a joint's reading), ``explained`` (part of the
            variance of all residuals, each in its uncertainty), ``explained_by_component``, ``p_value`` (times the
            number of tests), ``along`` (covariates that explain nothing beyond it); ``either``: ``covariate`` and
            ``explained`` of what explains most but as well a wander in time does, or null; ``withheld``: further
            covariates of which that holds, given what was found;
            ``table``: each covariate alone: ``covariate``, ``unit``, ``component``, ``explained`` (part of the variance
            of that component, along a joint of all), ``p_value`` of this test alone, ``p_value_of_all`` times the
            number of tests; both null where the data cannot tell; ``tests``: that number;
            ``drift``: ``component``, ``change`` from first to last, ``p_value`` times the number of components;
            ``correlation``: of successive poses, given what was found: ``component``, ``lag_1``, ``p_value`` likewise;
            ``allowed_for``: whether the p-values of the table allow for a wander in this component;
            ``scatter``: of the rest, against each covariate: ``covariate``, ``least`` and ``largest`` (``where``,
            ``rms``), ``p_value`` times the number of covariates; ``tails``: ``component``, ``kurtosis``, ``p_value``;
            ``worst``: ``regions`` (``covariate``, ``unit``, ``low``, ``high``, ``category``, ``where``, ``rms``, in
            stated uncertainties where these differ much,
            ``poses``, ``p_value`` times the number of regions), ``poses`` and ``rows`` (``row``, ``place``,
            ``residual`` by component).
        """
        s, tests = self.search, self.search.tests
        components = self.components
        return {
            "machine": self.fit.machine.name,
            "data": self.fit.observations.data.file,
            **self.fit.used_rows,
            "rows_looked_at": len(self.sample.rows),
            "poses": len(stretches(self.fit.observations.pose)[0]),
            "unit": self.unit,
            "rms": self.fit.rms,
            "components": [
                {"name": n, "rms": float(r), "unit": unit}
                for n, r, unit in zip(components, self.rms, self.fit.units, strict=True)
            ],
            "sentences": self.sentences,
            "claims": self.claims,
            "depends_on": [
                {
                    "covariate": f.dependence.driver.name,
                    "components": [self.component(trial) for trial in f.described],
                    "explained": f.explained,
                    "explained_by_component": {
                        n: float(fall / total) if total > 0 else 0.0
                        for n, fall, total in zip(components, f.falls, self.sample.total, strict=True)
                    },
                    "p_value": self.p_value(f.dependence.log10_p, tests),
                    "along": [driver.name for driver in f.along],
                }
                for f in s.found
            ],
            "either": s.either
            and {"covariate": s.either.dependence.driver.name, "explained": s.either.explained},
            "withheld": [driver.name for driver in s.withheld],
            "tests": tests,
            "table": list(self.table),
            "drift": [
                {
                    "component": n,
                    "change": d.change * part,
                    "p_value": self.p_value(d.log10_p, len(components)),
                }
                for n, d, part in zip(components, self.drifts, self.fit.in_units.tolist(), strict=True)
                if d
            ],
            "correlation": [
                {
                    "component": n,
                    "lag_1": c.lag_1,
                    "p_value": self.p_value(c.log10_p, len(components)),
                    "allowed_for": walk is not None,
                }
                for n, c, walk in zip(components, s.last.correlations, s.first.walks, strict=True)
                if c
            ],
            "scatter": [
                {
                    "covariate": u.covariate.name,
                    "least": {"where": u.low[0].text, "rms": u.low[1]},
                    "largest": {"where": u.high[0].text, "rms": u.high[1]},
                    "p_value": self.p_value(u.log10_p, len(self.uneven)),
                }
                for u in self.uneven
            ],
            "tails": [
                {
                    "component": components[t.component],
                    "kurtosis": t.kurtosis,
                    "p_value": self.p_value(t.log10_p, len(self.tails)),
                }
                for t in self.tails
            ],
            "worst": {
                "regions": [
                    {
                        "covariate": w.region.covariate.name,
                        "unit": w.region.covariate.unit,
                        "low": w.region.low,
                        "high": w.region.high,
                        "category": w.region.category,
                        "where": w.region.text,
                        "rms": w.rms,
                        "poses": w.poses,
                        "p_value": self.p_value(w.log10_p),
                    }
                    for w in self.worst
                ],
                "poses": [self._row(row) for row in self.worst_poses],
                "rows": [self._row(row) for row in self.worst_rows],
            },
        }

    def _rows(self, dependence: Dependence) -> list[dict[str, Any]]:
        return [
            {
                "covariate": dependence.driver.name,
                "unit": getattr(dependence.driver, "unit", ""),
                "component": self.component(trial),
                "explained": dependence.share(i) if e else None,
                "p_value": self.p_value(e.log10_p) if e else None,
                "p_value_of_all": self.p_value(e.log10_p, self.search.tests) if e else None,
            }
            for i, (trial, e) in enumerate(zip(dependence.trials, dependence.evidence, strict=True))
        ]

    def _row(self, row: int) -> dict[str, Any]:
        residual = zip(self.components, (self.fit.residuals[row] * self.fit.in_units).tolist(), strict=True)
        place = self.fit.observations.data.place(int(row))
        return {"row": self._number(row), "place": place, "residual": dict(residual)}

    def _number(self, row: int) -> int:
        return int(self.fit.observations.given(np.array(row)))


def _largest(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return where the largest values are, the largest first."""
    first = np.argpartition(-values, min(WORST_ROWS, len(values) - 1))[:WORST_ROWS]
    return np.asarray(first[np.argsort(-values[first], kind="stable")])


def compare(fit: Fit) -> Comparison:
    """Return what the residuals of a fit depend on: joints, directions, time, temperatures, places, columns.

    Parameters
    ----------
    fit : Fit
        Its outliers are left out.

    Returns
    -------
    Comparison

    Examples
    --------
    >>> from rodgen.calibration.fit import fit
    >>> from rodgen.data.measurements import Measurements
    >>> from rodgen.machines.machine import Joint, Machine, Measured, Target
    >>> table = Machine(
    ...     name="Rotary table", length_unit="mm", angle_unit="deg", gravity=(0, 0, -1), reference_temperature=20,
    ...     joints=(Joint("C", "revolute", (0, 0, 1)),), targets=(Target("ball", (120, 0, 40)),),
    ...     measured=Measured("point", "machine"), estimate=("target",),
    ... )
    >>> random = np.random.default_rng(1)
    >>> C = random.permutation(np.arange(0, 360, 5.0))
    >>> angle, noise = np.radians(C), random.normal(size=(3, 72)) * 0.002
    >>> angle = angle + 1e-4 * np.cos(2 * angle)  # an ellipse in the scale
    >>> x, y, z = 120 * np.cos(angle), 120 * np.sin(angle), 40 + 0 * angle
    >>> data = {"C [deg]": C, "x [mm]": x + noise[0], "y [mm]": y + noise[1], "z [mm]": z + noise[2]}
    >>> comparison = compare(fit(table, Measurements.from_frame(data)))
    >>> print(comparison.sentences[0])
    The residuals depend on C: 87 % of their variance, in x and y, along the motion of C (p < 1e-16).
    """
    with one_thread_in_blas():
        sample = Sample.of(fit)
        listed = compared(sample)
        found = search(sample, listed)
        covariates = [driver for driver in listed if isinstance(driver, Driver)]
        times = [c.values for c in covariates if c.in_time]
        components = range(sample.components)
        trends = tuple(drift(found.first.space, times[0], c) if times else None for c in components)
        return Comparison(
            fit=fit,
            sample=sample,
            search=found,
            worst=tuple(worst_regions(sample, covariates)),
            drifts=trends,
            uneven=tuple(uneven(sample, found, covariates)),
            tails=tuple(tails(sample, found)),
        )


# How evenly residuals scatter once all dependences are taken out, and whether large ones are too frequent.
#
# Evenness: cube roots of the cells' mean squares, which are nearly normal for normal errors (Wilson and Hilferty
# 1931), are tested against every driver as the residuals are, by poses (in the manner of Breusch and Pagan 1979, and
# of Levene 1960 for groups). Tails: kurtosis of one cell a pose (Anscombe and Glynn 1983).


LEAST_POSES = 20
"""Below this the p-value of a kurtosis is a guess."""


@dataclass(frozen=True, eq=False)
class Uneven:
    """How the scatter follows a covariate."""

    covariate: Driver
    log10_p: float
    """Not yet times the number of covariates."""
    low: tuple[Region, float]
    high: tuple[Region, float]
    """The quarter, or category, with the least and the largest scatter, and its rms in the fit's unit."""


@dataclass(frozen=True)
class Tails:
    """Kurtosis of one component, 3 for normal errors."""

    component: int
    kurtosis: float
    log10_p: float


def _errors(sample: Sample, search: Search) -> Array:
    """Return residuals less all that was found, at the size of errors, (N, m), in standard deviations."""
    space = search.last.filtered
    leverage = space.leverage.reshape(space.y.shape)
    errors = space.y / np.sqrt(1 - np.minimum(leverage, 0.9))
    if space.whiten:
        errors = errors[sample.pose > 0]  # the first pose has no step before it
    size = np.sqrt(np.mean(errors**2, axis=0))
    found = np.full(sample.y.shape, np.nan)
    found[-len(errors) :] = errors / np.where(size > 0, size, 1.0)
    return found


def uneven(sample: Sample, search: Search, covariates: Sequence[Driver]) -> list[Uneven]:
    """Test the scatter against every covariate."""
    errors = _errors(sample, search)
    rows = np.isfinite(errors[:, 0])
    z = np.where(rows, np.cbrt(np.mean(errors**2, axis=1)), 0.0)
    z[~rows] = z[rows].mean()
    # Means of more readings scatter less, as they should.
    other = np.column_stack([np.ones(len(z)), 1 / sample.count])
    taken = np.linalg.qr(other[:, : 1 + bool(np.ptp(sample.count))])[0]
    space = ProjectedResiduals(replace(sample, y=z[:, None], taken=taken))
    unit = np.sqrt(np.mean(sample.shown**2, axis=0))
    left = np.where(rows[:, None], errors, np.nan) * unit * _left(sample, search)
    found = []
    for covariate in covariates:
        columns = covariate.values[:, None] if covariate.kind == "approach" else covariate.low_columns
        evidence = space.test(columns[:, None, :])
        parts = [
            (region, float(np.sqrt(np.nanmean(left[inside] ** 2))))
            for region, inside in quarters(covariate)
            if rows[inside].any()
        ]
        if evidence and len(parts) > 1:
            low, high = (choose(parts, key=lambda part: part[1]) for choose in (min, max))
            found.append(Uneven(covariate, evidence.log10_p, low, high))
    return found


def _left(sample: Sample, search: Search) -> Array:
    """Return which part of each component's rms remains, (m,)."""
    before, after = np.sum(sample.y**2, axis=0), np.sum(search.last.space.y**2, axis=0)
    return np.asarray(np.sqrt(np.divide(after, before, out=np.ones_like(before), where=before > 0)))


def tails(sample: Sample, search: Search) -> list[Tails]:
    """Test the tails of each component; none where poses are few, or means are of different numbers of readings."""
    errors = _errors(sample, search)
    first, _ = stretches(sample.pose)
    errors = errors[first][np.isfinite(errors[first, 0])]
    if len(errors) < LEAST_POSES or sample.count.max() > 1.5 * sample.count.min():
        return []
    found = []
    for c, e in enumerate(errors.T):
        if np.ptp(e) > 0:
            kurtosis = kurtosis_of(e)
            found.append(
                Tails(c, kurtosis, float(np.log10(max(kurtosis_tail(kurtosis, len(e)), SMALLEST_P))))
            )
    return found
