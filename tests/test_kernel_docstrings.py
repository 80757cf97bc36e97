"""Public functions that pass their arguments to one kernel document the shapes of its inputs and outputs."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

import rodgen.kinematics
from rodgen.generated import numpy as generated

FOLDER = Path(rodgen.kinematics.__file__).parent
ENTRY = re.compile(
    r"^(?P<names>[\w, ]+ : )?(?:u?int8 |float )?array(?:_like)? (?P<shape>\([^()]*\))", re.MULTILINE
)


def wrappers() -> list[tuple[str, ast.FunctionDef, str, list[str]]]:
    """Functions whose last statement returns call_kernel(kernels.NAME, (arguments), out), with the arguments' names."""
    found = []
    for path in sorted(FOLDER.rglob("*.py")):
        for function in ast.parse(path.read_text()).body:
            if not isinstance(function, ast.FunctionDef) or function.name.startswith("_"):
                continue
            last = function.body[-1]
            if not (isinstance(last, ast.Return) and isinstance(last.value, ast.Call)):
                continue
            match last.value:
                case ast.Call(
                    ast.Name("call_kernel"), [ast.Attribute(ast.Name("kernels"), kernel), given, *_]
                ):
                    tuples = [given] if isinstance(given, ast.Tuple) else []
                    names = [a.id for t in tuples for a in t.elts if isinstance(a, ast.Name)]
                    if tuples and len(names) == len(tuples[0].elts):
                        found.append((str(path.relative_to(FOLDER)), function, kernel, names))
    return found


def shapes(text: str) -> list[tuple[list[str], str]]:
    """Names and last axes of each entry of a section of a docstring."""
    made = []
    for entry in ENTRY.finditer(text):
        names = (entry["names"] or "").removesuffix(" : ").replace(" ", "")
        axes = entry["shape"].strip("()").replace("...", "").strip(", ")
        made.append((names.split(",") if names else [], f"({axes.replace(' ', '')})"))
    return made


@pytest.mark.parametrize(
    ("file", "function", "kernel", "arguments"), wrappers(), ids=lambda x: getattr(x, "name", str(x))
)
def test_documented_shapes_are_those_of_the_kernel(file, function, kernel, arguments):
    module = ".".join(["rodgen.kinematics", *Path(file).with_suffix("").parts])
    doc = inspect.getdoc(getattr(importlib.import_module(module), function.name))
    assert doc, f"{file}: {function.name} has no docstring"
    inputs, outputs = (
        re.findall(r"\([^()]*\)", side) for side in getattr(generated.ALL, kernel).signature.split("->")
    )
    parameters, _, returns = doc.partition("\nReturns\n")
    documented = {name: shape for names, shape in shapes(parameters) for name in names}
    for name, shape in zip(arguments, inputs, strict=True):
        assert documented.get(name, shape) == shape, f"{file}: {name} of {function.name}"
    returns = re.split(r"\n[A-Z]\w+\n-+\n", returns)[0]
    assert [shape for _, shape in shapes(returns)] == outputs, f"{file}: what {function.name} returns"
