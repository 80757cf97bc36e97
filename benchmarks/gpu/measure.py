"""Measure solve_axis on a graphics processor, as part of its memory bandwidth.

python benchmarks/gpu/measure.py -o benchmarks/results/gpu.json   # then python benchmarks/run.py --page
python benchmarks/gpu/measure.py --cpu --rows 8192                # tries the script where there is none

It needs NumPy, array-api-compat, and what of PyTorch, JAX and CuPy is to be measured; rodgen need not be installed.
Each contender is a process of its own. It compiles and compares what it computes with NumPy's; when all have done that
they are timed, one after the other.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
for _folder in (ROOT / "benchmarks", ROOT / "src"):
    sys.path.append(str(_folder))
try:
    import rodgen.generated
except ModuleNotFoundError:  # it is not installed: generated/ lies outside of src/
    import rodgen

    rodgen.__path__.append(str(ROOT))

import problem  # noqa: E402

from gpu import device_code, page  # noqa: E402
from rodgen.generated.numpy.axis import solve_axis  # noqa: E402

DISTINCT = 8192
"""Rows that differ; they are repeated, so that every row's answer is known from few that NumPy computes."""
ROWS = 1 << 22
COPIED = 1 << 30
"""Bytes of the array whose copy tells the bandwidth."""
LAST, COMPILING, ALL = 90.0, 150.0, 220.0
"""Seconds in which a contender begins with a task, until the first are timed, and in all."""
TOLERANCE = {"float64": 1e-10, "float32": 2e-2}
"""Largest difference to NumPy's float64, relative to the largest number: roundings, times the condition of the axes."""


@dataclass(frozen=True)
class Library:
    """An array library on a device.

    Attributes
    ----------
    xp : module
        Its functions.
    array : callable
        Returns an array of NumPy on the device.
    wait : callable
        Returns when what it is given has been computed.
    compiled : callable
        Returns a function compiled, or as it is.
    copied : callable
        Returns a function without arguments that copies an array.
    device, version : str
    """

    xp: Any
    array: Callable[[Any], Any]
    wait: Callable[[Any], Any]
    compiled: Callable[[Any], Any]
    copied: Callable[[Any], Any]
    device: str
    version: str


def torch(cpu: bool) -> Library:
    import torch

    device = "cpu" if cpu else "cuda"

    def copied(x: Any) -> Any:
        y = torch.empty_like(x)
        return lambda: y.copy_(x)

    return Library(
        torch,
        lambda a: torch.tensor(a, device=device),
        (lambda _: None) if cpu else lambda _: torch.cuda.synchronize(),
        lambda f: f,
        copied,
        "the processor" if cpu else torch.cuda.get_device_name(),
        f"PyTorch {torch.__version__}",
    )


def torch_compiled(cpu: bool) -> Library:
    import torch as library

    return Library(**{**vars(torch(cpu)), "compiled": lambda f: library.compile(f, dynamic=False)})


def jax(cpu: bool) -> Library:
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    import jax

    jax.config.update("jax_enable_x64", True)
    if not cpu and jax.devices()[0].platform != "gpu":
        raise RuntimeError("JAX finds no graphics processor")
    add = jax.jit(lambda x: x + 1.0)
    return Library(
        jax.numpy,
        jax.numpy.asarray,
        jax.block_until_ready,
        jax.jit,
        lambda x: lambda: add(x),
        jax.devices()[0].device_kind,
        f"JAX {jax.__version__}",
    )


def cupy(cpu: bool) -> Library:
    import cupy

    if cpu:
        raise RuntimeError("CuPy runs on graphics processors only")

    def copied(x: Any) -> Any:
        y = cupy.empty_like(x)
        return lambda: cupy.copyto(y, x)

    return Library(
        cupy,
        cupy.asarray,
        lambda _: cupy.cuda.Device().synchronize(),
        lambda f: f,
        copied,
        cupy.cuda.runtime.getDeviceProperties(0)["name"].decode(),
        f"CuPy {cupy.__version__}",
    )


def cuda_c(cpu: bool) -> Library:
    found = cupy(cpu)
    return Library(**{**vars(found), "version": f"NVRTC through {found.version}"})


C = "the C code as CUDA"
LIBRARIES = {
    "PyTorch": torch,
    "PyTorch, torch.compile": torch_compiled,
    "JAX, jax.jit": jax,
    "CuPy": cupy,
    C: cuda_c,
}


@dataclass(frozen=True)
class Task:
    """What is timed.

    Attributes
    ----------
    call : callable
    arguments : tuple of array
        On the device.
    error : callable
        Returns how far what was computed is from NumPy's answer, relative to the largest number of it.
    bytes : int
        That must be read and written at least.
    """

    call: Callable[..., Any]
    arguments: tuple[Any, ...]
    error: Callable[[Any], float]
    bytes: int


def gap(library: Library, found: Any, expected: Any) -> float:
    """Return the largest difference, each of the repeated rows compared; infinite where only one is NaN."""
    known = library.array(np.nan_to_num(np.asarray(expected, np.float64), nan=0.0))
    found, is_nan = found.reshape((-1, *known.shape)), library.array(np.isnan(expected))
    if not bool(((found != found) == is_nan).all()):
        return float("inf")
    apart = library.xp.abs(library.xp.where(is_nan, known, found) - known)
    return float(apart.max()) / float(np.nanmax(np.abs(expected)))


