"""Show an entry of a derivation: its statement, then its proof or refutation with the steps that were recorded."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import sympy as sp

from rodgen.errors import joined
from rodgen.symbolic._latex import rendered_width
from rodgen.symbolic.reduction import Reduction, Relation
from rodgen.symbolic.vectors import Letter

if TYPE_CHECKING:
    from rodgen.symbolic.derivation import Derivation, Entry, Proof

WIDTH = 90
"""Characters of a line; a statement that is wider is broken, a step of a proof is shortened."""
LINES = 10
"""Lines of a side of a statement that are shown."""
NARROW = 64
"""Characters up to which a definition is shown."""
SHOWN = 3
"""Equations of a proof that are shown, and differences of sides whose certificate is."""


class _Writer:
    """Writes formulas for a terminal, in SymPy's own notation."""

    def typeset(self, formula: sp.Basic) -> str:
        return plain(formula)

    def value(self, value: sp.Basic) -> str:
        return plain(value)

    def math(self, text: str) -> str:
        return text

    def inline(self, formula: sp.Basic) -> str:
        return plain(formula)

    def display(self, formula: sp.Basic) -> str:
        return f"    {plain(formula)}"

    def width(self, text: str) -> int:
        return len(text)

    def words(self, text: str) -> str:
        return text

    def chain(self, first: str, *others: tuple[str, str]) -> str:
        return "\n".join([f"    {first}", *(f"    {sign} {part}" for sign, part in others)])

    def equations(self, pairs: Sequence[tuple[str, ...]]) -> str:
        return "\n".join(f"    {left} = {right}" for left, right in pairs)

    def link(self, entry: Entry) -> str:
        return entry.id

    def heading(self, word: str) -> str:
        return word


class _Markdown(_Writer):
    """LaTeX in Markdown."""

    def __init__(self, derivation: Derivation) -> None:
        self._derivation = derivation

    def typeset(self, formula: sp.Basic) -> str:
        return self._derivation.latex(formula)

    def value(self, value: sp.Basic) -> str:
        if isinstance(value, sp.MatrixBase):
            return r"\left(" + r",\, ".join(sp.latex(part) for part in value) + r"\right)"
        return str(sp.latex(value))

    def math(self, text: str) -> str:
        return f"${text}$"

    def inline(self, formula: sp.Basic) -> str:
        return self.math(self.typeset(formula))

    def display(self, formula: sp.Basic) -> str:
        return f"$$ {self._derivation.latex_lines(formula, WIDTH, LINES)} $$"

    def width(self, text: str) -> int:
        return rendered_width(text)

    def words(self, text: str) -> str:
        return rf"\text{{{text}}}"

    def chain(self, first: str, *others: tuple[str, str]) -> str:
        parts = [f"{_SIGNS[sign]} {part}" for sign, part in others]
        if rendered_width(" ".join([first, *parts])) <= WIDTH:
            return f"$$ {' '.join([first, *parts])} $$"
        if rendered_width(first) + max(map(rendered_width, parts)) > WIDTH + 5:
            lines = [f"& {first}", *(rf"&\quad {part}" for part in parts)]
        else:
            lines = [f"{first} &{parts[0]}", *(f"&{part}" for part in parts[1:])]
        return _aligned(lines)

    def equations(self, pairs: Sequence[tuple[str, ...]]) -> str:
        if len(pairs) == 1:
            return f"$$ {pairs[0][0]} = {pairs[0][1]} $$"
        return _aligned([f"{left} &= {right}" for left, right in pairs])

    def link(self, entry: Entry) -> str:
        return f'<a href="#{entry.id}">{entry.id}</a>'

    def heading(self, word: str) -> str:
        return f"*{word}*"


_SIGNS = {"=": "=", "!=": r"\neq"}


def _aligned(lines: Sequence[str]) -> str:
    return r"$$ \begin{aligned} " + r" \\ ".join(lines) + r" \end{aligned} $$"


