"""Pages of the reference that are made from what they describe: commands, effects, kernels, modules, errata."""

from __future__ import annotations

import argparse
import ast
import enum
import importlib
import inspect
import itertools
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from rodgen.cli._console import EXIT_CODES
from rodgen.cli.main import _GROUPS, _parser
from rodgen.machines.effects.catalogue import CATALOGUE

__all__ = ["command_pages", "effects_page", "kernels_page", "module_pages", "toctree"]

PLACES = {
    "revolute": "Revolute joints",
    "prismatic": "Prismatic joints",
    "machine": "The whole machine",
    "target": "Targets",
    "leg": "Legs",
    "legs": "All legs alike",
    "tower": "Towers of a linear delta",
    "towers": "All towers of a linear delta alike",
    "arm": "Arms of a rotary delta",
    "arms": "All arms of a rotary delta alike",
}


def toctree(names: list[str], *, hidden: bool = False, caption: str = "") -> str:
    """Return a table of contents."""
    options = [":hidden:"] * hidden + [f":caption: {caption}"] * bool(caption) + [":maxdepth: 1"]
    return "\n".join(["```{toctree}", *options, "", *names, "```", ""])


def _escaped(text: str) -> str:
    return re.sub(r"([\\`*_{}\[\]<>|$#~])", r"\\\1", text)


# commands -------------------------------------------------------------------------------------------------


def command_pages() -> dict[str, str]:
    """Return a page for each command, and one that lists them."""
    commands = _members(_parser())
    pages = {
        f"commands/{name}": _command(name, parser, 1) + "".join(_subcommands(parser))
        for name, (parser, _) in commands.items()
    }
    lines = ["# Commands", "", "What `rodgen COMMAND --help` prints, command by command.", ""]
    for title, names in _GROUPS.items():
        lines += [f"## {title[0].upper()}{title[1:]}", "", "| command | does |", "| --- | --- |"]
        lines += [
            f"| [`rodgen {name}`](commands/{name}.md) | {_escaped(commands[name][1])} |" for name in names
        ]
        lines += [""]
    lines += ["## Exit codes", "", *_code(EXIT_CODES.splitlines()[1:])]
    order = [f"commands/{name}" for names in _GROUPS.values() for name in names]
    pages["commands"] = "\n".join([*lines, toctree(order, hidden=True)])
    return pages


