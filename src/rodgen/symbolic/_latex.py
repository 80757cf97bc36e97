"""LaTeX of formulas in vector notation, with a paper's names for the symbols."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import sympy as sp
from sympy.printing.latex import LatexPrinter, accepted_latex_functions

from rodgen.symbolic.vectors import Letter, Vector

_FUNCTIONS = {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "sign": r"\operatorname{sgn}",
}
_ATOM = re.compile(
    r"(?P<letter>(?:\\(?:hat|bar|tilde|mathbf|mathrm)\s*)?(?:\\[A-Za-z]+|[A-Za-z]|\{[A-Za-z]+\}))(?P<mark>'|\^\*)?"
    r"(?:_(?P<index>\{[^{}]*\}|\\[A-Za-z]+|\w))?(?P<after>')?"
)
"""The name of one letter, with an index and a prime."""


class _Printer(LatexPrinter):  # type: ignore[misc]
    """SymPy's printer, with vectors, sums, products and functions set as books set them."""

    def __init__(self, names: Mapping[sp.Basic, str]) -> None:
        super().__init__({"symbol_names": dict(names)})
        self._known: dict[Any, str] = {}

    def _print(self, expr: Any, **options: Any) -> Any:
        if options or not isinstance(expr, sp.Basic):
            return super()._print(expr, **options)
        key = (type(expr), expr)  # equal numbers of different types are typeset differently
        if key not in self._known:
            self._known[key] = super()._print(expr)
        return self._known[key]

    def _name(self, vector: Vector) -> str:
        return str(self._settings["symbol_names"].get(vector) or rf"\vec {super()._print_Symbol(vector)}")

    def _deal_with_super_sub(self, string: str, style: str = "plain") -> str:
        """Set indices without spaces, and words upright."""
        name, supers, subs = self._split_super_sub(string)
        name = _upright(name)
        indices = [_upright(sub) for sub in subs]
        apart = "" if all(len(sub) == 1 for sub in subs) else ","
        text = name + (f"^{{{','.join(supers)}}}" if supers else "")
        return text + (f"_{{{apart.join(indices)}}}" if subs else "")

    def _print_Pow(self, expr: Any) -> str:
        base, exponent = expr.args
        name = str(self._settings["symbol_names"].get(base, ""))
        if exponent.is_Integer and exponent > 1 and name:
            if name.startswith((r"\sin", r"\cos")) and "^" not in name:
                return rf"{name[:4]}^{{{exponent}}}{name[4:]}"
            if "'" in name or "^" in name:
                return rf"{{{name}}}^{{{exponent}}}"
            if not _ATOM.fullmatch(name) and not name.startswith(r"\left"):
                return rf"\left({name}\right)^{{{exponent}}}"
        if exponent.is_Rational and exponent > 0 and abs(exponent.p) != 1 and exponent.q == 2:
            return str(self._print(sp.Pow(sp.sqrt(base), exponent.p, evaluate=False)))
        return str(super()._print_Pow(expr))

    def _print_Add(self, expr: Any, order: str | None = None) -> str:
        return _sum([self._term(term) for term in _ordered_terms(expr)])

    def _term(self, term: sp.Expr) -> str:
        text = str(self._print(term))
        return rf"\left({text}\right)" if self._needs_add_brackets(term) else text

    def _print_Mul(self, expr: Any) -> str:
        if expr.args[0] is sp.S.One or any(isinstance(arg, sp.Number) for arg in expr.args[1:]):
            return str(super()._print_Mul(expr))  # a product that is kept as it was written
        coefficient, rest = expr.as_coeff_Mul()
        if coefficient < 0:
            positive = _times(-coefficient, rest)
            text = str(self._print(positive))
            return rf"- \left({text}\right)" if positive.is_Add else f"- {text}"
        numerator, denominator = sp.fraction(expr, exact=True)
        if denominator == 1:
            return self._factors(expr)
        below = self._factors(denominator)
        factors = sp.Mul.make_args(numerator)
        sums = [factor for factor in factors if factor.is_Add]
        if denominator.is_Integer and sums:
            before = sp.Mul(*(factor for factor in factors if not factor.is_Add))
            return rf"\frac{{{self._factors(before)}}}{{{below}}} {self._factors(sp.Mul(*sums), last=False)}"
        return rf"\frac{{{self._factors(numerator)}}}{{{below}}}"

    def _factors(self, expr: sp.Expr, last: bool = True) -> str:
        """Write a product: numbers, letters, lengths and roots, brackets, and functions, whose arguments end last."""
        factors = expr.as_ordered_factors() if expr.is_Mul else [expr]
        factors = sorted(factors, key=self._rank)
        texts: list[str] = []
        for number, factor in enumerate(factors):
            text = str(self._print(factor))
            brackets = (len(factors) > 1 or not last) and self._needs_mul_brackets(
                factor, first=number == 0, last=number == len(factors) - 1
            )
            text = rf"\left({text}\right)" if brackets else text
            if (
                texts
                and texts[-1].isdigit()
                and (text[0].isdigit() or text.startswith((r"\frac", r"\tfrac")))
            ):
                text = rf"\cdot {text}"
            texts.append(text)
        return " ".join(texts)

    def _rank(self, factor: sp.Expr) -> int:
        base = factor.base if factor.is_Pow else factor
        if factor.is_number:
            return 0
        if base.is_Symbol:
            return (
                4 if str(self._settings["symbol_names"].get(base, "")).startswith((r"\sin", r"\cos")) else 1
            )
        if base.is_Function and base.func.__name__ not in ("Abs", "floor", "ceiling"):
            return 4
        return 3 if base.is_Add and not (factor.is_Pow and not factor.exp.is_Integer) else 2

    def _print_Function(self, expr: Any, exp: str | None = None) -> str:
        name = expr.func.__name__
        if hasattr(self, f"_print_{name}") and not isinstance(expr, sp.core.function.AppliedUndef):
            return str(getattr(self, f"_print_{name}")(expr, exp))
        function_name = rf"\{name}" if name in accepted_latex_functions else self._hprint_Function(name)
        head = _FUNCTIONS.get(name, function_name)
        head += "" if exp is None else f"^{{{exp}}}"
        arguments = [str(self._print(arg)) for arg in expr.args]
        if len(arguments) == 1 and head.startswith("\\") and self._stands_alone(expr.args[0]):
            return f"{head} {arguments[0]}"
        inner = r",\, ".join(arguments)
        if (
            len(arguments) == 1
            and isinstance(expr.args[0], sp.Basic)
            and type(expr.args[0]).__name__ == "_Dot"
        ):
            return f"{head}{inner}"
        return rf"{head}\left({inner}\right)"

    def _stands_alone(self, argument: sp.Expr) -> bool:
        """Whether a function's argument needs no brackets: a letter, perhaps with a number before or below it."""
        coefficient, letter = argument.as_coeff_Mul()
        if not (letter.is_Symbol and coefficient > 0):
            return False
        name = str(self._settings["symbol_names"].get(letter, "x"))
        return bool(_ATOM.fullmatch(name)) or (coefficient == 1 and name.startswith(r"\tfrac"))

    def _print_Vector(self, vector: Vector) -> str:
        return self._name(vector)

    def _print_Letter(self, matrix: Letter) -> str:
        return str(self._settings["symbol_names"].get(matrix) or super()._print_Symbol(matrix))

    def _print__Skew(self, matrix: Any) -> str:
        return rf"\left[{self._print(matrix.args[0])}\right]_\times"

    def _print_Identity(self, matrix: Any) -> str:
        return "I"

    def _print_Transpose(self, matrix: Any) -> str:
        text = self._grouped(matrix.args[0])
        return f"{{{text}}}^{{T}}" if text.endswith("'") else f"{text}^{{T}}"  # a prime is an exponent, too

    def _grouped(self, operand: sp.Basic) -> str:
        text = str(self._print(operand))
        is_letter = isinstance(operand, Letter) and not text.startswith(r"\frac")
        return text if is_letter else rf"\left({text}\right)"

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
        return _sum([str(self._print(term)) for term in _ordered_terms(total)])


