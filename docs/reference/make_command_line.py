"""Write the tables of docs/reference/command_line.md that are made from the commands: ``python docs/reference/make_command_line.py``.

`make check` fails where the page has others.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from rodgen.cli.main import _GROUPS, _parser

PAGE = Path(__file__).parent / "command_line.md"


def members(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The commands of a parser, by name."""
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(groups[0].choices) if groups else {}


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def usage(parser: argparse.ArgumentParser) -> str:
    """A command with its arguments, and the options without which it does nothing."""
    words = " ".join(parser.format_usage().removeprefix("usage: ").split())
    while (less := re.sub(r" \[-[^][]*(\[[^][]*\][^][]*)*\]", "", words)) != words:
        words = less
    return re.sub(r"{(\w+),[^}]*}", r"\1", words)


def commands() -> Iterator[str]:
    """The commands by subject."""
    parsers = members(_parser())
    yield from ("| command | |", "| --- | --- |")
    for title, group in _GROUPS.items():
        yield f"| **{title}** | |"
        yield from (f"| `{cell(usage(parsers[name]))}` | {summary} |" for name, (_, summary) in group.items())


def called(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, str, str]]:
    """Command, option and text of each option."""
    for member, below in members(parser).items():
        yield from called(below, f"{name} {member}".strip())
    for each in parser._actions if name else ():
        if each.option_strings and each.help != argparse.SUPPRESS and "--help" not in each.option_strings:
            value = "" if each.nargs == 0 else f" {each.metavar or '|'.join(map(str, each.choices or ()))}"
            yield name, ", ".join(each.option_strings) + value, (each.help or "") % vars(each)


def options() -> Iterator[str]:
    """The options, those first that more than two commands have."""
    owners: dict[tuple[str, str], list[str]] = {}
    for name, option, about in called(_parser()):
        owners.setdefault((option, about), []).append(name)
    yield from ("| of | option | |", "| --- | --- | --- |")
    for (option, about), names in sorted(owners.items(), key=lambda one: len(one[1]) < 3):
        yield f"| {', '.join(names)} | `{cell(option)}` | {cell(about)} |"


def made(page: str) -> str:
    """The page with its tables made anew."""
    for name, lines in (("commands", commands()), ("options", options())):
        start, end = f"<!-- {name}: made by make_command_line.py -->", f"<!-- end of {name} -->"
        before, _, rest = page.partition(start)
        page = "\n".join([f"{before}{start}", "", *lines, "", end]) + rest.partition(end)[2]
    return page


if __name__ == "__main__":
    PAGE.write_text(made(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
