"""``rodgen completion``: a script that lets the shell complete commands, options and file names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rodgen.cli._console import OK, Command, show

_COMPLETION = """\
Print a script that lets the shell complete the commands of rodgen, their options, and file names.

  bash   rodgen completion bash > ~/.local/share/bash-completion/completions/rodgen
  zsh    rodgen completion zsh > DIR/_rodgen, where DIR is a folder in $fpath
  fish   rodgen completion fish > ~/.config/fish/completions/rodgen.fish

It takes effect in a new shell. Print it again after an update of rodgen.
"""

_SHELLS = ("bash", "zsh", "fish")


def add_to(command: Command) -> None:
    """Add the command."""
    completion = command("completion", _run, "let the shell complete commands and options", _COMPLETION)
    completion.add_argument("shell", metavar="SHELL", choices=_SHELLS, help="bash, zsh or fish")


def _run(options: argparse.Namespace) -> int:
    import shtab

    for action in _actions(options.parser):
        if action.choices is None and action.nargs != 0:
            # A value is completed as a file name unless there is a fixed choice, as shells do by default.
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    show(shtab.complete(options.parser, options.shell))
    return OK


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the options and arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for member in action.choices.values():
                yield from _actions(member)
