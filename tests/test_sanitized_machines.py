"""The C of every example machine under the address and undefined-behaviour sanitizers: emitted, and made at run time.

The emitted functions get commands as they come and commands that are none. What is made at run time is compiled with
the sanitizers, because `CC` says so, and runs in a Python that has them loaded; each array is a heap block of its own.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_cases import Case, data_for
from test_branches import five_axis
from test_emitted_c import SANITIZERS, sanitized
from test_hexapod import given
from test_hexapod import machine as hexapod
from test_poses import fitted_with_errors

from conftest import C_WARNINGS, CPP_WARNINGS
from rodgen.cli.main import main
from rodgen.machines.emit import emit
from rodgen.machines.machine import Machine

pytestmark = pytest.mark.slow

MACHINES = sorted(
    path.parent for path in (Path(__file__).parent.parent / "examples" / "machines").glob("*/machine.toml")
)
FLAGS = " ".join(flag for flag in SANITIZERS if flag != "-O0")

HOSTILE = """
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include "{name}.h"

static uint64_t state = 17;

/* A number of usual size, or one that is none, nothing or far too large. */
static double drawn(void) {{
  static const double odd[] = {{0.0, -0.0, 1.0, DBL_MAX, -DBL_MAX, DBL_MIN, 4.9e-324, DBL_EPSILON, 1e160, 3.14159265}};
  state = state * 6364136223846793005u + 1442695040888963407u;
  const unsigned which = (unsigned)(state >> 33) % 64;
  if (which < 10)
    return odd[which];
  if (which < 12)
    return which == 10 ? NAN : (state & 1u << 20 ? INFINITY : -INFINITY);
  return ((double)(state >> 11) / 9007199254740992.0 - 0.5) * (which < 40 ? 6.0 : 2000.0);
}}

static void fill(void *block, size_t count) {{
  for (size_t i = 0; i < count; ++i)
    ((double *)block)[i] = drawn();
}}

int main(void) {{
  /* each on the heap, so that what lies outside of it is guarded */
  const size_t joints = {joints};
  {name}_row *row = malloc(sizeof *row);
  double *place = malloc({size} * sizeof *place), *slopes = malloc({slopes} * sizeof *slopes);
  double *wanted = malloc({size} * sizeof *wanted), *weight = malloc(joints * sizeof *weight);
  double *corrected = malloc(joints * sizeof *corrected), *distance = malloc(sizeof *distance);
  if (!row || !place || !slopes || !wanted || !weight || !corrected || !distance)
    return 3;
  for (int n = 0; n < 2000; ++n) {{
    const int target = n % ({targets} + 2) - 1;
    fill(row, sizeof *row / sizeof(double));
    fill(wanted, {size});
    fill(weight, joints);
    {name}_forward(row, target, place);
    {name}_jacobian(row, target, place, slopes);
    {name}_ideal(row->q, target, place);
    const double *to = n % 3 ? wanted : place, *freely = n % 2 ? weight : NULL;
    const int status = (int){name}_compensate(row, target, to, freely, corrected, distance);
    if (status < 0 || status > 6)
      return 4;
    for (size_t j = 0; status < 5 && j < joints; ++j)
      if (!isfinite(corrected[j]))
        return 5;
  }}
  free(row), free(place), free(slopes), free(wanted), free(weight), free(corrected), free(distance);
  return 0;
}}
"""

AT_RUN_TIME = """
import os, sys
os.environ["RODGEN_CPU"] = ""
import numpy as np
from rodgen.calibration.fit import fit
from rodgen.codegen import rows
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine

kernels = []
made = rows._in_library
def kept(*arguments):
    kernels.extend(made(*arguments).values())
    return made(*arguments)
rows._in_library = kept
folder = sys.argv[1]
machine = Machine.load(folder + "/machine.toml")
(data,) = (folder + "/" + name for name in os.listdir(folder) if name.endswith(".csv"))
fit(machine, Measurements.load(data), compiled=True)
assert kernels, "nothing was compiled"
rng = np.random.default_rng(17)
odd = np.array([np.nan, np.inf, -np.inf, 0, -0.0, 1e308, -1e308, 5e-324, 1e-160, 1e160])
def drawn(*shape):
    usual = rng.normal(size=shape) * 100
    return np.where(rng.random(shape) < 0.1, rng.choice(odd, shape), usual)
with np.errstate(all="ignore"):
    for kernel in kernels:
        row, *shapes = kernel.inputs.values()
        shared = [drawn(*shape) for shape in shapes]
        for count in (0, 1, 2, 7, 64, 1001):
            given = drawn(count, *row)
            kernel(given, *shared)
            kernel(np.asfortranarray(given), *shared)
            kernel(drawn(2 * count + 1, *row)[1::2], *shared)
            kernel(given[::-1], *shared)
            if kernel.has_jacobian:
                kernel.gram(given, *shared)
