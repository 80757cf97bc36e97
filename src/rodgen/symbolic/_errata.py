"""Errata of a source: the refuted entries of its derivation."""

from __future__ import annotations

import textwrap
from typing import Literal

import sympy as sp

from rodgen.symbolic.derivation import Derivation, Entry, Refutation
from rodgen.symbolic.display import plain

NOTHING = "Nothing is refuted."


def errata(*derivations: Derivation, form: Literal["text", "markdown"] = "text") -> str:
    """Return a list of the refuted entries: the claim, what is wrong, counterexample, correction.

    Each claim is marked: *printed* is a formula of the source, *said* are its words (with what they mean as
    a formula), and *tacit* is a hypothesis that the source needs and does not state.

    Parameters
    ----------
    *derivations : Derivation
        Whose errata to list.
    form : {"text", "markdown"}, optional
        Plain text for a terminal, or Markdown with LaTeX.

    Returns
    -------
    str
        The list, ending in a line break. It depends on the derivations alone.

    Examples
    --------
    >>> import sympy as sp
    >>> from rodgen.symbolic import Derivation
    >>> d = Derivation("square", title="A square", source="A pamphlet")
    >>> x = d.symbol("x", "x", "side", "m")
    >>> claim = d.state("area", sp.Eq((x + 1) ** 2, x**2 + 1), place="p. 1")
    >>> _ = claim.refute({x: 1}, sp.Eq((x + 1) ** 2, x**2 + 2*x + 1), because="2x is lost.", label="S1")
    >>> print(errata(d))
    A pamphlet
    <BLANKLINE>
    S1  area (p. 1)
        printed:  (x + 1)**2 = x**2 + 1
        wrong:    2x is lost.
        at:       x = 1
        there:    4 is not 2
        right:    (x + 1)**2 = x**2 + 2*x + 1
    <BLANKLINE>
    """
    write = {"text": _text, "markdown": _markdown}[form]
    return "\n".join(write(derivation) for derivation in derivations)


def _refuted(derivation: Derivation) -> list[tuple[Entry, Refutation]]:
    refuted = [(entry, entry.refutation) for entry in derivation if entry.refutation is not None]
    return sorted(refuted, key=lambda pair: _number_in(pair[1].label))


def _number_in(label: str) -> tuple[str, int]:
    digits = "".join(filter(str.isdigit, label))
    return label.removesuffix(digits), int(digits or 0)


def _text(derivation: Derivation) -> str:
    lines = [derivation.source, ""]
    refuted = _refuted(derivation)
    if not refuted:
        lines += [NOTHING, ""]
    for entry, wrong in refuted:
        lines.append(f"{wrong.label:3} {entry.id}" + (f" ({entry.place})" if entry.place else ""))
        rows = [("said", f"“{entry.words}”")] if entry.words else []
        written = "meaning" if entry.words else entry.origin
        rows += [(written, plain(claim)) for claim in entry.claims]
        rows.append(("wrong", wrong.because))
        rows.append(("at", ", ".join(f"{symbol} = {plain(v)}" for symbol, v in wrong.counterexample)))
        rows += [("there", _there(left, right)) for left, right in wrong.values]
        rows += [("right", plain(claim)) for claim in wrong.correction]
        for name, content in rows:
            text = f"    {name + ':':9} {content}"
            lines += textwrap.wrap(text, 108, subsequent_indent=" " * 14, break_long_words=False)
        lines.append("")
    return "\n".join(lines)


def _there(left: sp.Basic, right: sp.Basic) -> str:
    return "this is false" if right is sp.false else f"{plain(left)} is not {plain(right)}"


def _markdown(derivation: Derivation) -> str:
    lines = [f"# Errata: {derivation.source}", ""]
    refuted = _refuted(derivation)
    if not refuted:
        lines += [NOTHING, ""]
    for entry, wrong in refuted:
        heading = f"{wrong.label}. {entry.id}" if wrong.label else entry.id
        where = f" ({entry.place})" if entry.place else ""
        words = f" “{entry.words}” That is," if entry.words else ""
        lines += [f"## {heading}", "", f"{entry.origin.capitalize()}{where}:{words}", ""]
        lines += [f"$$ {derivation.latex(claim)} $$" for claim in entry.claims]
        at = ", ".join(f"${derivation.latex(s)} = {derivation.latex(v)}$" for s, v in wrong.counterexample)
        lines += ["", f"{wrong.because} At {at}:", ""]
        for left, right in wrong.values:
            if right is sp.false:
                lines.append("this is false.")
            else:
                lines.append(rf"$$ {derivation.latex(left)} \neq {derivation.latex(right)} $$")
        lines += ["", "Right is", ""]
        lines += [f"$$ {derivation.latex(claim)} $$" for claim in wrong.correction]
        lines.append("")
    return "\n".join(lines)
