"""Keep what was found: the machine file, the session, the report, emitted code."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from rodgen.errors import InputFileError, shown
from rodgen.workbench.parts import button
from rodgen.workbench.session import ENDING

if TYPE_CHECKING:
    from rodgen.workbench.page import Page

__all__ = ["Keeping", "file_in"]

_NAME = re.compile(r"[^\W_][\w .()+-]{0,119}")


def file_in(folder: str, name: str, ending: str) -> str:
    """Return the path of a file of a folder; a name that leads elsewhere is refused.

    Raises
    ------
    InputFileError
        When the name has a folder, begins with a dot, or has no letter or another ending.
    """
    if not _NAME.fullmatch(name) or not name.endswith(ending) or name.endswith((" ", ".")):
        where = "a name without a folder, of letters, digits, blanks and _ . - ( ) +"
        where += f", ending in {ending}" if ending else ""
        raise InputFileError("file name", "file", shown(name[:200]), where)
    return os.path.join(folder, name)


class Keeping:
    """The dialog, in one window.

    Parameters
    ----------
    page : Page
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        session = page.desk.session
        self.folder = os.path.dirname(os.path.abspath(session.state.file))
        stem = os.path.splitext(os.path.basename(session.state.file))[0]
        with ui.dialog() as self.dialog, ui.card().style("width:560px;max-width:95vw"):
            ui.label(f"In {self.folder}").classes("soft")
            self.said = ui.label().props('role="status"')
            for what, name, ending, writes in (
                ("Machine file", f"{stem}_better.toml", ".toml", session.save_machine),
                ("Session", f"{stem}{ENDING}", ENDING, session.save),
                ("Report", f"{stem}.html", ".html", self._report),
                ("C code, a folder", f"{stem}_c", "", partial(self._emit, "c")),
                ("Python code, a folder", f"{stem}_numpy", "", partial(self._emit, "numpy")),
            ):
                with ui.element("div").classes("line"):
                    field = ui.input(what, value=name).props("dense outlined maxlength=120").style("flex:1")
                    button("Write", partial(self._write, field, ending, writes), label=f"Write: {what}")
            with ui.element("div").classes("line"):
                button("Download the machine file", self._machine)
                ui.button("Close", on_click=self.dialog.close).props("flat dense no-caps")

    async def open(self) -> None:
        """Show the dialog."""
        self.said.set_text("")
        self.dialog.open()

    async def _write(self, field: Any, ending: str, writes: Callable[[str], object]) -> None:
        path = file_in(self.folder, str(field.value or ""), ending)
        self.said.set_text("Writing …")
        try:
            await asyncio.to_thread(writes, path)
        except Exception:
            self.said.set_text("")
            raise
        self.said.set_text(f"{path} is written.")

    def _report(self, path: str) -> None:
        from rodgen.calibration.diagnose import diagnose
        from rodgen.output.report import write_report

        desk, state = self.page.desk, self.page.state
        if desk.diagnosis is not None and desk.diagnosis[0] is state:
            found = desk.diagnosis[1]
        else:
            kept = state.observations.take(~state.aside) if state.aside.any() else state.observations
            found = diagnose(state.machine, kept)
        write_report(found, path)

    def _emit(self, lang: str, path: str) -> None:
        self.page.state.fit.emit(lang, path)

    async def _machine(self) -> None:
        name = os.path.basename(self.page.state.file)
        ui.download.content(self.page.desk.session.machine_text(), name)
