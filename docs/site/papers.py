"""A page for each source: its equations, their proofs, the kernels made from them, and what calls these."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from pathlib import Path

__all__ = ["PAPERS", "paper_page"]

PAPERS = {
    "rodrigues_problem": (
        "The inverse Rodrigues problem",
        ("rodrigues", "rotations", "axis", "axis_sensitivity", "axis_fit", "helical_axis", "machine_model"),
    ),
    "tricept_uncertainty": (
        "Positioning uncertainty of the Tricept",
        ("tricept", "tricept_uncertainty", "closed_chain"),
    ),
    "spatial_mechanisms": (
        "Crane and Duffy's spatial mechanisms",
        (
            "spatial_links",
            "trig_equation",
            "spherical_polygons",
            "spatial_loops",
            "biquadratic_pair",
            "robots_6r",
        ),
    ),
    "instantaneous_euler_angles": (
        "Instantaneous Euler angles",
        (
            "instantaneous_euler",
            "instantaneous_euler_inverse",
            "instantaneous_euler_ridges",
            "instantaneous_euler_motion",
            "three_sps_s",
            "instantaneous_euler_arm",
        ),
    ),
}
"""Pages of the sources: the title of each, and the derivations that prove it, in the order of reading."""
WIDEST = 240
"""Characters of LaTeX of a formula that a table shows; a longer one is shown on the page of its proof."""
_NUMBER = re.compile(r"\((\d+)\)(?:\s*(?:-|–|to)\s*\((\d+)\))?")


def paper_page(root: Path, title: str, records: Mapping[str, dict], shown: Mapping[str, set[str]]) -> str:
    """Return the page of a source.

    Parameters
    ----------
    root : Path
        The repository.
    title : str
    records : mapping of str to dict
        What is known of the executed derivations of this source, by name.
    shown : mapping of str to set of str
        The entries that the page of each derivation shows.
    """
    lines = [
        f"# {title}",
        "",
        "Each equation of the source leads to its proof. What is wrong in the source is marked, and put right on the "
        "page of its proof. A kernel names the equations that it evaluates; it is a function of its derivation's NumPy "
        "module and C header. Python functions check their input before they call one.",
        "",
    ]
    callers = _callers(root)
    for name, record in records.items():
        lines += [f"## {record['title']}", ""]
        page = f"derivations/{name}.html"
        printed = [entry for entry in record["entries"] if entry["origin"] != "own"]
        if printed:
            lines += ["| place | equation | verdict | kernels |", "| --- | --- | --- | --- |"]
        for entry in printed:
            made = [
                kernel
                for other in records.values()
                for kernel, source in other["kernels"].items()
                if _evaluates(source, entry, same=other is record)
            ]
            verdict = "**wrong**, put right" if entry["verdict"] == "refuted" else entry["verdict"]
            if entry["id"] in shown[name]:
                verdict = f'<a href="{page}#{escape(entry["id"])}">{verdict}</a>'
            place = escape(entry["place"]) or entry["id"]
            lines.append(f"| {place} | {_formula(entry)} | {verdict} | {_code(made)} |")
        own = len(record["entries"]) - len(printed)
        if own:
            also = "also " if printed else ""
            lines += ["", f'<a href="{page}">The derivation</a> {also}proves {own} statements of its own.']
        if record["kernels"]:
            lines += ["", "| kernel | evaluates | Python |", "| --- | --- | --- |"]
        for kernel, source in record["kernels"].items():
            lines.append(f"| `{kernel}` | {escape(source)} | {_code(sorted(callers[kernel]))} |")
        if record["kernels"]:
            lines += ["", f"NumPy: `rodgen.generated.numpy.{name}`. C: `generated/c/{name}.h`."]
        elif record["kernels_in"]:
            lines += ["", f"Kernels: {escape(record['kernels_in'])}."]
        lines.append("")
    return "\n".join(lines)


def _code(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _formula(entry: dict) -> str:
    claims = [latex.replace("|", r"\vert ").replace("\n", " ") for latex in entry["latex"]]
    wide = sum(map(len, claims)) > WIDEST
    return f"`{entry['id']}`" if wide else "<br>".join(f"${latex}$" for latex in claims)


def _evaluates(source: str, entry: dict, *, same: bool) -> bool:
    """Return whether a kernel's source names the entry, of the same derivation, or the number of its equation."""
    if same and re.search(rf"\bentr(y|ies)\b.*(?<![\w-]){re.escape(entry['id'])}(?![\w-])", source):
        return True
    return bool(_numbers(source) & _numbers(entry["place"]))


def _numbers(text: str) -> set[int]:
    if not re.search(r"\beqs?\.", text):
        return set()
    return {n for first, last in _NUMBER.findall(text) for n in range(int(first), int(last or first) + 1)}


@cache
def _callers(root: Path) -> defaultdict[str, set[str]]:
    """Return the public functions and methods that call each kernel, themselves or through their module's own."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for path in sorted((root / "src/rodgen/kinematics").rglob("*.py")):
        functions: dict[str, tuple[set[str], set[str]]] = {}
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                functions[node.name] = _used(node)
        for name in functions:
            if not name.startswith("_"):
                for kernel in _reached(name, functions):
                    found[kernel].add(name)
    return found


def _used(node: ast.AST) -> tuple[set[str], set[str]]:
    """Return the kernels that a function calls, and the other names in it."""
    kernels, names = set(), set()
    for part in ast.walk(node):
        if (
            isinstance(part, ast.Attribute)
            and isinstance(part.value, ast.Name)
            and part.value.id == "kernels"
        ):
            kernels.add(part.attr)
        if isinstance(part, ast.Name):
            names.add(part.id)
    return kernels, names


def _reached(name: str, functions: Mapping[str, tuple[set[str], set[str]]]) -> set[str]:
    """Return the kernels that a function calls, itself or through private functions of its module."""
    seen, todo, kernels = set(), [name], set()
    while todo:
        one = todo.pop()
        if one not in seen:
            seen.add(one)
            own, names = functions[one]
            kernels |= own
            todo += [other for other in names if other in functions and other.startswith("_")]
    return kernels
