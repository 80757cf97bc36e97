"""Two effects that hide each other, or that three others imitate one after the other, are found together."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rodgen.calibration.diagnose.candidate_space import CandidateSpace
from rodgen.calibration.diagnose.candidates import Candidate
from rodgen.calibration.diagnose.selection import Selection
from rodgen.machines.effects.plausibility import Plausibility, Size
from rodgen.statistics.columns import orthonormal_basis, pair_falls, project_out, unchanged

N = 400


def test_falls_of_pairs_are_those_of_least_squares():
    random = np.random.default_rng(3)
    bases = [orthonormal_basis(random.normal(size=(60, k))) for k in (1, 3, 2, 1, 3)]
    bases.append(orthonormal_basis(bases[1] @ random.normal(size=(3, 2))))  # within another one
    residual = random.normal(size=60)
    found = pair_falls(bases, residual, least=1e-6)
    assert found == pytest.approx(found.T, rel=1e-9)
    assert not found.diagonal().any()
    for i in range(len(bases)):
        for j in range(i):
            both = orthonormal_basis(np.concatenate([bases[i], bases[j]], axis=1))
            wanted = residual @ residual - np.sum(project_out(both, residual) ** 2)
            assert found[i, j] == pytest.approx(wanted, rel=1e-9)


def candidate(name: str, place: str, columns: np.ndarray) -> Candidate:
    """Return a candidate of any columns, (N,) or (N, k); after the first, of weights at later joints if at all."""
    columns = columns.reshape(N, 1, -1)
    definition = SimpleNamespace(
        at={"revolute"},
        formula=SimpleNamespace(names={"q", "s"}),
        per_run=False,
        parameters={"0": "1"},
        later_joints=name == "gravity_windup",
    )
    effect = SimpleNamespace(name=name, place=place, title=f"{name} at {place}", definition=definition)
    return Candidate(effect, tuple(f"{place}.{name}.{i}" for i in range(columns.shape[2])), columns, {})


def selected(found: list[Candidate], readings: np.ndarray) -> list[str]:
    """Return the titles of what is selected; errors on poses left out are those of the columns."""
    model = np.ones((N, 1, 1))

    def held_out(columns) -> float:
        whole = np.concatenate([model, *columns], axis=2).reshape(N, -1)
        basis = orthonormal_basis(whole)
        return float(np.sqrt(np.mean((project_out(basis, readings) / (1 - np.sum(basis**2, axis=1))) ** 2)))

    space = CandidateSpace(model, found, unchanged)
    several_joints = SimpleNamespace(q=np.arange(2.0 * N).reshape(N, 2))
    blocks = SimpleNamespace(held_out=held_out, observations=several_joints)
    clusters = SimpleNamespace(penalty=lambda others, columns: 0.0, residual=readings.reshape(N, 1))
    selection = Selection(space, blocks, N, clusters)
    return sorted(c.effect.title for c in selection.run())


def test_two_effects_that_hide_each_other_are_found():
    random = np.random.default_rng(7)
    first, idle = random.normal(size=N), random.normal(size=(N, 6))
    second = first + 0.15 * random.normal(size=N)  # alone each shows a hundredth of what both do
    readings = 8.0 * (first - second) + random.normal(size=N)
    readings -= readings @ first / (first @ first) * first * 0.98
    found = [candidate("backlash", "A", first), candidate("servo_lag", "B", second)]
    found += [candidate("scale", f"C{k}", idle[:, k]) for k in range(6)]
    assert selected(found, readings) == ["backlash at A", "servo_lag at B"]


def test_the_weight_at_a_later_joint_is_no_effect_of_its_own():
    random = np.random.default_rng(5)
    target, later, idle = random.normal(size=(3, N))
    found = [
        candidate("gravity_windup", "J2", target),
        candidate("gravity_windup", "J2", np.stack([target, later], axis=1)),
        candidate("coupling", "J3", later + 0.05 * random.normal(size=N)),
        candidate("scale", "J4", idle),
    ]
    noise = random.normal(size=N)
    assert selected(found, 3 * target + 3 * later + noise) == ["gravity_windup at J2"]
    assert selected(found, 3 * target + 3 * idle + noise) == ["gravity_windup at J2", "scale at J4"]


def test_what_a_light_part_may_do_is_no_effect_of_another_joint():
    """A weight that the data hardly call for is not taken in, but it is there."""
    random = np.random.default_rng(5)
    target, heavy, light, idle = random.normal(size=(4, N))
    found = [
        candidate("gravity_windup", "J2", np.stack([target, *some], axis=1))
        for some in ([], [heavy], [light], [heavy, light])
    ]
    found += [
        candidate("backlash", "J3", light + 0.05 * random.normal(size=N)),
        candidate("scale", "J4", idle),
    ]
    readings = 3 * target + 3 * heavy + 0.21 * light + random.normal(size=N)
    assert selected(found[:2] + found[4:], readings) == ["backlash at J3", "gravity_windup at J2"]
    assert selected(found, readings) == ["gravity_windup at J2"]
    assert selected(found, readings + idle) == ["gravity_windup at J2", "scale at J4"]


def test_a_parameter_that_the_data_hardly_narrow_costs_little():
    """Over a short way a wave is a slope; its second parameter is no reason to name the less likely slope."""
    random = np.random.default_rng(4)
    x = random.uniform(-1, 1, N)

    def likely(found: Candidate, odds: float, usual: float) -> Candidate:
        sizes = {name: Size(usual, 100.0) for name in found.short_names}
        return replace(found, prior=Plausibility(np.log(odds), sizes))

    def named(usual: float) -> list[str]:
        slope, wave = (
            candidate("scale", "J1", x),
            candidate("wave", "J1", np.stack([np.cos(x), np.sin(x)], axis=1)),
        )
        idle = [candidate("backlash", f"J{k}", random.normal(size=N)) for k in range(3)]
        return selected([likely(slope, 0.03, usual), likely(wave, 0.2, usual), *idle], 3 * np.sin(x) + noise)

    noise = random.normal(size=N)
    assert named(2.0) == ["wave at J1"]
    assert named(2e3) == ["scale at J1"]  # of a cosine that may be so large the data would leave a thousandth


def test_two_effects_win_over_three_that_imitate_them():
    random = np.random.default_rng(11)
    first, second, third = random.normal(size=(3, N))
    readings = 3 * first + 3 * second + random.normal(size=N)
    sum_ = first + second + 0.25 * third  # explains most at once
    found = [candidate("gravity_windup", "J2", first), candidate("gravity_windup", "J3", second)]
    found += [candidate("lateral_windup", "J1", sum_), candidate("scale", "J2", third)]
    found += [candidate("scale", "J3", first - second + 0.3 * random.normal(size=N))]
    assert selected(found, readings) == ["gravity_windup at J2", "gravity_windup at J3"]


def test_nothing_is_found_in_noise_by_pairs():
    random = np.random.default_rng(13)
    claims = 0
    for _ in range(20):
        found = [candidate("scale", f"J{k}", x) for k, x in enumerate(random.normal(size=(25, N)))]
        claims += bool(selected(found, random.normal(size=N)))
    assert claims <= 1  # the rate is one of a hundred
