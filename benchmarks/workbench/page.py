"""The part of the page on the workbench."""

from __future__ import annotations

from typing import Any

from report import table

BARS = {"first view": 2.0, "telescope, 1e5 rows": 1.0}
"""Wall time that is wanted, seconds, of any first view and of actions on a case."""
USUAL = 0.3
"""Of actions on all other cases."""


WORDS = """\
## The page of `rodgen open`

Wall times in headless Chromium ({browser}), without a graphics processor. The first view counts from
the start of the command, an action from the click. Both end when the last plot is painted. In brackets: the goal.
"""


def page(result: dict[str, Any]) -> str:
    """Return the table."""
    cases = result["cases"]
    body = [
        [what, *(f"{case[what]['wall']:.2f} s ({_goal(name, what):g} s)" for name, case in cases.items())]
        for what in next(iter(cases.values()))
    ]
    return "\n".join([WORDS.format(browser=result["browser"]), table(["", *cases], body)]) + "\n"


def _goal(case: str, what: str) -> float:
    return BARS.get("first view" if what.startswith("first view") else case, USUAL)
