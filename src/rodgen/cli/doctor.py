"""``rodgen doctor`` and ``completion``: what this installation runs on, and a script that completes its commands."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rodgen.cli._console import FAILED, OK, Command, argument, show, show_result
from rodgen.cli._machine import JSON
from rodgen.installation import document, examine

_DOCTOR = """\
Show what this installation runs on, for a report of a fault: versions, kernels, the C compiler for models that are made
at run time, their cache, threads, and the browser that draws images. The exit code is 1 if the compiled kernels do not
load, the compiler fails, or the cache cannot be used. Without compiled kernels or a compiler rodgen runs on NumPy.
"""


def add_to(command: Command) -> None:
    """Add the commands."""
    command("doctor", _run, _DOCTOR, JSON)
    command("completion", _complete, _COMPLETION, argument("SHELL", "bash, zsh or fish", choices=_SHELLS))


def _run(options: argparse.Namespace) -> int:
    report = examine()
    show_result(options, lambda: report, lambda: str(document(report)))
    return FAILED if report["problems"] else OK


# completion --------------------------------------------------------------------------------------------------------

_COMPLETION = """\
Print a script that lets the shell complete the commands of rodgen, their options, and file names.

  bash   rodgen completion bash > ~/.local/share/bash-completion/completions/rodgen
  zsh    rodgen completion zsh > DIR/_rodgen, where DIR is a folder in $fpath
  fish   rodgen completion fish > ~/.config/fish/completions/rodgen.fish

It takes effect in a new shell. Print it again after an update of rodgen.
"""

_SHELLS = ("bash", "zsh", "fish")


def _complete(options: argparse.Namespace) -> int:
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
