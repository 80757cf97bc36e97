"""The page of ``rodgen open`` alone: examples, files of this computer, files that are dropped, templates, imports."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from nicegui import ui

from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.files.read import machine_of
from rodgen.machines.imports.denavit_hartenberg import is_table
from rodgen.machines.imports.imported import Imported
from rodgen.machines.templates import CODES, KINDS, machine_template
from rodgen.workbench.keep import file_in
from rodgen.workbench.parts import STYLE, anew, button, card, downloaded, guarded, heading
from rodgen.workbench.server import MOST_BYTES
from rodgen.workbench.session import ENDING, Session

if TYPE_CHECKING:
    from nicegui.events import MultiUploadEventArguments

__all__ = [
    "Dropped",
    "Importer",
    "Start",
    "examples",
    "opened",
]


Importer: TypeAlias = Callable[[Sequence[str], Sequence[str]], Imported]
"""Makes a machine, and readings, of files, with options of ``rodgen import``."""

DATA = (".csv", ".csv.gz", ".parquet")
"""Endings of measurement files."""
MOST_FILES = 20
_CHOICES: dict[str, tuple[str, Any]] = {
    "column": ("Columns of a table, parted by ;", "A=-A_axis [deg] + 90; x=X meas"),
    "joints": ("Column of the first joint; others are numbered on", "q1"),
    "units": ("Units of columns without", "mm,deg"),
    "base": ("URDF: link that stands still", "base_link"),
    "tip": ("URDF: link that is measured", "tool0"),
    "convention": ("Denavit-Hartenberg convention", ["", "standard", "modified"]),
    "estimate": ("URDF, Denavit-Hartenberg: a fit adjusts", ["", "target", "geometry"]),
    "azimuth": ("Pointing run: azimuth 0 is", ["", "south", "north"]),
    "format": ("Pointing run: TPOINT's format", ["", "1", "2", "3", "4"]),
    "latitude": ("Equatorial mount: latitude", "31.7deg"),
    "ballbar": ("Ballbar: plane and radius", "XY=150mm"),
}
"""By option of ``rodgen import``: what it is called here, and an example or the choices."""


class Dropped:
    """The card, in one window.

    Parameters
    ----------
    open_ : coroutine function
        Opens what a function returns, and says why where that cannot be done.
    importer : Importer
    """

    def __init__(
        self,
        open_: Callable[[Callable[[], Session | Imported]], Awaitable[Imported | None]],
        importer: Importer,
    ) -> None:
        self.open_, self.importer = open_, importer
        self.files: dict[str, bytes] = {}
        with card("Dropped files"):
            heading("Drop files here")
            ui.label(
                "A machine file and its measurements; or what 'rodgen import' reads: a robot in URDF, a "
                "Denavit-Hartenberg table, a pointing run or a model of TPOINT, tables of readings (CSV, text, Excel, "
                "MATLAB), alone or with a machine file."
            ).classes("soft")
            self.upload = ui.upload(
                label="Choose files, or drop them here",
                multiple=True,
                auto_upload=True,
                max_total_size=MOST_BYTES // 2,
                max_files=MOST_FILES,
                on_multi_upload=guarded(self._taken),
                on_rejected=lambda: ui.notify(
                    f"More than {MOST_FILES} files, or {MOST_BYTES / 2e6:g} MB.", type="warning"
                ),
            )
            self.upload.props('flat bordered aria-label="Drop files"').classes("w-full")
            self.listed = ui.element("div").classes("w-full")
            with ui.expansion("What the files leave open").props("dense").classes("w-full") as self.open:
                self.choices = {option: _field(option, *about) for option, about in _CHOICES.items()}
            self.open.set_visibility(False)
            self.made = ui.element("div").classes("w-full")

    async def put(self, name: str, content: bytes) -> None:
        """Take a file in; a machine file is shown, to be changed, other files are opened if they can be."""
        await self._take({name: content})

    async def _taken(self, event: MultiUploadEventArguments) -> None:
        await self._take({file.name: await file.read() for file in event.files})
        self.upload.reset()

    async def _take(self, files: Mapping[str, bytes]) -> None:
        files = {_plain(name): content for name, content in files.items()}
        if sum(map(len, {**self.files, **files}.values())) > MOST_BYTES:
            raise RodgenError(f"more than {MOST_BYTES / 1e6:g} MB of files; expected fewer")
        self.files |= files
        self._list()
        if not all(_is_machine(*file) for file in self.files.items()):
            await self._open()

    def _list(self) -> None:
        self.open.set_visibility(bool(self.files))
        self.made.clear()
        with anew(self.listed):
            for name, content in self.files.items():
                with ui.element("div").classes("line"):
                    button("Remove", partial(self._remove, name), label=f"Remove {name}")
                    ui.label(name)
                if _is_machine(name, content):
                    self._edit(name)
            if self.files:
                with ui.element("div").classes("line"):
                    button("Open", self._open, label="Open the dropped files")
                ui.label(
                    "They are copied into a folder of their own, where what you keep is written, too."
                ).classes("soft")

    def _edit(self, name: str) -> None:
        """Show a machine file, to be changed, with what is wrong in it or what it describes."""
        text = ui.textarea(f"Machine file {name}", value=self.files[name].decode("utf-8", "replace"))
        text.props('outlined debounce=400 input-style="height:340px;font-size:.8rem"')
        text.classes("w-full mono")
        said = ui.label().props('role="status"').classes("code")

        def check() -> None:
            self.files[name] = str(text.value).encode()
            try:
                said.set_text(machine_of(str(text.value), name).describe())
            except RodgenError as error:
                said.set_text(str(error))

        text.on_value_change(check)
        check()

    async def _remove(self, name: str) -> None:
        del self.files[name]
        self._list()

    def _arguments(self) -> list[str]:
        given = {option: str(field.value or "").strip() for option, field in self.choices.items()}
        columns = [f"--column={each.strip()}" for each in given.pop("column").split(";") if each.strip()]
        return columns + [f"--{option}={text}" for option, text in given.items() if text]

    async def _open(self) -> None:
        made = await self.open_(partial(opened, dict(self.files), self._arguments(), self.importer))
        self.made.clear()
        if made is None:
            return
        with self.made:
            ui.label(f"{made.machine.name}: a machine without readings. Drop these, too.")
            ui.label(made.machine.describe()).classes("code")
            with ui.expansion("What was taken for what").props("dense").classes("w-full"):
                for note in made.notes:
                    ui.label(note).classes("soft")
            button("Download the machine file", partial(downloaded, made.text, "machine.toml"))


def _field(option: str, words: str, kind: str | list[str]) -> Any:
    words = f"{words} (--{option})"
    if isinstance(kind, str):
        made: Any = ui.input(words, placeholder=kind).props("maxlength=2000")
    else:
        made = ui.select({each: each or "not said" for each in kind}, value="", label=words)
    return made.props("dense options-dense outlined").classes("w-full")


def _is_machine(name: str, content: bytes) -> bool:
    return name.lower().endswith(".toml") and not is_table(name, content)


def _plain(name: str) -> str:
    """Return a name that a file may have: without a folder, and nothing but letters, digits and few signs."""
    plain = re.sub(r"[^\w .()+-]", "_", os.path.basename(name.replace("\\", "/")))
    return re.sub(r"^[\W_]+", "", plain)[-100:] or "file"


def opened(files: Mapping[str, bytes], arguments: Sequence[str], importer: Importer) -> Session | Imported:
    """Return the session of files, which are written into a folder of their own; a machine alone as it was imported.

    Parameters
    ----------
    files : mapping of str to bytes
        A machine file and measurements, or what `importer` reads; by names without a folder.
    arguments : sequence of str
        Options of ``rodgen import``.
    importer : Importer

    Raises
    ------
    RodgenError
        When they are neither.
    """
    folder = tempfile.mkdtemp(prefix="rodgen-")
    found: Session | Imported | None = None
    try:
        found = _opened_in(folder, files, arguments, importer)
    except RodgenError as error:
        raise RodgenError(str(error).replace(folder + os.sep, "")) from None
    finally:
        if not isinstance(found, Session):
            shutil.rmtree(folder, ignore_errors=True)
    return found


def _opened_in(
    folder: str, files: Mapping[str, bytes], arguments: Sequence[str], importer: Importer
) -> Session | Imported:
    paths = {name: file_in(folder, name, "") for name in files}
    for name, path in paths.items():
        Path(path).write_bytes(files[name])
    machines = [paths[name] for name, content in files.items() if _is_machine(name, content)]
    tables = [path for path in paths.values() if path.lower().endswith(DATA)]
    if len(paths) == 2 and machines and tables and not arguments:
        try:
            return Session.open(machines[0], tables[0])
        except InputFileError as error:
            if error.file != tables[0] or not re.match(r"(line 1|column|header)\b", error.place):
                raise  # it is not that columns have other names
    made = importer(list(paths.values()), arguments)
    if not made.columns:
        return made
    machine, data = (os.path.join(folder, f"imported{ending}") for ending in (".toml", ".csv"))
    if machines:
        machine = machines[0]
    else:
        Path(machine).write_text(made.text, encoding="utf-8")
    made.write_data(data)
    session = Session.open(machine, data)
    session.remarks += made.notes
    return session


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
