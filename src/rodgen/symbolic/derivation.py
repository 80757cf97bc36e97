"""A derivation: formulas from a source, each proved exactly or shown to be wrong.

A source's formula is *stated* and stays open until it is *proved*, by reducing its residual to an exact
zero, or *refuted*, by an exact counterexample and a proved correction. No kernel can be registered while
an entry is open, so code is generated from proved equations only.

>>> import sympy as sp
>>> from rodgen.symbolic import Derivation
>>> d = Derivation("lens", title="The thin lens", source="Any textbook")
>>> f = d.symbol("f", r"f", "focal length", "mm", positive=True)
>>> a = d.symbol("a", r"a", "object distance", "mm", positive=True)
>>> b = d.symbol("b", r"b", "image distance", "mm", value=a * f / (a - f))
>>> d.state("lens-equation", sp.Eq(1 / a + 1 / b, 1 / f), place="eq. (1)").prove().verdict
'proved'
>>> wrong = d.state("magnification", sp.Eq(b / a, f / (f - a)), place="eq. (2)")
>>> wrong.refute({a: 3, f: 1}, sp.Eq(b / a, f / (a - f)), because="the sign", label="L1").verdict
'refuted'
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, cast

import sympy as sp
from sympy.logic.boolalg import Boolean

from rodgen import methods
from rodgen.symbolic._latex import component_names, latex, latex_lines
from rodgen.symbolic.reduction import Reduction, reduction
from rodgen.symbolic.vectors import Letter, Vector, explicit

Substitution = Mapping[Any, Any]
"""Values for symbols and vectors: expressions, numbers or triples of numbers."""

Origin = Literal["printed", "said", "tacit", "own"]
"""Where a claim is from: the source prints the formula, says it in words or takes it for granted; or it is ours."""


class DerivationError(ValueError):
    """A statement that is false, not proved, or used before it is proved."""


def equal(left: sp.Basic, right: sp.Basic | int) -> sp.Eq:
    """Write an equation as printed: SymPy's ``Eq`` would evaluate it where it can."""
    return sp.Eq(left, right, evaluate=False)


class _Named(Protocol):
    """The part of a kernel that a derivation uses."""

    @property
    def name(self) -> str: ...


@dataclass(frozen=True)
class SymbolRow:
    """One line of the table of symbols."""

    name: str
    latex: str
    quantity: str
    unit: str
    symbol: sp.Basic
    value: sp.Basic | None


@dataclass(frozen=True)
class Refutation:
    """Why a claim is wrong, and what is right."""

    label: str
    because: str
    counterexample: tuple[tuple[sp.Basic, sp.Basic], ...]
    values: tuple[tuple[sp.Basic, sp.Basic], ...]
    """Both sides of each equation that fails, at the counterexample; (claim, False) for other claims."""
    correction: tuple[sp.Basic, ...]
    failing: tuple[sp.Basic, ...] = ()
    """The claims that fail, one for each of `values`."""


@dataclass(frozen=True)
class Computation:
    """One equation of a proof: its sides in components, and how their differences were reduced to zero."""

    claim: sp.Basic
    """The equation, or an expression that must vanish."""
    left: sp.Matrix
    right: sp.Matrix | None
    """Components of both sides, with everything substituted; None for the right side of an expression."""
    reductions: tuple[Reduction, ...]
    """One for each component."""


@dataclass(frozen=True)
class Proof:
    """What a proof used, recorded while it was decided."""

    substituted: tuple[sp.Symbol, ...]
    """Symbols that were replaced by their definitions or given values, in the order of their use."""
    conditions: tuple[tuple[sp.Symbol, sp.Expr, sp.Expr], ...]
    """The side conditions: the symbol for which each is used, and what is zero, as written and in components."""
    lemmas: tuple[Entry, ...]
    """Entries proved before, from which it follows."""
    computations: tuple[Computation, ...]


