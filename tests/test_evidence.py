"""The evidence of sets of effects, and the set that is selected, on made-up columns.

Costs are compared with densities of normal distributions, of dense covariance matrices by SciPy, and selections with
all sets there are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest
from linear_evidence import evidence_of
from scipy import integrate, linalg, optimize, stats

from rodgen.calibration.candidates import Candidate
from rodgen.calibration.selection import equals, ordered, ranking, select
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.plausibility import Plausibility, Size

N = 400
FLAT = 0.12
"""The cost is looked at along the variance where it is flat within a tenth."""


def candidate(
    name: str,
    place: str,
    columns: np.ndarray,
    *,
    odds: float = 1.0,
    usual: float | None = None,
    positive: bool = False,
    certain: bool = False,
) -> Candidate:
    """Return a candidate of any columns, (n,) or (n, k)."""
    columns = columns.reshape(len(columns), 1, -1)
    effect = SimpleNamespace(name=name, place=place, title=f"{name} at {place}", identity=(name, place))
    effect.definition = SimpleNamespace(own=False, of_all_legs=False)
    names = tuple(f"{place}.{name}.{i}" for i in range(columns.shape[2]))
    sizes = {} if usual is None else {str(i): Size(usual, 100 * usual, positive) for i in range(len(names))}
    return Candidate(effect, names, columns, {}, prior=Plausibility(math.log(odds), sizes, certain))  # type: ignore[arg-type]


def selected(found: Sequence[Candidate], readings: np.ndarray) -> list[str]:
    """Return the titles of what is selected."""
    return sorted(c.effect.title for c in select(evidence_of(found, readings)))


def minus_two_log_density(readings: np.ndarray, columns: np.ndarray, usual: np.ndarray) -> float:
    """Return -2 ln of the density of readings beyond their mean, with the likeliest variance of one, without 2 pi.

    They are normal, with the covariance that effects of normal sizes give them.
    """
    basis = linalg.null_space(np.ones((1, len(readings))))
    y, wide = basis.T @ readings, basis.T @ (columns * usual)

    def cost(log_variance: float) -> float:
        covariance = math.exp(log_variance) * np.eye(len(y)) + wide @ wide.T
        density = stats.multivariate_normal(cov=covariance).logpdf(y)
        return float(-2 * density - len(y) * math.log(2 * math.pi))

    return float(optimize.minimize_scalar(cost, bounds=(-3.0, 4.0), method="bounded").fun)


def few_candidates() -> tuple[list[Candidate], np.ndarray]:
    """Return five candidates of different odds and usual sizes, two of them nearly alike, and readings with two."""
    random = np.random.default_rng(1)
    columns = random.normal(size=(60, 6))
    columns[:, 3] = columns[:, 0] + 0.3 * columns[:, 3]
    found = [
        candidate("gain", "A", columns[:, 0], odds=0.3, usual=1.0),
        candidate("backlash", "A", columns[:, 1], odds=0.1, usual=0.5),
        candidate("wave", "A", columns[:, 4:6], odds=0.2, usual=2.0),
        candidate("gain", "B", columns[:, 3], odds=0.05, usual=3.0),
        candidate("lag", "B", columns[:, 2], odds=1.0, usual=0.7),
    ]
    readings = 0.9 * columns[:, 0] + columns[:, 4:6] @ [0.8, -1.1] + random.normal(size=60)
    return found, readings


def test_the_cost_of_every_set_is_its_density_over_all_usual_sizes():
    found, readings = few_candidates()
    evidence = evidence_of(found, readings)
    nothing = minus_two_log_density(readings, np.zeros((60, 0)), np.zeros(0))
    choice = math.log(0.3 + 0.1 + 0.2 + 0.05 + 1.0)
    for count in range(1, 6):
        for several in itertools.combinations(found, count):
            flat = np.concatenate([c.columns[:, 0] for c in several], axis=1)
            usual = np.concatenate([c.prior.usual(c.short_names) for c in several])
            theta = evidence.estimated(several).theta
            if np.any(np.abs(theta) > usual):
                continue  # wider than usual, which costs in addition
            odds = -2 * sum(c.prior.log_odds for c in several)
            ends = np.cumsum([len(c.names) for c in several])
            for c, end in zip(several, ends, strict=True):
                if len(c.names) > 1:  # these are small together
                    part = slice(end - len(c.names), end)
                    scale = float(np.max(np.abs(theta[part]) / usual[part]))
                    usual[part] *= scale
                    odds -= 2 * math.log(scale)
            odds += 2 * choice * len({c.effect.name for c in several})
            expected = minus_two_log_density(readings, flat, usual) - nothing + odds
            assert evidence.cost(several) - evidence.cost([]) == pytest.approx(expected, abs=FLAT)


def test_the_set_that_is_selected_is_the_most_probable_of_all():
    found, readings = few_candidates()
    evidence = evidence_of(found, readings)
    every = [s for k in range(6) for s in itertools.combinations(found, k)]
    best = min(every, key=evidence.cost)
    assert {c.effect.title for c in best} == {"gain at A", "wave at A"}
    assert {c.effect.title for c in select(evidence)} == {c.effect.title for c in best}


def test_no_set_that_costs_less_than_a_limit_is_left_out() -> None:
    found, readings = few_candidates()
    evidence, left_out = evidence_of(found, readings), 0
    for chosen in (list(some) for k in range(4) for some in itertools.combinations(found, k)):
        limit = evidence.cost(chosen)
        (near,) = evidence.promising([chosen], len(found), limit)
        for c in (c for c in found if c not in (*near, *chosen)):
            assert evidence.cost([*chosen, c]) >= limit
            left_out += 1
    assert left_out  # a limit that leaves nothing out would show nothing


def test_odds_of_an_alternative_are_those_of_its_set():
    random = np.random.default_rng(5)
    x, y = random.normal(size=(2, N))
    found = [
        candidate("gain", "A", x, odds=1.0, usual=1.0),
        candidate("lag", "A", x + 1e-3 * y, odds=0.1, usual=1.0),
        candidate("backlash", "A", y, odds=1.0, usual=1.0),
    ]
    evidence = evidence_of(found, 0.5 * x + 0.1 * random.normal(size=N))
    (chosen,) = select(evidence)
    assert chosen is found[0]
    (alias,) = equals(evidence, [chosen])
    assert alias.candidates == (found[1],)
    assert math.exp(-alias.cost / 2) == pytest.approx(0.1, rel=0.2)  # they are alike but for their odds


def test_one_effect_may_be_in_the_place_of_any_three_of_four() -> None:
    random = np.random.default_rng(7)
    columns = random.normal(size=(N, 4))
    parts = [candidate("zero", name, columns[:, i], usual=1.0) for i, name in enumerate("ABCD")]
    whole = candidate("offset", "T", columns[:, 1:].sum(axis=1) + 0.01 * random.normal(size=N), usual=1.0)
    readings = 3.0 * columns.sum(axis=1) + random.normal(size=N)
    (found, *_) = equals(evidence_of([*parts, whole], readings), parts)
    assert ([c.effect.place for c in found.replaced], found.candidates) == (["B", "C", "D"], (whole,))


@pytest.mark.parametrize("turning", [2, 6])
def test_the_ladder_of_a_robot_is_physical_whatever_explains_most(turning):
    random = np.random.default_rng(3)
    columns, names = random.normal(size=(N, 4)), ["backlash", "gravity_windup", "axis_offset", "zero_offset"]
    definitions = {e.name: e for e in CATALOGUE if "revolute" in e.at}
    found = [candidate(name, "A", column) for name, column in zip(names, columns.T, strict=True)]
    for c in found:
        c.effect.definition = definitions[c.effect.name]
    joints = [SimpleNamespace(revolute=True)] * turning
    machine = SimpleNamespace(joints=joints, measurand=SimpleNamespace(is_direction=False))
    readings = columns @ [8.0, 4.0, 2.0, 1.0] + 0.1 * random.normal(size=N)
    evidence = evidence_of(found, readings, base=SimpleNamespace(machine=machine))
    assert [c.effect.name for c in ordered(evidence, found)] == (names if turning == 2 else names[::-1])


@pytest.mark.parametrize("times", [0.2, 3.0, 20.0])
def test_a_size_far_from_usual_costs_what_a_cauchy_distribution_says(times):
    """Of one effect with its size determined well: the density of Cauchy's distribution integrated over all sizes."""
    random = np.random.default_rng(2)
    x = random.normal(size=N)
    x -= x.mean()
    noise = random.normal(size=N)
    noise -= noise.mean() + x * (x @ noise) / (x @ x)
    y = times * x + noise
    evidence = evidence_of([one := candidate("gain", "A", x, usual=1.0)], y)
    variance = evidence.estimated([one]).variance

    def density(size: float) -> float:
        return math.exp(-((size - times) ** 2) * (x @ x) / 2 / variance) / math.pi / (1 + size**2)

    likely, _ = integrate.quad(density, times - 1, times + 1, points=[times])
    rest = (N - 1) * math.log(variance) + noise @ noise / variance
    exact = rest - 2 * math.log(likely)
    assert evidence.cost([one]) == pytest.approx(exact, abs=2.5 + 4 * math.log(max(times, 1)))