def _members(parser: argparse.ArgumentParser) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    """Return the commands of a parser, each with its summary."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            summaries = {choice.dest: choice.help or "" for choice in action._choices_actions}
            return {name: (member, summaries[name]) for name, member in action.choices.items()}
    return {}


def _subcommands(parser: argparse.ArgumentParser) -> Iterator[str]:
    for name, (member, _) in _members(parser).items():
        yield "\n" + _command(f"{parser.prog.removeprefix('rodgen ')} {name}", member, 2)


def _command(name: str, parser: argparse.ArgumentParser, level: int) -> str:
    usage = re.sub(r"\n +", "\n    ", parser.format_usage().removeprefix("usage: ").strip())
    lines = [f"{'#' * level} `rodgen {name}`", "", "```text", usage, "```", ""]
    lines += _paragraphs(parser.description or "")
    for action in parser._actions:
        hidden = isinstance(action, argparse._HelpAction | argparse._SubParsersAction)
        if not hidden and action.help != argparse.SUPPRESS:
            lines += [f"{_invocation(action)}\n: {_escaped(_help(parser, action)) or '&nbsp;'}", ""]
    return "\n".join(lines)


def _invocation(action: argparse.Action) -> str:
    value = "" if action.nargs == 0 else _value(action)
    if not action.option_strings:
        return f"`{value}`"
    return ", ".join(f"`{option} {value}`".replace(" `", "`") for option in action.option_strings)


def _value(action: argparse.Action) -> str:
    shown = action.metavar if isinstance(action.metavar, str) else None
    if shown is None:
        shown = "|".join(map(str, action.choices)) if action.choices else action.dest.upper()
    return f"[{shown}]" if action.nargs == "?" else f"{shown} ..." if action.nargs in ("*", "+") else shown


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    text = action.help or ""
    return parser._get_formatter()._expand_help(action) if text else ""


def _paragraphs(text: str) -> Iterator[str]:
    """Yield the lines of a help text as Markdown: indented lines are code, others prose."""
    code: list[str] = []
    prose: list[str] = []
    for line in [*text.splitlines(), ""]:
        indented = line.startswith(" ")
        if code and not indented and line.strip():
            yield from _code(code)
            code = []
        if indented or (code and not line.strip()):
            if prose:
                yield from (_escaped(" ".join(prose)), "")
                prose = []
            code.append(line)
        elif line.strip():
            prose.append(line.strip())
        elif prose:
            yield from (_escaped(" ".join(prose)), "")
            prose = []
    if code:
        yield from _code(code)


def _code(lines: list[str]) -> Iterator[str]:
    yield from ("```text", textwrap.dedent("\n".join(lines)).strip("\n"), "```", "")


# effects --------------------------------------------------------------------------------------------------


def effects_page() -> str:
    """Return the catalogue of effects."""
    lines = [
        "# The catalogue of effects",
        "",
        *_paragraphs(_members(_parser())["effects"][0].description),
        "",
    ]
    lines += [
        "`rodgen effects` lists them in a terminal. How effects enter a model, and what the names in the formulas "
        "mean, is described on the page [effects](effects.md).",
        "",
    ]
    for place, title in PLACES.items():
        lines += [f"## {title}", ""]
        for effect in CATALOGUE:
            if place == _first_place(effect):
                lines += [f"({place}-{effect.name})=", f"### `{effect.name}`", "", *_effect(effect), ""]
    return "\n".join(lines)


def _first_place(effect: Any) -> str:
    return next(place for place in PLACES if place in effect.at)


def _effect(effect: Any) -> Iterator[str]:
    entry = effect.as_dict()
    yield from ("```text", *textwrap.wrap(entry["equation"], 88, subsequent_indent="    "), "```", "")
    yield from (_escaped(entry["meaning"]), "")
    parameters = [f"`{name}` [{_escaped(unit)}]" for name, unit in entry["parameters"].items()]
    others = [
        PLACES[place].lower() for place in PLACES if place in effect.at and place != _first_place(effect)
    ]
    rows = {
        "Parameters": ", ".join(parameters)
        + (", and those of weights at later joints" if entry["later_joints"] else ""),
        "Also at": ", ".join(others),
        "Searched for": ", ".join(f"`{name}`" for name in entry["searched"]),
        "ISO 230": _escaped(entry["iso"] or ""),
        "Usual size": _escaped(entry["usual_size"] or ""),
        "Remedy": _escaped(entry["remedy"] or ""),
        "Source": _escaped(entry["source"] or ""),
    }
    for title, text in rows.items():
        if text:
            yield from (f"{title}\n: {text}", "")


# kernels --------------------------------------------------------------------------------------------------


def kernels_page(root: Path, derivations: Mapping[str, str]) -> str:
    """Return the table of the generated kernels, read from the generated NumPy modules.

    Parameters
    ----------
    root : Path
        The repository.
    derivations : mapping of str to str
        The names of derivations and their titles.
    """
    lines = [
        "# Kernels",
        "",
        "Functions that the derivations generate, in NumPy (`generated/numpy`), in C99 (`generated/c`, for `double` "
        "and `float`, for one element and for many) and as a NumPy extension. Each is compared with its own evaluation "
        "at 50 digits in every target. [The C code on a controller](/guides/c.md) shows how to call them; public "
        "Python functions check their input before they call one.",
        "",
    ]
    for name, title in derivations.items():
        file = root / f"generated/numpy/{name}.py"
        if not file.is_file():
            continue
        lines += [f"## `{name}`", "", f"Derivation: [{title}](/science/derivations/{name}.ipynb).", ""]
        lines += ["| kernel | inputs | outputs | does |", "| --- | --- | --- | --- |"]
        for function in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(function, ast.FunctionDef) and not function.name.startswith("_"):
                lines.append(_kernel_row(function))
        lines.append("")
    return "\n".join(lines)


def _kernel_row(function: ast.FunctionDef) -> str:
    document = ast.get_docstring(function) or ""
    inputs = ", ".join(f"`{argument.arg}`" for argument in function.args.args)
    returned = re.search(r"^Returns\n-+\n(.*?)(?:\n\n[A-Z]|\Z)", document, re.DOTALL | re.MULTILINE)
    outputs = re.findall(r"^(\w+) :", returned[1], re.MULTILINE) if returned else []
    summary = _escaped(document.partition("\n\n")[0].replace("\n", " "))
    return f"| `{function.name}` | {inputs} | {', '.join(f'`{name}`' for name in outputs)} | {summary} |"


# Python ---------------------------------------------------------------------------------------------------


def module_pages(modules: Mapping[str, str]) -> dict[str, str]:
    """Return a page, in reStructuredText, for each public module, and one that lists them."""
    described: dict[int, str] = {}
    pages = {f"python/{name}.rst": _module(name, described) for name in modules}
    rows = "\n".join(f"| [`{name}`](python/{name}.rst) | {text} |" for name, text in modules.items())
    pages["python.md"] = (
        "# The Python packages\n\nPublic names, by the modules from which they are imported. Functions on arrays take "
        "any shape with the components along the last axis, and return a status for every element.\n\n"
        f"| module | about |\n| --- | --- |\n{rows}\n\n{toctree([f'python/{name}' for name in modules], hidden=True)}"
    )
    return pages


def _module(name: str, described: dict[int, str]) -> str:
    """Return the page of a module; what the page of another module describes is only listed."""
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError:  # a module that a package imports when it is asked for
        package, _, attribute = name.rpartition(".")
        module = getattr(importlib.import_module(package), attribute)
    kinds: dict[str, list[str]] = {
        "Classes": [],
        "Exceptions": [],
        "Statuses": [],
        "Functions": [],
        "Data": [],
    }
    own = [m for m, x in vars(module).items() if m[0] != "_" and getattr(x, "__module__", None) == name]
    public = getattr(module, "__all__", own)
    for member in sorted([*public, *getattr(module, "_LATER", ())], key=str.lower):
        kinds[_kind(getattr(module, member))].append(member)
    lines = [name, "=" * len(name), "", f".. currentmodule:: {name}", "", inspect.getdoc(module) or "", ""]
    for kind, members in kinds.items():
        if not members:
            continue
        lines += [kind, "-" * len(kind), ""]
        if kind == "Data":
            for member in members:
                lines += [f".. py:data:: {member}", "", textwrap.indent(_document(module, member), "   "), ""]
            continue
        places = {m: described.setdefault(id(getattr(module, m)), f"{name}.{m}") for m in members}
        lines += [".. autosummary::", "   :nosignatures:", ""]
        lines += [f"   {m if place == f'{name}.{m}' else '~' + place}" for m, place in places.items()] + [""]
        directive = {"Functions": "autofunction", "Exceptions": "autoexception"}.get(kind, "autoclass")
        for member, place in places.items():
            if place == f"{name}.{member}":
                lines += [f".. {directive}:: {member}", *["   :members:"] * (kind != "Functions"), ""]
    return "\n".join(lines)


def _kind(found: Any) -> str:
    if inspect.isclass(found):
        if issubclass(found, Exception):
            return "Exceptions"
        return "Statuses" if issubclass(found, enum.Enum) else "Classes"
    return "Functions" if callable(found) else "Data"


def _document(module: ModuleType, name: str) -> str:
    """Return the string after the assignment of a name, in the module where it is assigned; else its value."""
    package = module.__name__.rpartition(".")[0] if not hasattr(module, "__path__") else module.__name__
    for place, other in list(sys.modules.items()):
        if (
            place.startswith(package)
            and getattr(other, name, None) is getattr(module, name)
            and other.__file__
        ):
            body = ast.parse(Path(other.__file__).read_text(encoding="utf-8")).body
            for statement, after in itertools.pairwise(body):
                targets = getattr(statement, "targets", None) or [getattr(statement, "target", None)]
                is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                if is_text and any(isinstance(target, ast.Name) and target.id == name for target in targets):
                    return inspect.cleandoc(str(after.value.value))
    return f"``{getattr(module, name)!r}``"
