"""The command line: it reads what was asked for, calls the library, and prints.

There is no mathematics here. What a command needs is imported when it runs, so that ``rodgen --help`` and
``rodgen solve`` never wait for SymPy.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import IO, TYPE_CHECKING, Any, NoReturn

from rodgen.errors import InputFileError, RodgenError, shown

if TYPE_CHECKING:
    from rodgen.symbolic import Derivation

__all__ = ["main"]

OK, FAILED, BAD_INPUT, INTERRUPTED, READER_GONE = 0, 1, 2, 130, 141

# Modules that only some commands need, and the extra that brings them.
_EXTRAS = {
    "sympy": "derive",
    "jinja2": "derive",
    "pint": "tables",
    "pyarrow": "tables",
    "tqdm": "tables",
    "matplotlib": "plot",
}

_EXIT_CODES = """\
exit codes:
  0  done
  1  a check failed: a statement is not proved, or generated files are stale
  2  bad input: one line on standard error, FILE: PLACE: what was found; what was expected
  130  interrupted (Ctrl-C)
  141  whoever read the output closed it
"""

_PAIRS = """\
The table, CSV (gzip or not) or Parquet, has one row a pair of points, seen before and after a rotation by a
known angle, with a unit in brackets after each column's name; it may have further columns:

  rho_x [mm],rho_y [mm],rho_z [mm],rho_prime_x [mm],rho_prime_y [mm],rho_prime_z [mm],angle [deg]

Any units of length and angle will do, also different ones in one table: um, m, inch, rad, arcsec, mrad, ...
"""

_SOLVE = f"""\
Find, for every pair of a table, both unit axes about which the rotation can have been, through the origin.

{_PAIRS}
The output gets every column of the table, then
  e1_x e1_y e1_z e2_x e2_y e2_z   the unit axes
  status                          two_axes; one_axis (tangent); no_axis (the angle is too small: both are the
                                  least-squares axis); parallel; perpendicular; every_axis; lengths_differ;
                                  invalid
  length_mismatch                 |rho'|/|rho| - 1
  condition                       by how much errors of the points grow in the axes
"""

_FIT = f"""\
Fit one axis to all pairs of a table: its direction, a point on it, their uncertainties, and what the data do
not determine.

{_PAIRS}"""

_DERIVE = """\
Run a derivation, prove every statement in it, and print what was proved, what was found wrong in the source,
and how long it took.

The script is plain Python (jupytext percent format when it is to become a notebook) that leaves a
rodgen.symbolic.Derivation in the module-level name 'derivation'.
"""

_ERRATA = """\
Print what is wrong in the sources, with an exact counterexample and the correction. Each claim is marked: 'printed' is
a formula of the source, 'said' are its words (with their meaning as a formula), 'tacit' is a hypothesis that it needs
and does not state.
"""

_KERNELS = """\
Write the kernels of a derivation: a NumPy module, C source and header, and for kernels that say where their inputs
are sampled a test. With --check nothing is written: files that differ are shown as a diff, and the exit code is 1.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the command's name; ``sys.argv[1:]`` when left out.

    Returns
    -------
    int
        The exit code.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with _one_line_warnings():
            try:
                options = _parser().parse_args(_joined(given))
            except SystemExit:  # --help and --version
                _print("", end="")
                return OK
            code: int = options.run(options)
            return code
    except _UsageError as error:
        return _complain(error)
    except BrokenPipeError:
        # Who read the output has seen enough. What is still buffered must not raise once more at the exit.
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return READER_GONE
    except KeyboardInterrupt:
        return INTERRUPTED
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        found, expected = f"no module {error.name!r}", f"it: pip install 'rodgen[{extra}]'"
        return _complain(InputFileError("command line", given[0], found, expected))
    except RodgenError as error:
        from rodgen._scripts import UnprovedError

        _complain(error)
        if isinstance(error, InputFileError) and error.file == "standard output":
            # Closed here, because the interpreter would try, and complain, once more at the exit.
            with contextlib.suppress(OSError, AttributeError):
                sys.stdout.close()
        return FAILED if isinstance(error, UnprovedError) else BAD_INPUT


def _complain(error: Exception) -> int:
    print(error, file=sys.stderr)
    return BAD_INPUT


def _print(text: str, end: str = "\n") -> None:
    """Print to standard output, and say in one sentence when that cannot be done."""
    if sys.stdout is None:
        raise InputFileError("standard output", "file", "closed", "an open standard output")
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputFileError(
            "standard output", "file", f"cannot be written ({error.strerror})", "a writable place with room"
        ) from None


