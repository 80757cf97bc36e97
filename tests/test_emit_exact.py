"""Programs of emitted machines with 50 digits: their derivatives, and how far off the emitted NumPy code is.

The text that is emitted runs with the numbers of mpmath in place of NumPy's. A central difference of the place with
a step h = 1e-20 is off by h² times a third derivative, which is far below 1e-25 of the largest slope.
"""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from emitted_cells import EXAMPLES, Cell, cells, measuring

from rodgen.codegen.program import Program
from rodgen.codegen.program_text import array_language, component_names, program_text
from rodgen.machines.emit._content import content_of
from rodgen.machines.emit._kernels import MachineKernels

CELLS = cells()
CHOSEN = [
    "gantry-rotary-machine+", "alt-azimuth-machine+", "arm-6r-machine", "arm-6r-machine:pose", "tricept-machine",
    "3-sps-s-machine", "hexapod-machine",
]  # fmt: skip
EXACT = SimpleNamespace(
    **{name: getattr(mpmath, name) for name in ("sin", "cos", "tan", "asin", "atan2", "exp", "log", "sqrt", "sign")},
    abs=abs, nan=mpmath.nan, inf=mpmath.inf, pow=lambda x, y: x**y, where=lambda holds, yes, no: yes if holds else no,
)  # fmt: skip


def function(program: Program, namespace: Any) -> Any:
    """Return a program as a function of its inputs by name: of the text that is emitted as Python."""
    text = program_text(program, array_language("np"))
    names = [name for port in program.inputs.items() for name in component_names(*port)]
    results = ", ".join(x for values in text.results.values() for x in values)
    lines = [f"def f({', '.join(names)}):", *(f" {x.name} = {x.text}" for x in text.lines)]
    made: dict[str, Any] = {"np": namespace}
    exec("\n".join([*lines, f" return ({results},)"]), made)
    return lambda values: np.array(made["f"](*(values[name] for name in names)))


def named(kernels: MachineKernels, sample: Any, number: Any) -> dict[str, Any]:
    values = {f"q_{j}": number(x) for j, x in enumerate(sample.q, 1)}
    for port, xs in sample.fields.items():
        names = component_names(port, kernels.place.inputs[port])
        values |= {name: number(x) for name, x in zip(names, xs, strict=True)}
    values |= {f"seen_{i}": number(x) for i, x in enumerate(kernels.seen[sample.target].tolist(), 1)}
    return values | {constant.name: number(constant.value) for constant in kernels.constants}


def with_pose(kernels: MachineKernels, values: dict[str, Any], namespace: Any) -> dict[str, Any]:
    if kernels.pose is None:
        return values
    return values | {f"start_{i}": x for i, x in enumerate(function(kernels.pose, namespace)(values), 1)}


@pytest.mark.thorough
@pytest.mark.quick("alt-azimuth-machine+")
@pytest.mark.parametrize("name", CHOSEN)
def test_derivatives_and_places_of_emitted_programs_with_50_digits(name, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    source, file = CELLS[name.rstrip("+").partition(":")[0]]
    kind = name.partition(":")[2]
    cell = Cell(source, measuring(file, kind) if kind else file, whole=name.endswith("+"))
    content = content_of(cell.fitted, "device", cell.observations.travel)
    fitted, sample = content.fitted, content.samples[0]
    joints, step = len(sample.q), mpmath.mpf(10) ** -20
    with mpmath.workdps(50):
        values = with_pose(fitted, named(fitted, sample, mpmath.mpf), EXACT)
        place = function(fitted.place, EXACT)
        both = function(fitted.place_and_jacobian, EXACT)(values)
        exact, slopes = (
            both[: -joints * content.numbers],
            both[-joints * content.numbers :].reshape(-1, joints),
        )
        assert (exact == place(values)).all()
        for j in range(joints):
            ends = [place(values | {f"q_{j + 1}": values[f"q_{j + 1}"] + h}) for h in (step, -step)]
            off = np.abs((ends[0] - ends[1]) / (2 * step) - slopes[:, j]).max()
            assert off <= 1e-25 * max(1, np.abs(slopes).max()), j
    found = function(fitted.place_and_jacobian, np)(with_pose(fitted, named(fitted, sample, float), np))
    off = np.abs((found - both).astype(float))
    # some hundred roundings of numbers as large as the machine; Newton's steps amplify them less than tenfold
    assert off[: len(exact)].max() <= 2**-44 * content.size
    assert off[len(exact) :].max() <= 2**-40 * max(content.size, 1)


@pytest.mark.thorough
def test_emit_needs_no_sympy(tmp_path, monkeypatch):
    monkeypatch.setenv("RODGEN_CPU", "numpy")
    folder = EXAMPLES / "mount"
    code = f"""
import sys
from rodgen.cli.main import main
for language in ("c", "cpp", "numpy", "jax", "matlab"):
    output = "{tmp_path}/" + language
    words = ["emit", "{folder / "machine.toml"}", "{folder / "mmt_2021.csv"}", "--lang", language, "-o", output]
    assert main(words) == 0, language
    assert "sympy" not in sys.modules, language
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert {path.name for path in tmp_path.iterdir()} == {"c", "cpp", "numpy", "jax", "matlab"}
