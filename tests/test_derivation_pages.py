"""Every page of a derivation: all proofs show their steps, and formulas fit into lines."""

import re

import pytest

from conftest import group_of
from rodgen.codegen.scripts import load_derivation, packaged_derivations
from rodgen.symbolic._latex import rendered_width
from rodgen.symbolic.display import LINES, WIDTH

QUICK = {"axis_fit", "instantaneous_euler_inverse", "rotations", "trig_equation"}
"""Of these all proofs and their pages take a second each."""
NAMES = [
    pytest.param(
        name, marks=[pytest.mark.xdist_group(group_of(name)), *([] if name in QUICK else [pytest.mark.slow])]
    )
    for name in packaged_derivations()
]


def formulas(page):
    displayed = re.findall(r"\$\$(.*?)\$\$", page, re.DOTALL)
    inline = re.findall(r"\$([^$\n]+)\$", re.sub(r"\$\$.*?\$\$", "", page, flags=re.DOTALL))
    return displayed, inline


@pytest.mark.thorough("trig_equation")
@pytest.mark.parametrize("name", NAMES)
def test_pages_show_steps_and_are_typeset(name):
    derivation = load_derivation(name)
    assert derivation.undeclared() == []
    derivation._repr_markdown_()
    for entry in derivation:
        page = entry._repr_markdown_()
        assert f"**{entry.id}**" in page
        assert "*Proof.*" in page
        assert page.index("$$") < page.index("*Proof.*")
        assert not re.search(r"\n\n(\n|$)", page)
        displayed, inline = formulas(page)
        assert displayed
        for formula in [*displayed, *inline]:
            assert formula.count("{") == formula.count("}")
        for formula in displayed:
            if "matrix" not in formula:  # a matrix of many columns cannot be broken
                lines = formula.split(r" \\ ")
                assert max(map(rendered_width, lines)) <= 1.4 * WIDTH
                assert len(lines) <= 4 * LINES
        assert len(entry.steps().splitlines()) > 2