@dataclass
class Entry:
    """A formula, with where it is from and the record of its proof or refutation.

    Entries are made by :meth:`Derivation.state` and :meth:`Derivation.check`.
    """

    derivation: Derivation = field(repr=False)
    id: str
    claims: tuple[sp.Basic, ...]
    text: str
    place: str
    assumptions: tuple[sp.Basic | str, ...]
    origin: Origin
    words: str = ""
    """The source's own words, where it prints no formula."""
    verdict: str = "open"
    because: str = ""
    given: tuple[tuple[sp.Basic, sp.Basic], ...] = ()
    modulo: tuple[tuple[sp.Symbol, sp.Expr], ...] = ()
    refutation: Refutation | None = None
    proof: Proof | None = field(default=None, repr=False)
    """How the entry, or what is right instead of it, was proved."""
    seconds: float = 0.0
    symbols: tuple[SymbolRow, ...] = field(default=(), repr=False)
    """The table of symbols as it was when the entry was stated."""
    introduced: tuple[SymbolRow, ...] = field(default=(), repr=False)
    """Rows of that table which neither an entry before this one nor the table itself has shown."""

    @property
    def variables(self) -> tuple[sp.Basic, ...]:
        """Symbols and vectors in the formula, sorted by name."""
        variables: set[sp.Basic] = set()
        for claim in self.claims:
            variables |= claim.free_symbols
        return tuple(sorted(variables, key=str))

    @property
    def method(self) -> str:
        """How the entry was decided, in plain words."""
        if self.because or self.verdict == "open":
            return self.because
        free = [str(key) for key, value in self.given if key == value]
        known = [str(key) for key, value in self.given if key != value] + [str(key) for key, _ in self.modulo]
        words = "Both sides are identical"
        words += f", for any {', '.join(free)}" if free else ""
        words += f", given {', '.join(known)}" if known else ""
        return f"{words}."

    def prove(
        self,
        *residuals: sp.Basic | Entry,
        given: Substitution | None = None,
        modulo: Mapping[sp.Symbol, sp.Expr] | None = None,
        because: str = "",
    ) -> Entry:
        """Prove the entry: every residual must reduce to exactly zero.

        Parameters
        ----------
        *residuals : expression, matrix, equation or Entry, optional
            Expressions that must vanish, and entries proved before, from which the entry follows; then `because`
            must say why it follows. By default the two sides of the entry's own equations are subtracted.
        given : mapping, optional
            Values for symbols or vectors under which the entry holds, such as ``{rho_prime:
            rodrigues(rho, theta)}``. The definitions in the table of symbols are always used.
        modulo : mapping of symbol to expression, optional
            Expressions that are zero by hypothesis, see :func:`rodgen.symbolic.reduction.remainder`.
        because : str, optional
            The argument in words; it is shown in the notebook.

        Returns
        -------
        Entry
            The entry itself.

        Raises
        ------
        DerivationError
            When a residual does not vanish; the message shows the remainder.
        """
        if residuals and not because:
            raise DerivationError(
                f"{self.id}: given residuals need `because`: why the entry follows from them"
            )
        start = time.perf_counter()
        self.proof = self._vanish(residuals or self.claims, given, modulo, "is not proved")
        self._decide("proved", because, given, modulo, start)
        return self

    def refute(
        self,
        counterexample: Substitution,
        correction: sp.Basic | Sequence[sp.Basic],
        *,
        because: str,
        label: str = "",
        given: Substitution | None = None,
        modulo: Mapping[sp.Symbol, sp.Expr] | None = None,
        proof: Sequence[sp.Basic | Entry] = (),
    ) -> Entry:
        """Refute the entry by an exact counterexample, and prove what is right instead.

        Parameters
        ----------
        counterexample : mapping
            An exact number for each free symbol or a triple for each free vector. It must satisfy the
            entry's assumptions, and at least one claim must be false there.
        correction : relation or sequence of relations
            What is right; proved like an entry.
        because : str
            What is wrong, in words.
        label : str, optional
            Number in the errata.
        given, modulo : mapping, optional
            As in :meth:`prove`, for the correction; `given` holds for the counterexample, too.
        proof : sequence of expressions, equations or entries, optional
            Residuals or proved entries from which the correction follows, when its own sides are not
            subtracted.

        Returns
        -------
        Entry
            The entry itself.

        Raises
        ------
        DerivationError
            When the counterexample violates an assumption, is not exact, leaves a symbol open or does
            not refute, or when the correction is not proved.
        """
        start = time.perf_counter()
        corrections = (correction,) if isinstance(correction, sp.Basic) else tuple(correction)
        point = {sp.sympify(key): _exact(value, self.id) for key, value in counterexample.items()}
        insert = self.derivation.insert({**(given or {}), **point})
        for assumption in self.assumptions:
            if isinstance(assumption, sp.Basic) and not _truth(assumption, insert, self.id):
                raise DerivationError(f"{self.id}: the counterexample violates the assumption {assumption}")
        values: list[tuple[sp.Basic, sp.Basic]] = []
        failing = []
        for claim in self.claims:
            if isinstance(claim, sp.Eq):
                left, right = (_number(side, insert, self.id) for side in claim.args)
                if not _equal(left, right):
                    values.append((left, right))
                    failing.append(claim)
            elif not _truth(claim, insert, self.id):
                values.append((claim, sp.false))
                failing.append(claim)
        if not values:
            raise DerivationError(f"{self.id}: the counterexample {dict(counterexample)} satisfies the claim")
        complaint = "has a correction that is not proved"
        self.proof = self._vanish(tuple(proof) or corrections, given, modulo, complaint)
        self.refutation = Refutation(
            label, because, tuple(point.items()), tuple(values), corrections, tuple(failing)
        )
        self._decide("refuted", because, given, modulo, start)
        return self

    def residuals(self, given: Substitution | None = None) -> list[sp.Expr]:
        """Return left minus right side of the entry's equations, in components, definitions substituted."""
        insert = self.derivation.insert(given)
        return [residual for claim in self.claims for residual in _difference(*self._sides(claim, insert))]

    def _sides(
        self, claim: sp.Basic, insert: Callable[[sp.Basic], Any]
    ) -> tuple[sp.Matrix, sp.Matrix | None]:
        if isinstance(claim, Boolean) and not isinstance(claim, sp.Eq):
            raise DerivationError(f"{self.id}: {claim} is not an equation; give its residuals and `because`")
        if not isinstance(claim, sp.Eq):
            return sp.Matrix([insert(claim)]), None
        left, right = (sp.Matrix([insert(side)]) for side in claim.args)
        if left.shape != right.shape:
            shapes = f"{left.shape} and {right.shape}"
            raise DerivationError(f"{self.id}: the sides of {claim} have the shapes {shapes}")
        return left, right

    def _vanish(
        self,
        claims: Sequence[sp.Basic | Entry],
        given: Substitution | None,
        modulo: Mapping[sp.Symbol, sp.Expr] | None,
        complaint: str,
    ) -> Proof:
        lemmas = tuple(claim for claim in claims if isinstance(claim, Entry))
        for lemma in lemmas:
            if lemma.verdict != "proved":
                raise DerivationError(
                    f"{self.id} {complaint}: it builds on {lemma.id}, which is {lemma.verdict}"
                )
        insert = self.derivation.insert(given)
        equations = [claim for claim in claims if not isinstance(claim, Entry)]
        sides = [self._sides(claim, insert) for claim in equations]
        substituted = tuple(insert.substituted)
        conditions = {key: insert(value) for key, value in (modulo or {}).items()}
        computations = []
        number = 0
        for claim, (left, right) in zip(equations, sides, strict=True):
            reductions = []
            for residual in _difference(left, right):
                number += 1
                reduced = reduction(residual, conditions)
                if reduced.remainder != 0:
                    rest = _shortened(reduced.remainder)
                    raise DerivationError(f"{self.id} {complaint}: residual {number} leaves {rest}")
                reductions.append(reduced)
            computations.append(Computation(claim, left, right, tuple(reductions)))
        return Proof(
            substituted,
            tuple((key, value, conditions[key]) for key, value in (modulo or {}).items()),
            lemmas,
            tuple(computations),
        )

    def _decide(
        self,
        verdict: str,
        because: str,
        given: Substitution | None,
        modulo: Mapping[sp.Symbol, sp.Expr] | None,
        start: float,
    ) -> None:
        if self.verdict != "open":
            raise DerivationError(f"{self.id} is {self.verdict} already")
        self.verdict, self.because = verdict, because
        self.given = tuple((given or {}).items())
        self.modulo = tuple((modulo or {}).items())
        self.seconds = time.perf_counter() - start

    def latex(self) -> str:
        """Typeset the formula as it is written."""
        return r" \\ ".join(self.derivation.latex(claim) for claim in self.claims)

    # implemented by rodgen.symbolic.display, as rodgen.facade says
    steps = cast("Callable[..., str]", methods.method())
    _repr_markdown_ = cast("Callable[..., str]", methods.method())