def plain(claim: sp.Basic) -> str:
    """Write a formula on one line, in SymPy's notation, with ``=`` for an equation."""
    if isinstance(claim, sp.core.relational.Relational):
        sign = "=" if isinstance(claim, sp.Eq) else claim.rel_op
        return f"{plain(claim.lhs)} {sign} {plain(claim.rhs)}"
    if isinstance(claim, sp.MatrixBase):
        return "(" + ", ".join(plain(part) for part in claim) + ")"
    return str(sp.sstr(claim))


def report(derivation: Derivation) -> str:
    """Return the entries as text: id, verdict, time in ms, formula, and the argument below it."""
    width = max((len(entry.id) for entry in derivation), default=2)
    lines = [f"{derivation.title} ({derivation.source})", "", f"{'id':{width}}  verdict     ms  formula"]
    for entry in derivation:
        formula = "; ".join(map(plain, entry.claims))
        if len(formula) > WIDTH:
            formula = f"{formula[:WIDTH]}… ({len(formula)} characters)"
        lines.append(f"{entry.id:{width}}  {entry.verdict:7}  {1e3 * entry.seconds:5.0f}  {formula}")
        lines += textwrap.wrap(entry.method, 110, initial_indent=" " * 4, subsequent_indent=" " * 4)
    counts = [sum(entry.verdict == v for entry in derivation) for v in ("proved", "refuted", "open")]
    proofs = sum(entry.seconds for entry in derivation)
    lines += ["", "{} proved, {} refuted, {} open; {:.1f} s in proofs".format(*counts, proofs)]
    if derivation.seconds:
        lines[-1] += f", {derivation.seconds:.1f} s from the first line to the last kernel"
    return "\n".join(lines)


def markdown(entry: Entry) -> str:
    """Return statement and proof as Markdown with LaTeX."""
    write = _Markdown(entry.derivation)
    origin = "" if entry.origin == "own" else entry.origin
    heading = ", ".join(
        part for part in (f'<a id="{entry.id}"></a>**{entry.id}**', origin, entry.place) if part
    )
    words = f"“{entry.words}” That is," if entry.words else ""
    blocks = _introductions(entry, write)
    blocks.append(" ".join(part for part in (f"{heading}.", entry.text, words) if part))
    blocks += [write.display(claim) for claim in entry.claims]
    if entry.assumptions:
        wide = [a for a in entry.assumptions if not isinstance(a, str) and _within(a, write, WIDTH) is None]
        others = [a if isinstance(a, str) else write.inline(a) for a in entry.assumptions if a not in wide]
        blocks.append(
            "Assuming" + (" " + "; ".join(others) if others else "") + (" and" if others and wide else "")
        )
        blocks[-1] += "" if wide else "."
        blocks += [write.display(a) for a in wide]
    return "\n\n".join([*blocks, *_argument(entry, write)])


def steps(entry: Entry) -> str:
    """Return the statement, and its proof or refutation, as text for a terminal."""
    lines = [
        f"{entry.id}"
        + (f" ({entry.place})" if entry.place else "")
        + (f": {entry.text}" if entry.text else "")
    ]
    lines += [f"    {plain(claim)}" for claim in entry.claims]
    if entry.assumptions:
        lines.append(
            "Assuming " + "; ".join(a if isinstance(a, str) else plain(a) for a in entry.assumptions) + "."
        )
    return "\n".join([*lines, *_argument(entry, _Writer())])


def _introductions(entry: Entry, write: _Markdown) -> list[str]:
    """List the symbols that the reader meets here for the first time."""
    lines = []
    for row in entry.introduced:
        formula = f"${row.latex}$"
        if (value := _within(row.value, write, NARROW)) is not None:
            formula = f"${row.latex} = {value}$"
        unit = "" if row.unit == "1" else f" [{row.unit}]"
        lines.append(f"- {formula}: {row.quantity}{unit}")
    return ["\n".join(lines)] if lines else []


