"""LaTeX of formulas in vector notation, with a paper's names for the symbols."""

from __future__ import annotations

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
