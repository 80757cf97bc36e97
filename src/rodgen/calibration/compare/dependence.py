"""What do the residuals depend on? Every driver is tested in every component, and the strongest are taken out in turn.

Where a driver belongs to a joint, its effect on the joint's reading is tested, too: one curve along the motion of the
target when the joint moves, whatever the direction of that.

The driver that explains most joins what the fit takes out, and all are tested again, until no claim holds: this
distinguishes a driver that merely varies with another one from one with an effect of its own.

Where residuals of successive poses are alike, p-values allow for a random walk in addition to the errors
(`serial_correlation`). Time itself, and the run, which is a piece of it, are tested without one, because a walk is a
dependence on time.

A claim holds when its p-value times the number of tests is below `COMPARISON.dependence`, which is therefore the rate
of claims in data of which nothing is missing. To explain is to lower the variance when the model has such a curve in it
and is fitted again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from rodgen.array_types import Array
from rodgen.calibration.compare.explained import Explained, ProjectedResiduals
from rodgen.calibration.compare.sample import Pair, Sample
from rodgen.calibration.compare.serial_correlation import (
    RandomWalk,
    SerialCorrelation,
    random_walk,
    serial_correlation,
)
from rodgen.data.drivers import Driver
from rodgen.statistics.thresholds import COMPARISON

Candidate: TypeAlias = Driver | Pair

MOST_FOUND = 6
"""Dependences that are taken out one after the other."""


@dataclass(frozen=True)
class Trial:
    """One test of a driver: of a curve in one component, or along the motion that a joint causes."""

    driver: Candidate
    component: int | None = None
    """The component."""
    joint: int | None = None
    """Else the joint along whose motion it acts."""

    def columns(self, sample: Sample) -> Array:
        """Return its columns, (N, m, k)."""
        return self._placed(sample, self.driver.columns)

    def given(self, sample: Sample) -> Array | None:
        """Return columns that may explain the residuals and are not tested, (N, m, l): of a pair, each of the two."""
        if not isinstance(self.driver, Pair):
            return None
        alone = self.driver.alone
        if self.joint is not None:
            alone = np.column_stack([np.ones(len(alone)), alone])
        return self._placed(sample, alone)

    def all_columns(self, sample: Sample) -> list[Array]:
        """Return both, where there are both."""
        given = self.given(sample)
        return [self.columns(sample)] if given is None else [given, self.columns(sample)]

    def _placed(self, sample: Sample, columns: Array) -> Array:
        if self.joint is not None:
            return np.asarray(columns[:, None, :] * sample.motions[:, :, self.joint, None])
        found = np.zeros((*sample.y.shape, columns.shape[1]))
        found[:, self.component] = columns
        return found


@dataclass(frozen=True, eq=False)
class Dependence:
    """What one driver explains."""

    driver: Candidate
    trials: tuple[Trial, ...]
    evidence: tuple[Explained | None, ...]
    """Of each; None where it cannot be tested."""
    total: Array
    """Sum of the squares of the residuals, (m,)."""

    def share(self, number: int) -> float:
        """Return what a trial explains: of its component's variance, or, along a motion, of that of all."""
        evidence, c = self.evidence[number], self.trials[number].component
        if evidence is None:
            return 0.0
        falls = (evidence.falls, self.total) if c is None else (evidence.falls[c], self.total[c])
        fall, total = (float(np.sum(x)) for x in falls)
        return min(max(fall / total, 0.0), 1.0) if total > 0 else 0.0

    def claimed(self, tests: int) -> list[int]:
        """Return the numbers of the trials that are beyond chance and explain enough to be mentioned."""
        limit = np.log10(COMPARISON.dependence / max(tests, 1))
        p = [e.log10_p if e else 0.0 for e in self.evidence]
        return [i for i in range(len(p)) if p[i] < limit and self.share(i) > COMPARISON.explained]

    def withheld(self, tests: int) -> bool:
        """Return whether it would be claimed if successive poses were independent, but is not."""
        limit = np.log10(COMPARISON.dependence / max(tests, 1))
        alone = [e.alone if e and e.alone is not None else 0.0 for e in self.evidence]
        would = any(p < limit and self.share(i) > COMPARISON.explained for i, p in enumerate(alone))
        return would and not self.claimed(tests)

    @property
    def good(self) -> list[int]:
        """The numbers of the trials that are likely to show something, if successive poses were independent."""
        limit = np.log10(COMPARISON.taken_out)
        p = [0.0 if e is None else e.log10_p if e.alone is None else e.alone for e in self.evidence]
        return [i for i in range(len(p)) if p[i] < limit]

    @property
    def log10_p(self) -> float:
        """The smallest p-value of all trials, not yet times their number."""
        return min((e.log10_p for e in self.evidence if e), default=0.0)


