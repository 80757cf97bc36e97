"""Printers: how an expression of a kernel is written in each language.

A printer turns one SymPy expression into one line of source. It is all that a new target language needs
besides a template: name the operators that differ, and the table of elementary functions.
"""

from __future__ import annotations

from typing import ClassVar

import sympy as sp
from sympy.core.relational import Relational
from sympy.printing.codeprinter import CodePrinter
from sympy.printing.precedence import PRECEDENCE, precedence

from rodgen.codegen.kernel import KernelError
from rodgen.symbolic import EPS, LARGEST

__all__ = ["CPrinter", "KernelPrinter", "NumPyPrinter", "VectorCPrinter"]

ELEMENTARY = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log")


class KernelPrinter(CodePrinter):  # type: ignore[misc]
    """What every target has in common: products in place of small powers, exact constants, no surprises."""

    language = "a kernel language"
    functions: ClassVar[dict[str, str]] = {}
    largest_power_as_product = 4
    conjunction, disjunction, negation = " & ", " | ", "~"

    def __init__(self) -> None:
        super().__init__({"strict": False})

    def line(self, value: sp.Basic) -> str:
        """Return `value` as source text in one line; KernelError where the language cannot say it."""
        self._not_supported: set[sp.Basic] = set()
        text = str(self._print(value)).replace("\n", " ")
        if self._not_supported:
            raise KernelError(f"{self.language} cannot write {min(map(str, self._not_supported))}")
        return text

    # numbers -----------------------------------------------------------------

    def number(self, value: float) -> str:
        """Write a floating-point constant."""
        return repr(float(value))

    def _print_Integer(self, expr: sp.Integer) -> str:
        return self.number(int(expr)) if expr >= 0 else f"-{self.number(-int(expr))}"

    def _print_Rational(self, expr: sp.Rational) -> str:
        p, q = int(expr.p), int(expr.q)
        if q & (q - 1) == 0:
            return self.number(p / q)
        return f"{self.number(p)}/{self.number(q)}"

    def _print_Float(self, expr: sp.Float) -> str:
        raise KernelError(
            f"the float {float(expr):.6g} stands in a kernel; expected an exact number, such as sp.Rational(1, 2)"
        )

    def _print_NumberSymbol(self, expr: sp.Basic) -> str:
        return self.number(float(expr))

    def not_a_number(self) -> str:
        """Write NaN."""
        raise NotImplementedError

    def _print_NaN(self, expr: sp.Basic) -> str:
        return self.not_a_number()

    # operators ---------------------------------------------------------------

    def square_root(self, argument: str) -> str:
        """Write a square root."""
        raise NotImplementedError

    def power(self, base: str, exponent: str) -> str:
        """Write a general power."""
        raise NotImplementedError

    def _print_Pow(self, expr: sp.Pow) -> str:
        base, exponent = expr.args
        if exponent.is_negative:
            below = self.parenthesize(sp.Pow(base, -exponent), PRECEDENCE["Pow"])
            return f"{self.number(1)}/{below}"
        if exponent == 1:
            return str(self._print(base))
        if exponent == sp.S.Half:
            return self.square_root(self._print(base))
        if exponent.is_Integer and exponent <= self.largest_power_as_product:
            factor = self.parenthesize(base, PRECEDENCE["Pow"])
            return "(" + "*".join([factor] * int(exponent)) + ")"
        return self.power(self._print(base), self._print(exponent))

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
        numerator = "*".join(above) or self.number(1)
        if not below:
            return numerator
        return f"{numerator}/{below[0]}" if len(below) == 1 else f"{numerator}/({'*'.join(below)})"

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
        if item.is_Rational and not item.is_Integer and "/" in printed:
            binds = PRECEDENCE["Mul"]
        return f"({printed})" if binds < level or (strict and binds == level) else printed

    # functions ---------------------------------------------------------------

    def _print_Function(self, expr: sp.Function) -> str:
        name = type(expr).__name__
        if name not in self.functions:
            known = ", ".join(sorted(self.functions))
            raise KernelError(f"{self.language} has no {name}(); a kernel may use {known}, sqrt and select")
        return f"{self.functions[name]}({', '.join(str(self._print(a)) for a in expr.args)})"

    def _print_Expr(self, expr: sp.Expr) -> str:
        return self._print_Function(expr)  # Max, integrals and the like: told, too

    # conditions --------------------------------------------------------------

    def _print_Relational(self, expr: Relational) -> str:
        return f"{self._print(expr.lhs)} {expr.rel_op} {self._print(expr.rhs)}"

    def _print_And(self, expr: sp.And) -> str:
        return self._joined(expr, self.conjunction)

    def _print_Or(self, expr: sp.Or) -> str:
        return self._joined(expr, self.disjunction)

    def _joined(self, expr: sp.And | sp.Or, operator: str) -> str:
        return operator.join(f"({self._print(a)})" for a in sorted(expr.args, key=sp.default_sort_key))

    def _print_Not(self, expr: sp.Not) -> str:
        return f"{self.negation}({self._print(expr.args[0])})"


