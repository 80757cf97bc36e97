"""The evidence of sets of effects, and the set that is selected, on made-up columns.

Costs are compared with densities of normal distributions, of dense covariance matrices by SciPy, and selections with
all sets there are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_effects import hidden
from linear_evidence import evidence_of
from scipy import integrate, linalg, optimize, stats
from scipy.spatial.transform import Rotation

import rodgen
from rodgen.calibration.candidates import Candidate
from rodgen.calibration.diagnose import diagnose
from rodgen.calibration.evidence import Evidence
from rodgen.calibration.remarks import lifted, on_preferred
from rodgen.calibration.selection import equals, ordered, ranking, select
from rodgen.data.units import unit_factor
from rodgen.machines.effects.catalogue import CATALOGUE
from rodgen.machines.machine import Machine
from rodgen.machines.model import Model
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


# Several waves of one encoder beside a lag are found together


TABLE = """name = "Table"
units = { length = "mm", angle = "deg" }
joint = [{ name = "C", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] }]
target = [{ name = "ball", point = [200, 0, 50] }]
measured = { kind = "point", frame = "free" }
"""
WAVES = {1: (60, 30), 2: (20, -12), 4: (8, 9), 8: (6, -5)}
ARCSEC = np.pi / 648000


def test_one_two_four_and_eight_waves_a_turn_beside_a_lag(tmp_path):
    rng = np.random.default_rng(1)
    q, v = rng.uniform(-np.pi, np.pi, 300), np.radians(rng.choice([-10, -5, 0, 5, 10], 300))
    off = sum(a * np.cos(k * q) + b * np.sin(k * q) for k, (a, b) in WAVES.items()) * ARCSEC - 0.003 * v
    place = np.stack([200 * np.cos(q + off), 200 * np.sin(q + off), np.full(300, 50.0)], -1)
    table = np.column_stack([np.degrees(q), np.degrees(v), place + rng.normal(0, 0.001, place.shape)])
    (tmp_path / "machine.toml").write_text(TABLE)
    header = "C [deg],v_C [deg/s],x [mm],y [mm],z [mm]"
    np.savetxt(tmp_path / "data.csv", table, "%.7f", ",", header=header, comments="")
    fit = Machine.load(tmp_path / "machine.toml").fit(rodgen.Measurements.load(tmp_path / "data.csv"))
    names = {c.effect.name for c in select(Evidence.of(fit))}
    assert names == {"servo_lag", "encoder_eccentricity", "encoder_ellipticity", "encoder_harmonics"}


# A target that was taken off between runs and put on again


ARM = """name = "Two axes of an arm"
units = { length = "mm", angle = "deg" }
joint = [
  { name = "A1", type = "revolute", axis = [0, 0, 1], point = [0, 0, 0] },
  { name = "A2", type = "revolute", axis = [0, 1, 0], point = [0, 0, 340] },
]
target = [{ name = "marker", point = [0, 0, 1300]ATTITUDE }]
measured = { kind = "KIND", frame = "free" }
estimate = { parameters = ["target"] }
"""
KEY = ("target_remounting", "marker")


def arm(folder: Path, turns, heights, *, kind="pose", rows=12, attitude=""):
    """Write what a tracker reads of a marker that sits in each run turned by some degrees and at some height."""
    rng = np.random.default_rng(2)
    table = []
    for run, (turn, height) in enumerate(zip(turns, heights, strict=True), 1):
        for _ in range(rows):
            a, b = rng.uniform(-150, 150), rng.uniform(-80, 80)
            m = Rotation.from_euler("ZY", [a, b], degrees=True)
            place = m.apply([0, 0, height - 340]) + [0, 0, 340] + rng.normal(0, 0.1, 3)  # noqa: RUF005
            noise = Rotation.from_rotvec(1e-4 * rng.normal(size=3))
            turned = noise * m * Rotation.from_euler("Z", turn, degrees=True)
            turn_vector = turned.as_rotvec(degrees=True) if kind == "pose" else []
            table.append([a, b, *place, *turn_vector, run])
    (folder / "machine.toml").write_text(ARM.replace("KIND", kind).replace("ATTITUDE", attitude))
    read = ["rx [deg]", "ry [deg]", "rz [deg]"] if kind == "pose" else []
    header = ",".join(["A1 [deg]", "A2 [deg]", "x [mm]", "y [mm]", "z [mm]", *read, "run"])
    np.savetxt(folder / "data.csv", table, "%.9g", ",", header=header, comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


@pytest.mark.thorough
@pytest.mark.parametrize("attitude", ["", ", attitude = [10, 0, 40]"])
def test_a_marker_that_was_turned_between_runs_is_found_and_measured(attitude, tmp_path):
    base = arm(tmp_path, (0, 20, 38), (1300, 1297, 1302), attitude=attitude)
    evidence = Evidence.of(base)
    (chosen,) = select(evidence)
    assert chosen.key == KEY
    final = base.machine.with_effect(chosen.effect).fit(base.observations.data)
    assert final.rms < 0.12
    for run, turn, height in ((2, 20, -3), (3, 38, 2)):
        found = {x: final.estimates[f"marker.target_remounting[{run}].{x}"] for x in ("z", "rx", "ry", "rz")}
        assert found["z"].value == pytest.approx(height, abs=5 * found["z"].std)
        degrees = [found[x].value / 3600 for x in ("rx", "ry", "rz")]
        assert degrees == pytest.approx([0, 0, turn], abs=0.02)


def test_a_ball_that_was_put_on_again_is_found_by_its_places(tmp_path):
    base = arm(tmp_path, (0, 0, 0), (1300, 1299, 1301), kind="point")
    assert [c.key for c in select(Evidence.of(base))] == [KEY]


def test_nothing_is_remounted_where_nothing_was_and_where_there_is_one_run(tmp_path):
    base = arm(tmp_path, (0, 0, 0), (1300, 1300, 1300))
    evidence = Evidence.of(base)
    assert select(evidence) == []
    assert KEY in {c.key for c in evidence.candidates}
    one = arm(tmp_path, (0,), (1300,))
    assert KEY not in {c.key for c in Evidence.of(one).candidates}
    model = Model(one.machine.add(*KEY[:1], target=KEY[1]), runs=("1",))
    assert not any("remounting" in key for key in model.keys)
    assert one.machine.add("target_remounting", target="marker").fit(
        one.observations.data
    ).rms == pytest.approx(one.rms)


# Play shows in a scan to and fro: the order of the rows says from which side each position was approached


ANTENNA = """name = "Antenna"
units = { length = "mm", angle = "deg" }
joint = [
  { name = "AZ", type = "revolute", axis = [0, 0, -1] },
  { name = "EL", type = "revolute", axis = [1, 0, 0] },
]
target = [{ name = "beam", point = [0, 1, 0] }]
measured = { kind = "direction", frame = "free" }
"""


def scan(folder: Path, play: float, *, shuffled: bool = False):
    """Write directions of an antenna that sweeps its azimuth to and fro, and stays behind by half of the play."""
    rng = np.random.default_rng(5)
    line = np.linspace(-100, 100, 12)
    az = np.concatenate([line if k % 2 == 0 else line[::-1] for k in range(8)])
    el = np.repeat(10 + 8 * np.arange(8), 12)
    side = np.sign(np.diff(az, prepend=az[0]))
    for i in range(len(side)):  # where only the elevation moved, the azimuth leans to the side of before
        side[i] = side[i] or (side[i - 1] if i else 1)
    a, e = np.radians(az) - side * play / 2 * ARCSEC, np.radians(el)
    u = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], -1)
    u += rng.normal(size=u.shape) * 2 * ARCSEC
    table = np.column_stack([az, el, u / np.linalg.norm(u, axis=1, keepdims=True)])
    if shuffled:
        rng.shuffle(table)
    (folder / "machine.toml").write_text(ANTENNA)
    np.savetxt(folder / "data.csv", table, "%.9f", ",", header="AZ [deg],EL [deg],ux,uy,uz", comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


def test_play_shows_in_a_scan_of_directions(tmp_path):
    fit = scan(tmp_path, 20.0)
    assert fit.observations.approach_assumed.tolist() == [True, False]
    evidence = Evidence.of(fit)
    assert [c.key for c in select(evidence)] == [("backlash", "AZ")]
    (one,) = (c for c in evidence.candidates if c.key == ("backlash", "AZ"))
    assert one.prior.log_odds == pytest.approx(np.log(0.2 * 0.1))  # of a telescope, as far as the order tells
    assert [c.key for c in select(Evidence.of(scan(tmp_path, 0.0)))] == []


def test_directions_in_any_order_are_no_scan(tmp_path):
    assert not scan(tmp_path, 20.0, shuffled=True).observations.approach_assumed.any()


# A drive that yields the wrong way says that gravity is the wrong way round; a preferred effect is answered


AXES = np.array([(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], float)
POINTS = np.array(
    [(0, 0, 0), (0, 0, 400), (0, 0, 1000), (300, 0, 1100), (900, 0, 1100), (950, 0, 1100)], float
)
TOOL = np.array([1100.0, 0.0, 1120.0])
MASSES = (0, 120, 60, 25, 10, 8)
GIVES_WAY = (0, 4e-9, 9e-9, 0, 0, 0)
"""Radians per newton and millimetre."""


def motions(q):
    """Return the motion of each link, as rotation and translation, of the bed first."""
    turn, at = np.eye(3), np.zeros(3)
    found = [(turn, at)]
    for n, p, angle in zip(AXES, POINTS, q, strict=True):
        rotation = Rotation.from_rotvec(angle * n).as_matrix()
        at = at + turn @ (p - rotation @ p)
        turn = turn @ rotation
        found.append((turn, at))
    return found


def sagging(folder: Path, gravity: float):
    """Write a robot whose second and third drive yield to weights in the middle of its links, and fit it."""
    rng = np.random.default_rng(1)
    middles = (POINTS + np.vstack([POINTS[1:], TOOL])) / 2
    rows = []
    for _ in range(60):
        q = np.radians(rng.uniform(-1, 1, 6) * [150, 60, 70, 150, 100, 150])
        links, off = motions(q), np.zeros(6)
        for i in np.flatnonzero(GIVES_WAY):
            turn, at = links[i]
            for mass, middle, (turn_k, at_k) in list(zip(MASSES, middles, links[1:], strict=True))[i:]:
                arm = turn_k @ middle + at_k - (turn @ POINTS[i] + at)
                off[i] += GIVES_WAY[i] * (turn @ AXES[i]) @ np.cross(arm, [0, 0, gravity * 9.81 * mass])
        turn, at = motions(q + off)[-1]
        rows.append([*np.degrees(q), *(turn @ TOOL + at + rng.normal(0, 0.05, 3))])
    joints = "\n".join(
        f'  {{ name = "J{i}", type = "revolute", axis = {n.tolist()}, point = {p.tolist()} }},'
        for i, (n, p) in enumerate(zip(AXES, POINTS, strict=True), 1)
    )
    (folder / "machine.toml").write_text(
        f'name = "Robot"\nunits = {{ length = "mm", angle = "deg" }}\njoint = [\n{joints}\n]\n'
        f'target = [{{ name = "tool", point = {TOOL.tolist()} }}]\n'
        'measured = { kind = "point", frame = "free" }\nestimate = { parameters = ["target"] }\n'
    )
    header = ",".join([*(f"J{i} [deg]" for i in range(1, 7)), "x [mm]", "y [mm]", "z [mm]"])
    np.savetxt(folder / "data.csv", rows, "%.5f", ",", header=header, comments="")
    data = rodgen.Measurements.load(folder / "data.csv")
    return Machine.load(folder / "machine.toml").fit(data)


@pytest.mark.parametrize("gravity", [-1.0, 1.0])
def test_weight_that_lifts_asks_for_gravity(gravity, tmp_path):
    base = sagging(tmp_path, gravity)
    evidence = Evidence.of(base)
    chosen = select(evidence)
    assert {c.key for c in chosen} == {("gravity_windup", "J2"), ("gravity_windup", "J3")}
    machine = base.machine
    for c in chosen:
        machine = machine.with_effect(c.effect)
    final = base.refit(machine)
    found = list(lifted(final.machine, [c.effect for c in chosen], final.estimates))
    assert found == ["weight lifts J2 and J3: is gravity the right way round?"] * (gravity > 0)
    scale, nothing = on_preferred(evidence, chosen, [("scale", "J2"), ("tube_flexure", None)])
    assert scale.startswith("scale at J2 was preferred: it is ")
    assert scale.endswith("times less probable than what was chosen.")
    assert nothing == "tube_flexure was preferred, but no such effect can be seen in this machine or table."
    assert list(on_preferred(evidence, chosen, [("gravity_windup", None)])) == []


# How large an effect could be without being found: as large as simulations say


DRAWS = 20


@pytest.fixture(scope="module")
def innocent(tmp_path_factory):
    machine, data = hidden("gantry", 3, []).write(tmp_path_factory.mktemp("innocent"))
    return rodgen.Machine.load(machine).fit(rodgen.Measurements.load(data))


def share_found(base, one, factor):
    """Return the share of simulated data sets in which an effect of some times the stated size is found."""
    evidence = Evidence.of(base)
    rows = evidence.sensitivities
    own = next(c for c in evidence.candidates if c.effect.title == one.effect.title)
    i = own.short_names.index(one.parameter)
    size = factor * one.size * unit_factor(one.unit, base.machine.length_unit)[0]
    rng = np.random.default_rng(0)
    scale = np.std(rows.residual)
    count = 0
    for _ in range(DRAWS):
        residual = scale * rng.standard_normal(rows.residual.shape) - size * own.columns[:, :, i]
        count += bool(select(evidence_of(evidence.candidates, -residual, rows.model, base)))
    return count / DRAWS


@pytest.mark.thorough
@pytest.mark.parametrize(
    "title", ["squareness at Y", pytest.param("gravity_sag at X", marks=pytest.mark.slow)]
)
def test_an_effect_of_the_stated_size_is_found_in_95_of_100_data_sets(innocent, title):
    found = diagnose(innocent)
    one = next(one for one in found.could_hide if one.effect.title == title)
    assert share_found(innocent, one, 1.0) > 0.8  # 0.95, and three standard deviations of 20 draws
    assert share_found(innocent, one, 0.5) < 0.5


def test_text_and_json_say_what_could_hide(innocent):
    found = diagnose(innocent)
    assert found.verdict == "nothing_missing"
    text = " ".join(str(found).split())
    assert "How much of it is noise is not known" in " ".join(
        text.split()
    )  # none is stated, and no pose was repeated
    first = next(one for one in found.could_hide if one.possible)
    assert f"{first.effect.title} {first.parameter} = " in text
    assert "e+" not in text  # 4000 arcsec, not 4e+03
    assert not {one.effect.title for one in found.could_hide} & {effect.title for effect in found.unseen}
    printed = found.to_dict()["could_hide"]
    assert len(printed) == len(found.could_hide) > 30
    assert [one["rms"] for one in printed] == sorted((one["rms"] for one in printed), reverse=True)
    assert all(one["size"] > 0 and one["unit"] for one in printed)


def test_sizes_that_no_machine_has_are_no_table_of_what_may_be_there(innocent):
    found = diagnose(innocent)
    first, *others = found.could_hide
    text = " ".join(str(replace(found, could_hide=(replace(first, possible=False), *others))).split())
    assert f"{first.effect.title} {first.parameter} = " not in text
    assert f"only more than any machine has of {first.effect.title}." in text


def test_a_size_is_possible_that_machines_have(innocent):
    by = {(one.effect.title, one.parameter): one for one in diagnose(innocent).could_hide}
    scale = next(one for (title, _), one in by.items() if title == "scale at X")
    assert scale.possible
    assert scale.size < 0.05  # the largest of the table
