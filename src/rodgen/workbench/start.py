"""The page of ``rodgen open`` alone: examples, files of this computer, files that are dropped, templates."""

from __future__ import annotations

import asyncio
import os
import re
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from rodgen.errors import InputFileError, RodgenError, shown
from rodgen.machines.templates import KINDS, machine_template
from rodgen.workbench.guard import MOST_BYTES
from rodgen.workbench.keep import file_in
from rodgen.workbench.parts import STYLE, button, card, guarded, heading
from rodgen.workbench.session import ENDING, Session

__all__ = ["Start", "examples"]

DATA = (".csv", ".csv.gz", ".parquet")
"""Endings of measurement files."""


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
    """

    def __init__(self, opened: Callable[[Session], object]) -> None:
        self.opened = opened
        self.dropped: dict[str, bytes] = {}
        ui.add_css(STYLE)
        ui.dark_mode(None)
        with ui.element("main").style("max-width:760px;width:100%;margin:0 auto;display:grid;gap:12px"):
            heading("rodgen: a machine and its measurements", 1)
            self.said = ui.label().props('role="alert"').style("color:#c04d00")
            for part in (self._files, self._drop, self._examples, self._templates, self._imports):
                part()

    async def _open(self, open_: Callable[[], Session]) -> None:
        self.said.set_text("")
        try:
            session = await asyncio.to_thread(open_)
        except RodgenError as error:
            self.said.set_text(str(error))
            return
        self.opened(session)
        ui.navigate.reload()

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

    def _drop(self) -> None:
        with card("Dropped files"):
            heading("Or drop a machine file and its measurements here")
            ui.upload(
                multiple=True,
                auto_upload=True,
                max_file_size=MOST_BYTES // 2,
                max_files=4,
                on_upload=guarded(self._taken),
                on_rejected=lambda: self.said.set_text(f"A file is larger than {MOST_BYTES / 2e6:g} MB."),
            ).props('flat bordered aria-label="Drop files" accept=".toml,.csv,.gz,.parquet"').classes(
                "w-full"
            )
            ui.label(
                "They are copied into a folder of their own, where what you keep is written, too."
            ).classes("soft")

    async def _taken(self, event: Any) -> None:
        self.dropped[event.file.name] = await event.file.read()
        machines = [name for name in self.dropped if name.endswith(".toml")]
        tables = [name for name in self.dropped if name.endswith(DATA)]
        strange = [name for name in self.dropped if name not in {*machines, *tables}]
        if strange:
            del self.dropped[strange[0]]
            expected = f"a machine file, .toml, and a table: {', '.join(DATA)}"
            raise InputFileError(shown(strange[0][:80]), "file", "neither", expected)
        if machines and tables:
            machine, table = machines[-1], tables[-1]
            self.dropped, files = {}, dict(self.dropped)
            await self._open(partial(self._from_memory, machine, table, files))

    @staticmethod
    def _from_memory(machine: str, table: str, files: dict[str, bytes]) -> Session:
        folder = tempfile.mkdtemp(prefix="rodgen-")
        paths = [
            file_in(folder, re.sub(r"^\W+", "", os.path.basename(name)), "") for name in (machine, table)
        ]
        for path, name in zip(paths, (machine, table), strict=True):
            Path(path).write_bytes(files[name])
        return Session.open(*paths)

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
            kinds = {name: f"{name}: {words}" for name, words in KINDS.items()}
            with ui.element("div").classes("line"):
                kind = ui.select(kinds, value=next(iter(kinds)), label="Kind").props(
                    "dense options-dense outlined"
                )

                async def download() -> None:
                    north = 0.0 if str(kind.value).startswith("equatorial") else None
                    ui.download.content(
                        machine_template(str(kind.value), latitude=north), f"{kind.value}.toml"
                    )

                button("Download", download, label="Download the machine file")
            ui.label(
                "With comments, to be changed to your machine; 'rodgen new' knows more of each."
            ).classes("soft")

    def _imports(self) -> None:
        with card("Files of other programs"):
            heading("Files of other programs")
            for line in _IMPORTS:
                ui.label(line).classes("code")
            ui.label("writes a machine file, and measurements, that can be opened here.").classes("soft")


_IMPORTS = (
    "rodgen import robot.urdf -o machine.toml",
    "rodgen import table.csv -o machine.toml -d data.csv",
)


def _opened(machine: str, data: str) -> Session:
    if machine.endswith(ENDING) and not data:
        return Session.load(machine)
    for name, what in ((machine, "a machine file, or a session"), (data, "measurements")):
        if not name:
            raise InputFileError("rodgen open", "file", "none", what)
    return Session.open(machine, data)
