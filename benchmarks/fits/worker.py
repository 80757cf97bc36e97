"""Measurements that need a process of their own: what an import takes, how much memory a fit needs, another backend.

    python benchmarks/fits/worker.py derive MACHINE      # a model made or loaded, from the start of the process
    python benchmarks/fits/worker.py data FOLDER ROWS    # readings of the arm, a file a column
    python benchmarks/fits/worker.py large FOLDER        # fit them
    python benchmarks/fits/worker.py kernels ROWS        # ns a row

Each prints one line of JSON. Nothing but the standard library is imported before the clock runs.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from pathlib import Path

STARTED = time.perf_counter()


def derive(path: str) -> dict:
    import numpy

    after_numpy = time.perf_counter()
    from rodgen.machines.machine import Machine
    from rodgen.machines.model import Model

    imported = time.perf_counter()
    machine = Machine.load(path)
    model = Model(machine)
    loaded = time.perf_counter()
    made = model.kernels["residual_and_jacobian"]
    ready = time.perf_counter()
    assert numpy.isfinite(model.start()).all()
    return {
        "numpy": after_numpy - STARTED,
        "rodgen": imported - after_numpy,
        "machine": loaded - imported,
        "kernels": ready - loaded,
        "all": ready - STARTED,
        "processor": sum(
            sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        ),
        "parameters": len(model.parameters),
        "target": made.target,
        "SymPy imported": "sympy" in sys.modules,
    }


def data(folder: str, rows: str) -> dict:
    """Write readings of the arm in parts, so that this needs no more memory than they."""
    import numpy as np

    from fits import cases

    part = 250_000
    machine = cases.Machine.load(str(cases.HERE / "arm.toml"))
    rng, n = np.random.default_rng(7), int(float(rows))
    names = [f"J{j}" for j in range(1, 7)] + list("xyz")
    files = [np.lib.format.open_memmap(Path(folder, f"{name}.npy"), "w+", float, (n,)) for name in names]
    for start in range(0, n, part):
        here = slice(start, min(start + part, n))
        q = np.radians(rng.uniform(-120, 120, (6, here.stop - start)))
        table = cases.readings(machine, {f"J{j + 1} [rad]": q[j] for j in range(6)}, rng, errors=1)
        for file, values in zip(files, table.values(), strict=True):
            file[here] = values
    return {"rows": n}


def large(folder: str) -> dict:
    import numpy as np

    from fits import cases

    machine = cases.Machine.load(str(cases.HERE / "arm.toml"))
    columns = {}
    for name in [f"J{j}" for j in range(1, 7)] + list("xyz"):
        unit = "mm" if name in "xyz" else "rad"
        columns[f"{name} [{unit}]"] = np.load(Path(folder, f"{name}.npy"), mmap_mode="r")
    from rodgen.calibration.fit import fit

    few = {name: values[:1000] for name, values in columns.items()}
    fit(machine, cases.Measurements.from_frame(few), compiled=True)  # kernels are loaded, libraries warm
    begun, wall = time.process_time(), time.perf_counter()
    observations = cases.bind(machine, cases.Measurements.from_frame(columns))
    bound = time.process_time()
    found = fit(machine, observations)
    fitted, wall = time.process_time(), time.perf_counter() - wall
    return {
        "rows": observations.n,
        "bind": bound - begun,
        "fit": fitted - bound,
        "wall of both": wall,
        "iterations": found.solution.iterations,
        "rms": found.rms,
        "resident": _status("VmHWM"),  # ru_maxrss would be that of the process that started this one
    }


def _status(field: str) -> int:
    """Return a size that the system knows of this process, in bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    return 0


def kernels(rows: str) -> dict:
    """Time the arm's kernels on blocks as a fit uses them."""
    import clock
    import numpy as np

    from fits import cases

    case = cases.arm(int(float(rows)))
    problem = cases.Problem(case.model, case.observations)
    theta, frame, n = case.model.start(), case.frame, problem.rows
    problem.cost(theta, frame)
    e, g = case.model.parameters_of_effects(theta), case.model.geometry(theta, frame, 0)
    blocks = [problem._block(*block) for block in problem._blocks()]
    entries = {}
    for name, parts in (("residual", 1), ("residual_and_jacobian", 2)):
        kernel = case.model.kernels[name]
        shapes = list(kernel.outputs.values())
        outs = [tuple(np.empty((len(b), *shape)) for shape in shapes) for b in blocks]

        def call(kernel=kernel, outs=outs, parts=parts) -> None:
            for block, out in zip(blocks, outs, strict=True):
                kernel(block, g, e, out=out if parts == 2 else out[0])

        entries[name] = clock.Entry(call, n)
    entries["normal equations"] = clock.Entry(
        lambda: problem.normal_equations(theta, frame), n, processor=time.process_time_ns
    )
    for entry in entries.values():
        clock.calibrate(entry, 0.02)
    clock.alternate(entries, 15)
    found = {name: entry.median for name, entry in entries.items()}
    return {"target": case.model.kernels["residual"].target, "block": len(blocks[0]), **found}


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    what, *words = sys.argv[1:]
    print(json.dumps({"derive": derive, "data": data, "large": large, "kernels": kernels}[what](*words)))