def _argument(entry: Entry, write: _Writer) -> list[str]:
    """Write the proof, or the refutation and the proof of what is right."""
    if entry.proof is None:
        return [write.heading(f"{entry.verdict.capitalize()}.")]
    wrong = entry.refutation
    if wrong is None:
        return list(_proof(entry, entry.proof, entry.claims, entry.because, write))
    head = write.heading(f"Refuted{f' ({wrong.label})' if wrong.label else ''}.")
    at = ", ".join(
        write.math(f"{write.typeset(symbol)} = {write.value(value)}")
        for symbol, value in wrong.counterexample
    )
    blocks = [f"{head} {wrong.because}" + (f" At {at}:" if at else "")]
    for claim, (left, right) in zip(wrong.failing, wrong.values, strict=True):
        if right is sp.false:
            blocks.append("the claim is false.")
        else:
            blocks.append(_unequal(claim, left, right, write))
    blocks.append("Right is")
    for claim in wrong.correction:
        blocks.append(write.display(claim))
    return [*blocks, *_proof(entry, entry.proof, wrong.correction, "", write)]


def _unequal(claim: sp.Basic, left: sp.Basic, right: sp.Basic, write: _Writer) -> str:
    numbers = [write.value(side) for side in (left, right)]
    sides = [_within(side, write, NARROW // 2) for side in claim.args]
    parts = [("=", sides[0]), ("=", numbers[0]), ("!=", numbers[1]), ("=", sides[1])]
    if sides[0] in (None, numbers[0]):
        parts.pop(0)
    if sides[1] in (None, numbers[1]):
        parts.pop()
    return write.chain(str(parts[0][1]), *((sign, str(part)) for sign, part in parts[1:]))


def _proof(
    entry: Entry, proof: Proof, claims: Sequence[sp.Basic], because: str, write: _Writer
) -> Iterator[str]:
    opening = [write.heading("Proof."), because]
    if proof.lemmas:
        opening.append(f"It follows from {joined([write.link(lemma) for lemma in proof.lemmas])}.")
    if not proof.computations:
        yield " ".join(part for part in opening if part)
        return
    computations = [c for c in proof.computations if c.claim != 0]
    if because and not all(c.claim in claims for c in computations):
        opening.append("The computation:")
    formulas, names, free = _substitutions(entry, proof, write)
    if names:
        named = f"the definition{'s' * (len(names) > 1)} of {joined(names, most=len(names))}"
        opening.append(f"Insert {named}{', and' if formulas else '.'}")
    elif formulas:
        opening.append("Insert")
    yield " ".join(part for part in opening if part)
    if formulas:
        yield write.equations(formulas)
    notes = []
    if free:
        notes.append(f"This holds for any {joined(free, most=len(free))}.")
    relations = _relations(proof, write)
    if relations:
        notes.append(f"The computation uses {joined(relations, most=len(relations))}.")
    if notes:
        yield " ".join(notes)
    for computation in computations[:SHOWN]:
        claim = None if computation.claim in claims else _within(computation.claim, write, WIDTH)
        if claim is not None:
            yield f"{write.math(claim if isinstance(computation.claim, sp.Eq) else f'{claim} = 0')}."
    yield _computation(proof, write)


def _substitutions(
    entry: Entry, proof: Proof, write: _Writer
) -> tuple[list[tuple[str, ...]], list[str], list[str]]:
    """Return what was substituted in the order of its use: formulas, names of what is long, and what stays free."""
    owners: dict[sp.Basic, tuple[sp.Basic, Any]] = {}
    for row in entry.derivation.symbols:
        if row.value is not None:
            owners.update(dict.fromkeys(_parts(row.symbol), (row.symbol, row.value)))
    free = []
    for key, value in entry.given:
        if key == value:
            free.append(write.inline(key))
        owners.update(dict.fromkeys(_parts(key), (key, value)))
    new = {row.symbol for row in entry.introduced}
    formulas: list[tuple[str, ...]] = []
    names = []
    for symbol, value in dict(owners[s] for s in proof.substituted).items():
        whole = sp.ImmutableMatrix(value) if isinstance(value, list | tuple) else sp.sympify(value)
        formula = _within(whole, write, WIDTH - 20)
        if formula is None or (symbol in new and _within(whole, write, NARROW) is not None):
            names.append(write.inline(symbol))
        else:
            formulas.append((write.typeset(symbol), formula))
    return formulas, names, free


def _parts(key: Any) -> list[sp.Basic]:
    return list(key) if isinstance(key, Letter) else [key]


def _relations(proof: Proof, write: _Writer) -> list[str]:
    """Return the relations that some reduction used, and whether functions of sums were expanded."""
    written = {symbol: condition for symbol, condition, _ in proof.conditions}
    reductions = [r for c in proof.computations for r in c.reductions]
    relations = list(
        dict.fromkeys(
            _relation(r, division.relation, written, write) for r in reductions for division in r.divisions
        )
    )
    if len(relations) > 6:
        relations = [*relations[:5], f"{len(relations) - 5} relations of the same kind"]
    return [*(["the addition theorems"] if any(r.expanded for r in reductions) else []), *relations]


def _relation(
    reduced: Reduction, relation: Relation, written: Mapping[sp.Symbol, sp.Expr], write: _Writer
) -> str:
    if not relation.of_function:
        return _vanishing(written[relation.symbol], relation.symbol, write)
    root = reduced.written_out(relation.symbol)
    if not root.is_Pow:
        return _vanishing(reduced.written_out(relation.zero), relation.symbol, write)
    formula = _within(root, write, NARROW)
    return "the definition of a root" if formula is None else f"the definition of {write.math(formula)}"


def _vanishing(zero: sp.Expr, symbol: sp.Symbol, write: _Writer) -> str:
    """Write an expression that is zero as an equation, its constant or what is known on the right."""
    terms = sp.Add.make_args(zero)
    left = [t for t in terms if not t.is_number]
    holding = [t for t in terms if symbol in t.free_symbols]
    if len(holding) == 1 and len(left) < len(terms) + (len(holding) < len(left)):
        left = holding
    right = [-t for t in terms if t not in left]
    equation = sp.Eq(sp.Add(*left), sp.Add(*right), evaluate=False)
    return write.inline(equation)


def _computation(proof: Proof, write: _Writer) -> str:
    """Write how both sides came to be the same: their differences as multiples of what is zero, where that is short."""
    lines = [
        difference
        for c in proof.computations
        for difference, left, right in zip(
            c.reductions, c.left, sp.zeros(*c.left.shape) if c.right is None else c.right, strict=True
        )
        if left != right
    ]
    if not lines and any(c.claim != 0 for c in proof.computations):
        return "Both sides are then the same."
    certificates = [_certificate(difference, write) for difference in lines[: SHOWN + 1]]
    if lines and len(lines) <= SHOWN and None not in certificates:
        sides = " - ".join(write.words(side) for side in ("left side", "right side"))
        return write.equations([(sides, f"{certificate} = 0") for certificate in certificates])
    return "By computation (polynomial division, `rodgen.symbolic.remainder`), the difference of both sides is 0."


def _certificate(reduced: Reduction, write: _Writer) -> str | None:
    """Write the difference of both sides as a sum of multiples of what is zero, where that is short."""
    products = reduced.cofactors() if 0 < len(reduced.divisions) <= 2 else None
    if not products or any(zero == 0 for _, zero in products):
        return None
    denominator = reduced.denominator()
    total = [sp.Mul(cofactor / denominator, zero, evaluate=False) for cofactor, zero in products]
    return _within(sp.Add(*total, evaluate=False) if len(total) > 1 else total[0], write, WIDTH)


def _operations(formula: Any) -> int:
    if isinstance(formula, sp.MatrixBase):
        return sum(map(_operations, formula))
    return int(formula.count_ops())


def _within(formula: Any, write: _Writer, width: int) -> str | None:
    """Typeset a formula if it is no wider than that."""
    if formula is None or _operations(formula) > width:
        return None
    text = write.typeset(formula)
    return text if write.width(text) <= width else None


def in_notebook() -> bool:
    """Return whether a Jupyter kernel runs this code; IPython is not imported to find out."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    return running is not None and "IPKernelApp" in running.config
