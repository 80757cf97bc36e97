"""The operations of programs, and how each language writes them: a language is a column.

``{}`` stand for the operands. What ends with a bracket is a call, whose operands need no brackets of their own.
"""

from __future__ import annotations

from typing import NamedTuple


class Operation(NamedTuple):
    """How an operation is written."""

    c: str
    """In C and C++, on numbers."""
    lanes: str
    """In C, on vectors of rows; see the template ``rows.c.j2``."""
    array: str
    """The function of the array API standard, which NumPy and JAX have."""
    matlab: str
    """In MATLAB and GNU Octave, on rows of numbers; see the template ``helpers.m.j2``."""


OPERATIONS = {
    "add": Operation("{} + {}", "{} + {}", "add", "{} + {}"),
    "sub": Operation("{} - {}", "{} - {}", "subtract", "{} - {}"),
    "mul": Operation("{}*{}", "{}*{}", "multiply", "{}.*{}"),
    "neg": Operation("-{}", "-{}", "negative", "-{}"),
    "div": Operation("{}/{}", "{}/{}", "divide", "{}./{}"),
    "recip": Operation("1.0/{}", "1.0/{}", "reciprocal", "1.0./{}"),
    "lt": Operation("{} < {}", "{} < {}", "less", "{} < {}"),
    "le": Operation("{} <= {}", "", "less_equal", "{} <= {}"),
    "eq": Operation("{} == {}", "", "equal", "{} == {}"),
    "ne": Operation("{} != {}", "", "not_equal", "{} ~= {}"),
    "and": Operation("{} && {}", "", "logical_and", "{} & {}"),
    "or": Operation("{} || {}", "", "logical_or", "{} | {}"),
    "not": Operation("!{}", "", "logical_not", "~{}"),
    "select": Operation("{} ? {} : {}", "lanes_blend({}, {}, {})", "where", "select({}, {}, {})"),
    "abs": Operation("fabs({})", "lanes_magnitude({})", "abs", "abs({})"),
    "sign": Operation("sign_of_number({})", "lanes_sign({})", "sign", "sign_of({})"),
    "sqrt": Operation("sqrt({})", "lanes_root({})", "sqrt", "real_sqrt({})"),
    "pow": Operation("pow({}, {})", "lanes_pow({}, {})", "pow", "real_power({}, {})"),
    "sin": Operation("sin({})", "lanes_sin({})", "sin", "sin({})"),
    "cos": Operation("cos({})", "lanes_cos({})", "cos", "cos({})"),
    "tan": Operation("tan({})", "lanes_tan({})", "tan", "tan({})"),
    "asin": Operation("asin({})", "lanes_asin({})", "asin", "real_asin({})"),
    "acos": Operation("acos({})", "", "acos", "real_acos({})"),
    "atan": Operation("atan({})", "", "atan", "atan({})"),
    "atan2": Operation("atan2({}, {})", "lanes_atan2({}, {})", "atan2", "atan2({}, {})"),
    "sinh": Operation("sinh({})", "", "sinh", "sinh({})"),
    "cosh": Operation("cosh({})", "", "cosh", "cosh({})"),
    "tanh": Operation("tanh({})", "", "tanh", "tanh({})"),
    "exp": Operation("exp({})", "lanes_exp({})", "exp", "exp({})"),
    "log": Operation("log({})", "lanes_log({})", "log", "real_log({})"),
    "power_of_two_scale": Operation("power_of_two_scale({})", "", "", "power_of_two_scale({})"),
    "pi": Operation("", "", "", ""),
}
"""What is in the kernels of papers only is not written on vectors of rows."""

CONDITION = "lt"
"""The operation that gives truth values in a program over rows."""

COMPARISONS = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
"""Operations that compare two numbers, and their signs."""

CONDITIONS = frozenset({*COMPARISONS, "and", "or", "not"})
"""Operations that give truth values."""

OPERATORS = frozenset({"add", "sub", "mul", "div", "neg", "recip"})
"""Operations that C writes alike for numbers and vectors."""

CPP_WORDS = """
alignas alignof and_eq asm bitand bitor catch char8_t char16_t char32_t co_await co_return co_yield compl
concept const_cast consteval constexpr constinit decltype delete dynamic_cast explicit export friend mutable
namespace new noexcept not_eq nullptr operator or_eq private protected public reinterpret_cast requires
signals slots static_assert static_cast std template this thread_local throw typeid typename using virtual
wchar_t xor xor_eq
DOMAIN EDOM EOF ERANGE FALSE HUGE HUGE_VAL OVERFLOW PLOSS Real SING TLOSS TRUE UNDERFLOW detail
"""
"""Words that C++ keeps, macros of its headers, and names in the template."""
MATLAB_WORDS = """
case catch classdef do else elseif end end_try_catch end_unwind_protect endclassdef endfor endfunction endif endparfor
endswitch endwhile function global if otherwise parfor persistent return spmd switch try until unwind_protect
unwind_protect_cleanup while
"""
"""Words that MATLAB and GNU Octave keep."""
