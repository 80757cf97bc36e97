"""``rodgen derive`` and ``kernels``: run derivations, generate code.

A derivation is one of rodgen's own by its name, or a user's by its file: a script in plain Python that leaves a
:class:`rodgen.symbolic.Derivation` in the module-level name ``derivation``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import (
    FAILED,
    OK,
    Command,
    argument,
    arguments_as_options,
    choice,
    conclude,
    flag,
    notify,
    option,
    show,
)
from rodgen.cli._values import InputFile, OutputFile, OutputFolder
from rodgen.errors import InputFileError, RodgenError
from rodgen.stages import each, stage

if TYPE_CHECKING:
    from rodgen.codegen.source_files import Rendered
    from rodgen.symbolic import Derivation


_DERIVE = """\
Run a derivation, prove every statement in it, and print each formula with its verdict, the argument, and the time
taken. A script is plain Python that leaves a rodgen.symbolic.Derivation in the module-level name 'derivation'.
"""

_KERNELS = """\
Write the kernels of a derivation: a NumPy module, and C source and header; with --target the kernels in other
languages. With --check nothing is written: differences are shown as a diff, and the exit code is 1.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    name, about = "NAME|SCRIPT.py", "one of rodgen's own, or a script"
    command(
        "derive",
        _derive,
        _DERIVE,
        argument(name, about, InputFile, dest="derivation"),
        flag("--steps", "print every proof with its steps, too"),
        option("--notebook FILE.ipynb", "also run it as a notebook, and write that", OutputFile),
    )
    command(
        "kernels",
        _kernels,
        _KERNELS,
        argument(name, f"{about}; left out, all of rodgen's own", InputFile, nargs="?", dest="derivation"),
        option("-o --output DIR", "default: %(default)s", OutputFolder, default="generated"),
        choice(
            "--target",
            ("numpy", "c", "cpp", "matlab"),
            "language, may be repeated; default: numpy and c",
            action="append",
        ),
        flag("--check", "compare with what is there instead of writing"),
    )


def _derive(options: argparse.Namespace) -> int:
    from rodgen.codegen.scripts import check_notebook, load_derivation, run_notebook

    if options.notebook:
        with arguments_as_options():
            check_notebook(options.notebook)  # before the proofs, which take their time
    with stage("deriving"):
        derivation = load_derivation(options.derivation)
    if options.notebook:
        with stage("running the notebook"):
            run_notebook(options.derivation, options.notebook)
    if options.steps:
        for entry in derivation:
            show(f"{entry.steps()}\n")
    show(derivation.report())
    return FAILED if derivation.open else OK


def _kernels(options: argparse.Namespace) -> int:
    from rodgen.codegen import KernelError
    from rodgen.codegen.scripts import kept_kernels, load_derivation, packaged_derivations
    from rodgen.codegen.source_files import USUAL_TARGETS, check_kernels, write_kernels

    is_of_rodgen = options.derivation is None
    derivations: list[Derivation | Rendered] = []
    if is_of_rodgen:
        # what is compared is derived anew
        load = load_derivation if options.check or options.target else kept_kernels
        derivations += [load(name) for name in each("deriving", packaged_derivations())]
    else:
        with stage("deriving"):
            derivation = load_derivation(options.derivation)
        if not derivation.kernels:
            where = derivation.kernels_in or "a derivation with kernels"
            raise InputFileError(options.derivation, "kernels", "none: it proves statements only", where)
        derivations.append(derivation)
    folder = Path(options.output)
    # rodgen's own kernels are a NumPy extension, too
    written_as: dict[str, Any] = {
        "targets": options.target or USUAL_TARGETS,
        "extension": is_of_rodgen and not options.target,
    }
    try:
        if not options.check:
            with stage("writing kernels"):
                written = write_kernels(derivations, folder, **written_as)
            for path in written:
                show(str(path))
            if not written:
                conclude(f"{folder}: the files are there already, as they would be written")
            return OK
        with stage("comparing kernels"):
            difference = check_kernels(derivations, folder, **written_as)
    except KernelError as error:
        raise RodgenError(f"{options.derivation}: {error}") from None
    except BrokenPipeError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        file = getattr(error, "filename", None) or str(folder)
        raise InputFileError(file, "file", reason, "a folder for generated files") from None
    if not difference:
        return OK
    show(difference, end="")
    named = [*([options.derivation] if not is_of_rodgen else []), "-o", options.output]
    command = " ".join(["rodgen kernels", *named, *(f"--target {target}" for target in options.target or ())])
    notify(f"{folder}: differs from what the derivations generate; '{command}' regenerates it")
    return FAILED
