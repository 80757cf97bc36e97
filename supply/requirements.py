"""Print what extras of this project need, a line each: pip installs these while the extension is compiled."""

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def requirements(extra: str) -> Iterator[str]:
    """Yield the requirements of an extra, those of the extras that it names among them."""
    for requirement in PROJECT["optional-dependencies"][extra]:
        of_this_project = re.fullmatch(r"rodgen\[(.*)\]", requirement)
        if of_this_project:
            for name in of_this_project[1].split(","):
                yield from requirements(name)
        else:
            yield requirement


print(
    *dict.fromkeys(
        [*PROJECT["dependencies"], *(each for extra in sys.argv[1:] for each in requirements(extra))]
    ),
    sep="\n",
)
