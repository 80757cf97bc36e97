"""Run the command line: parse it, run the command, and report an error in one line.

The commands are the other modules of :mod:`rodgen.cli`. What a command needs is imported when it runs, so that
``rodgen --help`` and ``rodgen apply`` never wait for SymPy.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from glob import glob
from importlib import import_module
from typing import Any, NoReturn

from rodgen.cli._console import (
    BAD_INPUT,
    DEBUG,
    EXIT_CODES,
    FAILED,
    INTERNAL,
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    READER_GONE,
    TERMINATED,
    Parser,
    UsageError,
    adder,
    notify,
    refused,
    show,
)
from rodgen.cli._progress import Display, display
from rodgen.cli._values import EditedMachine, InputFile, OutputFile, OutputFolder, OutputTable, StateFile
from rodgen.errors import MOST_NAMES, InputFileError, NotConvergedError, RodgenError, UnprovedError
from rodgen.files import OutputSet
from rodgen.stages import listening

__all__ = ["main"]

_GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "from measurements to a corrected machine": {
        "fit": ("fit", "fit a machine to measurements"),
        "compare": ("fit", "what the error of a machine's model depends on"),
        "diagnose": ("diagnose", "which physical effect a machine's model misses"),
        "emit": (
            "emit",
            "a fitted machine as C, C++, MATLAB, NumPy or JAX code, URDF, DH or TPOINT model, or tables of its errors",
        ),
        "report": ("report", "the diagnosis of a machine as one page"),
    },
    "the same, on a page": {"open": ("open", "a page on which effects are added and the error falls")},
    "many machines": {"fleet": ("fleet", "many machines: which effects are common, which machines odd")},
    "a machine file to begin with": {
        "new": ("new", "a machine file with comments to begin with"),
        "import": ("imports", "make a machine file of other files"),
    },
    "more about a machine": {
        "check": ("check", "whether a machine file and its data can be right"),
        "plan": ("plan", "what to measure next"),
        "predict": ("predict", "positions of a fitted machine at other commands, with uncertainty"),
        "watch": ("watch", "new readings: has the machine changed?"),
        "add": ("edit", "add effects to a machine, and see the error fall"),
        "remove": ("edit", "remove an effect from a machine"),
        "set": ("edit", "say what is known of a parameter, or tie it to others"),
        "exclude": ("edit", "exclude rows of measurements, or let them count again"),
        "simulate": ("simulate", "simulated measurements with a hidden effect"),
        "effects": ("effects", "the catalogue of effects"),
    },
    "functions of arrays, on tables": {
        "apply": ("apply", "a function on the rows of a table"),
        "fit-axis": ("axis", "one axis from pairs of points, or from poses"),
        "mechanism": ("mechanisms", "forward and reverse analysis of robots and loops"),
    },
    "equations": {
        "derive": ("derivations", "run a derivation and print its report"),
        "kernels": ("derivations", "generate code from a derivation"),
    },
    "the installation": {
        "doctor": ("doctor", "what rodgen runs on here, and what is broken"),
        "completion": ("doctor", "let the shell complete commands and options"),
    },
}
"""Commands by subject, as ``rodgen --help`` shows them: the module that adds each, and what it does.

