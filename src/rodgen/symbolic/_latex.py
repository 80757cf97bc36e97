"""LaTeX of formulas in vector notation, with a paper's names for the symbols."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import sympy as sp
from sympy.printing.latex import LatexPrinter

from rodgen.symbolic.vectors import Letter, Vector


class _Printer(LatexPrinter):  # type: ignore[misc]
    """SymPy's printer, with vectors set as books set them."""

    def _name(self, vector: Vector) -> str:
        return str(self._settings["symbol_names"].get(vector) or rf"\vec {super()._print_Symbol(vector)}")

    def _print_Pow(self, expr: Any) -> str:
        base, exponent = expr.args
        name = str(self._settings["symbol_names"].get(base, ""))
        if exponent.is_Integer and exponent > 1 and name.startswith((r"\sin", r"\cos")) and "^" not in name:
            return rf"{name[:4]}^{{{exponent}}}{name[4:]}"
        return str(super()._print_Pow(expr))

    def _print_Vector(self, vector: Vector) -> str:
        return self._name(vector)

    def _print_Letter(self, matrix: Letter) -> str:
        return str(self._settings["symbol_names"].get(matrix) or super()._print_Symbol(matrix))

    def _print__Skew(self, matrix: Any) -> str:
        return rf"\left[{self._print(matrix.args[0])}\right]_\times"

    def _print_Identity(self, matrix: Any) -> str:
        return "I"

    def _print_Transpose(self, matrix: Any) -> str:
        return f"{self._grouped(matrix.args[0])}^{{T}}"

    def _grouped(self, operand: sp.Basic) -> str:
        text = str(self._print(operand))
        plain = isinstance(operand, Letter) and not text.startswith(r"\frac")
        return text if plain else rf"\left({text}\right)"

    def _print__Cross(self, product: Any) -> str:
        return r" \times ".join(self._grouped(a) for a in product.args)

    def _print__FormalDeterminant(self, product: Any) -> str:
        rows = [
            " & ".join(self._print(c) for c in (a.components if isinstance(a, Vector) else a))
            for a in product.args
        ]
        return r"\begin{vmatrix} \vec i & \vec j & \vec k \\ " + r" \\ ".join(rows) + r" \end{vmatrix}"

    def _print__Dot(self, product: Any, exp: str | None = None) -> str:
        text = r"\left(" + r",\, ".join(self._print(a) for a in product.args) + r"\right)"
        return text if exp is None else f"{text}^{{{exp}}}"

    def _print__Norm(self, length: Any, exp: str | None = None) -> str:
        text = rf"\left|{self._print(length.args[0])}\right|"
        return text if exp is None else f"{text}^{{{exp}}}"

    def _print_MatMul(self, product: Any) -> str:
        scalar = sp.Mul(*[a for a in product.args if not getattr(a, "is_Matrix", False)])
        matrices = [a for a in product.args if getattr(a, "is_Matrix", False)]
        text = r" \, ".join(
            rf"\left({self._print(a)}\right)" if isinstance(a, sp.MatAdd) else str(self._print(a))
            for a in matrices
        )
        if scalar == 1:
            return text
        if scalar == -1:
            return f"- {text}"
        factor = str(self._print(scalar))
        if isinstance(scalar, sp.Add):
            factor = rf"\left({factor}\right)"
        return rf"{factor} \, {text}"

    def _print_MatAdd(self, total: Any) -> str:
        # Single letters first, then terms by their number of operations, as papers print sums.
        terms = sorted(total.args, key=lambda term: (term.count_ops(), sp.default_sort_key(term)))
        text = " + ".join(str(self._print(term)) for term in terms)
        return text.replace("+ - ", "- ")


def latex(formula: sp.Basic, names: Mapping[sp.Basic, str]) -> str:
    """Typeset a formula, a relation or a matrix, with `names` for its symbols."""
    return str(_Printer({"symbol_names": dict(names)}).doprint(formula))


_LETTER = re.compile(
    r"(?P<letter>(?:\\(?:hat|bar|tilde|mathbf)\s*)?(?:\\[A-Za-z]+|[A-Za-z]))(?P<mark>'|\^\*)?"
    r"(?:_(?P<index>\{[^{}]*\}|\\[A-Za-z]+|\w))?(?P<after>')?"
)


def component_names(matrix: Letter, name: str) -> dict[sp.Symbol, str]:
    """Return the names of a vector's or matrix's components, made from its own."""
    rows, columns = (int(size) for size in matrix.shape)
    indices = [(i, j) for i in range(1, rows + 1) for j in range(1, columns + 1)]
    bare = name.replace(r"\vec", "").strip()
    plain = _LETTER.fullmatch(bare)
    if plain:
        letter, mark = plain["letter"], plain["mark"] or plain["after"] or ""
        index = (plain["index"] or "").strip("{}")
    else:
        letter, mark, index = rf"\left({name}\right)", "", ""
    apart = "," if max(rows, columns) > 9 else ""
    found = {}
    for component, (i, j) in zip(matrix, indices, strict=True):
        own = f"{i}" if columns == 1 else f"{i}{apart}{j}"
        found[component] = f"{letter}{mark}_{{{index + ',' if index else ''}{own}}}"
    return found


_SILENT = frozenset(
    "left right bigl bigr Bigl Bigr big Big mathrm mathcal mathbf vec bar hat tilde dot text displaystyle tfrac frac "
    "dfrac sqrt operatorname begin end overline".split()
)
_TOKEN = re.compile(r"\\[A-Za-z]+|\\.|[{}^_&]|\s+|.", re.DOTALL)
_SCRIPT = 0.7
"""Size of a subscript or superscript."""


def rendered_width(tex: str) -> int:
    r"""Return about how many characters wide LaTeX is when it is typeset on one line.

    Examples
    --------
    >>> rendered_width(r"\frac{a + b}{2} = \vec x")
    9
    """
    return round(_Width(tex).total())


class _Width:
    """Walks through the tokens of a formula."""

    def __init__(self, tex: str) -> None:
        self._tokens = [t for t in _TOKEN.findall(tex) if not t.isspace()]
        self._at = 0

    def total(self) -> float:
        """Return the width up to the end of the group, the environment or the formula."""
        lines, columns = [[0.0]], []
        while self._at < len(self._tokens):
            token = self._tokens[self._at]
            self._at += 1
            if token == "}":
                break
            if token == r"\end":
                self._argument()
                break
            if token == "&":
                lines[-1].append(0.0)
            elif token == r"\\":
                lines.append([0.0])
            else:
                lines[-1][-1] += self._one(token)
        columns = [max(line[i] for line in lines if i < len(line)) for i in range(max(map(len, lines)))]
        return sum(columns) + len(columns) - 1

    def _argument(self) -> float:
        if self._at == len(self._tokens):
            return 0.0
        token = self._tokens[self._at]
        self._at += 1
        return self._one(token)

    def _one(self, token: str) -> float:
        if token == "{":
            return self.total()
        if token in "^_":
            return _SCRIPT * self._argument()
        if token in (r"\frac", r"\dfrac"):
            return max(self._argument(), self._argument())
        if token == r"\tfrac":
            return _SCRIPT * max(self._argument(), self._argument())
        if token == r"\begin":
            self._argument()
            return self.total()
        if token == r"\quad":
            return 2.0
        if token[0] == "\\":
            name = token[1:]
            if not name.isalpha() or name in _SILENT:
                return 0.0 if name not in "{}|" else 1.0
            return (
                float(len(name))
                if name in ("sin", "cos", "tan", "ln", "log", "exp", "max", "min", "det")
                else 1.0
            )
        return 3.0 if token in "=+-<>" else 1.0
