"""Add commands and their options to the parser, and print."""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NoReturn, Protocol

from rodgen.errors import InputFileError, RodgenError, UnfitArgumentError, nearest_hint, shown
from rodgen.files import publish_outputs, unwritable
from rodgen.stages import stage

DEBUG = "--debug"
OK, FAILED, BAD_INPUT, NOT_CONVERGED, INTERNAL = 0, 1, 2, 3, 70
INTERRUPTED, READER_GONE, TERMINATED = 130, 141, 143

EXIT_CODES = """\
exit codes:
  0  done
  1  a check failed: a statement is not proved, generated files are stale, a file is wrong, a fleet or a watch has an
     alarm, or the installation is broken
  2  bad input: one line on standard error, FILE: PLACE: what was found; what was expected
  3  a fit did not converge: the numbers are where it stopped; or pairs of points do not determine their axis
  70  an error in rodgen itself: one line on standard error; with --debug, where
  130  interrupted (Ctrl-C)
  141  the reader of the output closed it
  143  ended by SIGTERM or SIGHUP
"""

# control characters but tab and line feed, and those that turn the direction of writing
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def after_fits(converged: bool) -> int:
    """Return the exit code of a command that fits, and say so where a fit did not converge."""
    if converged:
        return OK
    notify("rodgen: the fit did not converge; the numbers are where it stopped, not an optimum")
    return NOT_CONVERGED


# options -----------------------------------------------------------------------------------------------


def refused(option: str, found: str, expected: str) -> InputFileError:
    """Return the error of an option: what was found, and what was expected."""
    return InputFileError("command line", option, found, expected)


@contextlib.contextmanager
def arguments_as_options() -> Iterator[None]:
    """Name the option of an argument that a function refuses in the block."""
    try:
        yield
    except UnfitArgumentError as error:
        raise refused(f"--{error.key}", error.found, error.expected) from None


class UsageError(Exception):
    """The command line is not a command."""


class Parser(argparse.ArgumentParser):
    """A parser whose error messages are one line, and which takes options anywhere among the files."""

    _in_two_passes = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the options first: else an optional file would have to come before them."""
        if self._in_two_passes or self._subparsers is not None:
            return super().parse_known_args(args, namespace)
        self._in_two_passes = True
        try:
            namespace_read, unknown = self.parse_known_intermixed_args(self._joined(args), namespace)
        finally:
            self._in_two_passes = False
        if unknown:  # said here, where the options are known: else the parser of all commands says it
            options = {name: name for action in self._actions for name in action.option_strings}
            hint = nearest_hint(unknown[0].partition("=")[0], options)
            self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
        return namespace_read, unknown

    def _joined(self, arguments: Sequence[str]) -> list[str]:
        """Join ``--point -1,2,3`` with an equals sign: argparse takes "-1,2,3", a value, for an option."""
        joined: list[str] = []
        for argument in arguments:
            action = self._option_string_actions.get(joined[-1]) if joined else None
            takes_text = action is not None and action.nargs is None and not isinstance(action.type, type)
            if takes_text and re.match("-[^-]", argument) and argument not in self._option_string_actions:
                joined[-1] += f"={argument}"
            else:
                joined.append(argument)
        return joined

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a misspelt choice with the nearest one, others with all."""
        choices = {str(choice): str(choice) for choice in action.choices or ()}
        if str(value) not in choices and (hint := nearest_hint(str(value), choices)):
            raise argparse.ArgumentError(action, f"invalid choice: {shown(value)}{hint}")
        super()._check_value(action, value)

    def error(self, message: str) -> NoReturn:
        """Raise the message as a `UsageError`."""
        raise UsageError(refused(self.prog, message, f"what '{self.prog} --help' shows"))


class Option:
    """An option or an argument of commands: its names, and what `argparse` shall know of it."""

    def __init__(self, *names: str, **how: Any) -> None:
        self.names, self.how = names, how

    def add_to(self, parser: argparse._ActionsContainer) -> None:
        """Add it to the parser of a command."""
        parser.add_argument(*self.names, **self.how)


