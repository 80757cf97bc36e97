"""Docstrings of functions over a kernel say what the kernel's ports are."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

import rodgen.generated
import rodgen.kinematics
from rodgen.generated import numpy as generated
from rodgen.kinematics.ports import documented_by

FOLDER = Path(rodgen.kinematics.__file__).parent
HEADERS = "\n".join(
    path.read_text(encoding="utf-8")
    for path in sorted((Path(rodgen.generated.__file__).parent / "c").glob("*.h"))
)


def ports(kernel: str) -> dict[str, tuple[str, str]]:
    """Shape and unit of each port by its name, from the comment of the C function."""
    module = getattr(generated.ALL, kernel).__module__.rpartition(".")[2]
    (comment,) = re.findall(rf"/\*((?:(?!/\*).)*?)\*/\nvoid {module}_{kernel}_f64\(", HEADERS, re.DOTALL)
    rows = re.findall(r"^ \* (\w+)(?: \(([\d, ]+)\))?, ([^:]*): ", comment, re.MULTILINE)
    return {name: (f"(..., {shape})" if shape else "(...)", unit) for name, shape, unit in rows}


def wrappers() -> list[tuple[str, str, str, list[str] | None]]:
    """Module and name of each function that is documented by a kernel, the kernel, and its outputs if not all."""
    found = []
    for path in sorted(FOLDER.rglob("*.py")):
        module = ".".join(["rodgen.kinematics", *path.relative_to(FOLDER).with_suffix("").parts])
        for function in ast.parse(path.read_text(encoding="utf-8")).body:
            for decorator in getattr(function, "decorator_list", ()):
                match decorator:
                    case ast.Call(
                        ast.Name("documented_by"), [ast.Attribute(_, kernel) | ast.Name(kernel), *only]
                    ):
                        outputs = ast.literal_eval(only[0]) if only else None
                        found.append((module, function.name, kernel, outputs))
    return found


WRAPPERS = wrappers()


@pytest.mark.parametrize(
    ("module", "name", "kernel", "only"), WRAPPERS, ids=[name for _, name, *_ in WRAPPERS]
)
def test_every_port_stands_in_the_docstring_with_its_shape_and_unit(module, name, kernel, only):
    function = getattr(importlib.import_module(module), name)
    parameters, _, returns = inspect.getdoc(function).partition("\nReturns\n-------\n")
    results = re.split(r"\n\n[A-Z]", returns)[0]
    inputs = inspect.signature(getattr(generated.ALL, kernel)).parameters
    own = inspect.signature(function).parameters
    holder = function.__globals__.get(results.partition("\n")[0])  # a class whose attributes are the results
    for port, (shape, unit) in ports(kernel).items():
        if port in own:
            entry = rf"^{port} : array_like {re.escape(shape)}, {re.escape(unit)}(, optional)?$"
            assert re.search(entry, parameters, re.MULTILINE)
        elif port in getattr(holder, "_fields", ()):
            assert re.search(rf"^{port} : array {re.escape(shape)}", inspect.getdoc(holder), re.MULTILINE)
        elif port not in inputs and not holder and (only is None or port in only):
            line = f"int8 array {shape}" if unit.startswith("codes") else f"array {shape}, {unit}"
            assert f"\n{port} : {line}\n" in f"\n{results}\n"
            assert not unit.startswith("codes of ") or f":class:`{unit[9:]}`" in results


def test_functions_that_only_call_a_kernel_are_documented_by_it():
    documented = {(module, name) for module, name, *_ in WRAPPERS}
    for path in sorted(FOLDER.rglob("*.py")):
        module = ".".join(["rodgen.kinematics", *path.relative_to(FOLDER).with_suffix("").parts])
        for function in ast.parse(path.read_text(encoding="utf-8")).body:
            match function:
                case ast.FunctionDef(
                    name=name, body=[*_, ast.Return(ast.Call(ast.Name("call_kernel"), [ast.Attribute(), *_]))]
                ) if not name.startswith("_"):
                    assert (module, name) in documented


def test_own_words_follow_those_of_the_kernel():
    def kernel():
        """Double a length.

        Source: a ruler

        Parameters
        ----------
        x : array (..., 3), length
            three lengths

        Returns
        -------
        y : array (...), length
            their sum
        status : int8 array (...), codes of Kind
            what it is
        """

    @documented_by(kernel)
    def function(x, *, unit="m"):
        """Return twice the sum.

        Parameters
        ----------
        x
            Not negative.
        unit : str, optional
            The unit.
        """

    assert inspect.getdoc(function) == "\n".join(
        [
            *("Return twice the sum.", "", "Parameters", "----------"),
            *("x : array_like (..., 3), length", "    Three lengths. Not negative."),
            *("unit : str, optional", "    The unit.", "", "Returns", "-------"),
            *("y : array (...), length", "    Their sum."),
            *("status : int8 array (...)", "    What it is: codes of :class:`Kind`.", "", "Raises", "------"),
            "ValueError",
            "    When shapes do not broadcast, or the last axes of an argument are others than those above.",
            *("TypeError", "    When an argument is not real.", "", "Notes", "-----"),
            "Source: a ruler; proved in the derivation ``test_kernel_docstrings``.",
        ]
    )


def test_without_docstrings_functions_stay_as_they_are():
    def kernel():
        pass

    function = documented_by(kernel)(lambda x: x)
    assert (function(2), function.__doc__) == (2, None)
