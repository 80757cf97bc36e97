"""``rodgen derive`` and ``kernels``: run derivations, generate code."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rodgen.cli._console import FAILED, OK, Command, conclude, notify, show
from rodgen.cli._values import InputFile, OutputFile, OutputFolder
from rodgen.errors import InputFileError, RodgenError
from rodgen.stages import each, stage

if TYPE_CHECKING:
    from rodgen.symbolic import Derivation

_DERIVE = """\
Run a derivation, prove every statement in it, and print what was proved, what was found wrong in the source, and the
time taken.

The script is plain Python (jupytext percent format when it is to become a notebook) that leaves a
rodgen.symbolic.Derivation in the module-level name 'derivation'.
"""

_KERNELS = """\
Write the kernels of a derivation: a NumPy module, and C source and header; with --target the kernels in other
languages. With --check nothing is written: differences are shown as a
diff, and the exit code is 1.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    derive = command("derive", _derive, "run a derivation and print its report", _DERIVE)
    about = "one of rodgen's own, or a script"
    derive.add_argument("derivation", metavar="NAME|SCRIPT.py", type=InputFile, help=about)
    derive.add_argument("--steps", action="store_true", help="print every proof with its steps, too")
    about = "also run it as a notebook, and write that"
    derive.add_argument("--notebook", metavar="FILE.ipynb", type=OutputFile, help=about)

    kernels = command("kernels", _kernels, "generate code from a derivation", _KERNELS)
    kernels.add_argument("derivation", metavar="NAME|SCRIPT.py", type=InputFile, nargs="?", help=about)
    about = "default: %(default)s"
    kernels.add_argument("-o", "--output", metavar="DIR", type=OutputFolder, default="generated", help=about)
    kernels.add_argument(
        "--target",
        choices=("numpy", "c", "cpp", "matlab"),
        action="append",
        help="language, may be repeated: NumPy, C99, a C++17 header, MATLAB and GNU Octave (default: numpy and c)",
    )
    kernels.add_argument("--check", action="store_true", help="compare with what is there instead of writing")


def _derive(options: argparse.Namespace) -> int:
    from rodgen.cli.scripts import check_notebook, load_derivation, run_notebook

    if options.notebook:
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


def _loaded(name: str | None) -> list[Derivation]:
    from rodgen.cli.scripts import load_derivation, packaged_derivations

    if name:
        with stage("deriving"):
            return [load_derivation(name)]
    return [load_derivation(n) for n in each("deriving", packaged_derivations())]


def _kernels(options: argparse.Namespace) -> int:
    from pathlib import Path

    from rodgen.codegen import KernelError
    from rodgen.codegen.source_files import USUAL_TARGETS, check_kernels, write_kernels

    derivations = _loaded(options.derivation)
    if not any(derivation.kernels for derivation in derivations):
        raise InputFileError(
            options.derivation, "kernels", "none: it proves statements only", "a derivation with kernels"
        )
    folder = Path(options.output)
    own = options.derivation is None
    # rodgen's own kernels are a NumPy extension, too
    written_as = {"targets": options.target or USUAL_TARGETS, "extension": own and not options.target}
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
    named = [*([options.derivation] if not own else []), "-o", options.output]
    command = " ".join(["rodgen kernels", *named, *(f"--target {target}" for target in options.target or ())])
    notify(f"{folder}: differs from what the derivations generate; '{command}' regenerates it")
    return FAILED
