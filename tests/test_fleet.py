"""Many machines: results that survive, what is common, odd or changes, and how often that is wrong."""

from __future__ import annotations

import html
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fleet_tasks import squared_unless_killed
from shown_numbers import missing, numbers_of, words_of
from simulated_fleet import Truth, make_fleet

from rodgen.calibration.fleet import Fleet, Pair, diagnose_fleet, pairs_of
from rodgen.calibration.fleet.changes import Changes, Night
from rodgen.calibration.fleet.store import FleetMachine, Plan, write_plan
from rodgen.calibration.fleet.summary import parameter_cells, valued
from rodgen.cli.main import main
from rodgen.schedulers import local_processes
from rodgen.statistics.drift import drifts
from rodgen.statistics.random_effects import population
from rodgen.statistics.thresholds import FLEET

COUNT = FLEET.fewest


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Truth, Fleet]:
    """A folder with a fleet, one of whose machines sags, and two that cannot be diagnosed; and its results."""
    folder = tmp_path_factory.mktemp("fleet")
    truth = make_fleet(folder, COUNT, m3=60.0)
    (folder / "data-0/broken.csv").write_text("AZ [deg],EL [deg]\n1,2\n")
    (folder / "machines/broken.toml").write_text((folder / "machines/m0.toml").read_text())
    (folder / "data-0/lonely.csv").write_text("AZ [deg],EL [deg],ux,uy,uz\n")
    pairs = pairs_of(str(folder / "machines"), str(folder / "data-0"))
    return folder, truth, diagnose_fleet(pairs, folder / "results", date="2026-11-20")


@pytest.mark.thorough
def test_an_effect_that_all_have_is_common(fleet: tuple[Path, Truth, Fleet]) -> None:
    _, truth, found = fleet
    (kind,) = found.kinds
    effect = kind.effects[0]
    assert (effect.title, effect.common, len(kind.machines)) == ("tube_flexure", True, COUNT)
    (parameter,) = effect.parameters
    others = parameter.population
    # five standard deviations of the mean, and the interval of the spread
    assert abs(others.mean - truth.mean) < 5 * others.mean_std
    assert others.spread_interval[0] < truth.spread < others.spread_interval[1]


def test_the_machine_that_sags_is_odd(fleet: tuple[Path, Truth, Fleet]) -> None:
    _, truth, found = fleet
    first = found.odd[0]
    assert (first.machine, first.key) == ("m3", "tube_flexure.a")
    assert abs(first.value - truth.flexure["m3"]) < 5 * first.std


def test_what_cannot_be_diagnosed_is_named(fleet: tuple[Path, Truth, Fleet]) -> None:
    _, _, found = fleet
    assert sorted(machine.name for machine in found.failed) == ["broken", "lonely"]
    assert all("; expected" in machine.error for machine in found.failed)
    text = found.summary()
    assert f"{COUNT + 2} machines, 2026-11-20: effects are missing in {COUNT} and 2 could not" in text
    assert all(machine.error in " ".join(text.split()) for machine in found.failed)


@pytest.mark.thorough
def test_each_number_of_the_page_stands_in_the_text_and_in_the_json(fleet: tuple[Path, Truth, Fleet]) -> None:
    found = fleet[2]
    shown = numbers_of(" ".join(words_of(found._repr_html_())))
    assert len(shown) > 10
    assert shown <= numbers_of(str(found.document()))
    # of the method: its level, the fewest machines, and that of intervals; and bounds of small probabilities
    limits = {f"{100 * FLEET.false_discoveries:g}", str(FLEET.fewest), "95"}
    limits |= {number for number in shown if number.startswith("1e-")}
    assert missing(shown - limits, json.loads(json.dumps(found.to_dict()))) == set()


@pytest.mark.thorough
def test_what_is_done_is_not_done_again(fleet: tuple[Path, Truth, Fleet]) -> None:
    folder, _, _ = fleet
    results = folder / "results/machines"
    times = {file.name: file.stat().st_mtime_ns for file in results.iterdir()}
    table = folder / "data-0/broken.csv"  # which is soon done
    table.write_text(table.read_text() + "\n")
    (results / "m2.json").write_text('{"half')
    (results / "lonely.json").write_text('{"key": 3}')
    diagnose_fleet(pairs_of(str(folder / "machines"), str(folder / "data-0")), folder / "results")
    changed = {file.name for file in results.iterdir() if file.stat().st_mtime_ns != times[file.name]}
    assert changed == {"broken.json", "m2.json", "lonely.json"}


