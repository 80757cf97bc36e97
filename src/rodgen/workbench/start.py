"""The page of ``rodgen open`` alone: examples, files of this computer, files that are dropped, templates, imports."""

from __future__ import annotations

import asyncio
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from nicegui import ui

from rodgen.errors import InputFileError, MissingOptionError, RodgenError
from rodgen.machines.files.read import machine_of
from rodgen.machines.imports.denavit_hartenberg import is_table
from rodgen.machines.imports.imported import Imported
from rodgen.machines.templates import CODES, KINDS, machine_template
from rodgen.workbench.keep import file_in
from rodgen.workbench.parts import STYLE, anew, button, card, downloaded, field, folded, guarded, heading
from rodgen.workbench.server import MOST_BYTES
from rodgen.workbench.session import ENDING, Session

if TYPE_CHECKING:
    from nicegui.events import MultiUploadEventArguments

__all__ = ["Dropped", "Importer", "Start", "examples", "opened"]


Importer: TypeAlias = Callable[[Sequence[str], Sequence[str]], Imported]
"""Makes a machine, and readings, of files, with options of ``rodgen import``."""

DATA = (".csv", ".csv.gz", ".parquet")
"""Endings of measurement files."""
MOST_FILES = 20


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
        open_: Callable[[Callable[[], Session | Imported]], Awaitable[Imported | MissingOptionError | None]],
        importer: Importer,
    ) -> None:
        self.open_, self.importer = open_, importer
        self.files: dict[str, bytes] = {}
        self.answers: list[str] = []
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
            self.asked = ui.element("div").classes("w-full")
            with folded("Options of 'rodgen import'"):
                self.options = field("Options", example="--azimuth south --estimate geometry")

    async def _taken(self, event: MultiUploadEventArguments) -> None:
        await self.take({file.name: await file.read() for file in event.files})
        self.upload.reset()

    async def take(self, files: Mapping[str, bytes]) -> None:
        """Take files in; a machine file is shown, to be changed, other files are opened if they can be."""
        files = {_plain(name): content for name, content in files.items()}
        if sum(map(len, {**self.files, **files}.values())) > MOST_BYTES:
            raise RodgenError(f"more than {MOST_BYTES / 1e6:g} MB of files; expected fewer")
        self.files |= files
        self._list()
        if not all(_is_machine(*file) for file in self.files.items()):
            await self._open()

    def _list(self) -> None:
        self.answers = []
        self.asked.clear()
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
        status = ui.label().props('role="status"').classes("code")

        def check() -> None:
            self.files[name] = str(text.value).encode()
            try:
                status.set_text(machine_of(str(text.value), name).describe())
            except RodgenError as error:
                status.set_text(str(error))

        text.on_value_change(check)
        check()

    async def _remove(self, name: str) -> None:
        del self.files[name]
        self._list()

    async def _open(self) -> None:
        try:
            arguments = [*shlex.split(str(self.options.value or "")), *self.answers]
        except ValueError as error:
            raise RodgenError(f"options: {error}; expected closed quotation marks") from None
        opened_files = await self.open_(partial(opened, dict(self.files), arguments, self.importer))
        with anew(self.asked):
            if isinstance(opened_files, MissingOptionError):
                self._ask(opened_files)
            elif opened_files is not None:
                ui.label(f"{opened_files.machine.name}: a machine without readings. Drop these, too.")
                ui.label(opened_files.machine.describe()).classes("code")
                with folded("What was taken for what"):
                    for note in opened_files.notes:
                        ui.label(note).classes("soft")
                button("Download the machine file", partial(downloaded, opened_files.text, "machine.toml"))

    def _ask(self, missing: MissingOptionError) -> None:
        """Ask for the one thing that the files leave open."""
        heading("One thing is missing")
        ui.label(f"{missing.file}, {missing.place}: {missing.found}.")
        with ui.element("div").classes("line"):
            if missing.choices:
                of = missing.option.lstrip("-").strip("=").replace("=", " ")
                answer: Any = ui.select([*missing.choices], label=f"It is: {of}", with_input=True)
                answer.props('new-value-mode="add-unique"')
            else:
                answer = field(f"It is: {missing.expected}")
            answer.props("dense options-dense outlined").classes("grow")

            async def go_on() -> None:
                if answer.value:
                    self.answers.append(f"{missing.option}{answer.value}")
                    await self._open()

            button("Go on", go_on, look="first")


def _is_machine(name: str, content: bytes) -> bool:
    return name.lower().endswith(".toml") and not is_table(name, content)


