"""The page of a fleet: what its machines have in common, and each machine on a page of its own by a click."""

from __future__ import annotations

import asyncio
from typing import Any

from nicegui import ui

from rodgen.calibration.fleet import Fleet
from rodgen.calibration.fleet.summary import about_machines
from rodgen.errors import RodgenError
from rodgen.output.report.fleet import FleetTable, fleet_figures, fleet_tables, machine_tables
from rodgen.workbench.desk import Desk
from rodgen.workbench.drawing import drawn
from rodgen.workbench.page import Page
from rodgen.workbench.parts import STYLE, button, card, guarded, heading
from rodgen.workbench.session import Session

ROWS = 25
"""Rows of a table that are shown at a time."""
WIDTH = 1000
"""Of the figures, in pixels."""
COLUMN = "display:grid;gap:12px;grid-template-columns:minmax(0,1fr)"
CLICKED = "(e) => emit((((e && e.points) || [])[0] || {}).customdata)"


class FleetDesk:
    """The results of a fleet, and which of its machines is open; all windows share it."""

    def __init__(self, folder: str) -> None:
        self.fleet = Fleet.load(folder)
        self.desk: Desk | None = None
        self._name = ""
        self._left: dict[str, Desk] = {}  # machines that something was done to, to go on with
        self.figures = fleet_figures(self.fleet)
        self.dark = False

    def window(self) -> None:
        """Make a window: of the fleet, or of the machine that is open with a way back."""
        if self.desk is None:
            FleetPage(self)
            return
        with ui.element("nav").props('aria-label="Fleet"'):
            button("Back to the fleet", self._back, icon="arrow_back")
        Page(self.desk)

    async def _back(self) -> None:
        if self.desk is not None and len(self.desk.session.states) > 1:
            self._left[self._name] = self.desk
        self.desk = None
        ui.navigate.reload()

    async def open(self, name: str) -> None:
        """Open a machine.

        Raises
        ------
        RodgenError
            When its files cannot be used.
        """
        pair = next(machine.pair for machine in self.fleet.machines if machine.name == name)
        if not (pair.machine and pair.data):
            missing = "measurements" if pair.machine else "machine file"
            raise RodgenError(f"{name}: no {missing}; expected both")
        self.desk = self._left.pop(name, None) or Desk(
            await asyncio.to_thread(Session.open, pair.machine, pair.data)
        )
        self._name = name
        ui.navigate.reload()


class FleetPage:
    """One window of the fleet."""

    def __init__(self, desk: FleetDesk) -> None:
        self.desk = desk
        ui.add_css(STYLE)
        self.client = ui.context.client
        with ui.element("header").classes("head"):
            heading(f"Fleet, {desk.fleet.plan.date}", 1)
        ui.label(about_machines(desk.fleet)).props('role="status"')
        with ui.element("div").style(f"width:100%;{COLUMN}"):
            for table in fleet_tables(desk.fleet):
                self._table(table)
            self.plots = ui.element("div").style(COLUMN)
            for table in machine_tables(desk.fleet):
                self._table(table)
        self._draw()
        self.client.on_connect(self._connected)

    async def _connected(self) -> None:
        try:
            asked = "window.matchMedia('(prefers-color-scheme: dark)').matches"
            dark = bool(await ui.run_javascript(f"return {asked}", timeout=5.0))
        except TimeoutError:
            return
        if dark is not self.desk.dark:
            self.desk.dark = dark
            self._draw()

    def _table(self, table: FleetTable) -> None:
        with card(table.title):
            heading(table.title)
            if table.note:
                ui.label(table.note).classes("soft")
            if not table.rows:
                ui.label("None.")
                return
            names = [str(i) for i in range(len(table.header))]
            columns: list[dict[str, Any]] = [
                {"name": name, "label": words, "field": name, "align": "left", "sortable": True}
                for name, words in zip(names, table.header, strict=True)
            ]
            rows = [{"key": k, **dict(zip(names, row, strict=True))} for k, row in enumerate(table.rows)]
            made = ui.table(
                rows=rows, columns=columns, row_key="key", pagination=ROWS if len(rows) > ROWS else None
            )
            made.props("dense flat wrap-cells").classes("w-full").style("overflow-wrap:normal")
            if table.of_machines:
                # a link can be reached with the keyboard, which a row cannot
                made.add_slot(
                    "body-cell-0",
                    '<q-td :props="props"><a href="#" style="color:inherit" :aria-label="`Open ${props.value}`" '
                    "@click.prevent=\"() => $parent.$emit('machine', props.value)\">{{ props.value }}</a></q-td>",
                )
                made.on("machine", guarded(self._asked))

    async def _asked(self, event: Any) -> None:
        await self.desk.open(str(event.args))

    def _draw(self) -> None:
        self.plots.clear()
        with self.plots:
            for figure in self.desk.figures:
                made = drawn(figure, dark=self.desk.dark, width=WIDTH, select=False)
                with card(made.title):
                    heading(made.title)
                    ui.label(made.note).classes("soft")
                    with ui.element("div").classes("legend"):
                        for sign, colour, name in made.legend:
                            ui.html(f'<span style="color:{colour}">{sign}</span> ', sanitize=False)
                            ui.label(name)
                    plot = ui.plotly(made.content).props('role="img"')
                    plot.props["aria-label"] = made.alt
                    plot.style(f"height:{made.content['layout']['height']}px;width:100%")
                    plot.on("plotly_click", guarded(self._clicked), js_handler=CLICKED)

    async def _clicked(self, event: Any) -> None:
        if isinstance(event.args, int) and 0 <= event.args < len(self.desk.fleet.machines):
            await self.desk.open(self.desk.fleet.machines[event.args].name)
