"""Measure fits and diagnoses of a 6R arm in many files: time, memory and bytes for docs/guides/scale.md.

python benchmarks/scale.py --rows 1e6 1e7                          # makes the files first; removes them in the end
python benchmarks/scale.py --rows 1e7 --where threads=2 --diagnose
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

HERE = Path(__file__).parent
MACHINE = HERE.parent / "examples/machines/robot_6r_tracker/machine.toml"
FILE_ROWS = 250_000
HIDDEN = "encoder_eccentricity@J2:a=12arcsec,b=3arcsec"
LIMITS = np.array([150, 80, 80, 170, 110, 170])


def make(folder: Path, rows: int) -> None:
    """Write measurements of an arm that wanders through its workspace, with an effect that its file lacks."""
    from rodgen.calibration.simulate import simulate
    from rodgen.machines.machine import Machine

    machine = Machine.load(MACHINE)
    for number, start in enumerate(range(0, rows, FILE_ROWS)):
        n, random = min(FILE_ROWS, rows - start), np.random.default_rng(number)
        way = 0.5 * np.cumsum(random.normal(size=(n, 6)), axis=0)
        q = LIMITS * np.sin(way / 40 + random.uniform(0, 6, 6))
        design = {f"J{j + 1} [deg]": q[:, j] for j in range(6)}
        design["target"] = np.array([f"reflector_{k}" for k in (1, 2, 3)])[np.arange(n) // 50 % 3]
        made = simulate(machine, design, [HIDDEN], noise="0.02mm", seed=number)
        pq.write_table(pa.table({**design, **made.columns}), folder / f"part{number:05d}.parquet")


def measure(folder: Path, where: str | None, *, diagnosed: bool) -> dict[str, float]:
    """Return what one fit, and one diagnosis, of the files takes; without `where` in memory."""
    from rodgen.calibration.fit import fit
    from rodgen.data.measurements import Measurements
    from rodgen.machines.machine import Machine
    from rodgen.schedulers import workers

    machine = Machine.load(MACHINE)
    with workers(where or "threads") as active:
        before = _spent(active)
        if where is None:
            table = pa.concat_tables([pq.read_table(file) for file in sorted(folder.iterdir())])
            joined = folder.parent / "all.parquet"
            pq.write_table(table, joined)
            del table
            before = _spent(active)
            data = Measurements.load(joined)
        else:
            data = Measurements.scan(folder)
        fitted = fit(machine, data)
        read = _spent(active)
        found = {"rows": fitted.problem.count, "fit_s": read[0] - before[0], "fit_cpu_s": read[1] - before[1]}
        if where is not None:
            theta, frame = fitted.solution.theta + 1e-9, fitted.solution.frame
            start = _spent(active)
            equations = fitted.problem.normal_equations(theta, frame)
            end = _spent(active)
            found |= {"pass_s": end[0] - start[0], "pass_cpu_s": end[1] - start[1]}
            found |= {"reduced_B": len(pickle.dumps(equations)), "parts": len(data.parts)}
            found["sent_B"] = len(pickle.dumps((fitted.problem.model, theta, frame)))
        if diagnosed:
            start = _spent(active)
            diagnosis = fitted.diagnose()
            end = _spent(active)
            found |= {"diagnose_s": end[0] - start[0], "diagnose_cpu_s": end[1] - start[1]}
            assert [step.effect.title for step in diagnosis.steps] == ["encoder_eccentricity at J2"]
        found["largest_GB"] = max(_memory(active)) / 1e6
        found["all_GB"] = sum(_memory(active)) / 1e6
    found["files_GB"] = sum(file.stat().st_size for file in folder.iterdir()) / 1e9
    return found


def _spent(active) -> tuple[float, float]:
    """Return wall time, and processor time of this program and of the workers."""
    times = [time.process_time()]
    if active.client is not None:
        times += active.client.run(time.process_time).values()
    return time.perf_counter(), sum(times)


def _memory(active) -> list[int]:
    """Return the largest resident sizes, kB."""
    sizes = [_largest()]
    return sizes + (list(active.client.run(_largest).values()) if active.client is not None else [])


def _largest() -> int:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=float, nargs="+", default=[1e6])
    parser.add_argument("--where", nargs="+", default=["memory", "threads=2", "processes=1", "processes=2"])
    parser.add_argument("--diagnose", action="store_true")
    parser.add_argument("--folder", help="where the files are made, or were made before")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one is not None:
        where = None if arguments.one == "memory" else arguments.one
        found = measure(Path(arguments.folder), where, diagnosed=arguments.diagnose)
        print(json.dumps(found))
        return
    for rows in map(int, arguments.rows):
        with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as temporary:
            folder = Path(arguments.folder or temporary) / f"{rows}"
            if not folder.exists():
                folder.mkdir(parents=True)
                make(folder, rows)
            for where in arguments.where:
                command = [sys.executable, __file__, "--one", where, "--folder", str(folder)]
                command += ["--diagnose"] * arguments.diagnose
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                print(where, done.stdout.strip(), flush=True)


if __name__ == "__main__":
    main()