def _plain(name: str) -> str:
    """Return a name that a file may have: without a folder, and nothing but letters, digits and few signs."""
    simple = re.sub(r"[^\w .()+-]", "_", os.path.basename(name.replace("\\", "/")))
    return re.sub(r"^[\W_]+", "", simple)[-100:] or "file"


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
    content: Session | Imported | None = None
    try:
        content = _opened_in(folder, files, arguments, importer)
    except MissingOptionError as error:
        raise MissingOptionError(os.path.basename(error.file), *error.args[1:]) from None
    except RodgenError as error:
        raise RodgenError(str(error).replace(folder + os.sep, "")) from None
    finally:
        if not isinstance(content, Session):
            shutil.rmtree(folder, ignore_errors=True)
    return content


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
    imported = importer(list(paths.values()), arguments)
    if not imported.columns:
        return imported
    machine, data = (os.path.join(folder, f"imported{ending}") for ending in (".toml", ".csv"))
    if machines:
        machine = machines[0]
    else:
        Path(machine).write_text(imported.text, encoding="utf-8")
    imported.write_data(data)
    session = Session.open(machine, data)
    session.remarks += imported.notes
    return session


def examples() -> dict[str, tuple[str, str]]:
    """Return the example machines of a checkout of the repository: by name, the machine file and the measurements."""
    folder = Path(__file__).resolve().parents[3] / "examples/machines"
    files_of = {}
    for machine in sorted(folder.glob("*/machine.toml")):
        data = next(iter(sorted(machine.parent.glob("*.csv"))), None)
        if data is not None:
            files_of[machine.parent.name.replace("_", " ")] = str(machine), str(data)
    return files_of


class Start:
    """One window of it.

    Parameters
    ----------
    opened : callable
        Is called with the session that a user has opened.
    importer : Importer
    left : sequence of Session, optional
        That a user has left, and may go back to.
    """

    def __init__(
        self, opened: Callable[[Session], object], importer: Importer, left: Sequence[Session] = ()
    ) -> None:
        self.opened, self.left = opened, left
        ui.add_css(STYLE)
        with ui.element("div").classes("start"):
            with ui.element("header"):
                heading("rodgen: a machine and its measurements", 1)
                ui.label("See what a model misses, add it, and watch the error fall.").classes("soft")
            self.said = ui.label().props('role="alert"').classes("alert")
            for session in left:
                back = partial(self._back, session)
                button(f"Back to {session.state.machine.name}", back, icon="arrow_back", look="first")
            self.dropped = Dropped(self._open, importer)
            self._examples()
            self._templates()
            self._files()

    async def _open(self, open_: Callable[[], Session | Imported]) -> Imported | MissingOptionError | None:
        """Open a session, or say why not; return what was imported without readings, or what files leave open."""
        self.said.set_text("Reading …")
        try:
            content = await asyncio.to_thread(open_)
        except MissingOptionError as error:
            self.said.set_text("")
            return error
        except RodgenError as error:
            self.said.set_text(str(error))
            return None
        self.said.set_text("")
        if isinstance(content, Imported):
            return content
        await self._back(content)
        return None

    async def _back(self, session: Session) -> None:
        self.opened(session)
        ui.navigate.reload()

    def _files(self) -> None:
        with card("Files of this computer"):
            heading("Files of this computer")
            machine, data = field("Machine file, or a session", most=4000), field("Measurements", most=4000)

            async def open_them() -> None:
                file, of = (os.path.expanduser(str(each.value or "").strip()) for each in (machine, data))
                await self._open(partial(_opened, file, of))

            button("Open", open_them, label="Open the files")

    def _examples(self) -> None:
        if not (files_of := examples()):
            return
        with card("Examples"):
            heading("Examples")
            with ui.element("div").classes("line"):
                for name, files in files_of.items():
                    opens = partial(self._open, partial(Session.open, *files))
                    button(name, opens, label=f"Open the example {name}")

    def _templates(self) -> None:
        with card("A machine file to begin with"):
            heading("A machine file to begin with")
            kinds = {name: f"{name}: {re.sub(_OPTIONS, '', words)}" for name, words in KINDS.items()}
            with ui.element("div").classes("line"):
                kind = ui.select(kinds, value=next(iter(kinds)), label="Kind")
                code = ui.input("Axes, from workpiece to tool", placeholder="[w C A b X Y Z t]")
                latitude = ui.number("Latitude [deg]", value=0, min=-90, max=90)
                for each in (kind, code, latitude):
                    each.props("dense options-dense outlined maxlength=100")
                latitude.bind_visibility_from(
                    kind, "value", backward=lambda name: name.startswith("equatorial")
                )
                code.bind_visibility_from(kind, "value", backward=CODES.__contains__)

                async def begin() -> None:
                    axes = code.value if kind.value in CODES else ""
                    text = machine_template(
                        kind.value, code=axes or None, latitude=radians(latitude.value or 0.0)
                    )
                    await self.dropped.take({f"{kind.value}.toml": text.encode()})

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