class Kernels(dict[str, Any]):
    """The kernels of a derivation by name; a notebook shows how many operations each takes."""

    def _repr_markdown_(self) -> str:
        rows = [f"| `{name}` | {sum(kernel.operations.values())} |" for name, kernel in self.items()]
        return "\n".join(["| kernel | operations |", "| --- | ---: |", *rows])


class Derivation:
    """The formulas of one source, in order, and the kernels made from them.

    Parameters
    ----------
    name : str
        Short name, a Python identifier.
    title, source : str
        What is derived, and the paper or book it is found in.
    kernels_in : str, optional
        Of one that proves statements only: where the code is that evaluates them.
    """

    def __init__(self, name: str, *, title: str, source: str, kernels_in: str = "") -> None:
        if not (name.isidentifier() and name.isascii()):
            raise DerivationError(f"{name!r} is not a name for a derivation; expected a plain identifier")
        self.name = name
        self.title = title
        self.source = source
        self.kernels_in = kernels_in
        self.symbols: list[SymbolRow] = []
        self.entries: dict[str, Entry] = {}
        self.kernels = Kernels()
        self._definitions: dict[sp.Symbol, sp.Expr] = {}
        self._names: dict[sp.Basic, str] = {}
        self._shown = 0  # rows of the table of symbols that a reader has seen
        self._start = time.perf_counter()
        self.seconds = 0.0

    def symbol(
        self,
        name: str,
        latex: str,
        quantity: str,
        unit: str,
        *,
        value: sp.Basic | None = None,
        **assumptions: bool | None,
    ) -> sp.Symbol:
        """Enter a number into the table of symbols.

        Parameters
        ----------
        name, latex : str
            Name in generated code, and name in the source.
        quantity, unit : str
            What it is, and its unit ("1" when it has none).
        value : expression, optional
            Definition; proofs substitute it.
        **assumptions
            SymPy assumptions, such as ``positive=True``; the number is real, but for ``real=None``.
        """
        symbol = sp.Symbol(name, **{"real": True, **assumptions})
        self._enter(SymbolRow(name, latex, quantity, unit, symbol, value))
        return symbol

    def vector(
        self, name: str, latex: str, quantity: str, unit: str, *, value: sp.Basic | None = None
    ) -> Vector:
        """Enter a vector with the components ``name_1``, ``name_2``, ``name_3``; as :meth:`symbol`."""
        vector = Vector(name)
        self._enter(SymbolRow(name, latex, quantity, unit, vector, value))
        return vector

    def matrix(
        self,
        name: str,
        latex: str,
        quantity: str,
        unit: str,
        *,
        value: sp.Basic | None = None,
        rows: int = 3,
        columns: int = 3,
    ) -> Letter:
        """Enter a matrix with the components ``name_1_1`` and so on; as :meth:`symbol`."""
        matrix = Letter(name, rows, columns)
        self._enter(SymbolRow(name, latex, quantity, unit, matrix, value))
        return matrix

    def letter(self, row: str, value: Any = None) -> Any:
        r"""Enter a number, a vector or a matrix into the table by its line there.

        Parameters
        ----------
        row : str
            ``name | latex | quantity | unit``. With ``[3]`` a name is that of a vector, with ``[2,3]`` that of a
            matrix; with ``>0`` that of a positive number, with ``>=0`` of one that is not negative.
        value : expression or matrix, optional
            Definition; a name without brackets is that of what it is.

        Examples
        --------
        >>> d = Derivation("turn", title="A turn", source="none")
        >>> n = d.letter(r"n[3] | \vec n | axis | 1")
        >>> d.letter("tilt | \\beta | tilt of the axis | rad", sp.acos(n.components[2]))
        tilt
        """
        written, latex, quantity, unit = map(str.strip, row.split(" | "))
        name, _, bound = written.partition(">")
        name, _, size = name.rstrip("]").partition("[")
        shape = [int(n) for n in size.split(",")] if size else getattr(value, "shape", ())
        letter: Any
        if tuple(shape) in ((3,), (3, 1)):
            letter = Vector(name)
        elif shape:
            letter = Letter(name, *shape)
        else:
            assumption = {"": {}, "0": {"positive": True}, "=0": {"nonnegative": True}}[bound]
            letter = sp.Symbol(name, real=True, **assumption)
        self._enter(SymbolRow(name, latex, quantity, unit, letter, value))
        return letter

    def letters(self, *rows: str) -> list[Any]:
        """Enter several letters into the table, as :meth:`letter`."""
        return [self.letter(row) for row in rows]

    def _enter(self, row: SymbolRow) -> None:
        if any(known.name == row.name for known in self.symbols):
            raise DerivationError(f"{self.name}: the symbol {row.name} is defined twice")
        self.symbols.append(row)
        self._names[row.symbol] = row.latex
        if isinstance(row.symbol, Letter):
            self._names.update(component_names(row.symbol, row.latex))
        if row.value is not None:
            self._definitions.update(_by_component(row.symbol, row.value))

    def state(
        self,
        id: str,
        *claims: sp.Basic,
        text: str = "",
        place: str = "",
        assumptions: Sequence[sp.Basic | str] = (),
        said: str = "",
        tacit: bool = False,
    ) -> Entry:
        """State a formula that the source prints, or a claim that it makes without one.

        Parameters
        ----------
        id : str
            Name of the entry, unique in the derivation.
        *claims : relation
            The formula as printed: equations (``equal(left, right)`` keeps one unevaluated), inequalities
            or logical expressions of them.
        text : str, optional
            What the source says with it.
        place : str, optional
            Where it is in the source.
        assumptions : sequence of relations or strings, optional
            Conditions under which it is claimed. A counterexample must satisfy the relations.
        said : str, optional
            The words of the source, where it says in words what `claims` writes as a formula.
        tacit : bool, optional
            Whether the source takes it for granted and neither prints nor says it.

        Raises
        ------
        DerivationError
            When the name is taken, nothing is claimed, or the claim is both said and tacit.
        """
        if said and tacit:
            raise DerivationError(f"{id}: what is said is not tacit; give `said` or `tacit`, not both")
        origin: Origin = "said" if said else "tacit" if tacit else "printed"
        return self._record(id, claims, text, place, assumptions, origin, said)

    def check(
        self, id: str, *claims: sp.Basic, text: str = "", assumptions: Sequence[sp.Basic | str] = ()
    ) -> Entry:
        """State a fact that the source does not; it must be proved as well."""
        return self._record(id, claims, text, "", assumptions, "own")

    def _record(
        self,
        id: str,
        claims: tuple[sp.Basic, ...],
        text: str,
        place: str,
        assumptions: Sequence[sp.Basic | str],
        origin: Origin,
        words: str = "",
    ) -> Entry:
        if id in self.entries:
            raise DerivationError(f"{self.name}: the entry {id} is stated twice")
        if not claims:
            raise DerivationError(f"{self.name}: the entry {id} claims nothing; give it a relation")
        for claim in claims:
            if claim in (sp.true, sp.false):
                raise DerivationError(
                    f"{id}: SymPy evaluated a claim to {claim}; keep it as printed with equal(left, right)"
                )
        entry = Entry(self, id, tuple(claims), text, place, tuple(assumptions), origin, words)
        entry.symbols, entry.introduced = tuple(self.symbols), tuple(self.symbols[self._shown :])
        self._shown = len(self.symbols)
        self.entries[id] = entry
        return entry

    @property
    def open(self) -> list[str]:
        """Names of the entries that are neither proved nor refuted."""
        return [entry.id for entry in self.entries.values() if entry.verdict == "open"]

    def kernel(self, *kernels: _Named) -> None:
        """Register the kernels from which code is generated.

        Raises
        ------
        DerivationError
            While an entry is open, and when a name is taken.
        """
        if self.open:
            names = ", ".join(self.open)
            raise DerivationError(f"{self.name}: no kernel can be registered while entries are open: {names}")
        for kernel in kernels:
            if not hasattr(kernel, "name"):
                kind = type(kernel).__name__
                raise DerivationError(f"{self.name}: {kind} is not a kernel; register what build() returns")
            if kernel.name in self.kernels:
                raise DerivationError(f"{self.name}: the kernel {kernel.name} is registered twice")
            self.kernels[kernel.name] = kernel
        self.seconds = time.perf_counter() - self._start

    def value(self, formula: sp.Basic, given: Substitution | None = None) -> Any:
        """Write a formula in components of the free symbols: a matrix, an expression or a relation.

        Parameters
        ----------
        formula : expression, matrix or relation
            In vectors and matrices, or in components.
        given : mapping, optional
            Values that take the place of definitions; a symbol given as itself is free again.
        """
        return self.insert(given)(formula)

    def insert(self, given: Substitution | None = None) -> _Insertion:
        """Return a function that does what :meth:`value` does, for many formulas with the same `given` values."""
        values = dict(self._definitions)
        for key, value in (given or {}).items():
            values.update(_by_component(key, value))
        return _Insertion(self.name, values)

    def latex(self, formula: sp.Basic) -> str:
        """Typeset a formula with the source's names for the symbols."""
        return latex(formula, self._names)

    def latex_lines(self, formula: sp.Basic, width: int, most: int) -> str:
        """Typeset a formula as :meth:`latex` does, broken into aligned lines of at most `width` characters.

        Of a side with more lines than `most` the first are shown, and the number of the others.
        """
        return latex_lines(formula, self._names, width, most)

    def undeclared(self) -> list[str]:
        """Return a line for each entry whose formula has symbols that the table of symbols did not hold before it.

        A symbol whose name is LaTeX, such as ``X_{12}``, is typeset as it is and needs no row.
        """
        lines = []
        for entry in self.entries.values():
            known: set[sp.Basic] = set()
            for row in entry.symbols:
                known |= {row.symbol, *(row.symbol if isinstance(row.symbol, Letter) else ())}
            missing = [v.name for v in entry.variables if v not in known and not set(v.name) & set("\\{}")]
            if missing:
                lines.append(
                    f"{self.name}: {entry.id} uses {', '.join(missing)} before the table of symbols has it"
                )
        return lines

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())

    def page(self, *ids: str) -> Page:
        """Return entries that a notebook shows one after the other."""
        return Page([self.entries[id] for id in ids])

    report = cast("Callable[..., str]", methods.method())  # by rodgen.symbolic.display, as rodgen.facade says

    def _repr_markdown_(self) -> str:
        self._shown = len(self.symbols)
        lines = ["| in the code | in the source | quantity | unit |", "| --- | --- | --- | --- |"]
        for row in self.symbols:  # a bar would end the cell
            latex, quantity = row.latex.replace("|", r"\vert "), row.quantity.replace("|", "&#124;")
            lines.append(f"| `{row.name}` | ${latex}$ | {quantity} | {row.unit} |")
        return "\n".join(lines)