The first group has the steps of ``make demo``. A module is imported only where one of its commands is called.
"""
_COMMANDS = {name: of for group in _GROUPS.values() for name, of in group.items()}

_ENDING = [signal.SIGTERM, *([signal.SIGHUP] if sys.platform != "win32" else [])]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments after ``rodgen``; default: ``sys.argv[1:]``.

    Returns
    -------
    int
        The exit code.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    called = next((argument for argument in words if not argument.startswith("-")), "")
    outputs = OutputSet()
    completed = outputs.completed
    options = argparse.Namespace(debug=DEBUG in words)
    if arguments is None:
        for ending in _ENDING:
            if signal.getsignal(ending) is signal.SIG_DFL:  # nohup ignores SIGHUP
                signal.signal(ending, _terminate)
    try:
        with outputs, display() as progress, _one_line_warnings(progress):
            try:
                options = _parser(called).parse_args(words)
            except SystemExit:  # --help and --version
                show("", end="")
                return OK
            _claim(outputs, options)
            with listening(*filter(None, [progress])), _scheduled(options):
                code: int = options.run(options)
            return code
    except UsageError as error:
        notify(str(error))
        return BAD_INPUT
    except BrokenPipeError:
        # The reader of the output has closed it. Buffered output must not raise again at exit.
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return READER_GONE
    except KeyboardInterrupt as error:
        if arguments is None:  # the process ends now; a second Ctrl-C would only show where
            for ending in (signal.SIGINT, *_ENDING):
                signal.signal(ending, signal.SIG_IGN)
        terminated = isinstance(error, _TerminatedError)
        how = "ended by a signal" if terminated else "interrupted"
        notify(f"rodgen: {how}; {_complete(completed) or 'no file was written'}")
        return TERMINATED if terminated else INTERRUPTED
    except ModuleNotFoundError as error:
        from rodgen.installation import EXTRAS

        extra = EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            return _internal_error(error, called, options.debug, completed)
        found, expected = f"no module {error.name!r}", f"it: pip install 'rodgen[{extra}]'"
        notify(str(refused(called, found, expected)))
        return BAD_INPUT
    except RodgenError as error:
        notify("; ".join(filter(None, [str(error), _of_other_form(error, options), _complete(completed)])))
        if isinstance(error, InputFileError) and error.file == "standard output":
            # Closed here, because the interpreter would try, and complain, once more at the exit.
            with contextlib.suppress(OSError, AttributeError):
                sys.stdout.close()
        if isinstance(error, NotConvergedError):
            return NOT_CONVERGED
        return FAILED if isinstance(error, UnprovedError) else BAD_INPUT
    except Exception as error:
        return _internal_error(error, called, options.debug, completed)


def _claim(outputs: OutputSet, options: argparse.Namespace) -> None:
    """Refuse outputs that are inputs, or cannot be written, before the command begins."""
    values = [
        each for value in vars(options).values() for each in (value if isinstance(value, list) else [value])
    ]
    for value in values:
        if isinstance(value, InputFile):
            for file in ["/dev/stdin" if value == "-" else value, *glob(value, recursive=True)]:
                outputs.protect(file)
        elif isinstance(value, EditedMachine) and os.path.realpath(value) == os.path.realpath(
            options.machine
        ):
            outputs.allow(value)
    for value in values:
        if isinstance(value, OutputTable) and value == "-":
            continue
        if isinstance(value, OutputFile | OutputFolder):
            outputs.claim(value, folder=isinstance(value, OutputFolder))
        if isinstance(value, StateFile):
            outputs.allow(value)


class _TerminatedError(KeyboardInterrupt):
    """SIGTERM or a terminal that is closed, which end a command as Ctrl-C does: temporary files are removed."""


def _scheduled(options: argparse.Namespace) -> contextlib.AbstractContextManager[object]:
    """Return a context in which tasks run where --scheduler says."""
    where = getattr(options, "scheduler", None)
    if where is None:
        return contextlib.nullcontext()
    from rodgen.schedulers import workers

    return workers(where)


def _terminate(*_: object) -> NoReturn:
    raise _TerminatedError


def _of_other_form(error: RodgenError, options: argparse.Namespace) -> str:
    """Return how to use a file of MACHINE or DATA that other programs have written; empty of other errors."""
    if not isinstance(error, InputFileError) or not re.match(r"line 1\b|header", error.place):
        return ""
    machine, data = getattr(options, "machine", None), getattr(options, "data", None)
    foreign = error.file == data or (error.file == machine and not error.file.endswith(".toml"))
    return "'rodgen import' reads files of other programs" if foreign else ""


def _complete(completed: Sequence[str]) -> str:
    """Return which files are complete, for the end of a line; empty where none is."""
    files = [file for file in dict.fromkeys(completed) if os.path.exists(file)]
    if len(files) > MOST_NAMES + 1:  # of a fleet
        files[MOST_NAMES:] = [f"{len(files) - MOST_NAMES} more"]
    return f"complete: {', '.join(files)}" if files else ""


def _internal_error(error: Exception, called: str, debug: bool, completed: Sequence[str]) -> int:
    """Report an error that rodgen does not expect, on one line, and return the exit code; raise it to debug."""
    if debug:
        raise error
    command = f"rodgen {called}".rstrip()
    if isinstance(error, MemoryError):
        reason = "out of memory; give it fewer rows or columns, or more memory"
    else:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        reason = f"an error in rodgen itself: {what}; please report it, with its files and what {DEBUG} shows"
    notify("; ".join(filter(None, [f"{command}: {reason}", _complete(completed)])))
    return INTERNAL


@contextlib.contextmanager
def _one_line_warnings(progress: Display | None) -> Iterator[None]:
    """Show each warning once, on one line of its own, and never as an error.

    Warnings for developers are hidden, as Python does.
    """
    reported: set[str] = set()

    def shown(message: Warning | str, *_: Any, **__: Any) -> None:
        text = " ".join(str(message).split())
        if text not in reported:
            reported.add(text)
            if progress:
                progress.clear()
            notify(f"rodgen: warning: {text}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for category in (UserWarning, RuntimeWarning):
            warnings.simplefilter("always", category)
        warnings.showwarning = shown
        yield


# options -----------------------------------------------------------------------------------------------


class _GroupedParser(Parser):
    """A parser whose help lists its commands by subject."""

    def format_help(self) -> str:
        """Return the help as argparse arranges it, with a heading for each group of commands."""
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        options = [action for action in self._actions if action.option_strings]
        (commands,) = (action for action in self._actions if not action.option_strings)
        listed = {action.dest: action for action in commands._get_subactions()}  # type: ignore[attr-defined]
        groups = {title: [listed[name] for name in names] for title, names in _GROUPS.items()}
        for title, actions in {**groups, "options": options}.items():
            formatter.start_section(title)
            formatter.add_arguments(actions)
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        show(f"rodgen {version('rodgen')}")
        parser.exit()


def _parser(called: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command that is called, or of all where None is; of others it has the names alone."""
    parser = _GroupedParser(
        prog="rodgen",
        description="Kinematics and calibration of machines: proved equations, generated code, and diagnosis of errors "
        "from measurements.\n\nrodgen COMMAND --help explains a command.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", nargs=0, action=_Version, help="print the version and exit")
    parser.add_argument(DEBUG, action="store_true", help="after an error in rodgen itself, show where it was")
    commands = parser.add_subparsers(metavar="COMMAND", parser_class=Parser)
    command = adder(commands, {name: summary for name, (_, summary) in _COMMANDS.items()})
    every = called in (None, "completion")  # it describes all
    for module in dict.fromkeys(of for name, (of, _) in _COMMANDS.items() if every or name == called):
        import_module(f"rodgen.cli.{module}").add_to(command)
    for name, (_, summary) in _COMMANDS.items():
        if name not in commands.choices:
            commands.add_parser(name, help=summary)
    missing = "the following arguments are required: COMMAND"  # said after what is unknown
    parser.set_defaults(parser=parser, run=lambda _: parser.error(missing))
    return parser


if __name__ == "__main__":
    sys.exit(main())
