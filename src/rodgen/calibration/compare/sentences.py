"""A comparison in words: a few sentences that are read in a minute, and a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from rodgen.calibration.checks.gross import on_gross_readings
from rodgen.calibration.compare.dependence import Dependence, Found
from rodgen.calibration.compare.sample import Pair
from rodgen.calibration.summary import contradictions
from rodgen.calibration.words import (
    NOTHING_LEFT,
    capitalized,
    chance,
    in_component,
    plain,
    probability,
    sized,
)
from rodgen.data.drivers import Driver
from rodgen.data.units import readable
from rodgen.errors import joined
from rodgen.statistics.f_tests import p_of_log10
from rodgen.statistics.thresholds import COMPARISON

if TYPE_CHECKING:
    from rodgen.calibration.compare.comparison import Comparison

MOSTLY, NEARLY_ALL = 0.65, 0.9
"""Parts of the explained variance from which one component, or two, are named."""
SHOWN_P = -1.3
"""Logarithm of the p-value, times the number of tests, from which a pair stands in the table, and none is denied."""
WANDER = ", by a drift or a slow wander"
"""What a dependence on time may be."""
NAMED = 6
"""Names in a list that is not the point of its sentence."""


def text(comparison: Comparison) -> str:
    """Return what ``print(comparison)`` shows."""
    parts = ([*sentences(comparison)], [*_table(comparison)], [*_largest(comparison)])
    return "\n\n".join("\n".join(part) for part in parts if part)


def sentences(comparison: Comparison) -> Iterator[str]:
    """Yield what an engineer needs to know, the most important first."""
    yield from comparison.fit.observations.on_rows
    if gross := on_gross_readings(comparison.fit):
        yield gross
    yield from contradictions(comparison.fit)
    if comparison.exact:
        if comparison.fit.degrees_of_freedom > 0:
            yield "The model fits the data to rounding: there is nothing to explain."
        else:
            yield NOTHING_LEFT
        return
    yield from claims(comparison)
    yield from _clear(comparison)
    yield from _unexplained(comparison)
    yield from _not_asked(comparison)


def claims(comparison: Comparison) -> Iterator[str]:
    """Yield the sentences that say that something is there."""
    if comparison.exact:
        return
    yield from _worst(comparison)
    yield from _either(comparison)
    yield from _found(comparison)
    yield from _time(comparison)
    yield from _withheld(comparison)
    yield from _scatter(comparison)
    yield from _heavy_tails(comparison)


# one after the other -----------------------------------------------------------------------------------------------


def _worst(comparison: Comparison) -> Iterator[str]:
    for worst in comparison.worst[:1]:
        if worst.log10_p < np.log10(COMPARISON.region):
            fit, unit = comparison.fit, comparison.sample.unit
            overall = float(np.sqrt(np.mean(fit.sizes[~fit.outliers] ** 2)))
            yield (
                f"The model is worst where {plain(worst.region.text, 90)}: {sized(worst.rms, unit)} there, "
                f"{sized(overall, unit)} overall."
            )


def _found(comparison: Comparison) -> Iterator[str]:
    drivers = [found.dependence.driver for found in comparison.search.found]
    members = {id(c) for pair in drivers if isinstance(pair, Pair) for c in (pair.first, pair.second)}
    for i, found in enumerate(comparison.search.found):
        start = "The residuals depend on" if i == 0 else "In addition they depend on"
        if i == 0 and comparison.search.either:
            start = "Leaving that aside, they depend on"
        said = f"{start} {_explained(comparison, found)}"
        said += f" ({_p(found.dependence.log10_p, comparison.search.tests)})"
        yield f"{said}{_change(comparison, found)}."
        along = [other for other in found.along if isinstance(other, Driver) and id(other) not in members]
        if along:
            said_of = _names(comparison, along, "and")
            names = joined(said_of)
            many = len(said_of) > 1 or " and " in names
            verb = "vary with it and explain" if many else "varies with it and explains"
            yield f"{_capital(names)} {verb} nothing more."


def _explained(comparison: Comparison, found: Found) -> str:
    """Say what a covariate explains, and where it shows."""
    said = f"{_text(found.dependence.driver)}: {_percent(found.explained)} of their variance"
    said += _mostly(comparison, found)
    joints = [plain(comparison.fit.machine.joints[joint].name) for joint in found.motions]
    if joints:
        said += f", along the motion of {joined(joints, 'or')}"
    return said


def _either(comparison: Comparison) -> Iterator[str]:
    either = comparison.search.either
    if either:
        yield (
            f"The residuals vary with {_explained(comparison, either)}; a slow wander in time would look the same, "
            f"because of the order in which the poses were measured. Measure in another order to tell them apart."
        )


def _mostly(comparison: Comparison, found: Found) -> str:
    part = found.falls / max(float(found.falls.sum()), 1e-300)
    order = np.argsort(-part)
    where = [_where(comparison, int(c)) for c in order]
    if len(part) == 1:
        return ""
    if part[order[0]] >= MOSTLY:
        return f", mostly {where[0]}"
    if len(part) > 2 and part[order[:2]].sum() >= NEARLY_ALL:
        return f", in {' and '.join(sorted(comparison.components[c] for c in order[:2]))}"
    return ""


def _where(comparison: Comparison, c: int) -> str:
    return in_component(comparison.components[c])


def _change(comparison: Comparison, found: Found) -> str:
    """Say by how much a component changes from the first to the last, where time is what it depends on."""
    if not found.dependence.driver.in_time:
        return ""
    drifts = _drifts(comparison)
    return WANDER + (f"; they drift {drifts} from first to last" if drifts else "")


def _drifts(comparison: Comparison) -> str:
    """Say by how much each component drifts that does beyond chance; empty where none does."""
    fit, m = comparison.fit, len(comparison.components)
    found = []
    for c, drift in enumerate(comparison.drifts):
        if drift and drift.log10_p < np.log10(COMPARISON.in_time / m):
            where = f" {_where(comparison, c)}" if m > 1 else ""
            found.append(f"{sized(drift.change * fit.in_units[c], fit.units[c], '+.3g')}{where}")
    return f"by {joined(found)}" if found else ""


def _time(comparison: Comparison) -> Iterator[str]:
    s, m = comparison.search, len(comparison.components)
    named = [driver for f in s.found for driver in (f.dependence.driver, *f.along)]
    drifts = _drifts(comparison)
    if drifts and not any(driver.in_time for driver in named):
        p = min(drift.log10_p for drift in comparison.drifts if drift)
        yield f"The residuals drift {drifts} from first to last ({_p(p, m)})."
    alike = [
        (c, k)
        for c, k in enumerate(s.last.correlations)
        if k and k.log10_p < np.log10(COMPARISON.in_time / m)
    ]
    if alike:
        _, most = min(alike, key=lambda pair: pair[1].log10_p)
        where = " " + joined([_where(comparison, c) for c, _ in alike]) if m > 1 else ""
        yield (
            f"Errors of successive poses are alike{where} (correlation {most.lag_1:.2f}, "
            f"{_p(most.log10_p, m)}), as if something wandered in time; the other p-values allow for that."
        )


def _withheld(comparison: Comparison) -> Iterator[str]:
    either = comparison.search.either
    names = [driver for driver in comparison.search.withheld if isinstance(driver, Driver)]
    names = [driver for driver in names if not either or driver is not either.dependence.driver]
    if names:
        yield (
            f"Whether {joined(_names(comparison, names), 'or', NAMED)} "
            f"{'matters' if len(names) == 1 else 'matter'}, too, cannot be distinguished from a slow wander in time."
        )


def _clear(comparison: Comparison) -> Iterator[str]:
    s = comparison.search
    named: set[str] = set()
    for driver in (
        *(d for f in s.found for d in (f.dependence.driver, *f.along)),
        *s.withheld,
        *([s.either.dependence.driver] if s.either else []),
    ):
        members = (driver.first, driver.second) if isinstance(driver, Pair) else (driver,)
        named |= {member.name for member in members}
    # what may be there, or explains too little to be named, is not denied
    named |= {d.driver.name for d in s.table if d.log10_p + np.log10(max(s.tests, 1)) < SHOWN_P}
    tested = {d.driver.name for d in s.table if any(d.evidence)}
    clear = [c for c in comparison.covariates if c.name in tested and c.name not in named]
    if _drifts(comparison) or s.either:
        clear = [c for c in clear if not c.in_time]
    names = _names(comparison, clear)
    if not names:
        return
    yield f"No dependence is seen on {joined(names, 'or')}."


def _unexplained(comparison: Comparison) -> Iterator[str]:
    """Say that something is there all the same, where the noise says so and no dependence was found."""
    lack = comparison.fit.lack_of_fit
    if lack and lack.misses and not any(claims(comparison)):
        yield (
            f"The residuals are {lack.ratio:.3g} times the noise all the same: what causes them may vary faster than "
            "the curves that a comparison tries, or was not recorded. A diagnosis tries more."
        )


def _names(comparison: Comparison, named: Sequence[Driver], word: str = "or") -> list[str]:
    """Name covariates; all directions of approach, velocities or places at once, where all are meant."""
    at_once = {
        "approach": ("any direction of approach", "the direction of approach of"),
        "velocity": ("any velocity", "the velocity of"),
        "place": (
            "the place on the sky" if comparison.unit == "arcsec" else "the place in the workspace",
            "",
        ),
    }
    names = [plain(c.text) for c in named if c.kind in {"joint", "period"}]
    for kind, (all_of_them, start) in at_once.items():
        have = [c for c in named if c.kind == kind]
        every = len(have) > 1 and len(have) == sum(c.kind == kind for c in comparison.covariates)
        if every and (kind != "approach" or comparison.fit.observations.approach_known.all()):
            names.append(all_of_them)
        elif have and start:
            names.append(f"{start} {joined([plain(c.joint) for c in have if c.joint], word)}")
        else:
            names += [c.text for c in have]
    return names + [plain(c.text) for c in named if c.kind not in {"joint", "period", *at_once}]


def _scatter(comparison: Comparison) -> Iterator[str]:
    tests = max(len(comparison.uneven), 1)
    claims = [u for u in comparison.uneven if u.log10_p < np.log10(COMPARISON.uneven / tests)]
    for u in sorted(claims, key=lambda u: u.log10_p)[:1]:
        unit = comparison.sample.unit
        yield (
            f"The remaining scatter is uneven: {sized(u.high[1], unit)} where {plain(u.high[0].text, 90)}, "
            f"{sized(u.low[1], unit)} where {plain(u.low[0].text, 90)} ({_p(u.log10_p, tests)})."
        )


def _heavy_tails(comparison: Comparison) -> Iterator[str]:
    if comparison.fit.gross_readings:
        return
    m = max(len(comparison.tails), 1)
    heavy = [t for t in comparison.tails if t.log10_p < np.log10(COMPARISON.tails / m)]
    for t in sorted(heavy, key=lambda t: t.log10_p)[:1]:
        where = f" {_where(comparison, t.component)}" if len(comparison.components) > 1 else ""
        yield (
            f"Large residuals are more frequent{where} than among normal errors "
            f"(kurtosis {t.kurtosis:.1f} instead of 3, {_p(t.log10_p, m)})."
        )


def _not_asked(comparison: Comparison) -> Iterator[str]:
    """Say what could not be tested."""
    rows = comparison.fit.rows
    if len(comparison.sample.rows) < rows:
        some = f"{len(comparison.sample.rows)} of {rows} rows"
        yield f"Dependences were sought in {some}, in stretches spread over the data."
    silent = [d.driver for d in comparison.search.table if not any(d.evidence)]
    names = [plain(driver.name) for driver in silent if isinstance(driver, Driver)]
    poses = comparison.sample.poses
    if not comparison.search.table:
        yield "All readings are of one pose and one target: nothing varies that the residuals could depend on."
    if names and not comparison.search.tests:
        many = "1 pose is" if poses == 1 else f"{poses} poses are"
        yield f"{many} too few, with this many parameters fitted, to show what the residuals depend on."
    elif names:
        yield (
            f"The data cannot show a dependence on {joined(names, 'or', NAMED)}: too few poses, or the fit "
            f"absorbs it."
        )


# tables ------------------------------------------------------------------------------------------------------------


def _table(comparison: Comparison) -> Iterator[str]:
    tests = comparison.search.tests
    rows = []
    for d in sorted(comparison.search.table, key=lambda d: d.log10_p):
        best = _best(d)
        if best is None:
            continue
        e, number = d.evidence[best], d.trials[best]
        p = e.log10_p + np.log10(tests) if e else 0.0
        if isinstance(d.driver, Pair) and p > SHOWN_P:
            continue
        name = plain(d.driver.name)
        if isinstance(d.driver, Driver) and d.driver.unit and d.driver.kind != "order":
            name += f" [{plain(d.driver.unit)}]"
        shown = probability(p_of_log10(p))
        if e and e.alone is not None and e.alone + np.log10(tests) < SHOWN_P < p:
            shown += f" ({probability(p_of_log10(e.alone + np.log10(tests)))} if nothing wanders)"
        rows.append((name, comparison.component(number), _percent(d.share(best)), shown))
    if not rows:
        return
    part = "of its variance" + (", weighted" if comparison.fit.weighted else "")
    head = ("covariate, each alone", "component", part, f"p, {tests} tests counted")
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(4)]
    for row in (head, *rows):
        yield (
            f"{row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]:>{widths[3]}}".rstrip()
        )


def _best(dependence: Dependence) -> int | None:
    """Return the trial with the strongest evidence; among those that chance explains, the one that explains most."""
    tested = [i for i, e in enumerate(dependence.evidence) if e]
    if not tested:
        return None

    def alone(i: int) -> float:
        e = dependence.evidence[i]
        return 0.0 if e is None else e.log10_p if e.alone is None else e.alone

    return min(tested, key=lambda i: (min(alone(i), SHOWN_P), -dependence.share(i)))


def _in_one_unit(parts: Sequence[tuple[str, float]], unit: str) -> str:
    factor, unit = readable(unit, max(abs(value) for _, value in parts))
    return f"{', '.join(f'{name} {value * factor:+.3g}' for name, value in parts)} {unit}"


def _largest(comparison: Comparison) -> Iterator[str]:
    o, fit = comparison.fit.observations, comparison.fit
    each = ", ".join(
        f"{name} {sized(r, unit)}"
        for name, r, unit in zip(comparison.components, comparison.rms, fit.units, strict=True)
    )
    yield f"rms by component: {each}"
    regions = [
        w
        for w in comparison.worst
        if w.log10_p < np.log10(COMPARISON.region) and w.region.covariate.kind in {"joint", "place"}
    ]
    for worst in regions:
        there = sized(worst.rms, comparison.sample.unit)
        yield f"worst where {plain(worst.region.text, 90)}: {there} ({_p(worst.log10_p)})"
    yield "largest residuals" + (", in their stated uncertainties:" if comparison.fit.weighted else ":")
    for row in comparison.worst_rows:
        parts = zip(comparison.components, fit.residuals[row] * fit.in_units, fit.units, strict=True)
        by_unit = [(unit, [*group]) for unit, group in groupby(parts, key=lambda part: part[2])]
        values = ", ".join(_in_one_unit([part[:2] for part in group], unit) for unit, group in by_unit)
        at = ", ".join(
            f"{plain(column.name)} {column.values[row]:.6g} {column.unit}"
            for column in (o.data.columns[joint.column] for joint in comparison.fit.machine.joints)
        )
        yield f"  {o.data.place(int(row))}: {values} ({at})"


# words -------------------------------------------------------------------------------------------------------------


def _text(driver: Driver | Pair) -> str:
    said = plain(driver.text, 90)
    if isinstance(driver, Driver) and driver.same:
        said += f" ({joined(plain(name) for name in driver.same)})"
    return said


def _capital(said: str) -> str:
    return capitalized(said) if said.startswith(("the ", "any ", "time")) else said


def _percent(part: float) -> str:
    if 0 < part < 0.01:
        return "<1 %"
    return f"{min(100 * part, 99.9):.3g} %" if part > 0.99 else f"{100 * part:.0f} %"


def _p(log10_p: float, tests: int = 1) -> str:
    return chance(p_of_log10(log10_p + np.log10(max(tests, 1))))
