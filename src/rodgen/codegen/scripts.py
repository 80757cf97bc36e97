"""Run scripts of derivations: rodgen's own by name, or a user's file; also as a notebook.

A script is plain Python that leaves a :class:`rodgen.symbolic.Derivation` in the module-level name ``derivation``.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import pkgutil
import re
import subprocess
import sys
import traceback
from importlib import metadata
from pathlib import Path
from types import ModuleType

from rodgen.codegen.build_cache import cached_text, source_hash
from rodgen.codegen.source_files import Rendered, rendered
from rodgen.errors import InputFileError, RodgenError, UnfitArgumentError, UnprovedError, shown
from rodgen.files import write_file
from rodgen.symbolic import Derivation, DerivationError

_OBJECT = "a module-level name 'derivation', a rodgen.symbolic.Derivation"


def packaged_derivations() -> list[str]:
    """Return the names of rodgen's own derivations, sorted."""
    package = importlib.import_module("rodgen.derivation")
    return sorted(m.name for m in pkgutil.iter_modules(package.__path__) if not m.ispkg)


def script_path(name: str) -> Path:
    """Find the script of a derivation.

    Parameters
    ----------
    name : str
        A name of `packaged_derivations`, or a file that ends in ``.py``.

    Raises
    ------
    InputFileError
        When there is neither.
    """
    if name.endswith(".py") or os.sep in name:
        path = Path(name)
        if not path.is_file():
            found = "a folder" if path.is_dir() else "no such file"
            raise InputFileError(name, "file", found, "a derivation script")
        return path
    if name not in packaged_derivations():
        raise InputFileError(
            name,
            "file",
            "no such derivation",
            f"{', '.join(packaged_derivations())}, or a script that ends in .py",
        )
    spec = importlib.util.find_spec(f"rodgen.derivation.{name}")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin)


def load_derivation(name: str) -> Derivation:
    """Run a derivation script and return its derivation.

    Parameters
    ----------
    name : str
        As for `script_path`.

    Returns
    -------
    Derivation

    Raises
    ------
    UnprovedError
        When a proof in it fails.
    InputFileError
        When the script does not exist, fails, or leaves no derivation.
    """
    path = script_path(name)
    try:
        module = _run(name, path)
    except DerivationError as error:
        message = str(error).partition("\n")[0]
        raise UnprovedError(f"{name}: {_line(error, path)}: {message}") from error
    except RodgenError:
        raise
    except (Exception, SystemExit) as error:
        text = (error.msg if isinstance(error, SyntaxError) else str(error)).partition("\n")[0]
        message = f"{type(error).__name__}: {text}"
        raise InputFileError(name, _line(error, path), message, "a script that runs to its end") from error
    derivation = getattr(module, "derivation", None)
    if not isinstance(derivation, Derivation):
        found = "no such name" if derivation is None else f"{shown(type(derivation).__name__)}"
        raise InputFileError(name, "'derivation'", found, _OBJECT)
    return derivation


def kept_kernels(name: str) -> Rendered:
    """Return the generated files of one of rodgen's own derivations; it is run only where a source of them has changed.

    Those are its script and the derivations that it imports, the floors below, and the libraries that prove and print.
    """
    scripts, waiting = dict[str, Path](), {name}
    while waiting:
        script = waiting.pop()
        scripts[script] = script_path(script)
        imports = re.findall(r".*\brodgen\.derivation\b.*", scripts[script].read_text(encoding="utf-8"))
        words = set(re.findall(r"\w+", " ".join(imports)))
        waiting |= words & set(packaged_derivations()) - set(scripts)
    home = Path(__file__).parents[1]
    below = [home / "codegen", home / "symbolic", *sorted(home.glob("*.py"))]
    libraries = [metadata.version(library) for library in ("sympy", "mpmath", "jinja2", "numpy")]
    text = cached_text(
        ["generated files", name, sys.version, *libraries, source_hash(*below, *sorted(scripts.values()))],
        lambda: json.dumps(rendered(load_derivation(name), extension=True, in_package=True)),
    )
    return Rendered(*json.loads(text))


