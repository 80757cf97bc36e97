"""Docstrings of functions over a kernel: shapes, units, source and errors are those of the kernel.

A docstring in the code says what the kernel does not know. The rest is read off the kernel when the module is imported.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

__all__ = ["documented_by"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

_RAISES = """\
ValueError
    When shapes do not broadcast, or the last axes of an argument are others than those above.
TypeError
    When an argument is not real."""


def documented_by(
    kernel: Callable[..., Any], outputs: Sequence[str] | None = None
) -> Callable[[_Function], _Function]:
    """Return a decorator that completes the docstring of a function over a kernel.

    Parameters
    ----------
    kernel : callable
        The kernel as a generated NumPy function. A parameter that has the name of an input, and each output, gets the
        shape, the unit and the words of the port; what the docstring says about it follows. So do errors and source.
    outputs : sequence of str, optional
        What the function returns, in its order; left out: all outputs, and then what else its docstring names. One
        whose Returns name a class keeps them.
    """
    if not kernel.__doc__:  # python -OO
        return lambda function: function
    derivation = kernel.__module__.rpartition(".")[2]
    summary, ports = _sections(kernel.__doc__)
    source = re.sub(r"(?s).*?Source: ([^\n]*).*", r"\1", summary)
    inputs, results = (_entries(ports[title]) for title in ("Parameters", "Returns"))

    def complete(function: _Function) -> _Function:
        head, described = _sections(function.__doc__)
        entries = _entries(described.pop("Parameters", ""))
        parameters = [
            _entry(name, _given(inputs.get(name, ""), parameter), entries.get(name, ""))
            for name, parameter in inspect.signature(function).parameters.items()
        ]
        entries = _entries(described.pop("Returns", ""))
        others = {name: entry for name, entry in entries.items() if name not in results}
        if all(" : " in entry for entry in others.values()):  # otherwise it is a class that holds the results
            named = dict.fromkeys([*results, *others] if outputs is None else outputs)
            entries = {name: _entry(name, results.get(name, ""), entries.get(name, "")) for name in named}
        proof = "" if "derivation" in source else f"; proved in the derivation ``{derivation}``"
        notes = [f"Source: {source}{proof}.", described.pop("Notes", "")]
        sections = {
            "Parameters": "\n".join(parameters),
            "Returns": "\n".join(entries.values()),
            "Raises": described.pop("Raises", _RAISES),
            "Notes": "\n\n".join(filter(None, notes)),
            **described,
        }
        function.__doc__ = "\n\n".join(
            [head, *(f"{title}\n{'-' * len(title)}\n{text}" for title, text in sections.items())]
        )
        return function

    return complete


def _sections(doc: str | None) -> tuple[str, dict[str, str]]:
    """Return what stands before the sections of a docstring, and the text of each by its title."""
    head, *rest = re.split(r"\n+([A-Z]\w+)\n-+\n", inspect.cleandoc(doc or ""))
    return head, dict(zip(rest[::2], rest[1::2], strict=True))


def _entries(section: str) -> dict[str, str]:
    """Return the entries of a section by their names."""
    entries = filter(None, re.split(r"\n(?=\S)", section))
    return {re.split(r"[ \n]", entry)[0]: entry for entry in entries}


def _given(port: str, parameter: inspect.Parameter) -> str:
    """Return the entry of an input as that of a parameter."""
    first, line, words = port.replace(" : array", " : array_like").partition("\n")
    return first + (", optional" if line and parameter.default is not parameter.empty else "") + line + words


def _entry(name: str, port: str, text_there: str) -> str:
    """Return the entry of a port, with what a docstring says about it after the kernel's words."""
    if not port:
        return text_there or name
    first, _, words = port.partition("\n")
    words = words.strip()
    if re.match(r"[a-z]{2,}\b", words):
        words = words[0].upper() + words[1:]
    first, codes, enum = first.partition(", codes of ")
    if codes:
        words += f": codes of :class:`{enum}`"
    text = f"{words}. {' '.join(text_there.partition(chr(10))[2].split())}"
    return f"{first}\n{textwrap.indent(textwrap.fill(text, 112), '    ')}"