class OneOf:
    """Options that exclude each other."""

    def __init__(self, *options: Option, required: bool = False) -> None:
        self.options, self.required = options, required

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Add them to the parser of a command."""
        group = parser.add_mutually_exclusive_group(required=self.required)
        for each in self.options:
            each.add_to(group)


def argument(metavar: str, about: str, kind: Any = None, **how: Any) -> Option:
    """Return an argument, whose value is an attribute of its name in small letters, read by `kind`."""
    name = how.pop("dest", metavar.partition(" ")[0].lower())
    return Option(name, metavar=metavar, help=about, type=kind, **how)


def option(usage: str, about: str, kind: Any = None, **how: Any) -> Option:
    """Return an option with a value, read by `kind`; `usage` is as in ``-o --output FILE``."""
    *names, metavar = usage.split()
    return Option(*names, metavar=metavar, help=about, type=kind, **how)


def repeated(usage: str, about: str, kind: Any = None, **how: Any) -> Option:
    """Return an option that may be given several times; its value is a list."""
    return option(usage, about, kind, action="append", default=[], **how)


def choice(name: str, choices: Iterable[Any], about: str, **how: Any) -> Option:
    """Return an option with a fixed choice."""
    return Option(name, choices=tuple(choices), help=about, **how)


def flag(name: str, about: str) -> Option:
    """Return an option without a value."""
    return Option(name, action="store_true", help=about)


class Command(Protocol):
    """Add a command, given its name, the function that runs it, its text, its options, and what is not so."""

    def __call__(
        self,
        name: str,
        run: Callable[[argparse.Namespace], int],
        text: str,
        *options: Option | OneOf,
        **how: Any,
    ) -> argparse.ArgumentParser:
        """Return the parser of the command."""


def adder(commands: Any, summaries: Mapping[str, str]) -> Command:
    """Return the function that adds commands to a parser's subparsers."""

    def command(
        name: str, run: Callable[[argparse.Namespace], int], text: str, *options: Option | OneOf, **how: Any
    ) -> argparse.ArgumentParser:
        parser: argparse.ArgumentParser = commands.add_parser(
            name, help=summaries[name], description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        parser.add_argument(DEBUG, action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        for each in options:
            each.add_to(parser)
        parser.set_defaults(run=run, **how)
        return parser

    return command


def group(command: Command, name: str, text: str, summaries: Mapping[str, str]) -> Command:
    """Add a command that has subcommands, with what each does; return the function that adds these."""

    def incomplete(options: argparse.Namespace) -> int:
        raise UsageError(f"rodgen {name} needs one of its commands; see 'rodgen {name} --help'")

    members = command(name, incomplete, text).add_subparsers(metavar="COMMAND", required=True)
    return adder(members, summaries)


@contextlib.contextmanager
def located(file: str, place: str, expected: str = "") -> Iterator[None]:
    """Raise a RodgenError of the block as one about a place in a file, or an option of the command line.

    Parameters
    ----------
    file, place : str
        As in `InputFileError`.
    expected : str
        Used when the error does not name what was expected; when this is empty too, the error passes unchanged.
    """
    try:
        yield
    except InputFileError:
        raise
    except (RodgenError, ValueError) as error:
        found, _, wanted = str(error).partition("; expected ")
        if not wanted and not expected:
            raise
        raise InputFileError(file, place, found, wanted or expected) from None


# output ------------------------------------------------------------------------------------------------


def show(text: str, end: str = "\n") -> None:
    """Print to standard output; a failure is an `InputFileError`."""
    publish_outputs()  # before the reader of standard output may leave
    if sys.stdout is None:
        raise InputFileError("standard output", "file", "closed", "an open standard output")
    text = _harmless(text)
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except UnicodeEncodeError:  # a terminal without Greek letters and degree signs
        encoding = sys.stdout.encoding
        print(text.encode(encoding, "replace").decode(encoding), end=end, flush=True)
    except OSError as error:
        raise unwritable("standard output", error) from None


def show_json(data: Any, *, indent: int | None = 2) -> None:
    """Print data as JSON, with null for a number that is not finite; on one line where `indent` is None."""
    from rodgen.views import to_json

    show(to_json(data, indent=indent, only_ascii=True))


def show_result(options: argparse.Namespace, data: Callable[[], Any], text: Callable[[], str]) -> None:
    """Print a result as JSON where --json was given, else as text."""
    with stage("writing the answer"):
        content: Any = data() if options.json else text()
    if options.json:
        show_json(content)
    else:
        show(content)


def _harmless(text: str) -> str:
    """Return a text in which characters that a terminal obeys, such as those of a name in a file, are written out."""
    return _OBEYED.sub(lambda match: ascii(match[0])[1:-1], text)


def notify(text: str) -> None:
    """Print a remark to standard error, if the process has one."""
    if sys.stderr is not None:
        print(_harmless(text), file=sys.stderr)


def conclude(text: str) -> None:
    """Give outputs their names, and say on standard error what they are."""
    publish_outputs()
    notify(text)
