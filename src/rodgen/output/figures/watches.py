"""How the evidence for a change grew while a machine was watched."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import plotly.graph_objects as go

from rodgen.output.figures.style import BLUE, ORANGE, PURPLE, Panel, add_trace, column, describe

if TYPE_CHECKING:
    from rodgen.calibration.watch import Watch


def watched(watch: Watch) -> go.Figure:
    """Return the evidence for a change over the rows, with the limit of an alarm and the alarms.

    Parameters
    ----------
    watch : Watch
    """
    rows = [row for row, _ in watch.history]
    # evidence that never was as low as the limit is high says nothing
    evidence = [max(value, -watch.log_limit) / math.log(10) for _, value in watch.history]
    figure = column([Panel("evidence for a change, powers of ten above the limit", 260, "row")])
    given: dict[str, Any] = {"mode": "lines", "line": {"color": BLUE, "width": 1.5}}
    add_trace(
        figure, 0, "evidence", x=rows, y=evidence, hovertemplate="row %{x}: %{y:.1f}<extra></extra>", **given
    )
    ends = [rows[0], rows[-1]] if rows else [0, 1]
    add_trace(figure, 0, "limit", x=ends, y=[0, 0], mode="lines", line={"color": ORANGE, "dash": "dash"})
    alarms = watch.alarm_rows
    mark = {"symbol": "x", "size": 9, "color": PURPLE}
    add_trace(figure, 0, "alarm", x=alarms, y=[0] * len(alarms), mode="markers", marker=mark)
    summary = f"{watch.alarms} alarm{'s' * (watch.alarms != 1)} in {watch.rows} rows"
    note = "Each point is the largest of some rows; above the limit an alarm is raised."
    return describe(
        figure, "watch", watch.fit.machine.name, note=note, alt=f"Evidence for a change: {summary}."
    )