def test_two_effects_that_hide_each_other_are_found():
    random = np.random.default_rng(7)
    first, idle = random.normal(size=N), random.normal(size=(N, 6))
    second = first + 0.15 * random.normal(size=N)  # alone each shows a hundredth of what both do
    readings = 8.0 * (first - second) + random.normal(size=N)
    readings -= readings @ first / (first @ first) * first * 0.98
    found = [candidate("backlash", "A", first), candidate("servo_lag", "B", second)]
    found += [candidate("gain", f"C{k}", idle[:, k]) for k in range(6)]
    assert selected(found, readings) == ["backlash at A", "servo_lag at B"]


def test_two_effects_win_over_three_that_imitate_them():
    random = np.random.default_rng(11)
    first, second, third = random.normal(size=(3, N))
    readings = 3 * first + 3 * second + random.normal(size=N)
    sum_ = first + second + 0.25 * third  # explains most at once
    found = [candidate("gravity_windup", "J2", first), candidate("gravity_windup", "J3", second)]
    found += [candidate("lateral_windup", "J1", sum_), candidate("gain", "J2", third)]
    found += [candidate("gain", "J3", first - second + 0.3 * random.normal(size=N))]
    assert selected(found, readings) == ["gravity_windup at J2", "gravity_windup at J3"]


