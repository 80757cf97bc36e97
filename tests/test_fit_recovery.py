"""A fit finds the errors that a machine has, and knows how well it knows them.

For each effect of the catalogue, the plain simulator measures a machine that has it (about 20 arcsec, 50 µm, or as
far at arms of 500 mm), noise is added, and a model with that effect is fitted; where the tracker stands is unknown,
too. @@
The machine is that of test_machine_models.py with all its effects; those that are not looked at are held at zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from machine_cases import (
    JOINTS,
    TARGETS,
    Case,
    Title,
    data_for,
    effect,
    every,
    frame,
    machine_file,
    noisy,
    title,
    with_effects,
)
from real_machines import real
from scipy import stats

from rodgen.calibration.fit import Fit, fit
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

KINDS = ["point", "direction", "distance"]
ROWS = 80
NOISE = {"point": 0.002, "direction": 2e-6, "distance": 0.002}
"""mm, rad: 0.4 arcsec."""
CHANCE = 1e-4
WELL = 100.0
"""A standard deviation so many times what it were if all others were known is that of a weakly determined parameter:
its intervals are as good as the linear model is over their length, which is another question."""


def titles(kind: str) -> list[Title]:
    """List effects with their places, but for set-ups, which are a choice of coordinates when the frame is free."""
    return [title(block) for block in every(kind).file["effect"] if block["name"] != "frame_shift"]


def errors(case: Case) -> dict[str, float]:
    """Return the errors of the machine: what is estimated, but for weights at later joints, and where the frame is."""
    keys = [
        key
        for key, number in case.model.keys.items()
        if case.model.parameters[number].hold is None and not key.startswith("frame.")
    ]
    values = case.sizeable(keys)
    for key, number in case.model.keys.items():
        if case.model.parameters[number].optional:
            values[key] = 0.0
    return values | frame(case.kind)


@dataclass
class Score:
    """Errors of many fits over their standard deviations, by parameter, and probabilities of their chi-squares."""

    inside: dict[str, list[bool]] = field(default_factory=dict)
    chances: list[float] = field(default_factory=list)

    def add(self, found: Fit, truth: Mapping[str, float]) -> None:
        stated = found.observations.sigma is not None
        left = found.degrees_of_freedom
        quantile = stats.norm.ppf(0.975) if stated else stats.t.ppf(0.975, left)
        numbers = [i for i in well_determined(found) if found.parameters[i].key in truth]
        if not numbers:
            return
        covariance = found.covariance[np.ix_(numbers, numbers)]
        std = np.sqrt(np.diag(covariance))
        error = np.array([found.values[i] - truth[found.parameters[i].key] for i in numbers]) / std
        for i, e in zip(numbers, error, strict=True):
            self.inside.setdefault(found.parameters[i].key, []).append(abs(e) < quantile)
        square = float(error @ np.linalg.solve(covariance / np.outer(std, std), error))
        n = len(numbers)
        self.chances.append(float(stats.chi2.sf(square, n) if stated else stats.f.sf(square / n, n, left)))

    def join(self, other: Score) -> None:
        for key, several in other.inside.items():
            self.inside.setdefault(key, []).extend(several)
        self.chances += other.chances

    @property
    def counts(self) -> tuple[int, int]:
        several = [x for each in self.inside.values() for x in each]
        return sum(several), len(several)


def well_determined(found: Fit) -> list[int]:
    """Return the numbers of the effects' parameters that the data determine well."""
    jacobian = found.problem.jacobian(found.solution.theta, found.solution.frame)
    alone = found.variance_factor / np.maximum(np.einsum("nmp,nmp->p", jacobian, jacobian), 1e-300)
    spread = np.diag(found.covariance)
    return [
        i
        for i in found.free
        if not found.determinacy.undetermined[i]
        and spread[i] < WELL**2 * alone[i]
        and found.parameters[i].slot[0] != "frame"
    ]


def draws(
    kind: str, of: Title, count: int, *, geometry_known: bool = True
) -> Iterator[tuple[Fit, dict[str, float]]]:
    """Fit `count` draws of the noise with stated uncertainty, and as many without."""
    rng = np.random.default_rng([22, KINDS.index(kind), *map(ord, f"{of}")])
    data = data_for(every(kind).file, ROWS, np.random.default_rng([21, KINDS.index(kind)]))
    for stated in ({"noise": NOISE[kind]}, {}):
        case = with_effects(kind, [of], data, geometry_known=geometry_known, **stated)
        values = errors(case)
        truth = case.simulated(values)
        for _ in range(count):
            reading = noisy(kind, truth, NOISE[kind], rng)
            yield fit(case.machine, replace(case.observations, reading=reading), compiled=True), values


def assert_covers(score: Score) -> None:
    """Assert that 93 to 97 % of the intervals hold the truth, or as many as chance allows where they are few."""
    inside, count = score.counts
    low, high = stats.binom.ppf([CHANCE / 2, 1 - CHANCE / 2], count, 0.95) / count
    assert min(low, 0.93) <= inside / count <= max(high, 0.97), (inside, count)
    # Right chi-squares have probabilities that are spread evenly.
    assert stats.kstest(score.chances, "uniform").pvalue > CHANCE


def scored(kind: str, of: Title, count: int, *, geometry_known: bool = True) -> Score:
    score = Score()
    for found, truth in draws(kind, of, count, geometry_known=geometry_known):
        assert found.solution.converged
        score.add(found, truth)
    return score


NOT_SEEN = {"point": set(), "direction": {"Z.load_sag.k0"}, "distance": set()}
"""Parameters that change no reading: of a drop that does not turn, a direction shows nothing."""


