"""Keep what was found: the machine file, the session, the report, emitted code."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from rodgen.errors import InputFileError, shown
from rodgen.machines.emit import FORMS
from rodgen.workbench.parts import button, dialog, field, soft
from rodgen.workbench.session import ENDING

if TYPE_CHECKING:
    from rodgen.workbench.desk import Window

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
    page : Window
    """

    def __init__(self, page: Window) -> None:
        self.page = page
        session = page.desk.session
        self.folder = os.path.dirname(os.path.abspath(session.state.file))
        stem = os.path.splitext(os.path.basename(session.state.file))[0]
        with dialog("Keep") as self.dialog:
            soft(f"In {self.folder}")
            self.said = ui.label().props('role="status"')
            for what, name, ending, writes in (
                ("Machine file", f"{stem}_better.toml", ".toml", session.save_machine),
                ("Session", f"{stem}{ENDING}", ENDING, session.save),
                ("Report", f"{stem}.html", ".html", self._report),
                ("Code, a folder", f"{stem}_c", "", self._emit),
            ):
                with ui.element("div").classes("line"):
                    where = field(what, value=name, most=120)
                    if writes == self._emit:
                        self.form = ui.select(FORMS, value="c", label="As").props(
                            "dense options-dense outlined"
                        )
                        self.form.classes("grow").on_value_change(partial(self._named, where, stem))
                    button("Write", partial(self._write, where, ending, writes), label=f"Write: {what}")
                    if writes != session.save:  # which is of no use elsewhere than near its measurements
                        take = partial(self._download, where, ending, writes)
                        button("Download", take, label=f"Download: {what}")

    async def open(self) -> None:
        """Show the dialog."""
        self.said.set_text("")
        self.dialog.open()

    async def _write(self, where: ui.input, ending: str, writes: Callable[[str], object]) -> None:
        path = file_in(self.folder, str(where.value or ""), ending)
        await self._made(writes, path)
        self.said.set_text(f"{os.path.basename(path)} is written.")

    async def _download(self, where: ui.input, ending: str, writes: Callable[[str], object]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = file_in(folder, str(where.value or ""), ending)
            await self._made(writes, path)
            if os.path.isdir(path):
                path = shutil.make_archive(path, "zip", path)
            ui.download.content(Path(path).read_bytes(), os.path.basename(path))

    async def _made(self, writes: Callable[[str], object], path: str) -> None:
        self.said.set_text("Writing …")
        try:
            await asyncio.to_thread(writes, path)
        finally:
            self.said.set_text("")

    def _named(self, where: Any, stem: str, event: Any) -> None:
        where.set_value(f"{stem}_{event.value}")

    def _report(self, path: str) -> None:
        from rodgen.calibration.diagnose import diagnose
        from rodgen.calibration.plan import PlanError, plan
        from rodgen.output.report import write_report

        desk, state = self.page.desk, self.page.state
        if desk.diagnosis is not None and desk.diagnosis[0] is state:
            diagnosis = desk.diagnosis[1]
        else:
            diagnosis = diagnose(state.machine, state.data)
        planned = desk.plan[1] if desk.plan is not None and desk.plan[0] is state else None
        if planned is None:
            with suppress(PlanError):
                planned = plan(diagnosis)
        write_report(diagnosis, path, planned)

    def _emit(self, path: str) -> None:
        self.page.state.fit.emit(self.form.value, path)