@dataclass(frozen=True, eq=False)
class Found:
    """A dependence that is beyond chance, given those found before."""

    dependence: Dependence
    trials: tuple[Trial, ...]
    """That describe it: one along a joint's motion, where that explains about as much as one for each component."""
    motions: tuple[int, ...]
    """The joints along whose motion one curve explains about as much; of a pair there may be two."""
    explained: float
    """Part of the variance of all components; of a pair, with what each of the two explains alone."""
    falls: Array
    """The same by component, as the fall of the sum of squares, (m,)."""
    along: tuple[Candidate, ...] = ()
    """What would have been beyond chance without it, but is not with it taken out."""

    @property
    def described(self) -> tuple[Trial, ...]:
        """The trials that describe it, each of those that do equally well."""
        return tuple(t for t in self.dependence.trials if t in self.trials or t.joint in self.motions)


@dataclass(frozen=True, eq=False)
class Round:
    """The tests of all drivers, given what was found before."""

    space: ProjectedResiduals
    """Residuals less what the fit takes out and what was found; not whitened."""
    filtered: ProjectedResiduals
    """The same, whitened where something wanders."""
    correlations: tuple[SerialCorrelation | None, ...]
    """Of these residuals, by component."""
    walks: tuple[RandomWalk | None, ...]
    """What the p-values allow for, by component."""
    suspects: frozenset[int]
    """Components that may wander."""
    table: tuple[Dependence, ...] = ()
    """Each driver alone."""


@dataclass(frozen=True, eq=False)
class Search:
    """Every test of the residuals, and what was found."""

    first: Round
    last: Round
    """The tests of the residuals as they are, and given all that was found."""
    found: tuple[Found, ...]
    """In the order of what they explain, each given those before."""
    tests: int
    """Number of tests of the first round."""
    either: Found | None
    """What explains about as much as all that was found, or more, but no better than a wander in time does."""

    @property
    def table(self) -> tuple[Dependence, ...]:
        """Each driver alone."""
        return self.first.table

    @property
    def withheld(self) -> tuple[Candidate, ...]:
        """What seems to matter given all that was found, but may as well be a wander in time."""
        return tuple(d.driver for d in self.last.table if d.withheld(self.tests))


def search(sample: Sample, drivers: Sequence[Candidate]) -> Search:
    """Find what the residuals depend on.

    Parameters
    ----------
    drivers : sequence of Driver or Pair
        In the order of preference where several explain the same.
    """
    trials = [(driver, tuple(_trials(sample, driver))) for driver in drivers]
    taken: list[Array] = []
    found: list[Found] = []
    now = first = _tested(sample, taken, trials)
    tests = sum(e is not None for d in first.table for e in d.evidence)
    waiting = {id(d.driver) for d in first.table if d.claimed(tests)}
    while len(found) < MOST_FOUND:
        claims = [_whole(now, d) for d in now.table if d.claimed(tests)]
        claims = [claim for claim in claims if claim.explained > COMPARISON.explained]
        if not claims:
            break
        new = _first(claims)
        driver = new.dependence.driver
        waiting.discard(id(driver))
        taken += [columns for trial in new.trials for columns in trial.all_columns(sample)]
        trials = [(other, t) for other, t in trials if other is not driver]
        now = _tested(sample, taken, trials, now.suspects)
        still = {id(d.driver) for d in now.table if d.claimed(tests)}
        along = tuple(d.driver for d in first.table if id(d.driver) in waiting - still)
        waiting &= still
        found.append(replace(new, along=along))
    most = max((f.explained for f in found), default=0.0)
    named = {id(driver) for f in found for driver in (f.dependence.driver, *f.along)}
    rivals = [_whole(first, d) for d in first.table if d.withheld(tests) and id(d.driver) not in named]
    rivals = [
        rival
        for rival in rivals
        if rival.explained > max(COMPARISON.nearly_as_much * most, COMPARISON.explained)
    ]
    either = _first(rivals) if rivals else None
    if found:  # what a wander would explain as well, and what was found explains in its place
        named |= {id(d.driver) for d in now.table if d.withheld(tests)}
        named |= {id(either.dependence.driver)} if either else set()
        alone = [d for d in first.table if isinstance(d.driver, Driver) and id(d.driver) not in named]
        with_it = tuple(d.driver for d in alone if d.withheld(tests))
        found[0] = replace(found[0], along=(*found[0].along, *with_it))
    return Search(first, now, tuple(found), tests, either)