def solving(library: Library, rows: int, real: str) -> Task:
    """solve_axis; of a hundred elements one has lengths that differ, and a few have no axis or are NaN."""

    few = problem.make(DISTINCT)
    few.rho_prime[::100] *= 1.01
    few.rho[7], few.angle[11], few.rho_prime[13] = 0.0, np.nan, np.inf
    inputs = [a.astype(real) for a in (few.rho, few.rho_prime, few.angle)]
    tolerance = 1e-8 if real == "float64" else 1e-5
    axes, status = solve_axis(*(a.astype(float) for a in inputs), tolerance)
    copies = rows // DISTINCT
    tiled = tuple(library.xp.tile(library.array(a), (copies,) + (1,) * (a.ndim - 1)) for a in inputs)

    def error(found: Any) -> float:
        codes = found[1].reshape((-1, DISTINCT)) == library.array(status)
        return gap(library, found[0], axes) if bool(codes.all()) else float("inf")

    size = np.dtype(real).itemsize
    call = library.compiled(lambda a, b, c: solve_axis(a, b, c, tolerance))
    if library.version.startswith("NVRTC"):
        call = device_code.solve(real, tolerance)
    return Task(call, tiled, error, rows * (13 * size + 1))


TASKS: dict[str, Callable[[Library, int], Task]] = {
    "solve_axis": lambda library, rows: solving(library, rows, "float64"),
    "solve_axis, float32": lambda library, rows: solving(library, rows, "float32"),
}


def seconds_of(call: Callable[[], Any], wait: Callable[[Any], Any]) -> float:
    """Return the median time of a call; several are under way at once, so that the device need not wait for Python."""

    def timed(calls: int) -> float:
        started = time.perf_counter()
        for _ in range(calls):
            result = call()
        wait(result)
        return (time.perf_counter() - started) / calls

    wait(call())
    calls = max(1, min(30, int(0.03 / timed(1))))
    return sorted(timed(calls) for _ in range(7))[3]


def work(name: str, rows: int, *, cpu: bool) -> None:
    """Compile and check; time when standard input says so; write what was found as one line."""
    library = LIBRARIES[name](cpu)
    ready, found = {}, {"name": name, "device": library.device, "version": library.version, "tasks": {}}
    begun = time.perf_counter()
    for title, make in TASKS.items():
        started = time.perf_counter()
        try:
            if started - begun > LAST:
                raise TimeoutError("not compiled in time")
            task = make(library, rows)
            result = task.call(*task.arguments)
            library.wait(result)
            error = task.error(result)
            row = {"error": error, "bytes": task.bytes}
            if not error <= TOLERANCE["float32" if "float32" in title else "float64"]:
                row["failed"] = f"off by {error:.1e}"
        except Exception as failure:
            traceback.print_exc()
            row = {
                "failed": f"{type(failure).__name__}: {str(failure).strip() or failure}".splitlines()[0][:300]
            }
        else:
            ready[title] = task
        row["to_compile"] = round(time.perf_counter() - started, 1)
        found["tasks"][title] = row
        print(f"{name}: {title}: {row}", file=sys.stderr, flush=True)
    print("ready", flush=True)
    sys.stdin.readline()
    x = library.array(np.random.default_rng(0).random((COPIED if not cpu else COPIED >> 8) // 8))
    found["bandwidth"] = 2 * x.nbytes / seconds_of(library.copied(x), library.wait)
    del x
    for title, task in ready.items():
        taken = seconds_of(lambda task=task: task.call(*task.arguments), library.wait)
        found["tasks"][title]["seconds"] = taken
    print(json.dumps(found), flush=True)


def read(process: subprocess.Popen[str], to: list[str]) -> None:
    """Keep the lines that `work` writes; libraries write others."""
    for line in process.stdout or ():
        if line == "ready\n" or line.startswith('{"name"'):
            to.append(line)


def measure(rows: int = ROWS, *, cpu: bool = False, only: str = "") -> dict[str, Any]:
    """Return what was measured, as plain data."""
    started = time.perf_counter()
    processes, lines = {}, {}
    for name in LIBRARIES:
        if only in name:
            command = [sys.executable, __file__, "--work", name, "--rows", str(rows), *["--cpu"] * cpu]
            made = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            processes[name], lines[name] = made, []
            threading.Thread(target=read, args=(made, lines[name]), daemon=True).start()

    def wait_for(names: list[str], count: int, until: float) -> None:
        while time.perf_counter() - started < until:
            if all(len(lines[n]) >= count or processes[n].poll() is not None for n in names):
                time.sleep(0.2)  # what a process wrote last
                return
            time.sleep(0.1)

    found = []
    wait_for(list(processes), 1, COMPILING)
    waiting = sorted(processes, key=lambda name: not lines[name])  # those that are ready first
    for name in waiting:
        wait_for([name], 1, ALL)
        if lines[name] and processes[name].poll() is None:
            processes[name].stdin.write("go\n")
            processes[name].stdin.flush()
            wait_for([name], 2, ALL)
        if len(lines[name]) > 1:
            found.append(json.loads(lines[name][-1]))
        else:
            why = "not compiled in time" if processes[name].poll() is None else "ended without an answer"
            found.append({"name": name, "failed": why})
        processes[name].kill()
        processes[name].wait()
    order = list(LIBRARIES)
    found.sort(key=lambda each: order.index(each["name"]))
    return {"rows": rows, "contenders": found, "seconds": round(time.perf_counter() - started)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", help="file to write, as JSON")
    parser.add_argument("--rows", type=int, default=ROWS, help=f"a multiple of {DISTINCT}")
    parser.add_argument("--only", default="", help="contenders with this in their name")
    parser.add_argument("--cpu", action="store_true", help="on the processor, to try the script")
    parser.add_argument("--work", choices=LIBRARIES, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.work:
        work(arguments.work, arguments.rows, cpu=arguments.cpu)
        return
    result = measure(arguments.rows, cpu=arguments.cpu, only=arguments.only)
    print(page.page(result))
    if arguments.output:
        Path(arguments.output).write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