class Page(list[Entry]):
    """Entries that a notebook shows one after the other, of :meth:`Derivation.page`."""

    def _repr_markdown_(self) -> str:
        return "\n\n".join(entry._repr_markdown_() for entry in self)


class _Insertion:
    """Put definitions and given values into formulas, and remember which were used."""

    def __init__(self, name: str, values: Mapping[sp.Symbol, sp.Expr]) -> None:
        self.substituted: list[sp.Symbol] = []
        self._name = name
        self._values = values
        self._done: dict[sp.Symbol, sp.Expr] = {}
        self._active: list[sp.Symbol] = []

    def __call__(self, formula: sp.Basic) -> Any:
        return self._inserted(explicit(formula))

    def _inserted(self, written: sp.Basic) -> Any:
        return written.xreplace({s: self._resolve(s) for s in sorted(written.free_symbols, key=str)})

    def _resolve(self, symbol: sp.Symbol) -> sp.Expr:
        value = self._values.get(symbol, symbol)
        if value == symbol:
            return symbol
        if symbol not in self._done:
            if symbol in self._active:
                raise DerivationError(f"{self._name}: {symbol} is defined by itself")
            self.substituted.append(symbol)
            self._active.append(symbol)
            self._done[symbol] = self._inserted(value)
            self._active.pop()
        return self._done[symbol]