def _run(name: str, path: Path) -> ModuleType:
    if not name.endswith(".py") and os.sep not in name:
        return importlib.import_module(f"rodgen.derivation.{name}")
    spec = importlib.util.spec_from_file_location(f"_rodgen_script_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # As Python does for a script: its own folder first, and the module where dataclasses and pickle find it.
    sys.path.insert(0, str(path.resolve().parent))
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.resolve().parent))
        del sys.modules[spec.name]
    return module


def _line(error: BaseException, path: Path) -> str:
    """Name the last line of the script itself that led to `error`."""
    if isinstance(error, SyntaxError) and error.lineno:
        return f"line {error.lineno}"
    here = [f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename).name == path.name]
    return f"line {here[-1]}" if here else "file"


def check_notebook(output: str | os.PathLike[str]) -> None:
    """Raise `InputFileError` where a notebook cannot be written, or Jupyter is not installed."""
    file = os.fspath(output)
    if not file.endswith(".ipynb"):
        raise InputFileError(file, "file", "a name without a known ending", "a name that ends in .ipynb")
    if not Path(file).resolve().parent.is_dir():
        raise InputFileError(file, "file", "a name in a folder that is not there", "a folder that is there")
    try:
        for package in ("jupytext", "nbclient", "nbformat"):
            importlib.import_module(package)
    except ImportError as error:
        expected = "it: pip install 'rodgen[notebooks]'"
        raise UnfitArgumentError("notebook", f"no module {error.name!r}", expected) from None


def run_notebook(name: str, output: str | os.PathLike[str], *, then: str = "") -> str:
    """Run a derivation script as a notebook, and write it with what it shows; its code is folded away.

    Parameters
    ----------
    name : str
        As for `script_path`; a script in jupytext's percent format, whose prose is in Markdown cells.
    output : str or os.PathLike
        Ends in ``.ipynb``.
    then : str, optional
        Code that runs after the last cell and does not become part of the notebook.

    Returns
    -------
    str
        What `then` prints.

    Raises
    ------
    UnprovedError
        When a cell fails.
    InputFileError
        When the script cannot be read, the output not be written, or Jupyter is not installed.
    """
    path = script_path(name)
    check_notebook(output)
    import jupytext
    import nbclient
    import nbformat

    notebook = jupytext.read(path, fmt="py:percent")
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata.pop("jupytext", None)
    code = "\n".join(cell.source for cell in notebook.cells)
    for variable, mark, heading in (
        (
            "derivation.kernels",
            "derivation.kernel(",
            "## Functions, and the number of operations that each takes",
        ),
        ("derivation", "derivation = Derivation(", "## All symbols"),
    ):
        if mark in code:
            heading_cell = nbformat.v4.new_markdown_cell(heading)
            notebook.cells += [heading_cell, nbformat.v4.new_code_cell(variable)]
    notebook.cells.append(nbformat.v4.new_code_cell(then))
    client = nbclient.NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        record_timing=False,  # the same script gives the same bytes
        resources={"metadata": {"path": str(path.resolve().parent)}},
    )
    try:
        # Hide the kernel's own messages about its sockets; errors come by protocol.
        # Figures bring plotly.js along, so that the notebook needs no network.
        environment = {"PLOTLY_RENDERER": "plotly_mimetype+notebook", **os.environ}
        client.execute(stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    except nbclient.exceptions.CellExecutionError as error:
        raise UnprovedError(f"{name}: {shown(f'{error.ename}: {error.evalue}', 300)[1:-1]}") from None
    last = notebook.cells.pop()
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"
        if cell["cell_type"] == "code":
            # JupyterLab folds by the first; MyST-NB and Jupyter Book by the second.
            cell["metadata"]["jupyter"] = {"source_hidden": True}
            cell["metadata"]["tags"] = ["hide-input"]
    text: str = nbformat.writes(notebook)
    write_file(os.fspath(output), text.encode())
    return "".join(part.text for part in last.outputs if part.output_type == "stream")
