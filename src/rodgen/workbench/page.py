"""The page of the workbench: residuals, suspects, the ladder of the error, and what was done."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from rodgen.calibration.error_table import Model as ErrorModel
from rodgen.calibration.error_table import error_table, noise_name
from rodgen.calibration.words import odds_text, sized
from rodgen.data.set_aside import SetAside
from rodgen.document import Table
from rodgen.errors import counted
from rodgen.machines.machine import Effect
from rodgen.output import figures
from rodgen.output.figures.drawn_rows import DrawnRows
from rodgen.output.numbers import shown_unit
from rodgen.statistics.digits import last_decimal
from rodgen.workbench.actions import Aside, Back
from rodgen.workbench.drawing import drawn
from rodgen.workbench.keep import Keeping
from rodgen.workbench.model import Model
from rodgen.workbench.parts import (
    STYLE,
    anew,
    button,
    card,
    cell,
    completing,
    field,
    folded,
    guarded,
    heading,
    shown_blocks,
    soft,
)
from rodgen.workbench.planning import Planning
from rodgen.workbench.suspecting import Suspecting
from rodgen.workbench.verdict import Verdict

if TYPE_CHECKING:
    from nicegui.elements.plotly import Plotly

    from rodgen.calibration.plan import Plan
    from rodgen.workbench.desk import Desk
    from rodgen.workbench.session import State

__all__ = ["Page"]

MOST_IN_TABLE = 200
DIGITS = 6
"""Of the largest number of a column of the table: all of its numbers have as many decimals."""
TOO_SMALL = 0.1
"""Part of an axis below which residuals are drawn on a new scale."""
SENT = 0.01
"""Seconds after which what was drawn is on its way to the browser."""
NARROW = 760
"""Width of a window, in pixels, below which its parts stand below each other."""
PLOTLY = '<script type="module" async>import "nicegui-plotly"</script>'
"""In the head of the page: its largest part is loaded while the rest is laid out."""
ASKED = """return [
    window.innerWidth,
    window.matchMedia("(prefers-color-scheme: dark)").matches,
    !!document.createElement("canvas").getContext("webgl")
]"""
"""Of a window: its width, whether it is dark, and whether it draws on canvas; a first view is drawn without."""
SELECTED = (
    "(e) => emit({rows: ((e && e.points) || []).map((p) => p.customdata).filter((x) => x !== undefined)})"
)


@dataclass(frozen=True)
class Slot:
    """The place of a figure.

    Attributes
    ----------
    about : element
        Title, note and legend.
    plot : Plotly
    height : int
    kind : str
        Of the figure: one of another kind gets a plot of its own.
    """

    about: ui.html
    plot: Plotly
    height: int
    kind: str


class Page:
    """One window of the page.

    Parameters
    ----------
    desk : Desk
        What all windows share.
    leave : callable
        Leads back to the start.
    """

    def __init__(self, desk: Desk, leave: Callable[[], object]) -> None:
        self.desk, self.leave = desk, leave
        self.selected: set[int] = set()
        self.ruled: tuple[set[int], dict[str, str]] = set(), {}
        self.options: dict[str, Any] = {
            "against": "order",
            "parts": "apart",
            "before": "none",
            "whitened": False,
        }
        self.options |= {"colour": "", "approach": ""}
        self.scales: dict[Any, tuple[float, Any]] = {}
        self.dark = False
        self.width = 1280
        self.has_canvas = False
        self.drag: str | bool = "select"
        self.plots: dict[str, Slot] = {}
        self.traces = 0
        self.shown: str | None = None
        self._build()

    # the parts ---------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What holds now."""
        return self.desk.session.state

    def _build(self) -> None:
        ui.add_css(STYLE)
        ui.add_head_html(PLOTLY)
        self.client = ui.context.client
        ui.keyboard(on_key=guarded(self._key), ignore=["input", "select", "textarea"])
        with ui.element("header").classes("head"):
            with ui.element("div"):
                heading(f"{self.state.machine.name}", 1)
                self.status = ui.label().props('role="status" aria-live="polite"').classes("soft")
            button("Start", self._leave, icon="home", label="Back to the start", look="bare plain")
            self.undo = button("Undo", self.desk.undo, icon="undo", look="bare plain")
            self.redo = button("Redo", self.desk.redo, icon="redo", look="bare plain")
            button("Light or dark", self._darken, icon="contrast", look="bare plain")
            button("Plan", lambda: self.planning.open(), icon="add_location").classes("sign")
            self.keeping = Keeping(self)
            button("Keep", self.keeping.open, icon="save").classes("sign")
        if remarks := self.desk.session.remarks:
            title = f"{counted(len(remarks), 'remark')} on the files"
            with folded(title, opened=len(remarks) <= 2):
                for remark in remarks:
                    soft(remark)
        self.verdict = Verdict(self)
        with ui.element("div").classes("desk"):
            with ui.element("div").classes("side"):
                place = ui.element("div").classes("second w-full")
                self.ladder = card("The error, step by step").classes("second")
                self.model = Model(self)
            with ui.element("div").classes("main"):
                with ui.element("section").classes("card first").props('aria-label="Residuals"'):
                    self._choices()
                    self.residuals = ui.element("div").classes("plot")
                self.rows = card("Rows")
                with ui.element("section").classes("card").props('aria-label="Further plots"'):
                    with ui.tabs(on_change=self._draw_other).props(
                        'dense no-caps outside-arrows align=left aria-label="Further plots"'
                    ) as self.tabs:
                        goes = ["Polar"] if figures.joints_that_go_round(self.state.fit) else []
                        for name in ("Map", "In space", *goes, "Q-Q", "Autocorrelation", "Errors"):
                            ui.tab(name)
                    self.other = ui.element("div").classes("plot")
                self.planning = Planning(self)
        with place:
            self.suspects = Suspecting(self, self.planning, self._preview)
        self._draw_residuals()
        self._fill_state()
        self.tabs.set_value("Map")
        self.desk.windows.append(self)
        self.client.on_disconnect(self._gone)
        self.client.on_delete(self._gone)  # also of one that has never connected
        self.client.on_connect(self._connected)

    def _gone(self) -> None:
        if self in self.desk.windows:
            self.desk.windows.remove(self)

    async def _connected(self) -> None:
        """Ask the window for its width and whether it is dark; then find what takes longer than a first view may."""
        if self not in self.desk.windows:
            self.desk.windows.append(self)
        try:
            width, dark, self.has_canvas = await ui.run_javascript(ASKED, timeout=5.0)
        except TimeoutError:
            width, dark = self.width, self.dark
        if (int(width), bool(dark)) != (self.width, self.dark):
            self.width, self.dark = int(width), bool(dark)
            if self.narrow:  # a finger scrolls the page
                self.drags.set_value(None)
            await self._draw()
        await self.desk.look()
        await self.desk.check()

    async def refresh(self, what: str) -> None:
        """Show something anew."""
        fills = {
            "state": self._fill_state,
            "ladder": self._fill_ladder,
            "suspects": self.suspects.fill,
            "work": self.verdict.fill,
            "plan": self.planning.fill,
        }
        with self.client:
            self.selected &= set(range(self.state.observations.n))
            if what in {"state", "plan"}:
                await self._draw()
            fills[what]()

    def _fill_state(self) -> None:
        session = self.desk.session
        self.undo.set_enabled(session.at > 0)
        self.redo.set_enabled(session.at < len(session.states) - 1)
        for fill in (self.verdict.fill, self._fill_ladder, self._fill_rows, self.model.fill):
            fill()
        self.suspects.fill()
        self.planning.fill()

    # the ladder --------------------------------------------------------------------------------------------------

    def _fill_ladder(self) -> None:
        session, fit = self.desk.session, self.state.fit
        known = "rung" in self.state.__dict__
        noise = session.ladder.noise if known else None
        text = f"Error {sized(fit.rms, fit.unit)} per reading"
        if known and (unseen := self.state.rung.held_out.rms) is not None:
            text += f", {sized(unseen, fit.unit)} on poses held out"
        if noise is not None and noise.value is not None:
            text += f"; {noise_name(noise.source)} {sized(noise.value, fit.unit)}"
        self.status.set_text(f"{text}; {os.path.basename(self.state.observations.data.file)}.")
        table = error_table([_model(state) for state in session.states], fit.unit, noise)
        with anew(self.ladder, "The error, step by step"):
            with ui.element("table").classes("grid").props('aria-label="Errors of the models"'):
                with ui.element("tr"):
                    for words in table.header:
                        cell(words, "th")
                for number, row in enumerate(table.rows):
                    undone = session.at < number < len(session.states)
                    with ui.element("tr").style("opacity:.5" if undone else ""):
                        self._rung(number, row)
            if known:
                rung = self.state.rung
                for sentence in (rung.verdict, rung.held_out.note, session.ladder.noise.text):
                    if sentence:
                        soft(sentence)

    def _rung(self, number: int, row: Sequence[str]) -> None:
        session = self.desk.session
        title, *numbers = row
        with ui.element("td"):
            if number < len(session.states):
                state = session.states[number]
                why = f" ({state.action.why})" if state.action and state.action.why else ""
                back = ui.button(f"{title}{why}", on_click=guarded(partial(self.desk.go, number)))
                back.props("flat dense no-caps align=left color=none")
                back.props["aria-label"] = f"Go back to: {title}"
                back.classes("now" if number == session.at else "")
                if "rung" not in state.__dict__:
                    numbers[1] = "…"  # it is being computed
            else:
                ui.label(title)
        for words in numbers:
            cell(words)

    # plots -------------------------------------------------------------------------------------------------------

    def _preview(self, effect: Effect | None) -> None:
        """Draw what an effect would explain over the residuals; of None nothing any more."""
        suspects, slot = self.desk.suspects, self.plots.get("residuals")
        if slot is None or self.shown == (effect and effect.title):
            return
        if self.shown is not None:
            ends = self.traces, self.traces + self.state.fit.residuals.shape[1]
            slot.plot.run_plot_method("deleteTraces", list(range(*ends)))
            self.shown = None
        if suspects is None or effect is None or self.options["parts"] != "apart" or self.options["whitened"]:
            return
        against, rows_kept = self.options["against"], sorted(self.selected)
        explained = suspects.explained(effect)
        traces = figures.explained_marks(self.state.fit, against, explained, suspects.rows, kept=rows_kept)
        self.shown = effect.title
        slot.plot.run_plot_method("addTraces", traces)

    @property
    def narrow(self) -> bool:
        """Whether the parts stand below each other."""
        return self.width <= NARROW

    @property
    def place(self) -> int:
        """Width of a plot, in pixels."""
        return self.width - 40 if self.narrow else min(self.width, 1680) - 400 - 96

    def _choices(self) -> None:
        rows = DrawnRows(self.state.fit)
        names, self.options["against"] = [*rows.drivers], rows.main_driver
        joints = [joint.name for joint in self.state.machine.joints]
        known = self.state.observations.approach_known
        marked = [joint for joint, way in zip(joints, known, strict=True) if way]
        parts = {"apart": "components", "together": "size"}
        choices: dict[str, tuple[str, Any]] = {
            "against": ("Against", names),
            "parts": ("Show", parts | {joint: f"reading of {joint}" for joint in joints}),
            "colour": ("Coloured by", {"": "nothing"} | {name: name for name in names}),
            "before": ("Compared with", {"none": "nothing", "step": "the step before", "first": "the file"}),
        }
        if marked:
            choices["approach"] = "Approach of", {"": "none"} | {joint: joint for joint in marked}
        with ui.element("div").classes("choices"):
            for key, (text, options) in choices.items():
                select = ui.select(options, value=self.options[key], label=text)
                select.on_value_change(guarded(partial(self._chosen, key))).props("dense options-dense")
            ui.checkbox("whitened", on_change=guarded(partial(self._chosen, "whitened"))).props("dense")
            drags = {"select": "Select", "zoom": "Zoom"}
            self.drags = ui.toggle(drags, value=self.drag, on_change=guarded(self._drags))
            self.drags.props('flat no-caps color=none toggle-color=primary clearable aria-label="Dragging"')

    async def _drags(self, event: Any) -> None:
        self.drag = event.value or False
        for slot in self.plots.values():
            slot.plot.run_plot_method("relayout", {"dragmode": self.drag})

    async def _chosen(self, key: str, event: Any) -> None:
        self.options[key] = event.value
        self._draw_residuals()
        if key == "before" or self.tabs.value == "Polar":
            self._draw_other()

    def _before(self) -> Any:
        wanted = self.options["before"]
        if wanted == "none" or self.state.before is None:
            return None
        before = self.state.before if wanted == "step" else self.desk.session.states[0]
        return before.fit if before.observations is self.state.observations else None

    def _planned(self) -> Plan | None:
        return None if self.desk.plan is None else self.desk.plan[1]

    async def _draw(self) -> None:
        """Draw all plots; the browser draws one while the next is made."""
        for draw in (self._draw_residuals, self._draw_other):
            draw()
            await asyncio.sleep(SENT)

    def _draw_residuals(self) -> None:
        self.shown = None
        fit, before, options = self.state.fit, self._before(), self.options
        unit = shown_unit(fit.unit, [(before or fit).rms, fit.rms]).unit
        key = options["parts"], options["whitened"], unit
        figure = figures.residual_plot(
            fit,
            **options | {"before": before},
            selected=sorted(self.selected),
            aside=np.flatnonzero(self.state.aside).tolist(),
            planned=self._planned(),
            least=self._scale(key) or (),
        )
        self._keep_scale(key, [axis.range[1] for axis in figure.select_yaxes() if axis.range])
        self.traces = len(figure.data)
        self.show("residuals", self.residuals, figure, revision=options["against"])

    def _scale(self, key: Any) -> Any:
        """Return the scale of a figure of a model before, on which the error is seen to fall; None for a new one."""
        rms, scale = self.scales.get(key, (0.0, None))
        return scale if self.state.fit.rms > TOO_SMALL * rms else None

    def _keep_scale(self, key: Any, scale: Any) -> None:
        if self._scale(key) is None or self.state.fit.rms > self.scales[key][0]:
            self.scales[key] = self.state.fit.rms, scale

    def show(self, name: str, place: ui.element, figure: Any, *, kind: str = "", revision: str = "") -> None:
        """Draw a figure at its place: into the plot that is there, where it is as high and of the same kind.

        While `revision` stays the same a user's zoom stays, too.
        """
        about, alt, content = drawn(
            figure,
            dark=self.dark,
            width=self.place,
            drag=self.drag,
            revision=revision,
            on_canvas=self.has_canvas,
        )
        height = content["layout"]["height"]
        slot = self.plots.get(name)
        if slot is None or (slot.height, slot.kind) != (height, kind):
            with anew(place):
                slot = self.plots[name] = Slot(
                    ui.html(sanitize=False),
                    ui.plotly(content).props('role="img"').style(f"height:{height}px"),
                    height,
                    kind,
                )
                slot.plot.on("plotly_selected", guarded(self._brushed), js_handler=SELECTED)
                slot.plot.on("plotly_click", guarded(self._clicked), js_handler=SELECTED)
        else:
            slot.plot.update_figure(content)
        slot.plot.props["aria-label"] = alt
        slot.about.set_content(about)

    def _draw_other(self) -> None:
        name, fit = self.tabs.value, self.state.fit
        if not name:
            return
        both: dict[str, Any] = {"before": self._before(), "selected": sorted(self.selected)}
        aside = np.flatnonzero(self.state.aside).tolist()
        ahead = both | {"planned": self._planned()}
        times = self._scale(name) or 0.0
        makers: dict[str, Callable[[], Any]] = {
            "Map": lambda: figures.residual_map(fit, exaggeration=times, **ahead),
            "In space": lambda: figures.residual_vectors(fit, exaggeration=times, **ahead),
            "Polar": lambda: figures.polar_plot(fit, self._round(), aside=aside, **ahead),
            "Q-Q": lambda: figures.quantiles_of_residuals(fit, **both),
            "Autocorrelation": lambda: figures.autocorrelation_of_residuals(fit),
            "Errors": lambda: figures.ladder(self.desk.session.ladder),
        }
        figure = makers[name]()
        if figure is not None and "exaggeration" in figure.layout.meta:
            self._keep_scale(name, figure.layout.meta["exaggeration"])
        if figure is None:
            self.plots.pop("other", None)
            with anew(self.other):
                ui.label(
                    "Residuals of distances, angles and attitudes are no places and no vectors in space."
                )
            return
        self.show("other", self.other, figure, kind=name, revision=self._round() if name == "Polar" else "")

    def _round(self) -> str:
        """Return the joint that a polar plot goes round: that of the x axis where it does."""
        joints = figures.joints_that_go_round(self.state.fit)
        against = self.options["against"]
        return against if against in joints else joints[0]

    # selecting ---------------------------------------------------------------------------------------------------

    async def _brushed(self, event: Any) -> None:
        if rows := _rows_of(event):
            await self.select(rows)

    async def _clicked(self, event: Any) -> None:
        await self.select(self.selected ^ _rows_of(event))

    async def select(self, rows: set[int]) -> None:
        """Select rows of the observations, and mark them everywhere."""
        self.selected = {row for row in rows if 0 <= row < self.state.observations.n}
        await self._draw()
        self._fill_rows()

    def _fill_rows(self) -> None:
        state, chosen = self.state, np.array(sorted(self.selected), int)
        count = len(chosen)
        with anew(self.rows, f"{count} rows selected" if count else "Rows"):
            if count or state.aside.any():
                with ui.element("div").classes("line"):
                    why = field("Note", example="why", most=200)
                    aside = button("Exclude", partial(self._aside, why))
                    back = button("Include again", self._back)
                    none = button("Select none", partial(self.select, set()))
                    aside.set_enabled(count > 0 and not state.aside[chosen].all())
                    back.set_enabled(bool(state.aside[chosen].any()) if count else bool(state.aside.any()))
                    none.set_enabled(count > 0)
            if not count:
                soft("Drag over a plot, or click marks, to select. The largest residuals:")
                finite = np.isfinite(state.fit.sizes).all(axis=1)
                size = np.where(finite, np.linalg.norm(state.fit.sizes, axis=1), -1)
                chosen = np.argsort(-size, kind="stable")[:8]
            shown_blocks([self._table(chosen[:MOST_IN_TABLE])])
            if count > MOST_IN_TABLE:
                soft(f"The first {MOST_IN_TABLE} of {count} rows.")
            with folded("Select by a rule"), ui.element("div").classes("line"):
                rule = field("Rule", example="EL < 20 deg and load > 50 N")
                completing(rule, lambda: state.data.columns)
                button("Select", partial(self._by_rule, rule), label="Select by the rule")

    def _table(self, rows: Any) -> Table:
        state, fit = self.state, self.state.fit
        columns = state.observations.data.columns
        header = [state.observations.data.counted]
        cells: list[Any] = [state.numbers[rows].tolist()]
        if state.aside[rows].any():
            header.append("state")
            cells.append(["excluded" if aside else "" for aside in state.aside[rows]])
        for name, values in zip(fit.machine.measurand.labels, fit.residuals[rows].T, strict=True):
            header.append(f"residual {name} [{fit.unit}]")
            cells.append(_numbers(values, fit.rms, 3))
        for column in columns.values():
            header.append(column.text)
            values = column.take(rows).values
            size = max((abs(x) for x in values if not isinstance(x, str) and np.isfinite(x)), default=0.0)
            cells.append(_numbers(values, size, DIGITS))
        return Table(
            header, [*zip(*[[str(x) for x in each] for each in cells], strict=True)], "r" * len(header)
        )

    async def _by_rule(self, rule: Any) -> None:
        text, o = str(rule.value or "").strip(), self.state.observations
        mask = SetAside(where=text).of(self.state.data, ()) if text else None
        rows = set() if mask is None else set(np.flatnonzero(~o.counted(~mask)).tolist())
        self.ruled = rows, {"where": text}
        await self.select(rows)

    def _which(self, rows: set[int]) -> dict[str, Any]:
        """Return how an action names rows: by their rule where they are all that it selected."""
        selected, rule = self.ruled
        if rule and selected == self.selected:
            return rule
        return {"rows": self.state.numbers[sorted(rows)].tolist()}

    async def _aside(self, why: Any) -> None:
        keys = self._which(self.selected)
        self.selected = set()
        await self.desk.do(Aside(**keys, why=str(why.value or "")[:200]))

    async def _back(self) -> None:
        gone = self.selected & set(np.flatnonzero(self.state.aside).tolist())
        await self.desk.do(Back(**self._which(gone)) if self.selected else Back())

    # doing -------------------------------------------------------------------------------------------------------

    async def _leave(self) -> None:
        self.leave()
        ui.navigate.reload()

    async def _key(self, event: Any) -> None:
        if not event.action.keydown or not (event.modifiers.ctrl or event.modifiers.meta):
            return
        if event.key == "z" and not event.modifiers.shift:
            await self.desk.undo()
        elif event.key == "y" or (event.key == "Z" and event.modifiers.shift):
            await self.desk.redo()

    async def _darken(self) -> None:
        self.dark = not self.dark
        # an element for it has the browser compute the style of the whole page anew with whatever is drawn
        ui.run_javascript(f"Quasar.Dark.set({str(self.dark).lower()})")
        await self._draw()


def _rows_of(event: Any) -> set[int]:
    """Return the rows of marks that a browser names."""
    return {
        int(row) for row in event.args.get("rows", ()) if isinstance(row, int | float) and abs(row) < 2**53
    }


def _model(state: State) -> ErrorModel:
    """Return a state as the table of errors shows it; what takes longer than the fit only where it is known."""
    if "rung" not in state.__dict__:
        return ErrorModel(state.title, state.fit.rms, None)
    rung = state.rung
    odds = odds_text(rung.step.odds) if rung.step else ""
    return ErrorModel(state.title, rung.fit.rms, rung.held_out.rms, odds)


def _numbers(values: Any, size: float, digits: int) -> list[str]:
    """Return the numbers of a column with the decimals of one size in so many digits; texts as they are."""
    decimals = max(int(last_decimal(size or 1.0, digits)), 0)
    return [x if isinstance(x, str) else f"{x:.{decimals}f}" for x in values]