class NumPyPrinter(KernelPrinter):
    """NumPy expressions on whole arrays."""

    language = "NumPy"
    functions: ClassVar[dict[str, str]] = {
        **{name: f"np.{name}" for name in ELEMENTARY},
        **{f"a{name}": f"np.arc{name}" for name in ("sin", "cos", "tan", "tan2")},
        "atan2": "np.arctan2",
        "Abs": "np.abs",
        "sign": "np.sign",
        "power_of_two_scale": "_power_of_two_scale",
    }

    def not_a_number(self) -> str:
        """Write NaN."""
        return "np.nan"

    def square_root(self, argument: str) -> str:
        """Write a square root."""
        return f"np.sqrt({argument})"

    def power(self, base: str, exponent: str) -> str:
        """Write a general power."""
        return f"np.power({base}, {exponent})"

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return str(expr.name)

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *cases, (last, _) = expr.args
        text = str(self._print(last))
        for value, condition in reversed(cases):
            text = f"np.where({self._print(condition)}, {self._print(value)}, {text})"
        return text

    def _print_BooleanTrue(self, expr: sp.Basic) -> str:
        return "True"

    def _print_BooleanFalse(self, expr: sp.Basic) -> str:
        return "False"


class CPrinter(KernelPrinter):
    """C99 expressions on scalars, in ``double`` or ``float``."""

    language = "C"
    conjunction, disjunction, negation = " && ", " || ", "!"

    def __init__(self, real: str = "double") -> None:
        super().__init__()
        self.real = real
        self.suffix = "f" if real == "float" else ""
        bits = "f32" if real == "float" else "f64"
        self.functions = {  # type: ignore[misc]
            **{name: name + self.suffix for name in ELEMENTARY},
            "Abs": "fabs" + self.suffix,
            "sign": f"sign_{bits}",
            "power_of_two_scale": f"power_of_two_scale_{bits}",
        }
        self.constants = {
            EPS: "FLT_EPSILON" if real == "float" else "DBL_EPSILON",
            LARGEST: "FLT_MAX" if real == "float" else "DBL_MAX",
        }

    def number(self, value: float) -> str:
        """Write a floating-point constant with the suffix of its type."""
        return repr(float(value)) + self.suffix

    def not_a_number(self) -> str:
        """Write NaN."""
        return f"({self.real})NAN"  # NAN is a float

    def square_root(self, argument: str) -> str:
        """Write a square root."""
        return f"sqrt{self.suffix}({argument})"

    def power(self, base: str, exponent: str) -> str:
        """Write a general power."""
        return f"pow{self.suffix}({base}, {exponent})"

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self.constants.get(expr, str(expr.name))

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *cases, (last, _) = expr.args
        text = str(self._print(last))
        for value, condition in reversed(cases):
            text = f"(({self._print(condition)}) ? {self._print(value)} : {text})"
        return text

    def _print_BooleanTrue(self, expr: sp.Basic) -> str:
        return "1"

    def _print_BooleanFalse(self, expr: sp.Basic) -> str:
        return "0"


class VectorCPrinter(CPrinter):
    """C99 expressions inside a loop that the compiler vectorises.

    Sine, cosine and arc tangent are inline polynomials: a call to libm would stop vectorisation, and compilers fuse sin
    and cos of one argument into a call that has no vector form. A condition is a mask of bits and a select blends
    with it: from ``?:`` compilers make control flow, and then no vectors (gcc 12 with nested conditions).
    """

    conjunction, disjunction, negation = (
        KernelPrinter.conjunction,
        KernelPrinter.disjunction,
        KernelPrinter.negation,
    )

    def __init__(self, real: str = "double") -> None:
        super().__init__(real)
        self.bits = "f32" if real == "float" else "f64"
        self.mask_type = "int32_t" if real == "float" else "int64_t"
        self.functions = {  # type: ignore[misc]
            "sin": f"vector_sin_{self.bits}",
            "cos": f"vector_cos_{self.bits}",
            "atan2": f"vector_atan2_{self.bits}",
            "Abs": "fabs" + self.suffix,
            "sign": f"sign_{self.bits}",
            "power_of_two_scale": f"power_of_two_scale_{self.bits}",
        }

    def _print_Piecewise(self, expr: sp.Piecewise) -> str:
        *cases, (last, _) = expr.args
        text = str(self._print(last))
        for value, condition in reversed(cases):
            text = f"blend_{self.bits}({self._print(condition)}, {self._print(value)}, {text})"
        return text

    def _print_Relational(self, expr: Relational) -> str:
        return f"mask_{self.bits}({super()._print_Relational(expr)})"

    def _print_BooleanTrue(self, expr: sp.Basic) -> str:
        return f"({self.mask_type})-1"

    def _print_BooleanFalse(self, expr: sp.Basic) -> str:
        return f"({self.mask_type})0"