def test_command_says_what_is_wrong(
    fleet: tuple[Path, Truth, Fleet], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _, _ = fleet
    files = [str(folder / "machines"), str(folder / "data-0"), "-o", str(folder / "results")]
    assert main(["fleet", *files, "--json"]) == 2  # two machines could not be diagnosed
    found = json.loads(capsys.readouterr().out)
    assert found["verdicts"] == {"effects_missing": COUNT}
    assert set(found["failed"]) == {"broken", "lonely"}
    assert found["odd"][0]["machine"] == "m3"
    history = ["--history", str(folder / "results")]
    assert main(["fleet", *files[:2], "-o", str(folder / "later"), *history, "--date", "2026-11-19"]) == 2
    assert "earlier results" in capsys.readouterr().err
    assert main(["fleet", *files, "--date", "tomorrow"]) == 2
    assert "--date" in capsys.readouterr().err


def test_report_shows_what_the_fleet_says(
    fleet: tuple[Path, Truth, Fleet], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _, _ = fleet
    found = Fleet.load(folder / "results")
    page = folder / "fleet.html"
    assert main(["report", str(folder / "results"), "-o", str(page)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    text = html.unescape(page.read_text())
    (kind,) = found.kinds
    (parameter,) = kind.effects[0].parameters
    mean, spread, _ = parameter_cells(parameter)
    p, i = parameter.population, parameter.machines.index("m1")
    alone = valued(float(parameter.values[i]), float(parameter.std[i]), parameter.unit)
    given = valued(float(p.shrunk[i]), float(p.shrunk_std[i]), parameter.unit)
    for cell in (mean, spread, alone, given, *(machine.error for machine in found.failed)):
        assert f">{cell}</td>" in text
    assert text.count('class="plot"') >= 1
    assert main(["report", str(folder / "results"), "-o", str(page), "--radius", "AZ=1mm"]) == 2
    assert "--radius: given with results of a fleet" in capsys.readouterr().err
    assert main(["report", str(folder / "machines"), "-o", str(page)]) == 2
    assert "no such file; expected results of 'rodgen fleet'" in capsys.readouterr().err


def test_another_fleet_that_is_written_to_the_same_folder_meanwhile_is_refused(
    refuses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other(pair: Pair) -> dict[str, Any]:
        write_plan(str(tmp_path), Plan("2026-11-21", 1.0, (), ()))
        return {"error": "no file", "key": {"format": 1}}

    monkeypatch.setattr("rodgen.calibration.fleet.run.diagnose_pair", other)
    refuses(diagnose_fleet, [Pair("a", "", "")], tmp_path)


def test_pairs_come_from_folders_or_from_one_machine_file(refuses, tmp_path: Path) -> None:
    for name in ("a.toml", "a.csv.gz", "b.parquet"):
        (tmp_path / name).touch()
    a, b = str(tmp_path / "a.csv.gz"), str(tmp_path / "b.parquet")
    machine = str(tmp_path / "a.toml")
    assert pairs_of(machine, str(tmp_path)) == [Pair("a", machine, a), Pair("b", machine, b)]
    refuses(pairs_of, str(tmp_path / "c.toml"), str(tmp_path))
    assert pairs_of(str(tmp_path), str(tmp_path)) == [Pair("a", machine, a), Pair("b", "", b)]
    refuses(pairs_of, machine, machine)


# processes ---------------------------------------------------------------------------------------------


def test_the_end_of_a_process_is_the_end_of_one_task() -> None:
    with local_processes(2) as some:
        runs = some.each("squaring", squared_unless_killed, [1, 2, 3, 4, 5], of_killed=lambda _: (0, 0))
        found = dict(runs)
    assert {number: square for number, (square, _) in found.items()} == {0: 1, 1: 4, 2: 0, 3: 16, 4: 25}
    processes = {process for _, process in found.values()} - {0}
    assert len(processes) <= 2 + 1  # each works on one task after the other; one was killed twice


@pytest.mark.thorough("SIGINT")
@pytest.mark.parametrize("ending", ["SIGINT", "SIGKILL"])
def test_processes_end_with_the_program_that_started_them(ending: str, tmp_path: Path) -> None:
    code = (
        "import signal\nfrom fleet_tasks import slept\nfrom rodgen.schedulers import local_processes\n"
        # a test run in the background ignores interrupts, and so would its children
        "if __name__ == '__main__':\n    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "    with local_processes(1) as some:\n"
        f"        list(some.each('sleeping', slept, [{str(tmp_path / 'begun')!r}]))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    path = {"PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen([sys.executable, script], env={**os.environ, **path}, stderr=-3) as run:
        while not (tmp_path / "begun").exists() or not (number := (tmp_path / "begun").read_text()):
            assert run.poll() is None
            time.sleep(0.05)
        run.send_signal(getattr(signal, ending))
        run.wait(20)
    stat = Path(f"/proc/{number}/stat")
    for _ in range(100):
        if not stat.exists() or b"Z" in stat.read_bytes().split()[2]:
            return
        time.sleep(0.05)
    raise AssertionError("the process is still there")


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    make_fleet(tmp_path, 8)
    command = [sys.executable, "-m", "rodgen", "fleet", "machines", "data-0", "-o", "results", "--jobs", "2"]
    results, seen = tmp_path / "results/machines", 0
    for _ in range(20):
        run = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, start_new_session=True)
        while run.poll() is None and (not results.exists() or len([*results.glob("*.json")]) == seen):
            time.sleep(0.05)
        if run.poll() is not None:
            break
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        files = {file.name: json.loads(file.read_text()) for file in results.glob("*.json")}
        assert len(files) > seen  # whole ones, and more each time
        seen = len(files)
    assert run.returncode == 0
    assert len([*results.glob("*.json")]) == 8


# statistics --------------------------------------------------------------------------------------------


def test_population_finds_spread_and_shrunk_values_are_nearer() -> None:
    random = np.random.default_rng(1)
    false, covered, shrunk, single = 0, 0, 0.0, 0.0
    for _ in range(200):
        std = random.uniform(0.5, 2.0, 40)
        truth = 3.0 + random.normal(size=40)
        values = truth + std * random.normal(size=40)
        found = population(values, std)
        false += found.odd.any()
        covered += found.spread_interval[0] <= 1.0 <= found.spread_interval[1]
        shrunk += np.mean((found.shrunk - truth) ** 2)
        single += np.mean((values - truth) ** 2)
    # of 200 draws: 5 % are expected to call some machine odd, 95 % to cover, each with binomial deviations of 3
    assert false < 10 + 10
    assert covered > 190 - 10
    assert shrunk < 0.5 * single


def test_population_is_not_spread_by_the_odd() -> None:
    random = np.random.default_rng(2)
    values, std = random.normal(size=50), np.full(50, 0.5)
    values[:5] += 15.0
    found = population(values, std)
    assert set(np.flatnonzero(found.odd)) == {*range(5)}
    assert found.spread < 1.5
    assert np.array_equal(found.shrunk[:5], values[:5])


@pytest.mark.thorough("5-0.0-60", "12-1.0-60")
@pytest.mark.parametrize(("nights", "scatter", "degrees"), [(5, 0.0, 60), (12, 1.0, 60), (30, 0.3, 150)])
def test_trends_and_changes_have_their_p_values(nights: int, scatter: float, degrees: int) -> None:
    random = np.random.default_rng(3)
    p = []
    for _ in range(4):
        sigma = random.uniform(0.5, 2.0, (2000, 1)) * random.uniform(0.8, 1.25, (2000, nights))
        values = sigma * random.normal(size=sigma.shape) + scatter * random.normal(size=sigma.shape)
        std = sigma * np.sqrt(random.chisquare(degrees, sigma.shape) / degrees)
        values[random.random(sigma.shape) < 0.05] = np.nan
        found = drifts(
            values,
            std,
            np.full(sigma.shape, float(degrees)),
            np.arange(nights) * 1.0,
        )
        p.append(found.p_value)
    for level in (0.01, 0.001):
        trend, change = (np.concatenate(p, axis=1) < level).mean(axis=1)
        expected = 4 * np.sqrt(level / 8_000)
        assert level * 0.7 - expected < trend < level * 1.15 + expected
        assert change < level * 1.15 + expected  # the number of places bounds it


@pytest.mark.thorough
@pytest.mark.parametrize(("machines", "nights"), [(1, 10), (3, 5), (12, 2)])
def test_scatter_that_few_differences_tell_is_not_taken_for_known(machines: int, nights: int) -> None:
    random, p = np.random.default_rng(5), []
    std, degrees = np.ones((machines, nights)), np.full((machines, nights), np.inf)
    for _ in range(3000 // machines):
        values = np.sqrt(1 + 2.0**2) * random.normal(size=std.shape)
        found = drifts(values, std, degrees, np.arange(nights) * 1.0)
        p.append(found.p_value)
    assert (np.concatenate(p, axis=1) < 0.001).mean() < 0.002


def test_machines_that_repeat_themselves_worse_than_others_raise_no_more_alarms() -> None:
    random, p = np.random.default_rng(6), []
    std, degrees = np.ones((1000, 12)), np.full((1000, 12), np.inf)
    for _ in range(6):
        scatter = 2 * np.exp(0.5 * random.normal(size=(1000, 1)))
        values = np.sqrt(1 + scatter**2) * random.normal(size=std.shape)
        values[:20, 6:] += 200.0  # some do change
        found = drifts(values, std, degrees, np.arange(12) * 1.0)
        p.append(found.p_value[:, 20:])
        assert found.p_value[1, :20].max() < 1e-9
    for level in (0.01, 1e-4):
        assert (np.concatenate(p, axis=1) < level).mean() < 1.5 * level + 4 * np.sqrt(level / 12_000)


def test_a_trend_and_a_change_are_told_apart() -> None:
    times, std = np.arange(10.0), np.full((50, 10), 0.5)
    values = 0.5 * np.random.default_rng(4).normal(size=(50, 10))
    values[0] += times
    values[1, 6:] += 5.0
    found = drifts(values, std, np.full((50, 10), np.inf), times)
    assert found.p_value[0, 0] < found.p_value[1, 0]
    assert found.p_value[1, 1] < found.p_value[0, 1]
    assert found.at[1] == 6
    assert abs(found.size[0, 0] - 1.0) < 5 * found.std[0, 0]
    assert abs(found.size[1, 1] - 5.0) < 5 * found.std[1, 1]


def made_machine(
    name: str, values: Mapping[str, tuple[float, float, str]], found: bool = False
) -> FleetMachine:
    """Return a machine with made-up estimates of an effect, which may be found."""
    step = {"effect": "tube_flexure", "joint": None, "indistinguishable_from": []}
    estimates = {"values": dict(values), "effects": {"tube_flexure": ["tube_flexure", None]}}
    return FleetMachine(
        name,
        {
            "verdict": "effects_missing" if found else "nothing_missing",
            "steps": [step] * found,
            "rms": {"after": None},
            "fleet": {"kind": "made", "with_found": estimates, "residual_dof": 100},
        },
    )


def test_an_effect_that_no_machine_shows_is_there_on_average() -> None:
    random = np.random.default_rng(9)
    for truth, there in ((1.0, True), (0.0, False)):
        values = truth + random.normal(size=60)
        machines = [
            made_machine(f"m{i}", {"tube_flexure.a": (value, 1.0, "arcsec")})
            for i, value in enumerate(values)
        ]
        fleet = Fleet("", Plan("2026-11-20", 1.0, (), ()), tuple(machines))
        (kind,) = fleet.kinds
        assert [(effect.title, effect.on_average) for effect in kind.effects] == [
            ("tube_flexure", True)
        ] * there
        assert bool(re.search("tube_flexure, there on average +0 of 60", fleet.summary())) is there


@dataclass(frozen=True)
class Made:
    """A machine of a night, with made-up estimates."""

    numbers: Mapping[str, tuple[float, float, str]]
    kind: str = "made"
    model: str = "one"
    found: tuple[str, ...] = ()
    degrees_of_freedom: float = 100.0

    def estimates(self, which: str = "with_found") -> Mapping[str, tuple[float, float, str]]:
        """Return them."""
        return self.numbers


def made_nights(count: int, machines: int, parameters: int, seed: int) -> Iterator[Night]:
    """Yield nights on which nothing changes, but machines do not repeat themselves exactly."""
    random = np.random.default_rng(seed)
    truth = random.normal(size=(machines, parameters))
    for number in range(count):
        sigma = random.uniform(0.5, 2.0, truth.shape)
        values = truth + sigma * random.normal(size=truth.shape) + 0.5 * random.normal(size=truth.shape)
        std = sigma * np.sqrt(random.chisquare(100, sigma.shape) / 100)
        date = str(np.datetime64("2026-01-01") + number)
        yield Night(
            date,
            {
                f"m{i}": Made({f"p{k}": (values[i, k], std[i, k], "mm") for k in range(parameters)})
                for i in range(machines)
            },
        )


@pytest.mark.slow
def test_the_fleet_has_no_more_false_alarms_than_stated() -> None:
    nights, stated, alarms = [*made_nights(90, 40, 8, 6)], 60.0, 0
    for last in range(3, len(nights) + 1):
        alarms += len(Changes(nights[:last], stated).found)
    expected = stated * (len(nights) - 2) / FLEET.nights
    # at most as many as stated, within three deviations of Poisson's; and not so few that changes would be missed
    assert 0.1 * expected < alarms < expected + 3 * np.sqrt(expected)


def test_alarms_come_when_a_machine_changes() -> None:
    nights = [*made_nights(12, 30, 4, 7)]
    for night in nights[8:]:
        value, std, unit = night.machines["m4"].estimates()["p2"]
        object.__setattr__(night.machines["m4"], "numbers", {"p2": (value + 12.0, std, unit)})
    found = Changes(nights, 1.0)
    first = found.found[0]
    assert (first.machine, first.key, first.what) == ("m4", "p2", "change")
    assert first.since == nights[8].date
    assert {change.machine for change in found.found} == {"m4"}
    assert not Changes(nights[:8], 1.0).found
    value, std, unit = nights[8].machines["m4"].estimates()["p2"]  # a larger one shows on two nights, too
    object.__setattr__(nights[8].machines["m4"], "numbers", {"p2": (value + 20.0, std, unit)})
    (change,) = Changes(nights[7:9], 1.0).found
    assert (change.machine, change.key, change.what) == ("m4", "p2", "change")
    assert not Changes(nights[8:9], 1.0).found


@pytest.mark.parametrize(("count", "at"), [(2, 1), (3, 2), (6, 3)])
def test_a_change_that_all_machines_share_is_no_scatter(count: int, at: int) -> None:
    nights = [*made_nights(count, 30, 4, 7)]
    for night in nights[at:]:
        for machine in night.machines.values():
            value, std, unit = machine.estimates()["p0"]
            object.__setattr__(machine, "numbers", {**machine.estimates(), "p0": (value + 20.0, std, unit)})
    alarms = Changes(nights, 1.0).found
    assert {change.key for change in alarms} == {"p0"}
    assert len(alarms) > 20
    assert Counter(change.since for change in alarms).most_common(1)[0][0] == nights[at].date


@pytest.mark.slow
def test_shrunk_estimates_are_nearer_to_the_truth(tmp_path: Path) -> None:
    truth = make_fleet(tmp_path, 40, mean=8.0, spread=1.2)
    pairs = pairs_of(str(tmp_path / "machines"), str(tmp_path / "data-0"))
    (kind,) = diagnose_fleet(pairs, tmp_path / "results").kinds
    (parameter,) = (p for p in kind.parameters if p.key == "tube_flexure.a")
    true = np.array([truth.flexure[name] for name in parameter.machines])
    found = parameter.population
    assert found.spread_interval[0] < truth.spread < found.spread_interval[1]
    assert abs(found.mean - truth.mean) < 4 * found.mean_std
    single = np.mean((parameter.values - true) ** 2)
    assert np.mean((found.shrunk - true) ** 2) < 0.8 * single