@contextlib.contextmanager
def _one_line_warnings() -> Iterator[None]:
    """Show each warning once, on one line, and let none of them stop the command.

    Those for developers stay silent, as they do in Python.
    """
    told: set[str] = set()

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: IO[str] | None = None,
        line: str | None = None,
    ) -> None:
        text = " ".join(str(message).split())
        if text not in told and sys.stderr is not None:
            told.add(text)
            print(f"rodgen: warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for category in (UserWarning, RuntimeWarning):
            warnings.simplefilter("always", category)
        warnings.showwarning = show
        yield


# options -----------------------------------------------------------------------------------------------


class _UsageError(Exception):
    """What was typed is no command."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _UsageError(
            InputFileError("command line", self.prog, message, f"what '{self.prog} --help' shows")
        )


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        print(f"rodgen {version('rodgen')}")
        parser.exit()


def _joined(arguments: list[str]) -> list[str]:
    """Join ``--point -1,2,3`` with an equals sign: argparse takes "-1,2,3" for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--point" and re.match(r"-[\d.]", argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="rodgen",
        description="Derive, prove and generate the equations of rotating machines, and use them.",
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", nargs=0, action=_Version, help="print the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[argparse.Namespace], int], summary: str, text: str) -> _Parser:
        made = commands.add_parser(
            name,
            help=summary,
            description=text,
            epilog=_EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        made.set_defaults(run=run)
        return made

    solve = command("solve", _solve, "axes of every pair of points of a table", _SOLVE)
    solve.add_argument("pairs", metavar="PAIRS", help="the table; '-' is CSV on standard input")
    solve.add_argument(
        "-o", "--output", metavar="FILE", help=".csv, .csv.gz or .parquet; default: CSV on standard output"
    )
    solve.add_argument(
        "--length-tolerance",
        metavar="RATIO",
        type=_ratio,
        help="mismatch of the lengths of rho and rho' beyond which the status is lengths_differ "
        "(a ratio; default 1e-8; measured points need some six times their relative uncertainty)",
    )

    fit = command("fit-axis", _fit_axis, "one axis from all pairs of a table", _FIT)
    fit.add_argument("pairs", metavar="PAIRS", help="the table; '-' is CSV on standard input")
    fit.add_argument(
        "--point",
        type=_point,
        default="free",
        metavar="free|origin|X,Y,Z",
        help="the point on the axis: fitted too (default), the origin, or this one, in the unit of rho_x",
    )
    fit.add_argument(
        "--loss",
        choices=("linear", "huber", "cauchy", "tukey"),
        default="linear",
        help="what a large residual costs: linear is least squares (default), the others resist outliers",
    )
    fit.add_argument(
        "--sigma",
        type=_length,
        metavar="LENGTH",
        help="standard uncertainty of one coordinate of one reading, with its unit, such as 0.01mm; "
        "default: estimated from the residuals",
    )
    fit.add_argument(
        "--json", action="store_true", help="print JSON: lengths in the unit of rho_x, angles in rad"
    )
    fit.add_argument("--plot", metavar="FILE", help="draw the pairs and residuals: .png, .svg or .pdf")

    derive = command("derive", _derive, "run a derivation and print its report", _DERIVE)
    derive.add_argument("derivation", metavar="NAME|SCRIPT.py", help="one of rodgen's own, or a script")
    derive.add_argument("--notebook", metavar="FILE.ipynb", help="also run it as a notebook, and write that")

    errata = command("errata", _errata, "what is wrong in the sources", _ERRATA)
    errata.add_argument(
        "derivation", metavar="NAME|SCRIPT.py", nargs="?", help="default: all of rodgen's own derivations"
    )
    errata.add_argument("--format", choices=("text", "markdown", "json"), default="text")

    kernels = command("kernels", _kernels, "generate code from a derivation", _KERNELS)
    kernels.add_argument(
        "derivation", metavar="NAME|SCRIPT.py", nargs="?", help="default: all of rodgen's own derivations"
    )
    kernels.add_argument("-o", "--output", metavar="DIR", default="generated", help="default: %(default)s")
    kernels.add_argument("--check", action="store_true", help="compare with what is there instead of writing")
    return parser


def _ratio(text: str) -> float:
    with contextlib.suppress(ValueError):
        value = float(text)
        if 0 <= value < math.inf:
            return value
    raise argparse.ArgumentTypeError(f"{shown(text)} is no ratio: a number from 0 up, such as 1e-6")


def _point(text: str) -> str | tuple[float, ...]:
    if text in ("free", "origin"):
        return "free" if text == "free" else (0.0, 0.0, 0.0)
    with contextlib.suppress(ValueError):
        point = tuple(float(part) for part in text.split(","))
        if len(point) == 3 and all(map(math.isfinite, point)):
            return point
    raise argparse.ArgumentTypeError(
        f"{shown(text)} is none of free, origin, and three numbers such as 1,2.5,-3"
    )


def _length(text: str) -> tuple[float, str]:
    found = re.fullmatch(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*?)\s*", text)
    if found and 0 < float(found[1]) < math.inf:
        return float(found[1]), found[2]
    raise argparse.ArgumentTypeError(f"{shown(text)} is no positive length with its unit, such as 0.01mm")


# commands ----------------------------------------------------------------------------------------------


def _solve(options: argparse.Namespace) -> int:
    from rodgen.tables import solve_table

    with contextlib.ExitStack() as stack:
        summary = solve_table(
            options.pairs,
            options.output,
            length_tolerance=options.length_tolerance,
            progress=_progress(stack),
        )
    counts = ", ".join(f"{count} {name}" for name, count in summary.counts.items())
    name = "standard input" if options.pairs == "-" else options.pairs
    if "lengths_differ" in summary.counts:
        counts += " (see --length-tolerance)"
    print(f"{name}: {summary.rows} pair{'s' * (summary.rows != 1)}: {counts}", file=sys.stderr)
    return OK


def _progress(stack: contextlib.ExitStack) -> Callable[[int | None, str], Callable[[int], object]] | None:
    """Make a progress bar where somebody looks: it shows itself after a second."""
    if sys.stderr is None or not sys.stderr.isatty():
        return None

    def start(total: int | None, unit: str) -> Callable[[int], object]:
        from tqdm import tqdm

        bar = tqdm(total=total, unit=unit, unit_scale=True, delay=1, leave=False, file=sys.stderr)
        stack.callback(bar.close)
        update: Callable[[int], object] = bar.update
        return update

    return start


def _fit_axis(options: argparse.Namespace) -> int:
    from rodgen.axis_fit import fit_axis
    from rodgen.tables import read_pairs

    pairs = read_pairs(options.pairs)
    sigma = None
    if options.sigma is not None:
        value, unit = options.sigma
        sigma = _in_unit(value, unit, pairs.unit)
    try:
        fit = fit_axis(
            pairs.rho, pairs.rho_prime, pairs.angle, point=options.point, loss=options.loss, sigma=sigma
        )
    except InputFileError:
        raise
    except RodgenError as error:
        raise RodgenError(f"{options.pairs}: {error}") from None
    if options.plot:
        from rodgen.axis_plot import save_axis_plot

        save_axis_plot(options.plot, pairs, fit)
    if options.json:
        import json

        _print(json.dumps({"file": options.pairs, "unit": pairs.unit, **fit.to_dict()}, allow_nan=False))
    else:
        _print(f"{options.pairs}, lengths in {pairs.unit}")
        _print(fit.summary())
    return OK


def _in_unit(value: float, unit: str, target: str) -> float:
    from rodgen.tables import UnitError, conversion_factor

    try:
        return value * conversion_factor(unit, "length", target)
    except UnitError as error:
        raise InputFileError("command line", "--sigma", error.found, error.expected) from None


def _derive(options: argparse.Namespace) -> int:
    from rodgen._scripts import load_derivation, run_notebook

    derivation = load_derivation(options.derivation)
    _print(derivation.report())
    if options.notebook:
        run_notebook(options.derivation, options.notebook)
    return FAILED if derivation.open else OK


def _loaded(name: str | None) -> list[Derivation]:
    from rodgen._scripts import load_derivation, packaged_derivations

    return [load_derivation(n) for n in ([name] if name else packaged_derivations())]


def _errata(options: argparse.Namespace) -> int:
    derivations = _loaded(options.derivation)
    if not options.derivation:
        derivations = [d for d in derivations if any(entry.refutation for entry in d)]
    if options.format == "json":
        import json

        _print(json.dumps([_refutations(derivation) for derivation in derivations], indent=2))
    else:
        from rodgen.symbolic import errata

        _print(errata(*derivations, form=options.format), end="")
    return OK


def _refutations(derivation: Derivation) -> dict[str, Any]:
    return {
        "source": derivation.source,
        "errata": [
            {
                "label": wrong.label,
                "id": entry.id,
                "place": entry.place,
                "origin": entry.origin,
                "words": entry.words,
                "claims": [str(claim) for claim in entry.claims],
                "because": wrong.because,
                "counterexample": {str(symbol): str(value) for symbol, value in wrong.counterexample},
                "there": [[str(left), str(right)] for left, right in wrong.values],
                "correction": [str(claim) for claim in wrong.correction],
            }
            for entry in derivation
            if (wrong := entry.refutation) is not None
        ],
    }


def _kernels(options: argparse.Namespace) -> int:
    from pathlib import Path

    from rodgen.codegen import KernelError
    from rodgen.codegen.project import check_kernels, write_kernels

    derivations = _loaded(options.derivation)
    folder = Path(options.output)
    own = options.derivation is None  # rodgen's own kernels are a NumPy extension, too
    try:
        if not options.check:
            for path in write_kernels(derivations, folder, extension=own):
                _print(str(path))
            return OK
        difference = check_kernels(derivations, folder, extension=own)
    except KernelError as error:
        raise RodgenError(f"{options.derivation}: {error}") from None
    except (OSError, UnicodeDecodeError) as error:
        if isinstance(error, BrokenPipeError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        file = getattr(error, "filename", None) or str(folder)
        raise InputFileError(file, "file", reason, "a folder for generated files") from None
    if not difference:
        return OK
    _print(difference, end="")
    command = " ".join(["rodgen kernels", *([options.derivation] if not own else []), "-o", options.output])
    print(f"{folder}: not what the derivations make; '{command}' writes it anew", file=sys.stderr)
    return FAILED


if __name__ == "__main__":
    sys.exit(main())
