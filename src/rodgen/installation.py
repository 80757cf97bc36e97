"""What this installation of rodgen runs on, and what is broken in it."""

from __future__ import annotations

import importlib
import importlib.util
import os
import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from rodgen.document import Document, Facts, Paragraph, Part

__all__ = ["EXTRAS", "document", "examine"]

EXTRAS = {
    "sympy": "derive",
    "jinja2": "derive",
    "pint": "tables",
    "pyarrow": "tables",
    "scipy": "machines",
    "threadpoolctl": "machines",
    "plotly": "plot",
    "kaleido": "plot",
    "choreographer": "plot",
    "shtab": "completion",
    "erfa": "import",
    "openpyxl": "import",
    "nicegui": "app",
    "uvicorn": "app",
}
"""Modules that only some commands need, and the extra that installs them."""

_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "RODGEN_CPU",
    "RODGEN_CACHE",
    "CC",
)


def examine() -> dict[str, Any]:
    """Return what the installation runs on, as plain data; ``problems`` are sentences, none where nothing is broken.

    Keys are ``rodgen``, ``python``, ``platform``, ``packages``, ``kernels``, ``compiler``, ``cache``, ``threads``,
    ``browser``, ``environment`` and ``problems``.
    """
    report: dict[str, Any] = {
        "rodgen": metadata.version("rodgen"),
        "python": {"version": platform.python_version(), "executable": sys.executable},
        "platform": platform.platform(),
        "packages": _packages(),
        "kernels": _kernels(),
        "compiler": _compiler(),
        "cache": _cache(),
        "threads": _threads(),
        "browser": _browser(),
        "environment": {name: os.environ[name] for name in _VARIABLES if name in os.environ},
    }
    report["problems"] = [
        f"{part}: {report[part]['problem']}"
        for part in ("kernels", "compiler", "cache")
        if report[part]["problem"]
    ]
    return report


def _packages() -> dict[str, str | None]:
    """Return the versions of the modules that rodgen uses, None of those that cannot be imported."""
    owners = metadata.packages_distributions()  # a module's distribution may have another name
    return {
        name: (metadata.version(owners[name][0]) if name in owners else "unknown")
        if _is_there(name)
        else None
        for name in ("numpy", *EXTRAS)
    }


def _is_there(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _kernels() -> dict[str, Any]:
    """Return the instruction set of the compiled kernels; a problem is an extension that is there and does not load."""
    from rodgen.kinematics.backend import backend

    spec = importlib.util.find_spec("rodgen._gufuncs")
    problem = None
    if spec is not None:
        try:
            importlib.import_module("rodgen._gufuncs")
        except ImportError as error:
            problem = f"{spec.origin} does not load ({error}); install rodgen again"
    return {"instruction_set": backend, "file": spec.origin if spec else None, "problem": problem}


def _compiler() -> dict[str, Any]:
    from rodgen.codegen.build_cache import CompilerError, check_compiler, compiler, compiler_version

    report: dict[str, Any] = {"command": None, "version": None, "problem": None}
    try:
        command = compiler()
    except CompilerError as error:
        # A machine without a compiler is in order; a compiler that CC names should exist.
        return report | {"problem": str(error) if os.environ.get("CC", "").strip() else None}
    report["command"] = " ".join(command)
    try:
        report["version"] = next(iter(compiler_version(command).splitlines()), None)
        check_compiler(command)
    except CompilerError as error:
        report["problem"] = str(error)
    return report


def _cache() -> dict[str, Any]:
    from rodgen.codegen.build_cache import cache_folder, cache_problem

    problem = cache_problem()
    folder, sizes = None, []
    try:
        folder = str(cache_folder())
        sizes = [file.stat().st_size for file in Path(folder).iterdir() if file.suffix in (".so", ".py")]
    except (OSError, RuntimeError):  # no folder, or no home to have it in
        pass
    return {
        "folder": folder,
        "entries": len(sizes),
        "bytes": sum(sizes),
        "writable": problem is None,
        "problem": problem
        and f"{folder}: {problem}, so every process compiles its models again; name another folder in RODGEN_CACHE",
    }


def _threads() -> dict[str, Any]:
    """Return the processors that this process may use, and the threads of the libraries of linear algebra."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    libraries = []
    if _is_there("threadpoolctl"):
        from threadpoolctl import threadpool_info

        libraries = [
            {"library": library["internal_api"], "threads": library["num_threads"]}
            for library in threadpool_info()
        ]
    return {"processors": allowed, "libraries": libraries}


def _browser() -> str | None:
    """Return the browser that draws images; None without one, or without the package that looks for it."""
    if not _is_there("choreographer"):
        return None
    from rodgen.output.figures.files import browser

    return browser()


def document(report: dict[str, Any]) -> Document:
    """Return what `examine` found as a document."""
    kernels, compiler, cache, threads = (report[part] for part in ("kernels", "compiler", "cache", "threads"))
    missing: dict[str, list[str]] = {}
    for name, extra in EXTRAS.items():
        if report["packages"][name] is None:
            missing.setdefault(extra, []).append(name)
    if kernels["instruction_set"] != "numpy":
        compiled = f"compiled, {kernels['instruction_set']}"
    elif kernels["file"] is None:
        compiled = "NumPy: none were compiled when rodgen was installed"
    else:
        compiled = f"NumPy: {'the compiled ones do not load' if kernels['problem'] else 'RODGEN_CPU is set'}"
    known = f"{compiler['command']}: {compiler['version']}"
    size = f"{cache['entries']} entries, {cache['bytes'] / 1e6:.1f} MB, {'' if cache['writable'] else 'not '}writable"
    libraries = [f"{library['library']} {library['threads']}" for library in threads["libraries"]]
    none = (
        "no Chrome or Chromium"
        if report["packages"]["choreographer"]
        else "not looked for: Kaleido is not installed"
    )
    rows = [
        ("rodgen", f"{report['rodgen']} on Python {report['python']['version']}, {report['platform']}"),
        (
            "packages",
            ", ".join(f"{name} {version}" for name, version in report["packages"].items() if version),
        ),
        *(("", f"no {', '.join(names)}: pip install 'rodgen[{extra}]'") for extra, names in missing.items()),
        ("kernels", compiled),
        ("compiler", known if compiler["command"] else "none: kernels run on NumPy"),
        ("cache", f"{cache['folder']}: {size}"),
        ("threads", ", ".join([f"{threads['processors']} processors", *libraries])),
        ("browser", report["browser"] or f"{none}; figures as .html only"),
        ("set", " ".join(f"{name}={value}" for name, value in report["environment"].items())),
    ]
    problems = report["problems"] or ["Nothing is broken."]
    return Document([Facts(rows), Part([Paragraph(text, "line") for text in problems])])
