"""Of the hypothetical-link technique: its flow chart, and the errors of four formulas for angle and axis."""

from __future__ import annotations

import re
from collections.abc import Callable

import mpmath
import numpy as np
import plotly.graph_objects as go
import sympy as sp

DIGITS = 40
AXES = 50

BOXES = {
    "given": ((320, 30), "given: *S6*, *a67*, *P* in the fixed system", "start"),
    "free": ((320, 90), "choose a67 = 0 and α67: 90°, or 45° or 135° where s71 is small", "box"),
    "seven": ((320, 150), "*S7* = *S6* c67 + (*a67* × *S6*) s67;  *P* := *P* + a67 *a67*", "box"),
    "skew": ((320, 220), "s71 = length of *S7* × *S1* > tolerance?", "question"),
    "normal": (
        (60, 350),
        "*a71* = *S7* × *S1* / s71|S7 = (*S1* × *P*) · *a71* / s71|a71 = (*P* × *S1*) · *S7* / s71"
        "|S1 = (*P* × *S7*) · *a71* / s71",
        "box",
    ),
    "level": ((500, 290), "S7 = 0;  S1 = −*P* · *S1*|a71 = length of *P* + S1 *S1*", "box"),
    "apart": ((500, 375), "a71 > tolerance · length of *P*?", "question"),
    "one": ((390, 465), "special case 1|*a71* = −(*P* + S1 *S1*) / a71", "box"),
    "two": ((630, 465), "special case 2|θ7 = 0;  *a71* = *a67*", "box"),
    "seventh": ((320, 560), "cos θ7 = *a67* · *a71*;  sin θ7 = (*a67* × *a71*) · *S7*", "box"),
    "first": ((320, 615), "cos γ1 = *a71* · *x*;  sin γ1 = (*a71* × *x*) · *S1*", "box"),
    "end": ((320, 675), "closed loop of seven axes: solve it for θ1 … θ6;  φ1 = θ1 − γ1", "start"),
}
"""Centre, lines and kind of each box of the flow chart; vectors stand between asterisks."""

ARROWS = (
    ("given", "free", ""),
    ("free", "seven", ""),
    ("seven", "skew", ""),
    ("skew", "normal", "yes"),
    ("skew", "level", "no"),
    ("level", "apart", ""),
    ("apart", "one", "yes"),
    ("apart", "two", "no"),
    ("normal", "seventh", ""),
    ("one", "seventh", ""),
    ("two", "seventh", ""),
    ("seventh", "first", ""),
    ("first", "end", ""),
)
FILL = {"start": "#dde8f4", "question": "#f6ecd2", "box": "white"}
LINE = 17
"""Height of a line of text, in pixels."""


def flow_chart() -> go.Figure:
    """Return the flow chart of the technique; vectors are bold."""
    figure = go.Figure()
    half = {name: (LINE * (text.count("|") + 1) + 10) / 2 for name, (_, text, _) in BOXES.items()}
    for start, stop, label in ARROWS:
        (x1, y1), (x2, y2) = BOXES[start][0], BOXES[stop][0]
        y1, y2 = y1 + half[start], y2 - half[stop]
        ends = {"x": x2, "y": y2, "ax": x1, "ay": y1, "axref": "x", "ayref": "y"}
        figure.add_annotation(**ends, arrowhead=2, arrowwidth=1.2, text="")
        if label:
            side = -24 if x2 < x1 else 24
            figure.add_annotation(
                x=(x1 + x2) / 2 + side, y=(y1 + y2) / 2, text=label, showarrow=False, bgcolor="white"
            )
    for (x, y), text, kind in BOXES.values():
        words = re.sub(r"\*(\w+)\*", r"<b>\1</b>", text.replace(">", "&gt;").replace("|", "<br>"))
        frame = {"bordercolor": "black", "borderpad": 5, "bgcolor": FILL[kind]}
        figure.add_annotation(x=x, y=y, text=words, showarrow=False, **frame)
    figure.update_xaxes(range=[-80, 760], visible=False).update_yaxes(range=[710, 0], visible=False)
    return figure.update_layout(width=900, height=800, font_color="black")


def by_formulas(matrix: np.ndarray) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Return the angle by arccosine and by atan2, the axis by the differences and by the quaternion."""
    differences = np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    trace, size = np.trace(matrix), np.linalg.norm(differences)
    products = np.block(
        [
            [np.array([[1 + trace]]), differences[None]],
            [differences[:, None], matrix + matrix.T + (1 - trace) * np.eye(3)],
        ]
    )
    q = products[:, np.argmax(np.diag(products))]
    axis = q[1:] / np.linalg.norm(q[1:]) * (1 if q[0] >= 0 else -1)
    return np.arccos(np.clip((trace - 1) / 2, -1, 1)), np.arctan2(size, trace - 1), differences / size, axis


def rotation_errors(matrix_from_axis_angle: Callable[..., sp.Matrix]) -> str:
    """Return the largest errors of the four formulas over random axes, as a Markdown table.

    Parameters
    ----------
    matrix_from_axis_angle : callable
        The exact matrix of an axis, a cosine and a sine.
    """
    lines = [
        "| θ | arccosine | atan2 | axis by differences | axis by quaternion |",
        "| --- | --- | --- | --- | --- |",
    ]
    random = np.random.default_rng(0)
    angles = {"1e-8": 1e-8, "1e-3": 1e-3, "π − 1e-3": np.pi - 1e-3, "π − 1e-8": np.pi - 1e-8}
    for name, angle in angles.items():
        worst = np.zeros(4)
        for _ in range(AXES):
            with mpmath.workdps(DIGITS):
                axis = mpmath.matrix(random.normal(size=3))
                axis /= mpmath.norm(axis)
                turn = matrix_from_axis_angle(
                    sp.Matrix([sp.Float(x, DIGITS) for x in axis]),
                    *(sp.Float(f(angle), DIGITS) for f in (mpmath.cos, mpmath.sin)),
                )
            found = by_formulas(np.array(turn.tolist(), float))
            exact = np.array([float(x) for x in axis])
            worst = np.maximum(
                worst, [*(abs(x - angle) for x in found[:2]), *(np.abs(x - exact).max() for x in found[2:])]
            )
        lines.append(f"| {name} | " + " | ".join(f"{x:.0e}" for x in worst) + " |")
    return "\n".join(lines)