def _lines(tex: str, width: int) -> list[str]:
    """Break LaTeX before signs into lines that are not wider, as far as there are signs."""
    width = max(width, 40)
    lines = [""]
    for part in _split(tex, _SIGNS):
        narrow = _narrowed(part.strip(), width)
        if lines[-1] and rendered_width(f"{lines[-1]} {narrow}") > width:
            lines.append(narrow)
        else:
            lines[-1] = f"{lines[-1]} {narrow}".lstrip()
    return lines


def _narrowed(tex: str, width: int) -> str:
    """Break what is in brackets, fractions, roots and the cells of matrices."""
    if rendered_width(tex) <= width:
        return tex
    ends = [at for at, token, depth in _depths(tex) if depth == 0 and token in _CLOSING]
    starts = [at + len(token) for at, token, depth in _depths(tex) if depth == 1 and token in _OPENING]
    groups = [(a, b) for a, b in zip(starts, ends, strict=True) if rendered_width(tex[a:b]) > width // 4]
    side_by_side = sum(not tex[:a].endswith("}{") for a, _ in groups)
    for a, b in reversed(groups):
        room, mark, cells = (width - 4) // max(side_by_side, 1), "", [tex[a:b]]
        if tex[:a].endswith(r"\left"):
            mark = r"\\.|."
        elif tex[:a].endswith(r"\begin"):
            mark, cells = r"\{\w+\}|&|\\\\|", _split(tex[a:b], ("&", r"\\"))
            rows = 1 + sum(cell.startswith(r"\\") for cell in cells)
            room //= max(len(cells) // rows, 1)
        marked = [(match.group(), cell[match.end() :]) for cell in cells if (match := re.match(mark, cell))]
        inner = [mark + _stacked(_lines(cell, room)) for mark, cell in marked]
        tex = tex[:a] + " ".join(inner) + tex[b:]
    return tex


def _split(tex: str, marks: Collection[str]) -> list[str]:
    """Return the parts of LaTeX that begin with these tokens outside all brackets."""
    places = [at for at, token, depth in _depths(tex) if at and depth == 0 and token in marks]
    return [tex[a:b] for a, b in itertools.pairwise([0, *places, len(tex)])]


def _depths(tex: str) -> Iterator[tuple[int, str, int]]:
    """Yield the tokens of LaTeX, where they are, and how many groups are open after each."""
    depth = 0
    for token in _TOKEN.finditer(tex):
        depth += (token.group() in _OPENING) - (token.group() in _CLOSING)
        yield token.start(), token.group(), depth


def _stacked(lines: Sequence[str]) -> str:
    if len(lines) == 1:
        return lines[0]
    return r"\begin{aligned} & " + r" \\ & \quad ".join(lines) + r" \end{aligned}"


def _times(coefficient: sp.Expr, rest: sp.Expr) -> sp.Expr:
    """Multiply without multiplying a sum out."""
    return rest if coefficient == 1 else sp.Mul(coefficient, *sp.Mul.make_args(rest), evaluate=False)


def _upright(name: str) -> str:
    return rf"\mathrm{{{name}}}" if len(name) > 1 and name.isalpha() else name


def _ordered_terms(total: Any) -> list[Any]:
    """Return the terms of a sum in the order of papers; one without a minus sign first, where there is one."""
    if isinstance(total, sp.MatAdd):  # single letters first, then terms by their number of operations
        terms = sorted(total.args, key=lambda term: (term.count_ops(), sp.default_sort_key(term)))
    else:
        terms = list(total.as_ordered_terms())
    first = next((i for i, term in enumerate(terms) if not _is_negative(term)), 0)
    return [terms[first], *terms[:first], *terms[first + 1 :]]


def _is_negative(term: Any) -> bool:
    if isinstance(term, sp.MatMul):
        return any(_is_negative(a) for a in term.args if not getattr(a, "is_Matrix", False))
    return bool(term.as_coeff_Mul()[0] < 0)


def _sum(terms: Sequence[str]) -> str:
    """Join terms; one that begins with a minus sign is subtracted."""
    text = terms[0]
    for term in terms[1:]:
        text += f" - {term[1:].lstrip()}" if term.startswith("-") else f" + {term}"
    return text


def latex(formula: sp.Basic, names: Mapping[sp.Basic, str]) -> str:
    """Typeset a formula, a relation or a matrix, with `names` for its symbols."""
    return str(_Printer(names).doprint(formula))


def latex_lines(formula: sp.Basic, names: Mapping[sp.Basic, str], width: int, most: int) -> str:
    """Typeset a formula or a relation; where it is wider than `width` characters, in aligned lines.

    Of more lines than `most` the first are shown, and the number of the others.
    """
    text = latex(formula, names)
    if rendered_width(text) <= width:
        return text
    if not isinstance(formula, sp.core.relational.Relational):
        lines = [f"& {line}" for line in _cut(_lines(text, width), most)]
        return r"\begin{aligned} " + r" \\ ".join(lines) + r" \end{aligned}"
    sign = {"==": "=", "!=": r"\neq", ">=": r"\geq", "<=": r"\leq"}.get(formula.rel_op, formula.rel_op)
    left, right = (latex(side, names) for side in formula.args)
    if rendered_width(left) <= width // 3:
        first, *others = _cut(_lines(right, width - rendered_width(left) - 3), most)
        lines = [f"{left} &{sign} {first}", *(rf"&\quad {line}" for line in others)]
    else:
        first, *others = _cut(_lines(left, width), most)
        lines = [f"& {first}", *(rf"&\quad {line}" for line in others)]
        first, *others = _cut(_lines(right, width - 4), most)
        lines += [rf"&\quad {sign} {first}", *(rf"&\qquad {line}" for line in others)]
    return r"\begin{aligned} " + r" \\ ".join(lines) + r" \end{aligned}"


def _cut(lines: list[str], most: int) -> list[str]:
    if len(lines) <= most:
        return lines
    return [*lines[: most - 1], rf"+ \cdots\;\text{{({len(lines) - most + 1} more lines)}}"]


def component_names(matrix: Letter, name: str) -> dict[sp.Symbol, str]:
    """Return the names of a vector's or matrix's components, made from its own."""
    rows, columns = (int(size) for size in matrix.shape)
    indices = [(i, j) for i in range(1, rows + 1) for j in range(1, columns + 1)]
    bare = name.replace(r"\vec", "").strip()
    match = _ATOM.fullmatch(bare)
    if match:
        letter, mark = match["letter"], match["mark"] or match["after"] or ""
        index = (match["index"] or "").strip("{}")
    else:
        letter, mark, index = rf"\left({name}\right)", "", ""
    apart = "," if max(rows, columns) > 9 else ""
    names = {}
    for component, (i, j) in zip(matrix, indices, strict=True):
        number = f"{i}" if columns == 1 else f"{i}{apart}{j}"
        names[component] = f"{letter}{mark}_{{{index + ',' if index else ''}{number}}}"
    return names


_SILENT = frozenset(
    "left right bigl bigr Bigl Bigr big Big mathrm mathcal mathbf vec bar hat tilde dot text displaystyle tfrac frac "
    "dfrac sqrt operatorname begin end overline".split()
)
_TOKEN = re.compile(r"\\[A-Za-z]+|\\.|[{}^_&]|\s+|.", re.DOTALL)
_SIGNS = ("+", "-", r"\cdot", r"\wedge", r"\vee", r"\Rightarrow")
_OPENING, _CLOSING = ("{", r"\left", r"\begin"), ("}", r"\right", r"\end")
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
