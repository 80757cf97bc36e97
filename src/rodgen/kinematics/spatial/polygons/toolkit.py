"""The toolkit of equations of a spherical polygon, as text to read or print.

To solve a mechanism one picks, of all equations of its spherical polygon, those in the unknowns one wants. This is the
list: what the names mean, the laws of every kind with every shift of the subscripts, and the
secondary laws with lengths and offsets.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from rodgen.polygon_laws import FAMILIES, POLYGONS, HalfTangent, Law, laws
from rodgen.polygon_notation import Monomial

_NAMES = (
    ("X_j = s_ij s_j", "Xb_j = s_jk s_j"),
    ("Y_j = -(s_jk c_ij + c_jk s_ij c_j)", "Yb_j = -(s_ij c_jk + c_ij s_jk c_j)"),
    ("Z_j = c_jk c_ij - s_jk s_ij c_j", "Zb_j = Z_j"),
    ("U_ij = s_i s_ij", "V_ij = -(s_j c_i + c_j s_i c_ij)", "W_ij = c_j c_i - s_j s_i c_ij"),
)
_STEP = (
    ("X_ab = X_a c_b - Y_a s_b", "X*_ab = X_a s_b + Y_a c_b"),
    ("Y_ab = c_e X*_ab - s_e Z_a", "Z_ab = s_e X*_ab + c_e Z_a"),
)
_POLAR_STEP = (
    ("U_ab = U_a c_e - V_a s_e", "U*_ab = U_a s_e + V_a c_e"),
    ("V_ab = c_b U*_ab - s_b W_a", "W_ab = s_b U*_ab + c_b W_a"),
)
_SECONDARY = (
    ("X0_j = a_ij c_ij s_j + S_j s_ij c_j",),
    ("Y0_j = a_ij (s_jk s_ij - c_jk c_ij c_j) - a_jk Z_j + S_j c_jk X_j",),
    ("Z0_j = a_ij Yb_j + a_jk Y_j + S_j s_jk X_j",),
    ("X0_ab = X0_a c_b - Y0_a s_b - S_b X*_ab", "X*0_ab = X0_a s_b + Y0_a c_b + S_b X_ab"),
    ("Y0_ab = c_e X*0_ab - s_e Z0_a - a_e Z_ab", "Z0_ab = s_e X*0_ab + c_e Z0_a + a_e Y_ab"),
)
_WORDS = {
    "joints": "Joint {j} has the links {ij} before it and {jk} after it; {c_j}, {s_j} are of its angle, {c_ij}, {s_ij} "
    "of a twist. One subscript; with a bar, {Xb}, the twist after the joint takes the place of the one before:",
    "step": "More: {a} is the row so far, {b} the next joint, {e} its link on the side where the row goes on. Rows "
    "rise or fall by one, with 1 next to the last joint; a falling row begins with the bar, a rising one without:",
    "polar": "In {U}, {V}, {W} the link {e} is on the side where the row comes from; {U} and {U*} do without the angle "
    "of {b}:",
    "dual": "With the dual angles of a twist and its length {a}, an angle and its offset {S}, the index 0 marks dual "
    "parts:",
    "secondary": "Every law above holds with the index 0 on its names and the dual part of its right side; the "
    "fundamental ones are:",
}
"""What is in braces is a formula."""


def toolkit(n: int, form: Literal["text", "markdown", "latex"] = "text") -> str:
    """Return the equations of the closed spherical polygon of n joints.

    Parameters
    ----------
    n : int
        Number of joints, 3 (triangle) to 7 (heptagon).
    form : {"text", "markdown", "latex"}, optional
        Plain characters, Markdown with LaTeX formulas, or the body of a LaTeX document (with amsmath).

    Returns
    -------
    str
        The names, the laws and the secondary laws, ending in a line break.

    Raises
    ------
    ValueError
        For another n or form.

    Notes
    -----
    Lecture notes "Robot Geometry" after Crane and Duffy, "Spherical Mechanism Equation Toolkit"; every law is proved in
    the derivation ``spherical_polygons``, from the list that is printed here.

    Examples
    --------
    >>> from rodgen import spatial
    >>> text = spatial.toolkit(4)
    >>> print(text.splitlines()[0])
    Spherical quadrilateral: 104 equations
    >>> "X_32 = s41 s1" in text, "Z0_41 = -a23 s23" in text
    (True, True)
    """
    if n not in POLYGONS:
        raise ValueError(f"there is a toolkit for 3 to 7 joints, not for {n}")
    if form not in ("text", "markdown", "latex"):
        raise ValueError(f"form is {form!r}; expected 'text', 'markdown' or 'latex'")
    return "\n".join(_lines(n, _Plain() if form == "text" else _Typeset(form == "markdown"))) + "\n"


def _title(n: int) -> str:
    return f"Spherical {POLYGONS[n]}: {len(laws(n))} equations"


def _heading(family: str) -> str:
    kinds = "" if family == "half tangent" else " sine, sine-cosine and cosine"
    return f"{family.capitalize()}{kinds} laws"


def _grouped(n: int, family: str) -> Iterator[Sequence[Law | HalfTangent]]:
    """Yield the laws of a family, the three of one row of subscripts together."""
    found = [law for law in laws(n) if law.family == family]
    size = 1 if family == "half tangent" else 3
    for start in range(0, len(found), size):
        yield found[start : start + size]


def _secondary(n: int) -> Iterator[Sequence[str]]:
    """Yield the three secondary laws of each fundamental row, in plain characters."""
    for group in _grouped(n, "fundamental"):
        sine, other, cosine = (law for law in group if isinstance(law, Law))
        assert isinstance(sine.right, Monomial)
        (_, (_, i)), (_, (_, j)) = sine.right.factors
        e = f"{i}{i % n + 1}"
        first, second, third = (law.left.text().replace("_", "0_") for law in (sine, other, cosine))
        yield (
            f"{first} = a{e} c{e} s{j} + S{j} s{e} c{j}",
            f"{second} = a{e} c{e} c{j} - S{j} s{e} s{j}",
            f"{third} = -a{e} s{e}",
        )


def _lines(n: int, form: _Plain | _Typeset) -> Iterator[str]:
    """Yield the lines of the toolkit."""
    yield from (form.heading(_title(n), 1), "", form.words("joints"), "", form.given(_NAMES), "")
    yield from (
        form.words("step"),
        "",
        form.given(_STEP),
        "",
        form.words("polar"),
        "",
        form.given(_POLAR_STEP),
    )
    for family in FAMILIES:
        rows = [[form.law(law) for law in group] for group in _grouped(n, family)]
        if rows:
            yield from ("", form.heading(_heading(family), 2), "", form.display(rows))
    yield from ("", form.heading("Secondary laws", 2), "", form.words("dual"), "", form.given(_SECONDARY), "")
    yield from (form.words("secondary"), "", form.given(list(_secondary(n))))


class _Plain:
    """Plain characters."""

    def heading(self, text: str, level: int) -> str:
        return text

    def words(self, key: str) -> str:
        return textwrap.fill(re.sub(r"[{}]", "", _WORDS[key]), 110)

    def law(self, law: Law | HalfTangent) -> str:
        return law.text()

    def display(self, rows: Sequence[Sequence[str]]) -> str:
        """Return the rows in columns."""
        widths = [max(len(row[k]) for row in rows if k < len(row)) for k in range(max(map(len, rows)))]
        return "\n".join(
            "    " + "   ".join(text.ljust(width) for text, width in zip(row, widths, strict=False)).rstrip()
            for row in rows
        )

    given = display


@dataclass(frozen=True)
class _Typeset:
    """Markdown with LaTeX formulas, or the body of a LaTeX document."""

    markdown: bool

    def heading(self, text: str, level: int) -> str:
        return f"{'#' * level} {text}" if self.markdown else rf"\{'sub' * (level - 1)}section*{{{text}}}"

    def words(self, key: str) -> str:
        return re.sub(r"{(.*?)}", lambda found: f"${_latex(found[1])}$", _WORDS[key])

    def law(self, law: Law | HalfTangent) -> str:
        return law.latex()

    def display(self, rows: Sequence[Sequence[str]]) -> str:
        """Return the rows as an array of formulas in LaTeX."""
        body = " \\\\\n".join(" & ".join(row) for row in rows)
        opened, closed = ("$$", "$$") if self.markdown else (r"\[", r"\]")
        array = f"\\begin{{array}}{{{'l' * max(map(len, rows))}}}\n{body}\n\\end{{array}}"
        return f"{opened}\n{array}\n{closed}"

    def given(self, rows: Sequence[Sequence[str]]) -> str:
        """Return rows of formulas in plain characters as such an array."""
        return self.display([[_latex(formula) for formula in row] for row in rows])


def _latex(formula: str) -> str:
    """Return the LaTeX of a formula in plain characters."""

    def name(found: re.Match[str]) -> str:
        letter, mark, zero, row = found.groups()
        letter = rf"\bar{{{letter}}}" if mark == "b" else letter + "^*" * (mark == "*")
        return f"{letter}_{{{zero}{row}}}" if zero + row else letter

    return re.sub(r"([A-Zacs])([b*]?)(0?)_?([a-z0-9]*)", name, formula)
