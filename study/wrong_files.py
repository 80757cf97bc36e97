"""Are wrong files noticed, is the right repair named, and is no right file accused? Hundreds of machines, corrupted.

    python study/wrong_files.py             # 300 wrong files, 300 right ones
    python study/wrong_files.py -n 40 --only axis_sign

The machines are the benches of the tests, the examples, and machines as they are met (`tests/real_machines.py`). A
wrong file is a right one with one thing wrong that people get wrong. Where that changes nothing that could be seen (two
parallel slides exchanged), the file counts as right; where it changes little (two targets exchanged that are close to
each other, in a rough file), it need not be called wrong, but may be with the right repair. A repair is right when the
repaired files predict the readings as well as those before, nothing fitted.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import tempfile
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

import numpy as np  # noqa: E402

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(path) for path in (HERE, ROOT / "tests") if str(path) not in sys.path]

from hidden_effects import BENCHES, Bench, _drawn, _scaled  # noqa: E402
from real_machines import KINDS, real  # noqa: E402

from rodgen.calibration.check import check, motion  # noqa: E402
from rodgen.calibration.problem import Problem  # noqa: E402
from rodgen.calibration.problem.binding import bind  # noqa: E402
from rodgen.calibration.repairs import ALONG  # noqa: E402
from rodgen.calibration.solve.starting_values import nearest_frames  # noqa: E402
from rodgen.data.measurements import Measurements  # noqa: E402
from rodgen.errors import RodgenError  # noqa: E402
from rodgen.machines.machine import Machine  # noqa: E402
from rodgen.machines.model import Frame, Model  # noqa: E402

Table = dict[str, list[str]]
EXAMPLES = (*(ROOT / "examples" / "machines").glob("*/machine.toml"),)
AS_GOOD, MORE = 1.5, 0.01
"""A repaired file is right where its error is this factor of what it was before the damage, or this part of the motion
more. Damage that does no more than that is too slight to be asked for, but may be found."""
UNSEEN = 1e-3
"""Part by which the error is more after damage that changes nothing that could be seen."""


LARGEST = 0.01
"""Part of the scatter of the readings that an effect makes at most."""


# files ----------------------------------------------------------------------------------------------------------


@dataclass
class Files:
    machine: dict[str, Any]
    table: Table

    @classmethod
    def read(cls, machine: Path, data: Path) -> Files:
        with data.open(newline="") as file:
            header, *rows = csv.reader(file)
        columns = list(zip(*rows, strict=True))
        return cls(
            tomllib.loads(machine.read_text()), {h: list(c) for h, c in zip(header, columns, strict=True)}
        )

    def write(self, folder: Path) -> tuple[Path, Path]:
        machine, data = folder / "machine.toml", folder / "data.csv"
        machine.write_text("\n".join(_toml(self.machine)))
        with data.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(self.table)
            writer.writerows(zip(*self.table.values(), strict=True))
        return machine, data

    @property
    def joints(self) -> list[dict[str, Any]]:
        return self.machine.get("joint", [])

    def column(self, name: str) -> str:
        return next(header for header in self.table if header.partition(" ")[0] == name)

    def numbers(self, name: str) -> np.ndarray:
        return np.array(self.table[self.column(name)], float)

    def put(self, name: str, values: np.ndarray) -> None:
        self.table[self.column(name)] = [repr(float(x)) for x in values]


def _toml(data: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in data.items():
        if not isinstance(value, dict) and not (
            isinstance(value, list) and value and isinstance(value[0], dict)
        ):
            yield f"{key} = {_value(value)}"
    for key, value in data.items():
        if isinstance(value, dict):
            yield f"[{prefix}{key}]"
            yield from (f"{k} = {_value(v)}" for k, v in value.items())
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for item in value:
                yield f"[[{prefix}{key}]]"
                yield from (f"{k} = {_value(v)}" for k, v in item.items())


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    return repr(value).replace("'", '"')


# what people get wrong --------------------------------------------------------------------------------------------


class InapplicableError(Exception):
    pass


def _moving(files: Files, kind: str = "") -> list[str]:
    if not files.joints:
        return [name for name in _legs(files) if np.ptp(files.numbers(name)) > 0]
    names = [
        j["name"] for j in files.joints if kind in j["type"] and not {"reading", "coordinate"} & j.keys()
    ]
    return [name for name in names if np.ptp(files.numbers(name)) > 0]


def _legs(files: Files) -> list[str]:
    return {"tricept": ["A0", "A1", "A-1"], "3-sps-s": ["L1", "L2", "L3"]}[files.machine["family"]]


def _readings(files: Files) -> list[str]:
    return {"point": list("xyz"), "direction": ["ux", "uy", "uz"], "distance": ["d"]}[
        files.machine["measured"]["kind"]
    ]


def _chosen(random: np.random.Generator, several: list[Any], count: int = 1) -> list[Any]:
    if len(several) < count:
        raise InapplicableError
    return [several[i] for i in random.choice(len(several), count, replace=False)]


def _joint(files: Files, random: np.random.Generator) -> dict[str, Any]:
    (name,) = _chosen(random, _moving(files) if files.joints else [])
    return next(j for j in files.joints if j["name"] == name)


def axis_sign(files: Files, random: np.random.Generator) -> None:
    joint = _joint(files, random)
    joint["axis"] = [-x for x in joint["axis"]]


def column_sign(files: Files, random: np.random.Generator) -> None:
    (name,) = _chosen(random, _moving(files) if files.joints else [])
    files.put(name, -files.numbers(name))


def mirror(files: Files, random: np.random.Generator) -> None:
    names = _readings(files)
    if random.integers(2):
        (name,) = _chosen(random, names if len(names) == 3 else [])
        files.put(name, -files.numbers(name))
    else:
        a, b = _chosen(random, names, 2)
        x, y = files.numbers(a), files.numbers(b)
        files.put(a, y)
        files.put(b, x)


def readings_permuted(files: Files, random: np.random.Generator) -> None:
    names = _readings(files)
    if len(names) < 3:
        raise InapplicableError
    values = [files.numbers(name) for name in names]
    turn = int(random.integers(1, 3))
    for name, value in zip(names, values[turn:] + values[:turn], strict=True):
        files.put(name, value)


def joint_order(files: Files, random: np.random.Generator) -> None:
    i, j = _chosen(random, list(range(len(files.joints))), 2)
    joints = files.joints
    joints[i], joints[j] = joints[j], joints[i]


def columns_exchanged(files: Files, random: np.random.Generator) -> None:
    kinds = [k for k in ("revolute", "prismatic") if files.joints and len(_moving(files, k)) > 1]
    names = _moving(files, _chosen(random, kinds)[0]) if files.joints else _legs(files)
    a, b = _chosen(random, names, 2)
    x, y = files.numbers(a), files.numbers(b)
    files.put(a, y)
    files.put(b, x)


def degrees_and_radians(files: Files, random: np.random.Generator) -> None:
    names = _moving(files, "revolute") if files.joints else []
    if not names:
        raise InapplicableError
    for name in names if random.integers(2) else _chosen(random, names):
        factor = np.degrees(1) if "[deg]" not in files.column(name) else np.radians(1)
        files.put(name, files.numbers(name) * factor)


def another_zero(files: Files, random: np.random.Generator) -> None:
    (name,) = _chosen(random, _moving(files, "revolute") if files.joints else [])
    turn = float(random.choice([90, -90, 180]))
    files.put(name, files.numbers(name) + (turn if "[deg]" in files.column(name) else np.radians(turn)))


UNITS = (1e-3, 1 / 25.4, 0.1, 1000.0)


def unit_of_readings(files: Files, random: np.random.Generator) -> None:
    if files.machine["measured"]["kind"] == "direction":
        raise InapplicableError
    factor = random.choice(UNITS)
    for name in _readings(files):
        files.put(name, files.numbers(name) * factor)


def unit_of_slides(files: Files, random: np.random.Generator) -> None:
    names = _moving(files, "prismatic")
    if not names:
        raise InapplicableError
    factor = random.choice(UNITS)
    for name in names if random.integers(2) or not files.joints else _chosen(random, names):
        files.put(name, files.numbers(name) * factor)


def unit_of_file(files: Files, random: np.random.Generator) -> None:
    if files.machine["measured"]["kind"] == "direction":
        raise InapplicableError
    factor = float(random.choice(UNITS))
    for thing in (*files.joints, *files.machine.get("target", [])):
        if "point" in thing:
            thing["point"] = [factor * x for x in thing["point"]]
    if "from" in files.machine["measured"]:
        files.machine["measured"]["from"] = [factor * x for x in files.machine["measured"]["from"]]
    for key, value in files.machine.get("geometry", {}).items():
        if key != "start":
            files.machine["geometry"][key] = (
                [factor * x for x in value] if isinstance(value, list) else factor * value
            )


def base_and_tool(files: Files, random: np.random.Generator) -> None:
    if any("coordinate" in joint for joint in files.joints):  # of joints before it
        raise InapplicableError
    if files.joints:
        files.joints.reverse()
        for joint in files.joints:
            joint["axis"] = [-x for x in joint["axis"]]
    else:
        geometry = files.machine["geometry"]
        geometry["R"], geometry["r"] = geometry["r"], geometry["R"]


def row_offset(files: Files, random: np.random.Generator) -> None:
    offset = int(random.choice([-2, -1, 1, 2]))
    names = {files.column(name) for name in _readings(files)}
    for name, values in files.table.items():
        if name in names:
            files.table[name] = values[offset:] if offset > 0 else values[:offset]
        else:
            files.table[name] = values[:-offset] if offset > 0 else values[-offset:]


def targets_exchanged(files: Files, random: np.random.Generator) -> None:
    a, b = _chosen(random, [t["name"] for t in files.machine.get("target", [])], 2)
    names = {a: b, b: a}
    column = files.column("target")
    files.table[column] = [names.get(x, x) for x in files.table[column]]


def another_axis(files: Files, random: np.random.Generator) -> None:
    joint = _joint(files, random)
    k = int(np.argmax(np.abs(joint["axis"])))
    if abs(joint["axis"][k]) < ALONG:  # an axis at a latitude: no repair can guess which one was meant
        raise InapplicableError
    axis = [0, 0, 0]
    axis[int(random.choice([i for i in range(3) if i != k]))] = int(random.choice([-1, 1]))
    joint["axis"] = axis


WRONG: dict[str, Callable[[Files, np.random.Generator], None]] = {
    f.__name__: f
    for f in (
        axis_sign, column_sign, mirror, readings_permuted, joint_order, columns_exchanged, degrees_and_radians,
        unit_of_readings, unit_of_slides, unit_of_file, base_and_tool, row_offset, targets_exchanged, another_axis,
        another_zero,
    )
}  # fmt: skip


# right files ------------------------------------------------------------------------------------------------------


def rough(bench: Bench, random: np.random.Generator) -> Bench:
    """Let the machine be as far from its file as machines are: some degrees, some percent of its lengths."""
    most = random.choice([0.0, 1.0, 4.0])
    size = float(
        np.ptp(np.array([x["point"] for x in (*bench.file["joint"], *bench.file["target"])]), axis=0).max()
    )
    wrong = dict(bench.wrong)
    for key in bench.base:
        if ".axis." in key:
            wrong[key] += most * random.normal() / 2
        elif ".point." in key or (key.startswith("target.") and bench.kind != "direction"):
            wrong[key] += most * random.normal() * size / 200
    return replace(bench, wrong=wrong)


def right_files(number: int, folder: Path) -> tuple[str, Files]:
    """Write a machine's right files: effects of any size, a rough geometry, outliers, a wandering set-up, few rows."""
    random = np.random.default_rng([number, 71])
    if number % 3 == 2:
        kind = list(KINDS)[number // 3 % len(KINDS)]
        return f"real {kind}", Files.read(*real(kind, number).write(folder))
    if number % 8 == 7:
        machine = EXAMPLES[number // 8 % len(EXAMPLES)]
        (data,) = machine.parent.glob("*.csv")
        return machine.parent.name, Files.read(machine, data)
    name = list(BENCHES)[number % 8]
    bench = rough(BENCHES[name](random, float(random.choice([0.25, 0.5, 1.0]))), random)
    titles = list(bench.natural)
    none = bench.measure({})
    values: dict[str, Any] = {}
    for i in random.choice(len(titles), int(random.integers(0, 4)), replace=False):
        keys, _, _ = _drawn(bench, titles[i], random)
        change = bench.rms(bench.difference(bench.measure(keys), none))
        most = LARGEST * float(np.std(none - none.mean(axis=0))) / change if change > 0 else 1.0
        values |= _scaled(keys, min(float(np.exp(random.uniform(0, np.log(300)))), most))
    if random.uniform() < 0.5:  # the set-up wanders
        steps = np.cumsum(random.normal(size=(int(bench.pose[-1]) + 1, 3)), axis=0) * bench.sigma / 2
        letter = "r" if bench.kind == "direction" else "t"
        values |= {f"{letter}{x}": lambda c, i=i: steps[bench.pose, i] for i, x in enumerate("xyz")}
    plain = bench.simulator(bench.file)
    reading = plain.with_noise(bench.measure(values), bench.sigma, random)
    rows = random.permutation(len(bench.q))[: int(random.choice([0, 0, 0.03, 0.1]) * len(bench.q))]
    for row in rows:
        reading = plain.with_outliers(reading, [int(row)], bench.sigma * random.uniform(8, 400), random)
    machine, data = folder / "machine.toml", folder / "data.csv"
    noise = f"noise = {bench.sigma!r}" if random.integers(2) else ""
    machine.write_text(bench.text.replace("{noise}", noise))
    columns = {k: v for k, v in bench.columns.items() if random.integers(2)}
    plain.write_csv(data, q=bench.q, reading=reading, target=bench.target, **columns)
    files = Files.read(machine, data)
    if len(files.machine["target"]) > 1 and random.uniform() < 0.2:  # some targets are taken for others
        column = files.column("target")
        names = [t["name"] for t in files.machine["target"]]
        for row in np.flatnonzero(random.uniform(size=len(files.table[column])) < 0.05):
            files.table[column][row] = str(random.choice(names))
    return name, files


# judging ----------------------------------------------------------------------------------------------------------


def error(machine: Machine, observations: Any) -> float:
    """Return the median error of a machine as its file says, in parts of how far what is measured moves."""
    observations = replace(observations, machine=machine)
    problem = Problem(
        Model(machine, observations.travel, observations.run_names, compiled=False), observations
    )
    theta = problem.model.start()
    frame = Frame.identity()
    if problem.model.structure.frame:
        frame = min(nearest_frames(problem, theta), key=lambda f: problem.cost(theta, f))
    residual = problem.residuals(theta, frame)
    size = motion(problem, theta)
    return float(np.median(np.linalg.norm(residual, axis=1)) / size)


def one(number: int, kind: str) -> dict[str, Any]:
    """Return the record of one case; the kind is empty for a right file."""
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(place)
        name, files = right_files(number, folder)
        record: dict[str, Any] = {"number": number, "kind": kind, "machine": name}
        good = _loaded(files.write(folder))
        before = error(good[0], bind(*good))
        if kind:
            random = np.random.default_rng([number, 72])
            try:
                WRONG[kind](files, random)
            except InapplicableError:
                return record | {"skipped": "inapplicable"}
        start = time.process_time()
        try:
            machine, data = _loaded(files.write(folder))
            observations = bind(machine, data)
        except RodgenError as refused:
            return record | {"skipped": "refused", "text": str(refused)}
        as_it_is = error(machine, observations)
        if kind and as_it_is <= (1 + UNSEEN) * before:
            record["skipped"] = "harmless"
        elif kind and as_it_is < AS_GOOD * before + MORE:
            record["skipped"] = "slight"
        found = check(machine, observations)
        record |= {
            "told": found.wrong,
            "seconds": time.process_time() - start,
            "text": str(found),
            "suspicions": found.suspicions,
        }
        record |= {"error": [before, as_it_is]}
        if found.wrong and kind:
            right = []
            for named in found.repairs:
                repaired = named.applied(machine, observations)
                right.append(error(*repaired) < min(AS_GOOD * before + MORE, as_it_is))
            record |= {"first": bool(right and right[0]), "named": any(right)}
        return record


def _loaded(paths: tuple[Path, Path]) -> tuple[Machine, Measurements]:
    return Machine.load(paths[0]), Measurements.load(paths[1])


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", type=int, default=300, metavar="N", help="wrong files, and right ones (300)")
    parser.add_argument("--first", type=int, default=0, help="number of the first machine")
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="kinds that contain TEXT; right: right files"
    )
    parser.add_argument("-v", action="store_true", help="show what was said of each case that went wrong")
    options = parser.parse_args()
    records = []
    for number in range(options.first, options.first + options.n):
        kinds = [list(WRONG)[number % len(WRONG)]]
        if options.only:
            kinds = [kind for kind in WRONG if options.only in kind]
        for kind in [*kinds, *([""] if options.only in "right" else [])]:
            records.append(one(number * 13 % 100_003, kind))
            r = records[-1]
            bad = r.get("told") is (not r["kind"]) if "skipped" not in r else is_accused(r)
            bad = bad or r.get("named") is False
            if bad:
                print(r if options.v else f"{name_of(r)}: {r['text']}", flush=True)
    print(summary(records))
    return 0


def is_accused(record: dict[str, Any]) -> bool:
    """Return whether files were called wrong that are right, or nearly right and are not repaired."""
    if not record.get("told"):
        return False
    skipped = record.get("skipped")
    return not record["kind"] or skipped == "harmless" or (skipped == "slight" and not record["first"])


def name_of(record: dict[str, Any]) -> str:
    """Return what finds a case again: its kind, its number and its machine."""
    return f"{record['kind'] or 'right'} {record['number']} ({record['machine']})"


def summary(records: list[dict[str, Any]]) -> str:
    """Return the table of the study."""
    lines = []
    for kind in [*WRONG, "all wrong"]:
        those = [r for r in records if r["kind"] and kind in (r["kind"], "all wrong")]
        asked = [r for r in those if "skipped" not in r]
        skipped = Counter(r["skipped"] for r in those if "skipped" in r)
        if those:
            told, first, named = (
                sum(bool(r.get(what)) for r in asked) for what in ("told", "first", "named")
            )
            lines.append(
                f"{kind:20} told {told} of {len(asked)}, right first {first}, named {named}; {dict(skipped)}"
            )
    right = [r for r in records if not r["kind"] or r.get("skipped") == "harmless"]
    accused = [r for r in records if is_accused(r)]
    lines.append(
        f"right files accused: {len(accused)} of {len(right)} {', '.join(map(name_of, accused))}".rstrip()
    )
    seconds = [r["seconds"] for r in records if "seconds" in r]
    lines.append(f"processor time: median {np.median(seconds):.2f} s, largest {max(seconds):.2f} s")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
