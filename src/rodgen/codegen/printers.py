"""Printers: how an expression of a kernel, and its lines, are written in each language.

A printer turns one SymPy expression into one line of source. It is all that a new target language needs
apart from a template: the operators that differ, and the table of elementary functions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import sympy as sp
from sympy.core.relational import Relational
from sympy.printing.codeprinter import CodePrinter
from sympy.printing.precedence import PRECEDENCE, precedence

from rodgen.codegen.kernel_parts import KernelError, Port
from rodgen.codegen.operations import CPP_WORDS, MATLAB_WORDS
from rodgen.symbolic import EPS, LARGEST

if TYPE_CHECKING:
    from rodgen.codegen.kernel import Kernel

ELEMENTARY = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log")

_MATLAB_NAMES = "assembled count eps evaluate given_columns kind NaN realmax real_power real_sqrt select"
"""Names in the template."""


class KernelPrinter(CodePrinter):  # type: ignore[misc]
    """What every target has in common: products in place of small powers, exact constants, no surprises."""

    language = "a kernel language"
    functions: ClassVar[dict[str, str]] = {}
    constants: ClassVar[dict[sp.Symbol, str]] = {}
    literal, not_a_number = "{!r}", ""
    square_root, general_power = "", ""
    choice = ""
    """Of a condition, the value where it holds, and the other."""
    truth = "True", "False"
    largest_power_as_product = 4
    comparison, conjunction, disjunction, negation = "{}", " & ", " | ", "~"
    times, over, unequal = "*", "/", "!="
    reserved: ClassVar[frozenset[str]] = frozenset()
    """Words that a kernel may have in Python and C, and not in this language."""
    longest_name = 1000

    def __init__(self) -> None:
        super().__init__({"strict": False})

    def line(self, value: sp.Basic) -> str:
        """Return `value` as source text in one line; a KernelError if the language has no word for it."""
        self._not_supported: set[sp.Basic] = set()
        text = str(self._print(value)).replace("\n", " ")
        if self._not_supported:
            raise KernelError(f"{self.language} cannot write {min(map(str, self._not_supported))}")
        return text

    # numbers -----------------------------------------------------------------

    def number(self, value: float) -> str:
        """Write a floating-point constant."""
        return self.literal.format(float(value))

    def _print_Integer(self, expr: sp.Integer) -> str:
        return self.number(int(expr)) if expr >= 0 else f"-{self.number(-int(expr))}"

    def _print_Rational(self, expr: sp.Rational) -> str:
        sign, p, q = "-" if expr.p < 0 else "", abs(int(expr.p)), int(expr.q)
        if q & (q - 1) == 0:
            return f"{sign}{self.number(p / q)}"
        return f"{sign}{self.number(p)}{self.over}{self.number(q)}"

    def _print_Float(self, expr: sp.Float) -> str:
        raise KernelError(
            f"the float {float(expr):.6g} stands in a kernel; expected an exact number, such as sp.Rational(1, 2)"
        )

    def _print_NumberSymbol(self, expr: sp.Basic) -> str:
        return self.number(float(expr))

    def _print_NaN(self, expr: sp.Basic) -> str:
        return self.not_a_number

    # operators ---------------------------------------------------------------

    def _print_Pow(self, expr: sp.Pow) -> str:
        base, exponent = expr.args
        if exponent.is_negative:
            below = self.parenthesize(sp.Pow(base, -exponent), PRECEDENCE["Pow"])
            return f"{self.number(1)}{self.over}{below}"
        if exponent == 1:
            return str(self._print(base))
        if exponent == sp.S.Half:
            return self.square_root.format(self._print(base))
        if exponent.is_Integer and exponent <= self.largest_power_as_product:
            factor = self.parenthesize(base, PRECEDENCE["Pow"])
            return "(" + self.times.join([factor] * int(exponent)) + ")"
        return self.general_power.format(self._print(base), self._print(exponent))

    def _print_Mul(self, expr: sp.Mul) -> str:
        coefficient, rest = expr.as_coeff_Mul()
        if coefficient.is_negative:
            return "-" + self.parenthesize(-coefficient * rest, PRECEDENCE["Mul"])
        above: list[str] = []
        below: list[str] = []
        for factor in expr.as_ordered_factors():
            if isinstance(factor, sp.Pow) and factor.exp.is_negative:
                below.append(self.parenthesize(sp.Pow(factor.base, -factor.exp), PRECEDENCE["Pow"]))
            elif isinstance(factor, sp.Rational) and factor.q != 1 and int(factor.q) & (int(factor.q) - 1):
                if factor.p != 1:
                    above.append(self.number(int(factor.p)))
                below.append(self.number(int(factor.q)))
            else:
                above.append(self.parenthesize(factor, PRECEDENCE["Mul"]))
        numerator = self.times.join(above) or self.number(1)
        if not below:
            return numerator
        denominator = below[0] if len(below) == 1 else f"({self.times.join(below)})"
        return f"{numerator}{self.over}{denominator}"

    def _print_Add(self, expr: sp.Add) -> str:
        text = ""
        # positive terms first: fewer signs, and the same order in every target
        terms = sorted(self._as_ordered_terms(expr), key=lambda t: bool(t.could_extract_minus_sign()))
        for term in terms:
            printed = self.parenthesize(term, PRECEDENCE["Add"])
            if not text:
                text = printed
            elif printed.startswith("-"):
                text += f" - {printed[1:]}"
            else:
                text += f" + {printed}"
        return text

    def parenthesize(self, item: sp.Basic, level: int, strict: bool = False) -> str:
        """Print `item`, in parentheses where it binds less than `level`."""
        printed = str(self._print(item))
        if isinstance(item, sp.Pow) and item.exp.is_negative and level > PRECEDENCE["Add"]:
            return f"({printed})"
        if isinstance(item, sp.Piecewise | sp.Symbol | sp.Function | sp.Pow):
            return printed
        binds = precedence(item)
        if item.is_Rational and not item.is_Integer and self.over in printed:
            binds = PRECEDENCE["Mul"]
        return f"({printed})" if binds < level or (strict and binds == level) else printed

    # names and functions -----------------------------------------------------

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self.constants.get(expr, str(expr.name))

    def _print_Function(self, expr: sp.Function) -> str:
        name = type(expr).__name__
        if name not in self.functions:
            known = ", ".join(sorted(self.functions))
            raise KernelError(f"{self.language} has no {name}(); a kernel may use {known}, sqrt and select")
        return f"{self.functions[name]}({', '.join(str(self._print(a)) for a in expr.args)})"

    def _print_Expr(self, expr: sp.Expr) -> str:
        return self._print_Function(expr)  # an error for Max, integrals and the like, too

    # conditions --------------------------------------------------------------

    def _print_Relational(self, expr: Relational) -> str:
        operator = self.unequal if isinstance(expr, sp.Ne) else expr.rel_op
        return self.comparison.format(f"{self._print(expr.lhs)} {operator} {self._print(expr.rhs)}")

    def _print_And(self, expr: sp.And) -> str:
        return self._joined(expr, self.conjunction)

    def _print_Or(self, expr: sp.Or) -> str:
        return self._joined(expr, self.disjunction)

    def _joined(self, expr: sp.And | sp.Or, operator: str) -> str:
        return operator.join(f"({self._print(a)})" for a in sorted(expr.args, key=sp.default_sort_key))

    def _print_Not(self, expr: sp.Not) -> str:
        return f"{self.negation}({self._print(expr.args[0])})"

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *cases, (last, _) = expr.args
        text = str(self._print(last))
        for value, condition in reversed(cases):
            text = self.choice.format(self._print(condition), self._print(value), text)
        return text

    def _print_BooleanTrue(self, expr: sp.Basic) -> str:
        return self.truth[0]

    def _print_BooleanFalse(self, expr: sp.Basic) -> str:
        return self.truth[1]


class ArrayPrinter(KernelPrinter):
    """Expressions on whole arrays, with the names of the array API standard, which NumPy and others have.

    Parameters
    ----------
    namespace : str
        The module's name in the code: ``np``, ``jnp``, or ``xp`` for whichever the arrays are of.
    """

    language = "NumPy"

    def __init__(self, namespace: str = "np") -> None:
        super().__init__()
        self.not_a_number = f"{namespace}.nan"
        self.square_root, self.general_power = f"{namespace}.sqrt({{}})", f"{namespace}.pow({{}}, {{}})"
        self.choice = f"{namespace}.where({{}}, {{}}, {{}})"
        self.functions = {  # type: ignore[misc]  # a table for each namespace
            **{name: f"{namespace}.{name}" for name in (*ELEMENTARY, "sign")},
            "Abs": f"{namespace}.abs",
            "power_of_two_scale": "_power_of_two_scale",
        }

    def _print_Pow(self, expr: sp.Pow) -> str:
        of_arrays = expr.free_symbols - {EPS, LARGEST}  # which the functions of the standard take
        if of_arrays or expr.exp.is_Integer or expr.exp.is_negative:
            return super()._print_Pow(expr)
        if expr.is_number:
            return self.number(float(expr))
        return f"{self.parenthesize(expr.base, PRECEDENCE['Pow'])}**{self.number(expr.exp)}"


class MatlabPrinter(KernelPrinter):
    """Expressions on rows of numbers in MATLAB and GNU Octave, where `kind` is the class of the numbers."""

    language = "MATLAB"
    times, over, unequal = ".*", "./", "~="
    not_a_number, truth = "NaN", ("true", "false")
    square_root, general_power, choice = "real_sqrt({})", "real_power({}, {})", "select({}, {}, {})"
    functions: ClassVar[dict[str, str]] = {
        **{name: name for name in (*ELEMENTARY, "power_of_two_scale")},
        **{name: f"real_{name}" for name in ("asin", "acos", "log")},
        "Abs": "abs",
        "sign": "sign_of",  # a sign is a likely name
    }
    constants: ClassVar[dict[sp.Symbol, str]] = {EPS: "eps(kind)", LARGEST: "realmax(kind)"}
    reserved = frozenset({*MATLAB_WORDS.split(), *_MATLAB_NAMES.split(), *functions.values()})
    longest_name = 63


C_MACROS = {
    **{name.upper(): (f"{name}{{f}}", "x") for name in (*ELEMENTARY, "sqrt", "fabs")},
    **{name.upper(): (f"{name}{{f}}", "x, y") for name in ("atan2", "pow")},
    **{name.upper(): (f"{name}_{{bits}}", "x") for name in ("sign", "power_of_two_scale")},
}
"""The macros that :class:`CPrinter` calls: the function that each calls, and its arguments.

