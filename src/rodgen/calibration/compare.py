"""Compare the residuals of a fit with everything that was recorded: what they follow, and where the model is worst.

A view of the evidence: each driver, and each pair of drivers, is a candidate with a curve of low order in one component
of the residuals, or along the motion that a joint causes. Those that the data call for are selected like effects, and
said with odds; a set-up that wanders, and errors that the readings of a pose share, are allowed for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rodgen.array_types import Array
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.gross_readings import on_gross_readings
from rodgen.calibration.problem import one_thread_in_blas
from rodgen.calibration.selection import equals, select, worth
from rodgen.calibration.sensitivities import Sensitivities
from rodgen.calibration.summary import contradictions
from rodgen.calibration.words import IN_UNCERTAINTIES, NOTHING_LEFT, in_component, odds_text, plain, sized
from rodgen.calibration.worst_regions import Region, worst_regions
from rodgen.data.poses import stretches
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.machines.drivers import Driver, drivers_of_place, products
from rodgen.machines.effects.definition import EffectDefinition
from rodgen.machines.effects.formula import Formula
from rodgen.machines.machine import Effect, Machine
from rodgen.machines.plausibility import Plausibility
from rodgen.statistics.columns import orthonormal_basis, project_out
from rodgen.statistics.thresholds import COST
from rodgen.views import Records, Result

if TYPE_CHECKING:
    from rodgen.calibration.fitted import Fit

ROUNDING = 64 * np.finfo(float).eps
"""Residuals below this part of the largest reading are rounding, of which nothing is said."""
SAME = 0.9999
"""Correlation from which two drivers are one: an altitude and the elevation axis that makes it."""
COMPETING = 30
"""Drivers in a component, the likeliest each alone, of which sets are selected."""
MOSTLY, NEARLY_ALL = 0.65, 0.9
"""Parts of the explained variance from which one component, or two, are named."""
WORST_ROWS = 5
NAMED = 6
"""Names in a list that is not the point of its sentence."""


# candidates ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trial:
    """Drivers that may matter, in one component of the residuals or along the motion of a joint."""

    drivers: tuple[Driver, ...]
    """One, or two together."""
    component: int | None
    joint: int | None
    """Number of the joint, where it is not a component."""

    @property
    def name(self) -> str:
        """Name of the driver, or both."""
        return " and ".join(driver.name for driver in self.drivers)

    @property
    def text(self) -> str:
        """What a sentence calls the drivers."""
        said = [plain(driver.text, 90) for driver in self.drivers]
        if len(said) > 1:
            each = self.drivers[0].kind == "target"
            return f"{said[1]}, differently for each target" if each else f"{joined(said)} together"
        same = [plain(name) for name in self.drivers[0].same]
        return said[0] + (f" ({joined(same)})" if same else "")

    def where(self, machine: Machine) -> str:
        """Name the component, or ``along JOINT``."""
        if self.joint is not None:
            return f"along {machine.joints[self.joint].name}"
        return machine.measurand.components[self.component or 0]

    def curves(self) -> Iterator[Array]:
        """Yield the columns of curves, (n, k), of the lowest order first."""
        if len(self.drivers) > 1:
            yield products(*(_first_order(driver) for driver in self.drivers))
            yield products(
                *(
                    driver.low_columns[:, :2] if driver.turn is None else _first_order(driver)
                    for driver in self.drivers
                )
            )
            return
        (driver,) = self.drivers
        first = _first_order(driver)
        if driver.coordinate is not None:
            first = np.column_stack([first, products(first, _first_order(driver.coordinate))])
        yield first
        yield driver.low_columns
        yield driver.columns


def _first_order(driver: Driver) -> Array:
    """Return the columns of the first order, (n, k): a straight line, or one wave of what goes round."""
    low = driver.low_columns
    if driver.categories or not low.shape[1]:
        return low
    if driver.turn is not None:
        return low[:, [0, low.shape[1] // 2]]
    return ((driver.values - driver.low) / driver.span - 0.5)[:, None]


_BARE = Formula.parse("a", file="comparison", place="driver")


def _candidates(rows: Sensitivities, trial: Trial, trials: Sequence[Trial]) -> Iterator[Candidate]:
    """Yield a trial as candidates, one of each curve; half of the odds are for single drivers, half for pairs."""
    machine = rows.fit.machine
    if trial.joint is not None:
        motion = rows.component(machine.joints[trial.joint].name, "reading")
        assert motion is not None
    else:
        motion = np.zeros_like(rows.residual)
        motion[:, trial.component or 0] = rows.weight[:, trial.component or 0]
    curves = [*{curve.shape[1]: curve for curve in trial.curves() if curve.shape[1]}.values()]
    odds = -math.log(2 * sum(len(other.drivers) == len(trial.drivers) for other in trials))
    if any(driver.kind == "place" for driver in trial.drivers):  # the joints make it
        odds -= COST.needed / 2
    for curve in curves:
        names = tuple(f"{trial.name}.{k}" for k in range(curve.shape[1]))
        effect = Effect(
            EffectDefinition(trial.name, frozenset({"machine"}), "reading", _BARE, {}, own=True),
            trial.where(machine),
        )
        columns = motion[:, :, None] * curve[:, None, :]
        yield Candidate(effect, names, columns, {}, float(len(curves)), Plausibility(odds))


def _drivers(rows: Sensitivities) -> list[Driver]:
    """Return everything that residuals are compared with; the place last, because joints make it.

    What does not vary is left out; what has the same values as another one becomes a further name of that.
    """
    fit, own = rows.fit, rows.rows
    given = (driver.as_noted(lambda values: values[own], own) for driver in fit.observations.drivers())
    found: list[Driver] = []
    for driver in (*given, *drivers_of_place(fit.machine, fit.places(rows.observations))):
        if driver.levels < 2:
            continue
        twin = next((i for i, other in enumerate(found) if _same(driver, other)), None)
        if twin is None:
            found.append(driver)
        else:
            found[twin] = replace(found[twin], same=(*found[twin].same, driver.text))
    return sorted(found, key=lambda driver: driver.kind == "place")


def _same(one: Driver, other: Driver) -> bool:
    """Return whether two drivers are the same numbers, but for their zero, sign and size."""
    if {one.kind, other.kind} & {"approach", "run", "target", "period", "time", "order"}:
        return False
    if one.turn is not None and other.turn is not None:
        a, b = 2 * np.pi * one.values / one.turn, 2 * np.pi * other.values / other.turn
        return bool(max(abs(np.mean(np.exp(1j * (a + sign * b)))) for sign in (1, -1)) > SAME)
    a, b = one.values - one.values.mean(), other.values - other.values.mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(size > 0 and abs(a @ b) > SAME * size)


def _trials(rows: Sensitivities, drivers: Sequence[Driver]) -> Iterator[Trial]:
    """Yield each driver, and pairs of joints with each other, with load, temperatures, columns and targets."""
    m = rows.residual.shape[1]
    joints = [driver for driver in drivers if driver.kind == "joint"]
    others = [d for d in drivers if d.kind in {"load", "temperature", "column", "target"}]
    pairs = [*combinations(joints, 2), *((o, j) for o in others for j in joints if o.joint != j.joint)]
    for several in (*((driver,) for driver in drivers), *pairs):
        yield from (Trial(several, c, None) for c in range(m))
        for number in dict.fromkeys(driver.number for driver in several):
            if (
                number is not None
                and rows.component(rows.fit.machine.joints[number].name, "reading") is not None
            ):
                yield Trial(several, None, number)


# the result ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Followed:
    """A driver that the residuals follow in one component."""

    trial: Trial
    explained: float
    """Part of the variance of all residuals, or of its component, less what chance explains."""
    falls: Array = field(repr=False)
    """By how much the sum of squares of each component falls, (m,)."""
    log_odds: float
    """Natural logarithm of the odds that it matters."""
    instead: tuple[str, ...] = ()
    """Drivers that explain the same in its place."""


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Result):
    """What the residuals of a fit follow, and where the model is worst; made by :func:`compare`.

    ``print(comparison)`` shows sentences, the most important first, and a table.

    Attributes
    ----------
    fit : Fit
    sensitivities : Sensitivities
        The rows that were looked at, without outliers.
    evidence : Evidence or None
        Of drivers in place of effects; None where no reading is beyond the fitted parameters.
    covariates : tuple of Driver
        What varies in the data and was compared with the residuals, in these rows.
    alone : tuple of Followed
        Each driver alone, in each component where it was tried.
    found : tuple of Followed
        Those that the data call for, each given those before.
    worst : tuple of Region
        Where the model is worse than elsewhere, the clearest first.
    """

    fit: Fit
    sensitivities: Sensitivities
    evidence: Evidence | None
    covariates: tuple[Driver, ...]
    alone: tuple[Followed, ...]
    found: tuple[Followed, ...]
    worst: tuple[Region, ...]

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
    def rms(self) -> NDArray[np.float64]:
        """Root mean square of each component, (m,), in the fit's `units`, without outliers."""
        squares = np.mean(self.fit.residuals[~self.fit.outliers] ** 2, axis=0)
        return np.sqrt(squares) * self.fit.in_units  # type: ignore[no-any-return]

    @cached_property
    def worst_rows(self) -> NDArray[np.intp]:
        """Rows with the largest residuals, outliers left out, the largest first."""
        size = np.linalg.norm(self.fit.sizes, axis=1)
        size[self.fit.outliers | ~np.isfinite(size)] = -1.0
        first = np.argpartition(-size, min(WORST_ROWS, len(size) - 1))[:WORST_ROWS]
        rows = first[np.argsort(-size[first], kind="stable")]
        return np.asarray(rows[size[rows] >= 0])

    @property
    def table(self) -> Records[dict[str, Any]]:
        """What each driver explains alone, as dicts with the keys of :meth:`to_dict`, or as a DataFrame."""
        return Records([_row(one, self.fit) for one in self.alone], dict)

    @property
    def claims(self) -> list[str]:
        """The sentences that say that something is there; empty when these data show nothing."""
        return [] if self.exact else [*_worst(self), *_found(self), *_shared(self, wanders=True)]

    @property
    def sentences(self) -> list[str]:
        """What an engineer needs to know, the most important first."""
        return list(_sentences(self))

    def __str__(self) -> str:
        parts = (self.sentences, [*_table(self)], [*_largest(self)])
        return "\n\n".join("\n".join(part) for part in parts if part)

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
            ``depends_on``: what residuals follow, each given those before: ``covariate``, ``component`` (or ``"along
            JOINT"`` for a joint's reading), ``explained`` (part of the variance of all residuals, each in its
            uncertainty), ``log10_odds`` that it matters, ``instead`` (what the data cannot distinguish from it);
            ``table``: each covariate alone: ``covariate``, ``unit``, ``component``, ``explained`` (part of the variance
            of that component, along a joint of all), ``log10_odds``;
            ``correlation``: a sentence on errors that readings share, or null;
            ``worst``: ``regions`` (``covariate``, ``unit``, ``low``, ``high``, ``category``, ``where``, ``rms``, in
            stated uncertainties where these differ much, ``poses``) and ``rows`` (``row``, ``place``, ``residual`` by
            component).
        """
        fit = self.fit
        return {
            "machine": fit.machine.name,
            "data": fit.observations.data.file,
            **fit.used_rows,
            "rows_looked_at": len(self.sensitivities.rows),
            "poses": len(stretches(fit.observations.pose)[0]),
            "unit": self.unit,
            "rms": fit.rms,
            "components": [
                {"name": n, "rms": float(r), "unit": unit}
                for n, r, unit in zip(self.components, self.rms, fit.units, strict=True)
            ],
            "sentences": self.sentences,
            "claims": self.claims,
            "depends_on": [_row(one, fit) | {"instead": list(one.instead)} for one in self.found],
            "table": list(self.table),
            "correlation": (self.evidence and self.evidence.correlation.text) or None,
            "worst": {
                "regions": [
                    {
                        "covariate": region.covariate.name,
                        "unit": region.covariate.unit,
                        "low": region.low,
                        "high": region.high,
                        "category": region.category,
                        "where": region.text,
                        "rms": region.rms,
                        "poses": region.poses,
                    }
                    for region in self.worst
                ],
                "rows": [
                    {
                        "row": int(fit.observations.given(np.array(row))),
                        "place": fit.observations.data.place(int(row)),
                        "residual": dict(
                            zip(self.components, (fit.residuals[row] * fit.in_units).tolist(), strict=True)
                        ),
                    }
                    for row in self.worst_rows
                ],
            },
        }


def _row(one: Followed, fit: Fit) -> dict[str, Any]:
    return {
        "covariate": one.trial.name,
        "unit": one.trial.drivers[0].unit if len(one.trial.drivers) == 1 else "",
        "component": one.trial.where(fit.machine),
        "explained": one.explained,
        "log10_odds": one.log_odds / math.log(10),
    }


def compare(fit: Fit) -> Comparison:
    """Return what the residuals of a fit follow: joints, directions, time, temperatures, places, columns.

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
    The residuals depend on C: 87 % of their variance, in x and y, along the motion of C (more than a million to 1).
    """
    with one_thread_in_blas():
        rows = Sensitivities.of(fit)
        drivers = _drivers(rows)
        trials = list(_trials(rows, drivers))
        worst = worst_regions(drivers, fit.sizes[rows.rows], np.asarray(rows.observations.pose))
        nothing = Comparison(fit, rows, None, tuple(drivers), (), (), tuple(worst))
        if nothing.exact or not trials:
            return nothing
        several = [list(_candidates(rows, trial, trials)) for trial in trials]
        weighed = _Weighed.of(fit, rows, several)
        if weighed is None:
            return nothing
        fall, full, chosen = _Fall.of(rows), weighed.evidence, weighed.chosen
        of = {id(c): trial for trial, own in zip(trials, several, strict=True) for c in own}
        alone = [_followed(of[id(c)], fall([c]), fall.total, odds, own=True) for c, odds in weighed.alone]
        chosen = _with_fewest_drivers(full, chosen, of)
        others = equals(full, chosen)
        chosen = sorted(chosen, key=lambda c: -float(fall([c]).sum()))
        together = dict[str, list[Candidate]]()  # a driver in several components is one dependence
        for c in chosen:
            together.setdefault(of[id(c)].name, []).append(c)
        found, before = list[Followed](), list[Candidate]()
        for own in together.values():
            more = fall([*before, *own]) - fall(before)
            before += own
            first = next((c for c in own if of[id(c)].joint is not None), own[0])
            same = [
                of[id(e.candidates[0])].name
                for e in others
                if e.replaced == (first,) and len(e.candidates) == 1
            ]
            one = _followed(of[id(first)], more, fall.total, sum(worth(full, chosen, c) for c in own) / 2)
            found.append(
                replace(one, instead=tuple(name for name in dict.fromkeys(same) if name not in together))
            )
        return Comparison(fit, rows, full, tuple(drivers), tuple(alone), tuple(found), tuple(worst))


def _with_fewest_drivers(
    evidence: Evidence, chosen: Sequence[Candidate], of: Mapping[int, Trial]
) -> list[Candidate]:
    """Return a set with single drivers in the place of pairs that the data cannot distinguish from them."""
    if all(len(of[id(c)].drivers) == 1 for c in chosen):
        return [*chosen]
    for equal in equals(evidence, chosen):
        if len(equal.replaced) == len(equal.candidates) == 1:
            (one,), (other,) = equal.replaced, equal.candidates
            if len(of[id(other)].drivers) < len(of[id(one)].drivers):
                return _with_fewest_drivers(evidence, [other if c is one else c for c in chosen], of)
    return [*chosen]


@dataclass(frozen=True)
class _Weighed:
    """What the evidence says of trials."""

    evidence: Evidence
    """With the likeliest ones."""
    alone: list[tuple[Candidate, float]]
    """The best curve of each, with the natural logarithm of its odds."""
    chosen: list[Candidate]

    @classmethod
    def of(cls, fit: Fit, rows: Sensitivities, several: Sequence[Sequence[Candidate]]) -> _Weighed | None:
        """Weigh trials, each with its curves; None where no reading is beyond the fitted parameters.

        What was selected would seem to be errors that readings share, so that these are estimated with it again.
        """
        widest = [own[-1] for own in several if own]
        chosen, found = list[Candidate](), None
        for _ in range(2):
            bare = Evidence.without_candidates(fit, rows, widest, chosen, _offsets(rows))
            if bare.dof < 1 or not bare.models[0].square > 0:
                return None
            alone, ranked = list[tuple[Candidate, float]](), list[tuple[float, int]]()
            for number, own in enumerate(several):
                weighed = bare.including(own)
                if weighed.candidates:
                    c = min(weighed.candidates, key=lambda c: weighed.cost([c]))
                    cost = weighed.cost([c]) - weighed.cost([])
                    alone.append((c, -cost / 2))
                    ranked.append((cost, number))
            likeliest = sorted(number for _, number in sorted(ranked)[:COMPETING])
            evidence = bare.including([c for number in likeliest for c in several[number]])
            found = cls(evidence, alone, chosen := select(evidence))
            if not chosen or bare.correlation.independent:
                break
        return found


def _offsets(rows: Sensitivities) -> Array | None:
    """Return columns of an offset in each component, (n, m, m), where a machine has no parameters that are fitted.

    An offset is no dependence on a driver; it would seem to be a set-up that wanders.
    """
    m = rows.residual.shape[1]
    return None if rows.model.shape[2] else np.asarray(rows.weight[:, :, None] * np.eye(m))


@dataclass(frozen=True)
class _Fall:
    """By how much candidates lower the sum of squares of each component, less what chance does."""

    residual: Array
    """Without what the fitted parameters imitate, (n, m)."""
    basis: Array
    """Orthonormal, of the fitted parameters, (n m, p)."""
    total: Array
    """Sum of squares of each component, (m,)."""

    @classmethod
    def of(cls, rows: Sensitivities) -> _Fall:
        n, m = rows.residual.shape
        beside = _offsets(rows)
        model = rows.model if beside is None else beside
        basis = orthonormal_basis(model.reshape(n * m, -1))
        residual = project_out(basis, rows.residual.ravel()).reshape(n, m)
        return cls(residual, basis, np.sum(residual**2, axis=0))

    def __call__(self, chosen: Sequence[Candidate]) -> Array:
        y = self.residual
        if not chosen:
            return np.zeros(y.shape[1])
        columns = np.concatenate([c.columns for c in chosen], axis=2).reshape(y.size, -1)
        basis = orthonormal_basis(project_out(self.basis, columns), relative=COST.visible**2)
        fitted = (basis @ (basis.T @ y.ravel())).reshape(y.shape)
        left = float(np.sum((y - fitted) ** 2)) / max(y.size - self.basis.shape[1] - basis.shape[1], 1)
        by_chance = left * np.sum(basis.reshape(*y.shape, -1) ** 2, axis=(0, 2))
        return np.asarray(np.sum(y**2 - (y - fitted) ** 2, axis=0) - by_chance)


def _followed(trial: Trial, falls: Array, total: Array, log_odds: float, *, own: bool = False) -> Followed:
    """Return a driver with the part that it explains of all components, or of its own."""
    one = slice(trial.component, trial.component + 1) if own and trial.component is not None else slice(None)
    whole = float(total[one].sum())
    share = min(max(float(falls[one].sum()) / whole, 0.0), 1.0) if whole > 0 else 0.0
    return Followed(trial, share, falls, log_odds)


# words ---------------------------------------------------------------------------------------------------------------


def _sentences(comparison: Comparison) -> Iterator[str]:
    fit = comparison.fit
    yield from fit.observations.on_rows
    if gross := on_gross_readings(fit):
        yield gross
    yield from contradictions(fit)
    if comparison.exact:
        rounding = "The model fits the data to rounding: there is nothing to explain."
        yield rounding if fit.degrees_of_freedom > 0 else NOTHING_LEFT
        return
    claims = comparison.claims
    yield from claims
    yield from _shared(comparison, wanders=False)
    yield from _clear(comparison)
    lack = fit.lack_of_fit
    if lack and lack.misses and not claims:
        yield (
            f"The residuals are {lack.ratio:.3g} times the noise all the same: what causes them may vary faster than "
            "the curves that a comparison tries, or was not recorded. A diagnosis tries more."
        )
    if not comparison.covariates:
        yield "All readings are of one pose and one target: nothing varies that the residuals could depend on."
    elif comparison.evidence is None:
        poses = len(stretches(fit.observations.pose)[0])
        many = "1 pose is" if poses == 1 else f"{poses} poses are"
        yield f"{many} too few, with this many parameters fitted, to show what the residuals depend on."
    elif (looked_at := len(comparison.sensitivities.rows)) < fit.rows:
        yield f"Dependences were sought in {looked_at} of {fit.rows} rows, in stretches spread over the data."


def _worst(comparison: Comparison) -> Iterator[str]:
    fit = comparison.fit
    unit = IN_UNCERTAINTIES if fit.weighted else fit.unit
    for region in comparison.worst[:1]:
        overall = float(np.sqrt(np.mean(fit.sizes[~fit.outliers] ** 2)))
        yield (
            f"The model is worst where {plain(region.text, 90)}: {sized(region.rms, unit)} there, "
            f"{sized(overall, unit)} overall."
        )


def _found(comparison: Comparison) -> Iterator[str]:
    for i, one in enumerate(comparison.found):
        start = "The residuals depend on" if i == 0 else "In addition they depend on"
        said = f"{start} {one.trial.text}: {_percent(one.explained)} of their variance"
        said += _mostly(comparison, one)
        if one.trial.joint is not None:
            said += f", along the motion of {plain(comparison.fit.machine.joints[one.trial.joint].name)}"
        yield f"{said} ({_odds(one.log_odds)})."
        if one.instead:
            names = [plain(name) for name in one.instead]
            few = names if len(names) <= NAMED else [*names[: NAMED - 1], f"{len(names) - NAMED + 1} others"]
            yield f"These data cannot distinguish that from a dependence on {joined(few, 'or')}."


def _shared(comparison: Comparison, *, wanders: bool) -> Iterator[str]:
    """Say which errors readings share; that a set-up wanders is a claim, what the readings of a pose share is noise."""
    correlation = comparison.evidence and comparison.evidence.correlation
    if correlation and correlation.text and correlation.wanders == wanders:
        yield correlation.text


def _mostly(comparison: Comparison, one: Followed) -> str:
    part = one.falls / max(float(one.falls.sum()), 1e-300)
    order = np.argsort(-part)
    if len(part) == 1:
        return ""
    if part[order[0]] >= MOSTLY:
        return f", mostly {in_component(comparison.components[order[0]])}"
    if len(part) > 2 and part[order[:2]].sum() >= NEARLY_ALL:
        return f", in {' and '.join(sorted(comparison.components[c] for c in order[:2]))}"
    return ""


def _clear(comparison: Comparison) -> Iterator[str]:
    """Say what the residuals do not depend on; what may matter is neither claimed nor denied."""
    likely = [d for one in comparison.alone if one.log_odds > 0 for d in one.trial.drivers]
    likely += [d for one in comparison.found for d in one.trial.drivers]
    named = {driver.name for driver in likely} | {name for one in comparison.found for name in one.instead}
    seen = {driver.name for one in comparison.alone for driver in one.trial.drivers}
    clear = [d for d in comparison.covariates if d.name in seen and d.name not in named]
    at_once = {"approach": "any direction of approach", "velocity": "any velocity"}
    at_once["place"] = "the place on the sky" if comparison.unit == "arcsec" else "the place in the workspace"
    names = [plain(d.text) for d in clear if d.kind not in at_once]
    for kind, all_of_them in at_once.items():
        here = [d for d in clear if d.kind == kind]
        every = len(here) > 1 and len(here) == sum(d.kind == kind for d in comparison.covariates)
        names += [all_of_them] if every else [plain(d.text) for d in here]
    if names:
        yield f"No dependence is seen on {joined(names, 'or')}."


def _table(comparison: Comparison) -> Iterator[str]:
    best = dict[str, Followed]()
    for one in sorted(comparison.alone, key=lambda one: -one.log_odds):
        if len(one.trial.drivers) == 1 or one.log_odds > 0:
            best.setdefault(one.trial.name, one)
    if not best:
        return
    rows = []
    for one in best.values():
        name, unit = plain(one.trial.name), _row(one, comparison.fit)["unit"]
        name += f" [{plain(unit)}]" if unit and one.trial.drivers[0].kind != "order" else ""
        rows.append(
            (name, one.trial.where(comparison.fit.machine), _percent(one.explained), _odds(one.log_odds))
        )
    part = "of its variance" + (", weighted" if comparison.fit.weighted else "")
    head = ("covariate, each alone", "component", part, "odds that it matters")
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(4)]
    for row in (head, *rows):
        yield f"{row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]:>{widths[3]}}".rstrip()


def _largest(comparison: Comparison) -> Iterator[str]:
    o, fit = comparison.fit.observations, comparison.fit
    each = zip(comparison.components, comparison.rms, fit.units, strict=True)
    yield f"rms by component: {', '.join(f'{name} {sized(r, unit)}' for name, r, unit in each)}"
    yield "largest residuals" + (", in their stated uncertainties:" if fit.weighted else ":")
    for row in comparison.worst_rows:
        parts = zip(comparison.components, fit.residuals[row] * fit.in_units, fit.units, strict=True)
        by_unit = [(unit, [*group]) for unit, group in groupby(parts, key=lambda part: part[2])]
        values = ", ".join(_in_one_unit([part[:2] for part in group], unit) for unit, group in by_unit)
        at = ", ".join(
            f"{plain(column.name)} {column.values[row]:.6g} {column.unit}"
            for column in (o.data.columns[joint.column] for joint in fit.machine.joints)
        )
        yield f"  {o.data.place(int(row))}: {values} ({at})"


def _in_one_unit(parts: Sequence[tuple[str, float]], unit: str) -> str:
    factor, unit = readable(unit, max(abs(value) for _, value in parts))
    return f"{', '.join(f'{name} {value * factor:+.3g}' for name, value in parts)} {unit}"


def _percent(part: float) -> str:
    if 0 < part < 0.01:
        return "<1 %"
    return f"{min(100 * part, 99.9):.3g} %" if part > 0.99 else f"{100 * part:.0f} %"


def _odds(log_odds: float) -> str:
    number = odds_text(math.exp(min(abs(log_odds), 700.0)))
    return f"{number} to 1" if log_odds >= 0 else f"1 to {number}"