print(len(kernels))
"""


@pytest.fixture(scope="module")
def library(compiler: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The sanitizer's library, which a Python that loads sanitized code must have from the start."""
    folder = tmp_path_factory.mktemp("probe")
    (folder / "probe.c").write_text("int main(void) { return 0; }\n")
    command = [compiler, *FLAGS.split(), str(folder / "probe.c"), "-o", str(folder / "probe")]
    found = subprocess.run(
        [compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=False
    )
    if subprocess.run(command, capture_output=True, check=False).returncode or not os.path.isabs(
        found.stdout.strip()
    ):
        pytest.skip(f"{compiler} has no sanitizers")
    return found.stdout.strip()


def survives(folder: Path, compiler: str) -> None:
    """Run the emitted C of a folder: its own test, and all its functions on commands that are none."""
    (header,) = folder.glob("*.h")
    name, text = header.stem, header.read_text()
    numbers = {word: int(re.search(rf"_{word} (\d+)", text)[1]) for word in ("JOINTS", "TARGETS")}  # type: ignore[index]
    size, slopes = (int(re.search(rf"double {word}\[(\d+)\]", text)[1]) for word in ("place", "jacobian"))  # type: ignore[index]
    program = HOSTILE.format(
        name=name, joints=numbers["JOINTS"], targets=numbers["TARGETS"], size=size, slopes=slopes
    )
    (folder / "hostile.c").write_text(program)
    compile_ = [compiler, *C_WARNINGS, *SANITIZERS]
    subprocess.run([*compile_, "-c", f"{name}.c"], cwd=folder, check=True)
    for main_file in ("hostile.c", f"{name}_test.c"):
        subprocess.run([*compile_, main_file, f"{name}.o", "-o", "run", "-lm"], cwd=folder, check=True)
        sanitized([folder / "run"])


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.name)
def test_emitted_c_survives_every_command(machine: Path, compiler: str, library: str, tmp_path: Path) -> None:
    (data,) = machine.glob("*.csv")
    assert main(["emit", str(machine / "machine.toml"), str(data), "--lang", "c", "-o", str(tmp_path)]) in (
        0,
        3,
    )
    survives(tmp_path, compiler)


def of_two_branches() -> Machine:
    """Return a machine that moves its workpiece, too."""
    case = Case(five_axis(), data_for(five_axis(), 40, np.random.default_rng(3)))
    return replace(case.machine, values=case.sizeable(case.model.keys))


OTHERS = {
    "branches": of_two_branches,
    "poses": lambda: fitted_with_errors()[1].machine,
    "hexapod": lambda: given(
        hexapod(estimate=["B1"], effects=[{"name": "leg_zero_offset", "joint": "L3"}]),
        {"geometry.B1.x": 0.5, "L3.leg_zero_offset.a": 0.7},
    ),
}
"""Machines of which no example has the kind."""


@pytest.mark.parametrize("name", OTHERS)
def test_emitted_c_of_other_kinds_survives_every_command(
    name: str, compiler: str, library: str, tmp_path: Path
) -> None:
    emit(OTHERS[name](), "c", tmp_path, name="device")
    survives(tmp_path, compiler)


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.name)
def test_emitted_cpp_passes_its_own_test(
    machine: Path, cpp_compiler: str, library: str, tmp_path: Path
) -> None:
    (data,) = machine.glob("*.csv")
    assert main(["emit", str(machine / "machine.toml"), str(data), "--lang", "cpp", "-o", str(tmp_path)]) in (
        0,
        3,
    )
    (source,) = tmp_path.glob("*_test.cpp")
    command = [cpp_compiler, *CPP_WARNINGS, *SANITIZERS, str(source), "-o", str(tmp_path / "run")]
    subprocess.run(command, check=True)
    sanitized([tmp_path / "run"])


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.name)
def test_what_is_compiled_at_run_time_survives_every_row(
    machine: Path, compiler: str, library: str, tmp_path: Path
) -> None:
    environment = {
        **os.environ, "LD_PRELOAD": library, "ASAN_OPTIONS": "detect_leaks=0", "CC": f"{compiler} {FLAGS}",
        "RODGEN_CACHE": str(tmp_path), "PYTHONMALLOC": "malloc",
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", AT_RUN_TIME, str(machine)],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(done.stdout) > 0
    assert "kernels that are made at run time run on NumPy" not in done.stderr
