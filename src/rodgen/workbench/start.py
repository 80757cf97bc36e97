"""The page of ``rodgen open`` alone: examples, files of this computer, files that are dropped, templates, imports."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable
from functools import partial
from math import radians
from pathlib import Path

from nicegui import ui

from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.imports.imported import Imported
from rodgen.machines.templates import CODES, KINDS, machine_template
from rodgen.workbench.dropped import Dropped, Importer
from rodgen.workbench.parts import STYLE, button, card, heading
from rodgen.workbench.session import ENDING, Session

__all__ = ["Start", "examples"]


def examples() -> dict[str, tuple[str, str]]:
    """Return the example machines of a checkout of the repository: by name, the machine file and the measurements."""
    folder = Path(__file__).resolve().parents[3] / "examples/machines"
    found = {}
    for machine in sorted(folder.glob("*/machine.toml")):
        data = next(iter(sorted(machine.parent.glob("*.csv"))), None)
        if data is not None:
            found[machine.parent.name.replace("_", " ")] = str(machine), str(data)
    return found


class Start:
    """One window of it.

    Parameters
    ----------
    opened : callable
        Is called with the session that a user has opened.
    importer : Importer
    """

    def __init__(self, opened: Callable[[Session], object], importer: Importer) -> None:
        self.opened = opened
        ui.add_css(STYLE)
        with ui.element("div").classes("start"):
            heading("rodgen: a machine and its measurements", 1)
            self.said = ui.label().props('role="alert"').classes("alert")
            self._files()
            self.dropped = Dropped(self._open, importer)
            self._examples()
            self._templates()

    async def _open(self, open_: Callable[[], Session | Imported]) -> Imported | None:
        """Open a session, or say why it cannot be opened; return what was imported without readings."""
        self.said.set_text("")
        try:
            found = await asyncio.to_thread(open_)
        except RodgenError as error:
            self.said.set_text(str(error))
            return None
        if isinstance(found, Imported):
            return found
        self.opened(found)
        ui.navigate.reload()
        return None

    def _files(self) -> None:
        with card("Files of this computer"):
            heading("Files of this computer")
            machine = (
                ui.input("Machine file, or a session")
                .props("dense outlined maxlength=4000")
                .classes("w-full")
            )
            data = ui.input("Measurements").props("dense outlined maxlength=4000").classes("w-full")

            async def open_them() -> None:
                file, of = (os.path.expanduser(str(each.value or "").strip()) for each in (machine, data))
                await self._open(partial(_opened, file, of))

            button("Open", open_them, label="Open the files")

    def _examples(self) -> None:
        if not (found := examples()):
            return
        with card("Examples"):
            heading("Examples")
            with ui.element("div").classes("line"):
                for name, files in found.items():
                    button(
                        name,
                        partial(self._open, partial(Session.open, *files)),
                        label=f"Open the example {name}",
                    )

    def _templates(self) -> None:
        with card("A machine file to begin with"):
            heading("A machine file to begin with")
            kinds = {name: f"{name}: {re.sub(_OPTIONS, '', words)}" for name, words in KINDS.items()}
            with ui.element("div").classes("line"):
                kind = ui.select(kinds, value=next(iter(kinds)), label="Kind")
                code = ui.input("Axes, from workpiece to tool", placeholder="[w C A b X Y Z t]")
                latitude = ui.number("Latitude [deg]", value=0, min=-90, max=90)
                balls = ui.number("Balls on the table, if probed", min=1, max=99, precision=0)
                for each in (kind, code, latitude, balls):
                    each.props("dense options-dense outlined maxlength=100")
                for each in (code, balls):
                    each.bind_visibility_from(kind, "value", backward=CODES.__contains__)
                latitude.bind_visibility_from(
                    kind, "value", backward=lambda name: name.startswith("equatorial")
                )

                async def begin() -> None:
                    text = machine_template(
                        kind.value,
                        code=(code.value or None) if kind.value in CODES else None,
                        latitude=radians(latitude.value or 0.0),
                        balls=int(balls.value) if balls.value and kind.value in CODES else None,
                    )
                    await self.dropped.put(f"{kind.value}.toml", text.encode())

                button("Begin with it", begin, label="Begin with the machine file")
            ui.label("With comments, to be changed to your machine; then drop its measurements.").classes(
                "soft"
            )


_OPTIONS = r"[;,] (or by )?--\w+"
"""What the kinds say of options of the command line."""


def _opened(machine: str, data: str) -> Session:
    if machine.endswith(ENDING) and not data:
        return Session.load(machine)
    for name, what in ((machine, "a machine file, or a session"), (data, "measurements")):
        if not name:
            raise InputFileError("rodgen open", "file", "none", what)
    return Session.open(machine, data)
