"""How often a watch raises a false alarm, and how late it sees a change: tables for docs/guides/watch.md.

    python study/watch.py            # both, some minutes
    python study/watch.py --alarms 4 # of four streams only

The machine is a trunnion of the tests' independent simulator, measured at random places with independent errors, normal
or with three degrees of freedom. Changes are of a size that is their rms per scalar reading over the noise. A rate of
false alarms of once a year cannot be simulated as it is; the bound holds for any, and is tried with once in 500 rows.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import hidden_effects

import rodgen
from rodgen.calibration.fit import fit
from rodgen.calibration.watch import Watch
from rodgen.calibration.watch.events import Changed
from rodgen.machines.files.read import machine_of

ROWS, LIMIT, LONG = 120, 500, 1500
SIZES = (0.5, 1.0, 2.0, 4.0)
CHANGES = {
    "zero_offset at C": "C.zero_offset.a",
    "target.b1": "target.b1.z",
    "encoder_eccentricity at C": "C.encoder_eccentricity.a",
    "tilt_error_motion at A": "A.tilt_error_motion.u_c1",
}
BENCH = hidden_effects.trunnion(np.random.default_rng(11))
MACHINE = machine_of(BENCH.text.replace("{noise}", ""), "trunnion")


def readings(rows: int, random: np.random.Generator, heavy: bool = False, **effects: float) -> dict:
    """Return measurements at random places."""
    q = random.uniform([-95, 0], [35, 360], size=(rows, 2)).round(3)
    target = [("b1", "b2")[i] for i in random.integers(0, 2, rows)]
    place = replace(BENCH, q=q, target=target, columns={}).measure(effects)
    error = random.normal(size=place.shape)
    if heavy:
        error /= np.sqrt(random.chisquare(3, (rows, 1)) / 3)
    place = place + BENCH.sigma * error
    columns = {"A [deg]": q[:, 0], "C [deg]": q[:, 1], "target": target}
    return columns | dict(zip(("x [mm]", "y [mm]", "z [mm]"), place.T, strict=True))


def reference(random: np.random.Generator, heavy: bool = False):
    """Return a fit of a fresh set of readings."""
    data = rodgen.Measurements.from_frame(readings(ROWS, random, heavy))
    return fit(MACHINE, data, loss="huber")


def alarms(streams: int, heavy: bool) -> tuple[int, int]:
    """Return false alarms and rows of some streams, with a limit of one in `LIMIT` rows."""
    found = rows = 0
    for seed in range(streams):
        random = np.random.default_rng([seed, heavy])
        watch = Watch(reference(random, heavy), rate="1/s", false_alarms=1 / LIMIT)
        watch._per_block = 1
        watch.update(readings(LONG, random, heavy))
        found, rows = found + watch.alarms, rows + watch.rows
    return found, rows


def unit(key: str) -> float:
    """Return what a parameter of 0.01 does to readings, rms over the noise."""
    q = readings(300, np.random.default_rng(0))
    some = replace(
        BENCH, q=np.column_stack([q["A [deg]"], q["C [deg]"]]), target=list(q["target"]), columns={}
    )
    moved = some.measure({key: BENCH.wrong.get(key, 0.0) + 0.01}) - some.measure({})
    return float(np.sqrt(np.mean(moved**2)) / BENCH.sigma)


def delays(title: str, key: str, size: float, tries: int) -> tuple[list[int], int, int]:
    """Return rows to the alarm, and how often the change was named first and among what is not told apart."""
    found, first, among = [], 0, 0
    value = BENCH.wrong.get(key, 0.0) + 0.01 * size / unit(key)
    for seed in range(tries):
        random = np.random.default_rng([seed, 7])
        watch = Watch(reference(random), rate="100/h")
        before = int(random.integers(40, 80))
        assert not watch.update(readings(before, random))
        for _ in range(20):
            events = [e for e in watch.update(readings(25, random, **{key: value})) if e.is_alarm]
            if events:
                found.append(events[0].at - before + 1)
                break
        named = [*watch.update(readings(40, random, **{key: value})), *watch.finish()]
        titles = next(
            ([one.title for one in e.likely] for e in named if isinstance(e, Changed) and e.settled), []
        )
        first += titles[:1] == [title]
        among += title in titles
    return found, first, among


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--alarms", type=int, default=12, metavar="STREAMS")
    parser.add_argument("--tries", type=int, default=5)
    options = parser.parse_args()
    print(f"| errors | rows | false alarms | allowed, once in {LIMIT} rows |\n| --- | ---: | ---: | ---: |")
    for heavy in (False, True):
        count, rows = alarms(options.alarms, heavy)
        print(f"| {'3 degrees of freedom' if heavy else 'normal'} | {rows} | {count} | {rows / LIMIT:.0f} |")
    print(
        "\n| change | rms / noise | rows to the alarm: median (largest) | named first | among those named |"
    )
    print("| --- | ---: | ---: | ---: | ---: |")
    for title, key in CHANGES.items():
        for size in SIZES:
            found, first, among = delays(title, key, size, options.tries)
            late = f"{np.median(found):.0f} ({max(found)})" if found else "none in 500"
            print(f"| {title} | {size:g} | {late} | {first} of {options.tries} | {among} |", flush=True)


if __name__ == "__main__":
    main()
