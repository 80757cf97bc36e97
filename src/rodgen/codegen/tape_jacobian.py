"""Derivatives of numbers of a tape: forward, or by sweeps backwards, of which one may do for all rows of a Jacobian.

Forward, the derivatives of a number are those of its operands times slopes. Backwards, a number whose adjoint, the
derivative of an output with respect to it, is t adds t times a slope to the adjoint of each of its operands.
:func:`jacobian_row` starts one sweep from all outputs, each with a seed: that is 1 in its own row of the Jacobian and 0
in the others. So the operations of the sweep are written once, and done for every row.

Where a part of the program acts on the outputs through one number only, as errors of a reading act through the angle of
their joint, the derivatives of that number are computed once, without a seed, and multiplied: a robot whose drives wind
up under the weights of all later joints needs half of the operations.

Backwards, the case of a select that is not taken must be finite, with its slopes, unless it is NaN: its derivative is
multiplied by 0 there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any, TypeAlias

from rodgen.codegen.operations import CONDITIONS
from rodgen.codegen.program import GIVEN
from rodgen.codegen.tape import Number, Value, cos, log, needed, select, sign, sin, sqrt

Edges: TypeAlias = dict[Number, list[tuple[Number, Any]]]
"""The operands of each number that depend on a variable, with its slope: a value, or a function of the adjoint."""


def jacobian_row(outputs: Sequence[Any], variables: Sequence[Number]) -> list[Value]:
    """Return the derivatives with respect to inputs of the sum of values times the seeds of their tape.

    They are the row of the Jacobian for the output whose seed is 1 where the others are 0.

    Examples
    --------
    >>> from rodgen.codegen.tape import Tape
    >>> tape = Tape()
    >>> (a, b), (s, t) = tape.inputs("p", 2), tape.seeds(2)
    >>> jacobian_row([a * b + 3 * a, b], [a, b]) == [s * (b + 3), s * a + t]
    True
    """
    tape = variables[0].tape
    edges = _edges([x for x in outputs if isinstance(x, Number)], variables)
    _narrow(edges, outputs)
    adjoints: dict[Number, Value] = {}
    seeds: Sequence[Value] = tape.seeds(len(outputs)) if len(outputs) > 1 else [1]
    for x, seed in zip(outputs, seeds, strict=True):
        if x in edges:
            adjoints[x] = adjoints.get(x, 0) + seed
    orders = _swept(edges, adjoints, edges)
    return [orders.get(x, 0) for x in variables]


def jacobian(
    outputs: Sequence[Any], variables: Sequence[Number], held: Collection[Any] = ()
) -> list[list[Value]]:
    """Return the derivatives of values with respect to inputs, row by row, in the way that takes fewest operations.

    Numbers that are held count as constants.

    Examples
    --------
    >>> from rodgen.codegen.tape import Tape
    >>> (a, b) = Tape().inputs("p", 2)
    >>> jacobian([a * b + 3 * a, b], [a, b]) == [[b + 3, a], [0, 1]]
    True
    """
    edges = _edges([x for x in outputs if isinstance(x, Number)], variables, held)
    narrow = dict(edges)
    of_narrow = _narrow(narrow, outputs)
    rows_swept = [
        way(*((narrow, of_narrow) if is_narrow else (edges, set())), outputs, variables)
        for way, is_narrow in _WAYS
    ]
    return min(rows_swept, key=lambda rows: len(needed([*outputs, *(x for row in rows for x in row)])))


def forward(outputs: Sequence[Any], variables: Sequence[Number]) -> list[list[Value]]:
    """Return the derivatives of values with respect to inputs, row by row, taken forward.

    A select keeps its condition and takes one slope of two, so that the case that is not taken may be infinite.

    Examples
    --------
    >>> from rodgen.codegen.tape import Tape
    >>> (a, b) = Tape().inputs("p", 2)
    >>> forward([a * b + 3 * a, b], [a, b]) == [[b + 3, a], [0, 1]]
    True
    """
    edges = _edges([x for x in outputs if isinstance(x, Number)], variables)
    return _forward(edges, _narrow(edges, outputs, selects=False), outputs, variables)


def _forward(
    edges: Edges, narrow: Collection[Number], outputs: Sequence[Any], variables: Sequence[Number]
) -> list[list[Value]]:
    tangents: dict[Number, dict[Number, Any]] = {x: {x: 1} for x in variables}
    for x, operands in reversed(edges.items()):
        if x.op == "select" and x not in narrow:
            holds, *cases = x.args
            both = [_tangents(case, tangents) for case in cases]
            rest = [math.nan if case != case else 0 for case in cases]  # what has no value has no derivative
            tangents[x] = {
                v: select(holds, *(t.get(v, zero) for t, zero in zip(both, rest, strict=True)))
                for v in variables
                if any(v in t for t in both)
            }
        elif operands:
            tangent_there = tangents[x] = {}
            for a, slope in operands:
                for v, tangent in tangents[a].items():
                    share = tangent * slope
                    tangent_there[v] = tangent_there[v] + share if v in tangent_there else share
    return [[_tangents(x, tangents).get(v, 0) for v in variables] for x in outputs]


def _tangents(x: Any, tangents: Mapping[Number, dict[Number, Any]]) -> dict[Number, Any]:
    return tangents.get(x, {}) if isinstance(x, Number) else {}


def _backward(
    edges: Edges, narrow: Collection[Number], outputs: Sequence[Any], variables: Sequence[Number]
) -> list[list[Value]]:
    rows = [_swept(edges, {x: 1}, edges) if x in edges else {} for x in outputs]
    return [[row.get(v, 0) for v in variables] for row in rows]


_WAYS = ((_forward, True), (_backward, False), (_backward, True))
"""How a Jacobian is taken, and whether narrow parts are taken first: forward that pays always."""


def _edges(outputs: Sequence[Number], variables: Sequence[Number], held: Collection[Any] = ()) -> Edges:
    """Return what depends on a variable and what outputs depend on, later numbers first."""
    free, edges = set(variables), Edges()
    for x in needed(outputs):
        operands = [] if x.op in GIVEN or x in held else _slopes(x)
        slopes = [(a, slope()) for a, slope in operands if isinstance(a, Number) and a in edges]
        if slopes or x in free:
            edges[x] = slopes
    reached = set(outputs)
    for x, slopes in reversed(edges.items()):
        if x in reached:
            reached.update(a for a, _ in slopes)
    return {x: slopes for x, slopes in reversed(edges.items()) if x in reached}


def _swept(edges: Edges, adjoints: dict[Number, Value], part: Iterable[Number]) -> dict[Number, Value]:
    """Return the adjoints that a sweep through a part leaves: of variables, and of what is not in the part."""
    adjoints = dict(adjoints)
    for x in part:
        if x not in adjoints or not edges[x]:
            continue
        adjoint = adjoints.pop(x)
        for operand, slope in edges[x]:
            share = slope(adjoint) if callable(slope) else adjoint * slope
            adjoints[operand] = adjoints[operand] + share if operand in adjoints else share
    return adjoints


def _narrow(edges: Edges, outputs: Sequence[Any], *, selects: bool = True) -> set[Number]:
    """Replace the operands of the numbers whose own derivatives pay by what these are with respect to.

    Without `selects` parts that have some are left out: the case that is not taken may be infinite.
    """
    parts = _narrow_parts(edges, [x for x in outputs if x in edges], selects)
    for narrow, part in parts:
        edges[narrow] = list(_swept(edges, {narrow: 1}, part).items())
    return {narrow for narrow, _ in parts}


def _narrow_parts(
    edges: Edges, outputs: Sequence[Number], selects: bool
) -> list[tuple[Number, list[Number]]]:
    """Return the numbers whose own derivatives pay, each with what acts through it alone; no two share a number.

    A number dominates what all ways from the outputs lead to through it.
    """
    above: dict[Number, Number | None] = dict.fromkeys(outputs)  # the next number that dominates each
    depth: dict[Number | None, int] = {None: 0}
    reached = dict.fromkeys(edges, 0)  # by which outputs, a bit each
    for n, x in enumerate(outputs):
        reached[x] |= 1 << n
    for x, operands in edges.items():
        depth[x] = depth[above[x]] + 1
        for a, _ in operands:
            reached[a] |= reached[x]
            above[a] = _common(above, depth, above[a], x) if a in above else x
    below: dict[Number | None, list[Number]] = {x: [] for x in (None, *edges)}
    for x in edges:
        below[above[x]].append(x)

    operations: dict[Number, int] = {}
    border: dict[Number, set[Number]] = {}  # where a sweep from the number ends
    bare: dict[Number, bool] = {}  # of selects that may do harm
    gain: dict[Number, int] = {}
    best: dict[Number, int] = {}  # with what is below
    for x, operands in reversed(edges.items()):
        inside = below[x]
        operations[x] = sum(1 if slope in (1, -1) else 2 for _, slope in operands)
        operations[x] += sum(operations[a] for a in inside)
        border[x] = {a for a, _ in operands}.union(*(border[a] for a in inside))
        border[x].difference_update(a for a in inside if edges[a])
        once = 0 if x.same else operations[x]
        bare[x] = selects or (x.op != "select" and all(bare[a] for a in inside))
        saved = reached[x].bit_count() * (operations[x] - 2 * len(border[x])) - once
        gain[x] = saved if bare[x] else 0
        best[x] = max(gain[x], sum(best[a] for a in inside))

    parts, rest = list[tuple[Number, list[Number]]](), below[None]
    while rest:
        x = rest.pop()
        if 0 < best[x] == gain[x]:
            part = [x]
            for a in part:
                part += below[a]
            parts.append((x, sorted(part, key=attrgetter("index"), reverse=True)))
        elif best[x]:
            rest += below[x]
    return parts


def _common(
    above: Mapping[Number, Number | None],
    depth: Mapping[Number | None, int],
    a: Number | None,
    b: Number | None,
) -> Number | None:
    """Return the nearest number that dominates both or is one of them; None where there is none."""
    while a is not b:
        if depth[a] < depth[b]:
            a, b = b, a
        assert a is not None
        a = above[a]
    return a


def _root(x: Any) -> tuple[Any, float]:
    """Return the number of which another is a power, and the exponent.

    Where a power is 0 so is its slope, and what is divided by it would have a derivative of infinity times 0.
    """
    if isinstance(x, Number) and x.op == "mul":
        (a, m), (b, n) = map(_root, x.args)
        return (a, m + n) if a is b else (x, 1)
    return x.args if isinstance(x, Number) and x.op == "pow" and isinstance(x.args[1], float) else (x, 1)


def _slopes(number: Number) -> list[tuple[Any, Callable[[], Any]]]:
    """Return each operand of a number, and a function that returns its slope."""
    op, args = number.op, number.args
    match op:
        case "add":
            return [(a, lambda: 1) for a in args]
        case "sub":
            return [(args[0], lambda: 1), (args[1], lambda: -1)]
        case "mul":
            if args[0] is args[1]:
                return [(args[0], lambda: 2 * number.args[0])]
            return [(args[0], lambda: args[1]), (args[1], lambda: args[0])]
        case "select":  # what has no value has no derivative
            holds, yes, no = args
            rest = [math.nan if x != x else 0 for x in (yes, no)]
            return [
                (yes, lambda: lambda t: select(holds, t, rest[1])),
                (no, lambda: lambda t: select(holds, rest[0], t)),
            ]
        case "pow":
            base, exponent = args
            return [
                (base, lambda: exponent * number.tape.number("pow", base, exponent - 1)),
                (exponent, lambda: number * log(base)),
            ]
        case "atan2":
            y, x = args
            square = x * x + y * y
            return [(y, lambda: x / square), (x, lambda: -y / square)]
        case "div":
            above, (below, n) = args[0], _root(args[1])
            if above == 1 and n == 1:
                return [(below, lambda: -(number * number))]
            return [(above, lambda: 1 / args[1]), (below, lambda: -n * number / below)]
        case "recip":
            below, n = _root(args[0])
            return [(below, lambda: -(number * number) if n == 1 else -n * number / below)]
        case "sign" | "power_of_two_scale" | "pi":
            return []
        case _ if op in CONDITIONS:
            return []
    (x,) = args
    slopes: dict[str, Callable[[], Any]] = {
        "neg": lambda: -1,
        "sqrt": lambda: 1 / (2 * number),
        "sin": lambda: cos(x),
        "cos": lambda: -sin(x),
        "tan": lambda: 1 + number * number,
        "asin": lambda: 1 / sqrt(1 - x * x),
        "acos": lambda: -1 / sqrt(1 - x * x),
        "atan": lambda: 1 / (1 + x * x),
        "sinh": lambda: number.tape.number("cosh", x),
        "cosh": lambda: number.tape.number("sinh", x),
        "tanh": lambda: 1 - number * number,
        "exp": lambda: number,
        "log": lambda: 1 / x,
        "abs": lambda: sign(x),
    }
    return [(x, slopes[op])]