@pytest.mark.thorough
@pytest.mark.quick("direction-1")
@pytest.mark.parametrize(
    ("kind", "count"),
    [("point", 1), ("direction", 1), *(pytest.param(kind, 2, marks=pytest.mark.slow) for kind in KINDS)],
)
def test_intervals_of_each_effect_s_parameters_hold_the_truth(kind, count):
    whole = Score()
    for of in titles(kind):
        score = scored(kind, of, count)
        (block,) = (b for b in every(kind).file["effect"] if title(b) == of)
        # left out, as no later joint is heavy
        optional = {f"A.gravity_windup.{k}" for k in ("k_Z", "k_C", "k2_Z")}
        assert score.inside.keys() == set(every(kind).keys_of(block)) - NOT_SEEN[kind] - optional
        whole.join(score)
    assert_covers(whole)


def test_a_frame_that_distances_do_not_see_takes_no_uncertainty_from_effects():
    """Distances from where a point starts do not see how the frame is turned, in three directions of the parameters."""
    (found, _), *_ = draws("distance", ("radial_error_motion", "A"), 1)
    effects = [i for i in found.free if found.parameters[i].slot[0] != "frame"]
    assert len(effects) == 8
    assert found.determinacy.rank == len(found.free) - 3
    jacobian = found.problem.jacobian(found.solution.theta, found.solution.frame)
    columns = jacobian.reshape(-1, jacobian.shape[-1])[:, list(found.free)]
    size = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / size, rcond=1e-9) / size[:, None]
    variances = found.variance_factor * np.sum(inverse[-8:] ** 2, axis=1)
    assert np.diag(found.covariance)[effects] == pytest.approx(variances, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_of_each_effect_hold_the_truth_in_many_draws(kind):
    """With 150 draws an effect; one effect's intervals may be off by what chance makes of so few."""
    whole = Score()
    for of in titles(kind):
        score = scored(kind, of, 75)
        inside, count = score.counts
        # errors of one fit depend on each other: at worst there are as many as there are fits
        low = stats.binom.ppf(CHANCE, 150, 0.95) / 150
        assert inside / count >= low, (of, inside, count)
        assert stats.kstest(score.chances, "uniform").pvalue > CHANCE, of
        whole.join(score)
    inside, count = whole.counts
    assert 0.93 <= inside / count <= 0.97
    assert_covers(whole)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_where_the_geometry_is_estimated_too(kind):
    """Axes, points, targets and the frame are free: a choice of coordinates must not be reported as determined."""
    whole = Score()
    for of in titles(kind):
        whole.join(scored(kind, of, 10, geometry_known=False))
    inside, count = whole.counts
    assert 0.93 <= inside / count <= 0.97
    assert_covers(whole)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["point", "direction"])  # distances do not see a turn about where they start
def test_intervals_of_set_ups_hold_the_truth(kind):
    file = machine_file(JOINTS[1:], TARGETS, kind=kind, effects=[effect("frame_shift")], noise=NOISE[kind])
    rng = np.random.default_rng(23)
    case = Case(file, data_for(file, ROWS, rng, runs=3))
    values = case.sizeable(case.model.keys)
    truth, score = case.simulated(values), Score()
    for _ in range(40):
        reading = noisy(kind, truth, NOISE[kind], rng)
        score.add(fit(case.machine, replace(case.observations, reading=reading), compiled=True), values)
    assert len(score.inside) == 3 * (3 if kind == "direction" else 6)
    assert_covers(score)


@pytest.mark.thorough
@pytest.mark.parametrize("stated", [True, False])
def test_weights_at_later_joints_are_taken_in_where_they_matter(stated):
    of = ("gravity_windup", "A")
    rng = np.random.default_rng(24)
    data = data_for(every("point").file, ROWS, rng)
    case = with_effects(
        "point", [of], data, geometry_known=True, **({"noise": NOISE["point"]} if stated else {})
    )
    score = Score()
    for heavy in ({"k_C"}, {"k_Z", "k_C"}, {"k2_Z"}):
        values = errors(case) | {f"A.gravity_windup.{k}": 3e-6 for k in heavy}
        truth = case.simulated(values)
        for _ in range(15):
            reading = noisy("point", truth, NOISE["point"], rng)
            found = fit(case.machine, replace(case.observations, reading=reading), compiled=True)
            taken = {found.parameters[i].key for i in found.free if found.parameters[i].optional}
            assert taken == {f"A.gravity_windup.{k}" for k in heavy}
            score.add(found, values)
    assert_covers(score)
    # a fit that begins where this one ended estimates them, too
    again = found.refit()
    assert taken == {again.parameters[i].key for i in again.free if again.parameters[i].optional}
    assert {key: again.estimates[key].std for key in taken} == pytest.approx(
        {key: found.estimates[key].std for key in taken}, rel=1e-6
    )


@pytest.mark.slow
def test_no_weight_is_taken_in_that_is_absurd_for_a_robot(tmp_path):
    """A weight off the line of J3, with a short lever arm, followed the encoder of J2: 5600 arcsec at whole reach."""
    machine, data = real("7R", 11).write(tmp_path)
    robot = Machine.load(machine)
    for name, joints in {"backlash": "123", "gravity_windup": "24", "encoder_eccentricity": "13"}.items():
        for joint in joints:
            robot = robot.add(name, joint=f"J{joint}")
    found = fit(robot, Measurements.load(data))
    sizes = [e.value for key, e in found.estimates.items() if ".gravity_windup." in key and e.value]
    assert len(sizes) == 4  # arcsec/mm
    assert max(map(abs, sizes)) < 0.1