def _whole(now: Round, dependence: Dependence) -> Found:
    """Return a claim with what it explains; of a pair, with what each of the two does alone."""
    apart = tuple(dependence.trials[i] for i in dependence.good if dependence.trials[i].joint is None)
    best, falls = apart, _falls(now, apart, dependence.total)
    motions: tuple[int, ...] = ()
    one = [(dependence.trials[i],) for i in dependence.good if dependence.trials[i].joint is not None]
    along = [(_falls(now, trials, dependence.total), trials) for trials in one]
    if along:
        # One curve instead of one for each component is the simpler story.
        enough = COMPARISON.nearly_as_much if len(falls) > 1 else 1 / COMPARISON.nearly_as_much
        most, trials = max(along, key=lambda pair: float(pair[0].sum()))
        if most.sum() >= enough * falls.sum():
            best, falls = trials, most
            good = [t[0].joint for f, t in along if f.sum() >= COMPARISON.nearly_as_much * most.sum()]
            motions = tuple(sorted(joint for joint in good if joint is not None))
    return Found(dependence, best, motions, float(falls.sum() / dependence.total.sum()), falls)


def _falls(now: Round, trials: Sequence[Trial], total: Array) -> Array:
    """Return by how much several trials at once lower the sum of squares of each component."""
    columns = [c for trial in trials for c in trial.all_columns(now.space.sample)]
    found = now.space.test(np.concatenate(columns, axis=-1)) if columns else None
    return np.clip(found.falls, 0.0, total) if found else np.zeros_like(total)


def _first(claims: Sequence[Found]) -> Found:
    """Return the claim to be named first."""
    most = max(claim.explained for claim in claims)
    best = next(claim for claim in claims if claim.explained >= COMPARISON.nearly_as_much * most)
    driver = best.dependence.driver
    if driver.in_time:  # a step between set-ups is not a drift
        steps = [c for c in claims if c.dependence.driver.kind == "run" and c.explained >= best.explained]
        best = steps[0] if steps else best
    if isinstance(driver, Pair):
        members = [c for c in claims if c.dependence.driver in (driver.first, driver.second)]
        strong = [c for c in members if c.explained >= COMPARISON.half * best.explained]
        if strong:
            return max(strong, key=lambda claim: claim.explained)
    return best


def _trials(sample: Sample, driver: Candidate) -> Iterator[Trial]:
    """Yield the tests of a driver."""
    for c in range(sample.components):
        yield Trial(driver, component=c)
    if isinstance(driver, Pair):
        joints = [
            d.number for d in (driver.first, driver.second) if d.kind == "joint" and d.number is not None
        ]
        if driver.first.kind == "load":  # it winds up a joint by an arm that later joints swing about
            joints = list(range(joints[0] + 1))
        if driver.first.kind != "target":
            yield from (Trial(driver, joint=joint) for joint in joints)
    elif driver.number is not None:
        yield Trial(driver, joint=driver.number)


def _tested(
    sample: Sample,
    taken: Sequence[Array],
    trials: Sequence[tuple[Candidate, tuple[Trial, ...]]],
    suspects: frozenset[int] = frozenset(),
) -> Round:
    """Test everything; components that have been suspected of wandering stay so, for what is taken out hides it."""
    components = range(sample.components)
    space = ProjectedResiduals(sample, taken)
    correlations = tuple(serial_correlation(space, c) for c in components)
    suspects |= {
        c for c, found in enumerate(correlations) if found and found.log10_p < np.log10(COMPARISON.suspected)
    }
    walks = tuple(random_walk(space, c) if c in suspects else None for c in components)
    filters = {c: walk for c, walk in enumerate(walks) if walk is not None}
    filtered = ProjectedResiduals(sample, taken, filters) if filters else space
    now = Round(space, filtered, correlations, walks, suspects)
    table = tuple(
        Dependence(driver, asked, tuple(_evidence(now, driver, trial) for trial in asked), sample.total)
        for driver, asked in trials
    )
    return replace(now, table=table)


def _evidence(now: Round, driver: Candidate, trial: Trial) -> Explained | None:
    columns, given = trial.columns(now.space.sample), trial.given(now.space.sample)
    plain = now.space.test(columns, given)
    if plain is None or driver.in_time or driver.kind == "run" or now.filtered is now.space:
        return plain
    if trial.component is not None and now.walks[trial.component] is None:
        return plain
    allowed = now.filtered.test(columns, given)
    if allowed is None:
        return None
    return Explained(max(plain.log10_p, allowed.log10_p), plain.falls, plain.log10_p)
