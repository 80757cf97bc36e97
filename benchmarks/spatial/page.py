"""The equations' part of the page."""

from __future__ import annotations

WORDS = """\
## Equations of spatial mechanisms

The hand-written pairs of equations do not polish or prove anything, return no status, and decide by a fixed threshold
which roots are real. The arithmetic limit is two arc tangents and a root, compiled with `-ffast-math`.
"""


def page(result: dict) -> str:
    lines = [WORDS]
    for title, key in (("A cos θ + B sin θ + D = 0", "trig"), ("two equations in two angles", "pair")):
        lines += [f"| {title} | ns each | spread | ratio |", "| --- | ---: | ---: | ---: |"]
        for row in result[key]["rows"]:
            name = f"**{row['name']}**" if row["name"].startswith("rodgen") else row["name"]
            lines.append(f"| {name} | {row['ns']:,.1f} | {row['spread']:.0%} | {row['ratio']:,.2f} |")
        lines.append("")
    names = {
        "by_eigenvalues": "NumPy's eigenvalues",
        "by_pencils": "SciPy's",
        "by_roots": "the octic's roots",
    }
    same = ", ".join(f"{text} in {result['pair']['same'][name]:.1%}" for name, text in names.items())
    return "\n".join([*lines, f"As many solutions as rodgen: {same} of the pairs."]) + "\n"