``{f}`` is the ending of C's functions on floats, ``{bits}`` that of the helpers in the templates.
"""


class CPrinter(KernelPrinter):
    """C99 expressions in a type REAL, which is ``double`` or ``float`` where they are compiled.

    Constants, functions and choices are macros. Each type has constants of its own precision: ``K(0.1)`` is ``0.1`` or
    ``0.1f``. In the loops that the compiler vectorises sine, cosine and arc tangent are inline polynomials: a call to
    libm would stop vectorisation, and compilers fuse sin and cos of one argument into a call that has no vector form. A
    condition is a mask of bits there and a select blends with it: from ``?:`` compilers make control flow, and then no
    vectors (gcc 12 with nested conditions).
    """

    language = "C"
    real, condition = "REAL", "CONDITION"
    literal, not_a_number, truth = "K({!r})", "(REAL)NAN", ("TEST(1)", "TEST(0)")
    square_root, general_power, choice = "SQRT({})", "POW({}, {})", "SELECT({}, {}, {})"
    comparison, negation = "TEST({})", "NOT"
    functions: ClassVar[dict[str, str]] = {
        **{name: name.upper() for name in (*ELEMENTARY, "sign", "power_of_two_scale")},
        "Abs": "FABS",
    }
    constants: ClassVar[dict[sp.Symbol, str]] = {EPS: "REAL_EPSILON", LARGEST: "REAL_MAX"}

    def component(self, port: Port, number: int) -> str:
        """Write what a component of an output is stored in."""
        return f"{port.name}[AT({number})]" if port.shape != () else f"*{port.name}"

    def code(self, port: Port, value: str) -> str:
        """Write a number as a code of a status."""
        return f"(CODE){value}"


class CppPrinter(CPrinter):
    """C++17 expressions in a type ``Real``, the parameter of a template.

    Parameters
    ----------
    only : bool
        Whether the kernel has one output, which is returned as it is; several are members of a structure.
    """

    language = "C++"
    real, condition = "Real", "bool"
    literal, not_a_number = "Real({!r})", "std::numeric_limits<Real>::quiet_NaN()"
    square_root, general_power, choice = "std::sqrt({})", "std::pow({}, {})", "(({}) ? {} : {})"
    comparison, conjunction, disjunction, negation = "{}", " && ", " || ", "!"
    truth = "true", "false"
    functions: ClassVar[dict[str, str]] = {
        **{name: f"std::{name}" for name in ELEMENTARY},
        "Abs": "std::fabs",
        **{name: f"detail::{name}" for name in ("sign", "power_of_two_scale")},
    }
    constants: ClassVar[dict[sp.Symbol, str]] = {
        EPS: "std::numeric_limits<Real>::epsilon()",
        LARGEST: "(std::numeric_limits<Real>::max)()",  # which windows.h makes a macro of
    }
    reserved = frozenset(CPP_WORDS.split())

    def __init__(self, only: bool = False) -> None:
        super().__init__()
        self.only = only

    def component(self, port: Port, number: int) -> str:
        """Write what a component of an output is stored in: matrices are arrays of rows."""
        places = np.unravel_index(number, port.shape) if port.shape else ()
        return ("out" if self.only else f"out.{port.name}") + "".join(f"[{i}]" for i in places)

    def code(self, port: Port, value: str) -> str:
        """Write a number as a code of a status."""
        return f"static_cast<{port.enum.__name__ if port.enum else 'int'}>({value})"


# the lines of a kernel ------------------------------------------------------------------------------------


def symbols_read(kernel: Kernel) -> set[sp.Symbol]:
    """Return the symbols on the right side of the assignments."""
    return {s for a in kernel.assignments for s in a.value.free_symbols}


WAITING = 16
"""So many arrays that no later line reads are kept at most: few enough for those in use to stay in the cache."""


def numpy_lines(kernel: Kernel, printer: ArrayPrinter) -> Iterator[str]:
    """Yield the assignments in Python, on arrays; now and then those that no later line reads are deleted."""
    kept = {EPS, LARGEST, *(s for p in (*kernel.inputs, *kernel.outputs) for s in p.symbols)}
    last_use = {s: n for n, (_, value) in enumerate(kernel.assignments) for s in value.free_symbols - kept}
    done: list[str] = []
    for n, (symbol, value) in enumerate(kernel.assignments):
        yield f"{symbol.name} = {printer.line(value)}"
        done += sorted(str(s.name) for s in value.free_symbols - kept if last_use[s] == n)
        if len(done) >= WAITING:
            yield f"del {', '.join(done)}"
            done = []


def c_lines(kernel: Kernel, printer: CPrinter, angles: Sequence[sp.Expr] = ()) -> tuple[list[str], list[str]]:
    """Return the lines of C or C++ that compute, and those that store the outputs, and angles for a later look."""
    targets = {s: (printer.component(p, i), p) for p in kernel.outputs for i, s in enumerate(p.symbols)}
    used_later = symbols_read(kernel)
    # a number's output is a pointer of that name; where the number is read again it has a name of its own
    renamed = {
        s: type(s)(f"{s.name}_value", real=True)
        for s, (_, port) in targets.items()
        if s in used_later and port.shape == ()
    }
    body, stores = [], []
    for assignment in kernel.assignments:
        symbol, text = assignment.symbol, printer.line(assignment.value.xreplace(renamed))
        if symbol not in targets:
            kind = printer.condition if assignment.is_condition else printer.real
            body.append(f"const {kind} {symbol.name} = {text};")
            continue
        target, port = targets[symbol]
        if symbol in used_later or (port.shape == () and port.is_status):
            name = f"{symbol.name}_value" if port.shape == () else symbol.name
            body.append(f"const {printer.real} {name} = {text};")
            text = name
        stores.append(f"{target} = {printer.code(port, text) if port.is_status else text};")
    looked_at = (printer.line(angle.xreplace(renamed)) for angle in angles)
    return body, [*stores, *(f"ANGLE({n}, {text});" for n, text in enumerate(looked_at))]
