"""What all commands share: how they take their options, where they print, how they show progress."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NoReturn, Protocol, TypeAlias

from rodgen.errors import InputFileError

__all__ = [
    "BAD_INPUT",
    "EXIT_CODES",
    "FAILED",
    "INTERRUPTED",
    "OK",
    "READER_GONE",
    "Command",
    "Parser",
    "UsageError",
    "adder",
    "fitting",
    "group",
    "reading",
    "show",
    "show_json",
    "tell",
    "working",
]

OK, FAILED, BAD_INPUT, INTERRUPTED, READER_GONE = 0, 1, 2, 130, 141

EXIT_CODES = """\
exit codes:
  0  done
  1  a check failed: a statement is not proved, generated files are stale, or a fit did not converge
  2  bad input: one line on standard error, FILE: PLACE: what was found; what was expected
  130  interrupted (Ctrl-C)
  141  whoever read the output closed it
"""

FitProgress: TypeAlias = Callable[[str, int, float], object]
ReadProgress: TypeAlias = Callable[[int | None, str], Callable[[int], object]]


# options -----------------------------------------------------------------------------------------------


class UsageError(Exception):
    """What was typed is no command."""


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line, and whose options may stand anywhere among the files."""

    _in_two_passes = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse options first, then the rest: else a file that may be left out would have to stand before them."""
        if self._in_two_passes or self._subparsers is not None:
            return super().parse_known_args(args, namespace)
        self._in_two_passes = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._in_two_passes = False

    def error(self, message: str) -> NoReturn:
        """Complain."""
        raise UsageError(
            InputFileError("command line", self.prog, message, f"what '{self.prog} --help' shows")
        )


class Command(Protocol):
    """Adds a command: its name, what runs it, its summary and its text."""

    def __call__(
        self, name: str, run: Callable[[argparse.Namespace], int], summary: str, text: str
    ) -> argparse.ArgumentParser:
        """Return its parser, for its options."""


def adder(commands: Any) -> Command:
    """Return what adds commands to the place for them that a parser has made."""

    def command(
        name: str, run: Callable[[argparse.Namespace], int], summary: str, text: str
    ) -> argparse.ArgumentParser:
        made: argparse.ArgumentParser = commands.add_parser(
            name,
            help=summary,
            description=text,
            epilog=EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        made.set_defaults(run=run)
        return made

    return command


def group(command: Command, name: str, summary: str, text: str) -> Command:
    """Add a command that has commands of its own; return what adds these.

    Parameters
    ----------
    command : Command
        What adds the group.
    name, summary, text : str
        As for a command.
    """

    def incomplete(options: argparse.Namespace) -> int:
        raise UsageError(f"rodgen {name} needs one of its commands; see 'rodgen {name} --help'")

    parser = command(name, incomplete, summary, text)
    members = parser.add_subparsers(metavar="COMMAND", required=True)

    return adder(members)


# output ------------------------------------------------------------------------------------------------


def show(text: str, end: str = "\n") -> None:
    """Print to standard output, and say in one sentence when that cannot be done."""
    if sys.stdout is None:
        raise InputFileError("standard output", "file", "closed", "an open standard output")
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except UnicodeEncodeError:  # a terminal without Greek letters and degree signs
        encoding = sys.stdout.encoding
        print(text.encode(encoding, "replace").decode(encoding), end=end, flush=True)
    except OSError as error:
        raise InputFileError(
            "standard output", "file", f"cannot be written ({error.strerror})", "a writable place with room"
        ) from None


def show_json(data: Any) -> None:
    """Print data as JSON; what is no finite number becomes null."""
    import json

    show(json.dumps(_plain(data), indent=2, allow_nan=False))


def _plain(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, Sequence) and not isinstance(data, str):
        return [_plain(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


def tell(text: str) -> None:
    """Print a remark to standard error, where there is one."""
    if sys.stderr is not None:
        print(text, file=sys.stderr)


# progress ----------------------------------------------------------------------------------------------


def _is_watched() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


def reading(stack: contextlib.ExitStack) -> ReadProgress | None:
    """Make a progress bar of what is read, where somebody looks: it shows itself after a second."""
    if not _is_watched():
        return None

    def start(total: int | None, unit: str) -> Callable[[int], object]:
        from tqdm import tqdm

        bar = tqdm(total=total, unit=unit, unit_scale=True, delay=1, leave=False, file=sys.stderr)
        stack.callback(bar.close)
        update: Callable[[int], object] = bar.update
        return update

    return start


@contextlib.contextmanager
def working(what: str) -> Iterator[Callable[[str], object] | None]:
    """Show what is done, and how long it has taken, where somebody looks."""
    if not _is_watched():
        yield None
        return
    from tqdm import tqdm

    line = "{desc}  {elapsed}"
    with tqdm(desc=what, bar_format=line, leave=False, file=sys.stderr) as bar:

        def told(what: str) -> None:
            bar.set_description_str(what, refresh=False)
            bar.update()

        yield told


@contextlib.contextmanager
def fitting() -> Iterator[FitProgress | None]:
    """Show what a fit does, where somebody looks."""
    with working("making the model") as told:
        yield None if told is None else lambda what, iteration, _: told(f"{what}, iteration {iteration}")