def _difference(left: sp.Matrix, right: sp.Matrix | None) -> list[sp.Expr]:
    return list(left if right is None else left - right)


def _by_component(key: Any, value: Any) -> dict[sp.Symbol, sp.Expr]:
    if isinstance(key, Letter):
        parts = explicit(value) if isinstance(value, sp.Basic | sp.MatrixBase) else sp.Matrix(value)
        return dict(zip(key, parts, strict=True))
    return {key: sp.sympify(explicit(value) if isinstance(value, sp.Basic) else value)}


def _exact(value: Any, id: str) -> sp.Basic:
    exact = sp.ImmutableMatrix(value) if isinstance(value, list | tuple) else sp.sympify(value)
    if exact.has(sp.Float) or exact.free_symbols:
        raise DerivationError(f"{id}: a counterexample is made of exact numbers, not {value}")
    return exact


def _number(formula: sp.Basic, insert: Callable[[sp.Basic], Any], id: str) -> sp.Basic:
    number = insert(formula)
    if isinstance(number, sp.MatrixBase):
        number = sp.ImmutableMatrix(number)
    if number.free_symbols:
        left = ", ".join(sorted(map(str, number.free_symbols)))
        raise DerivationError(f"{id}: the counterexample leaves {left} without a value")
    return number


def _equal(left: sp.Basic, right: sp.Basic) -> bool:
    if isinstance(left, sp.MatrixBase):
        return all(_equal(a, b) for a, b in zip(left, right, strict=True))
    return bool(sp.simplify(left - right) == 0)


def _truth(claim: sp.Basic, insert: Callable[[sp.Basic], Any], id: str) -> bool:
    if isinstance(claim, sp.Eq | sp.Ne):
        left, right = (_number(side, insert, id) for side in claim.args)
        return _equal(left, right) == isinstance(claim, sp.Eq)
    if isinstance(claim, Boolean) and not isinstance(claim, sp.core.relational.Relational) and claim.args:
        truths = [sp.true if _truth(part, insert, id) else sp.false for part in claim.args]
        return bool(claim.func(*truths))
    value = _number(claim, insert, id)
    if value not in (sp.true, sp.false):
        raise DerivationError(f"{id}: {claim} does not evaluate to true or false, but to {value}")
    return bool(value)


def _shortened(expr: sp.Expr) -> str:
    text = sp.sstr(expr)
    return text if len(text) <= 200 else f"{text[:200]}... ({len(text)} characters)"