def test_a_parameter_that_the_data_hardly_narrow_costs_little():
    """Over a short way a wave is a slope; its second parameter is no reason to name the less likely slope."""
    random = np.random.default_rng(4)
    x = random.uniform(-1, 1, N)
    noise = random.normal(size=N)

    def named(usual: float) -> list[str]:
        slope = candidate("gain", "J1", x, odds=0.03, usual=usual)
        wave = candidate("wave", "J1", np.stack([np.cos(x), np.sin(x)], axis=1), odds=0.2, usual=usual)
        idle = [candidate("backlash", f"J{k}", random.normal(size=N)) for k in range(3)]
        return selected([slope, wave, *idle], 3 * np.sin(x) + noise)

    assert named(2.0) == ["wave at J1"]


def test_nothing_is_found_in_noise():
    random = np.random.default_rng(13)
    for _ in range(8):  # a claim is a hundred times as probable as nothing
        found = [candidate("gain", f"J{k}", x, usual=0.3) for k, x in enumerate(random.normal(size=(25, N)))]
        assert selected(found, random.normal(size=N)) == []


def test_what_every_machine_has_is_no_choice():
    random = np.random.default_rng(3)
    x = random.normal(size=(N, 21))
    idle = [candidate(f"idle{k}", "A", x[:, k], usual=0.3) for k in range(20)]
    readings = 0.2 * x[:, 20] + random.normal(size=N)

    def gained(certain: bool) -> float:
        one = candidate("tube_flexure", "A", x[:, 20], usual=0.3, certain=certain)
        evidence = evidence_of([one, *idle], readings)
        return evidence.cost([]) - evidence.cost([one])

    assert gained(True) - gained(False) == pytest.approx(2 * math.log(21), abs=1e-9)


@pytest.mark.parametrize(("times", "named"), [(2.1, "tube_flexure"), (6.0, "harmonics")])
def test_of_what_is_equally_probable_the_usual_one_is_named(times, named):
    """One column: odds of 0.3 cost 2.4, a size of so many times the usual 2 ln(1 + times²): 1.0 and 4.8 more."""
    random = np.random.default_rng(3)
    x = random.normal(size=N)
    both = [
        candidate("harmonics", "EL", x, odds=0.3, usual=1.0),
        candidate("tube_flexure", "EL", x, usual=1 / times),
    ]
    assert selected(both, x + 0.1 * random.normal(size=N)) == [f"{named} at EL"]


def test_a_sign_that_physics_excludes_costs_a_factor_of_a_thousand():
    random = np.random.default_rng(3)
    x = random.normal(size=N)
    readings = -x + 0.5 * random.normal(size=N)
    costs = [
        (e := evidence_of([c := candidate("windup", "A", x, usual=1.0, positive=positive)], readings)).cost(
            [c]
        )
        - e.cost([])
        for positive in (True, False)
    ]
    assert costs[0] - costs[1] == pytest.approx(2 * math.log(1000))


def test_what_the_fitted_parameters_imitate_is_not_seen():
    random = np.random.default_rng(0)
    model = random.normal(size=(60, 3))
    inside = model @ random.normal(size=3)
    nearly = inside + 1e-5 * random.normal(size=60)
    half = np.stack([inside, random.normal(size=60)], axis=1)
    every = [
        candidate(name, "A", columns)
        for name, columns in (("inside", inside), ("nearly", nearly), ("half", half), ("no", np.zeros(60)))
    ]
    evidence = evidence_of(every, random.normal(size=60), model)
    assert [c.effect.name for c in evidence.candidates] == ["half"]
    assert [c.effect.name for c in evidence.unseen] == ["inside", "nearly", "no"]
    across = half[:, 1] - model @ np.linalg.lstsq(model, half[:, 1])[0]
    assert evidence.visible(every[2]) == pytest.approx(np.linalg.norm(across) / np.linalg.norm(half[:, 1]))
    assert ranking(evidence)[0].effect.name == "half"


def test_candidates_beside_others_are_weighed_as_if_those_were_fitted_parameters():
    found, readings = few_candidates()
    others, some = [found[0], found[1], found[4]], found[2:4]
    beside = evidence_of(found, readings).beside(some)
    model = np.column_stack([np.ones(60), *(c.columns.reshape(60, -1) for c in some)])
    fitted = evidence_of(others, readings, model)
    assert beside.dof == fitted.dof
    for chosen in ([others[0]], others[:2], others):
        # rounding of products of sixty readings
        assert beside.explained(chosen) == pytest.approx(fitted.explained(chosen), rel=1e-9)
        more, less = (e.misfit([]) - e.misfit(chosen) for e in (beside, fitted))
        assert more == pytest.approx(less, rel=1e-9)
