"""The page of the workbench: residuals, suspects, the ladder of the error, and what was done."""

from __future__ import annotations

import asyncio
import html
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nicegui import ui

from rodgen.calibration.error_table import THE_FILE, error_table, noise_name
from rodgen.calibration.error_table import Model as ErrorModel
from rodgen.calibration.words import odds_text, sized
from rodgen.errors import RodgenError, counted, listed
from rodgen.machines.drivers import Driver
from rodgen.machines.machine import Effect
from rodgen.output import figures
from rodgen.output.figures.drawn_rows import DrawnRows
from rodgen.workbench.actions import Add, Aside, Back, Repair
from rodgen.workbench.drawing import Drawn, drawn, overlay
from rodgen.workbench.keep import Keeping
from rodgen.workbench.model import Model, keys
from rodgen.workbench.parts import STYLE, anew, button, card, guarded, heading, shown_blocks
from rodgen.workbench.planning import Planning

if TYPE_CHECKING:
    from nicegui.elements.plotly import Plotly

    from rodgen.calibration.plan import Plan
    from rodgen.calibration.suspects import Suspect
    from rodgen.workbench.desk import Desk
    from rodgen.workbench.session import State

__all__ = ["Page"]

FIRST_SUSPECTS = 12
"""Suspects that are listed before all are asked for."""
FEW_REMARKS = 2
MOST_IN_TABLE = 200
SENT = 0.01
"""Seconds after which what was drawn is on its way to the browser."""
NARROW = 760
"""Width of a window, in pixels, below which its parts stand below each other."""
PLOTLY = '<script type="module" async>import "nicegui-plotly"</script>'
"""In the head of the page: its largest part is loaded while the rest is laid out."""
SELECTED = (
    "(e) => emit({rows: ((e && e.points) || []).map((p) => p.customdata).filter((x) => x !== undefined)})"
)


@dataclass(frozen=True)
class Slot:
    """The place of a figure.

    Attributes
    ----------
    note, legend : element
    plot : Plotly
    height : int
    kind : str
        Of the figure: one of another kind gets a plot of its own.
    """

    note: ui.element
    legend: ui.element
    plot: Plotly
    height: int
    kind: str


class Page:
    """One window of the page.

    Parameters
    ----------
    desk : Desk
        What all windows share.
    """

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self.selected: set[int] = set()
        self.ruled: tuple[set[int], dict[str, str]] = set(), {}
        self.against = "order"
        self.options: dict[str, Any] = {
            "colour": "",
            "parts": "apart",
            "approach": "",
            "whitened": False,
            "before": "none",
        }
        self.times = 0.0
        self.dark = False
        self.width = 1280
        self.all_suspects = False
        self.plots: dict[str, Slot] = {}
        self.content: Drawn | None = None
        self.shown: str | None = None
        self._build()

    # the parts ---------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What holds now."""
        return self.desk.session.state

    def _build(self) -> None:
        desk = self.desk
        ui.add_css(STYLE)
        ui.add_head_html(PLOTLY)
        self.client = ui.context.client
        ui.keyboard(on_key=guarded(self._key), ignore=["input", "select", "textarea"])
        with ui.element("header").classes("head"):
            heading(f"{self.state.machine.name}", 1)
            self.undo = button("Undo", self._undo, icon="undo", tip="Undo, Ctrl+Z").classes("sign")
            self.redo = button("Redo", self._redo, icon="redo", tip="Redo, Ctrl+Y").classes("sign")
            self.asking = button("Diagnose", desk.diagnose, icon="troubleshoot")
            button("Plan", self._ask_plan, icon="add_location")
            self.keeping = Keeping(self)
            button("Keep", self.keeping.open, icon="save")
            button("Light or dark", self._darken, icon="contrast", bare=True)
        self._remarks()
        self.status = ui.label().props('role="status" aria-live="polite"')
        self.wrong = ui.element("section").classes("card wrong").props('aria-label="A wrong file"')
        self.working = ui.element("section").classes("card").props('aria-label="In the background"')
        with ui.element("div").classes("desk"):
            with ui.element("div").classes("side"):
                self.ladder = card("Ladder of the error").classes("second")
                self.suspects = card("Suspects").classes("second")
                self.suggested = card("Suggestions of the diagnosis").classes("second")
                self.model = Model(self)
                self.doing = card("Done so far").classes("last")
            with ui.element("div").classes("main"):
                with ui.element("section").classes("card first").props('aria-label="Residuals"'):
                    self._choices()
                    self.residuals = ui.element("div").classes("plot")
                with ui.element("section").classes("card").props('aria-label="Selected rows"'):
                    self.rows = ui.element("div")
                with ui.element("section").classes("card").props('aria-label="Further plots"'):
                    with ui.tabs(on_change=self._draw_other).props(
                        'dense no-caps align=left aria-label="Further plots"'
                    ) as self.tabs:
                        goes = ["Polar"] if figures.joints_that_go_round(self.state.fit) else []
                        for name in ("Map", "In space", *goes, "Q-Q", "Autocorrelation", "Errors"):
                            ui.tab(name)
                    with ui.element("div").classes("line") as self.exaggerated:
                        ui.label("Exaggeration").classes("soft")
                        slider = ui.slider(
                            min=0, max=7, step=0.1, value=0, on_change=guarded(self._exaggerate)
                        )
                        slider.props(
                            'aria-label="Exaggeration, as a power of ten; 0: as can be seen" throttle=200'
                        )
                        slider.style("max-width:280px")
                    self.other = ui.element("div").classes("plot")
                self.planning = Planning(self)
        self._draw_residuals()
        self._fill_state()
        self._fill_suspects()
        self._fill_work()
        self.planning.fill()
        self.tabs.set_value("Map")
        desk.windows.append(self)
        self.client.on_disconnect(self._gone)
        self.client.on_delete(self._gone)  # also of one that has never connected
        self.client.on_connect(self._connected)

    def _remarks(self) -> None:
        """Say what differs from a session that was read, or what an import took for what."""
        remarks = self.desk.session.remarks
        few = len(remarks) <= FEW_REMARKS
        with (
            ui.element("div") if few else ui.expansion(f"{len(remarks)} remarks on the files").props("dense")
        ):
            for remark in remarks:
                ui.label(remark).classes("soft")

    def _gone(self) -> None:
        if self in self.desk.windows:
            self.desk.windows.remove(self)

    async def _connected(self) -> None:
        """Ask the window for its width and whether it is dark; then find what takes longer than a first view may."""
        if self not in self.desk.windows:
            self.desk.windows.append(self)
        asked = "[window.innerWidth, window.matchMedia('(prefers-color-scheme: dark)').matches]"
        try:
            width, dark = await ui.run_javascript(f"return {asked}", timeout=5.0)
        except TimeoutError:
            width, dark = self.width, self.dark
        if (int(width), bool(dark)) != (self.width, self.dark):
            self.width, self.dark = int(width), bool(dark)
            await self._draw()
        await self.desk.look()
        await asyncio.to_thread(lambda: self.state.check)
        self._fill_wrong()

    async def refresh(self, what: str) -> None:
        """Show something anew."""
        with self.client:
            if what == "state":
                self.selected &= set(range(self.state.observations.n))
                await self._draw()
                self._fill_state()
                self._fill_suspects()
                self.planning.fill()
            elif what == "ladder":
                self._fill_ladder()
            elif what == "suspects":
                self._fill_suspects()
            elif what == "work":
                self._fill_work()
            elif what == "plan":
                await self._draw()
                self.planning.fill()

    def _fill_state(self) -> None:
        session = self.desk.session
        self.undo.set_enabled(session.at > 0)
        self.redo.set_enabled(session.at < len(session.states) - 1)
        self._fill_ladder()
        self._fill_rows()
        self._fill_doing()
        self._fill_wrong()
        self._fill_suggested()
        self.model.fill()

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
        with anew(self.ladder, "Ladder of the error"):
            with ui.element("table").classes("ladder").props('aria-label="Errors of the models"'):
                with ui.element("tr"):
                    for words in table.header:
                        _in_cell("th", words)
                for number, row in enumerate(table.rows):
                    with ui.element("tr").style(
                        "opacity:.5" if session.at < number < len(session.states) else ""
                    ):
                        self._rung(number, row)
            if known:
                rung = self.state.rung
                for sentence in (rung.verdict, rung.held_out.note, session.ladder.noise.text):
                    if sentence:
                        ui.label(sentence).classes("soft")

    def _rung(self, number: int, row: Sequence[str]) -> None:
        session = self.desk.session
        title, *numbers = row
        with ui.element("td"):
            if number < len(session.states):
                back = ui.button(title, on_click=guarded(partial(self.desk.go, number)))
                back.props("flat dense no-caps align=left")
                back.props["aria-label"] = f"Go back to: {title}"
                if number == session.at:
                    back.props("color=primary").style("font-weight:650")
                if "rung" not in session.states[number].__dict__:
                    numbers[1] = "…"  # it is being computed
            else:
                ui.label(title)
        for words in numbers:
            _in_cell("td", words)

    # suspects ----------------------------------------------------------------------------------------------------

    def _fill_suspects(self) -> None:
        found = self.desk.suspects
        with anew(self.suspects, "Suspects"):
            if found is None:
                ui.label("Every effect of the catalogue is tested …").classes("soft")
                return
            listed = found.listed if self.all_suspects else found.listed[:FIRST_SUSPECTS]
            ui.label("Odds: how many times as probable the model is with it alone as without.").classes(
                "soft"
            )
            worse = next((s for s in listed if not s.chosen and s.like is None and s.odds < 1), None)
            for suspect in listed:
                if suspect is worse:
                    ui.label("Below this, no better than nothing:").classes("soft")
                self._suspect(suspect)
            if len(listed) < len(found.listed):
                button(f"All {len(found.listed)}", self._list_all, bare=False)
            groups = {s.like for s in listed if s.like is not None}
            for leader in groups:
                alike = [leader, *(s.effect for s in listed if s.like == leader)]
                button(
                    f"Where to measure to part {leader.title} from {len(alike) - 1} like it",
                    partial(self.planning.part, alike),
                )

    def _suspect(self, suspect: Suspect) -> None:
        title = suspect.effect.title
        row = ui.element("div").classes("suspect" + (" like" if suspect.like else ""))
        with row:
            add = button("Add", partial(self._add, suspect.effect), label=f"Add {title}")
            with ui.element("div").classes("what"):
                ui.label(title)
                unit = self.state.fit.unit
                said = f"odds {odds_text(suspect.odds)}, would leave {sized(suspect.rms, unit)}"
                ui.label(said).classes("soft")
                if suspect.like is not None:
                    ui.label(f"indistinguishable from {suspect.like.title}").classes("soft")
        for event in ("mouseenter", "focusin"):
            row.on(event, partial(self._preview, suspect.effect), args=[])
        for event in ("mouseleave", "focusout"):
            row.on(event, self._no_preview, args=[])
        with add:  # later than what it would explain is drawn
            ui.tooltip(suspect.effect.definition.meaning).props("delay=700")

    async def _list_all(self) -> None:
        self.all_suspects = True
        self._fill_suspects()

    async def _add(self, effect: Effect) -> None:
        await self.desk.do(Add(keys(effect, self.state.machine)))

    def _preview(self, effect: Effect) -> None:
        """Draw what an effect would explain over the residuals."""
        found, slot = self.desk.suspects, self.plots.get("residuals")
        if found is None or slot is None or self.content is None or self.shown == effect.title:
            return
        self._no_preview()
        if self.options["parts"] != "apart" or self.options["whitened"]:
            return
        factors = DrawnRows(self.state.fit).factors
        traces = overlay(self.content.content, found.explained(effect) * factors, found.rows)
        self.shown = effect.title
        slot.plot.run_plot_method("addTraces", traces)

    def _no_preview(self) -> None:
        slot = self.plots.get("residuals")
        if self.shown is not None and slot is not None and self.content is not None:
            count = len(self.content.content["data"])
            panels = self.state.fit.residuals.shape[1]
            slot.plot.run_plot_method("deleteTraces", list(range(count, count + panels)))
        self.shown = None

    # plots -------------------------------------------------------------------------------------------------------

    @property
    def place(self) -> int:
        """Width of a plot, in pixels."""
        return self.width - 40 if self.width <= NARROW else self.width - 400 - 70

    def _drivers(self) -> Mapping[str, Driver]:
        return DrawnRows(self.state.fit).drivers

    def _choices(self) -> None:
        names = [*self._drivers()]
        self.against = names[0] if names else "order"
        joints = [joint.name for joint in self.state.machine.joints]
        parts = {"apart": "components", "together": "size"} | {j: f"reading of {j}" for j in joints}
        with ui.element("div").classes("line"):
            heading("Residuals")
            self._choice("against", names, self.against, "Against")
            self._choice("colour", {"": "nothing", **{name: name for name in names}}, "", "Coloured by")
            self._choice("parts", parts, "apart", "Show")
            self._choice(
                "before",
                {"none": "nothing", "step": "the step before", "first": "the file"},
                "none",
                "Compared with",
            )
            known = self.state.observations.approach_known
            marked = [joint for joint, way in zip(joints, known, strict=True) if way]
            if marked:
                ways = {"": "none"} | {joint: joint for joint in marked}
                self._choice("approach", ways, "", "Approach of")
            ui.checkbox("whitened", on_change=guarded(partial(self._chosen, "whitened")))

    def _choice(self, key: str, options: Any, value: str, text: str) -> None:
        ui.select(options, value=value, label=text, on_change=guarded(partial(self._chosen, key))).props(
            "dense options-dense outlined"
        ).style("min-width:128px")

    async def _chosen(self, key: str, event: Any) -> None:
        if key == "against":
            self.against = event.value
        else:
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

    async def _ask_plan(self) -> None:
        await self.planning.open()

    async def _draw(self) -> None:
        """Draw all plots; the browser draws one while the next is made."""
        for draw in (self._draw_residuals, self._draw_other):
            draw()
            await asyncio.sleep(SENT)

    def _draw_residuals(self) -> None:
        self.shown = None
        state, aside = self.state, np.flatnonzero(self.state.aside).tolist()
        figure = figures.residual_plot(
            state.fit,
            self.against,
            before=self._before(),
            parts=self.options["parts"],
            whitened=self.options["whitened"],
            colour=self.options["colour"],
            approach=self.options["approach"],
            selected=sorted(self.selected),
            aside=aside,
            planned=self._planned(),
        )
        self.content = self.show("residuals", self.residuals, figure, revision=self.against)

    def show(self, name: str, place: ui.element, figure: Any, *, kind: str = "", revision: str = "") -> Drawn:
        """Draw a figure at its place: into the plot that is there, where it is as high and of the same kind.

        While `revision` stays the same a user's zoom stays, too.
        """
        made = drawn(figure, dark=self.dark, width=self.place, revision=revision)
        height = made.content["layout"]["height"]
        slot = self.plots.get(name)
        if slot is None or (slot.height, slot.kind) != (height, kind):
            with anew(place):
                slot = self.plots[name] = Slot(
                    ui.element("div").classes("soft"),
                    ui.element("div").classes("legend"),
                    ui.plotly(made.content).props('role="img"').style(f"height:{height}px"),
                    height,
                    kind,
                )
                slot.plot.on("plotly_selected", guarded(self._brushed), js_handler=SELECTED)
                slot.plot.on("plotly_click", guarded(self._clicked), js_handler=SELECTED)
        else:
            slot.plot.update_figure(made.content)
        slot.plot.props["aria-label"] = made.alt
        with anew(slot.note):
            ui.label(f"{made.title}. {made.note}")
        with anew(slot.legend):
            for sign, colour, words in made.legend:
                with ui.element("span"):
                    ui.label(sign).style(f"display:inline;color:{colour or 'inherit'}").props(
                        "aria-hidden=true"
                    )
                    ui.label(html.unescape(words)).style("display:inline;margin-left:4px")
        return made

    def _draw_other(self) -> None:
        name, fit = self.tabs.value, self.state.fit
        if not name:
            return
        self.exaggerated.set_visibility(name in {"Map", "In space"})
        both: dict[str, Any] = {"before": self._before(), "selected": sorted(self.selected)}
        aside = np.flatnonzero(self.state.aside).tolist()
        ahead = both | {"planned": self._planned()}
        makers: dict[str, Callable[[], Any]] = {
            "Map": lambda: figures.residual_map(fit, exaggeration=self.times, **ahead),
            "In space": lambda: figures.residual_vectors(fit, exaggeration=self.times, **ahead),
            "Polar": lambda: figures.polar_plot(fit, self._round(), aside=aside, **ahead),
            "Q-Q": lambda: figures.quantiles_of_residuals(fit, **both),
            "Autocorrelation": lambda: figures.autocorrelation_of_residuals(fit),
            "Errors": lambda: figures.ladder(self.desk.session.ladder),
        }
        made = makers[name]()
        if made is None:
            self.plots.pop("other", None)
            with anew(self.other):
                ui.label(
                    "Residuals of distances, angles and attitudes are no places and no vectors in space."
                )
            return
        self.show("other", self.other, made, kind=name, revision=self._round() if name == "Polar" else "")

    def _round(self) -> str:
        """Return the joint that a polar plot goes round: that of the x axis where it does."""
        found = figures.joints_that_go_round(self.state.fit)
        return self.against if self.against in found else found[0]

    async def _exaggerate(self, event: Any) -> None:
        self.times = round(10 ** float(event.value), 0) if event.value else 0.0
        self._draw_other()

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
        state = self.state
        chosen = np.array(sorted(self.selected), int)
        with anew(self.rows):
            with ui.element("div").classes("line"):
                heading(f"{len(chosen)} rows selected" if len(chosen) else "Rows")
                why = (
                    ui.input("Note", placeholder="why")
                    .props("dense outlined maxlength=200")
                    .style("width:140px")
                )
                aside = button("Set aside", partial(self._aside, why))
                back = button("Bring back", self._back)
                none = button("Select none", self._none)
                aside.set_enabled(len(chosen) > 0 and not state.aside[chosen].all())
                back.set_enabled(bool(state.aside[chosen].any()) if len(chosen) else bool(state.aside.any()))
                none.set_enabled(len(chosen) > 0)
            self._rule()
            if not len(chosen):
                size = np.where(
                    np.isfinite(state.fit.sizes).all(axis=1), np.linalg.norm(state.fit.sizes, axis=1), -1
                )
                chosen = np.argsort(-size, kind="stable")[:8]
                ui.label("Drag over a plot, or click marks, to select. The largest residuals:").classes(
                    "soft"
                )
            self._table(chosen[:MOST_IN_TABLE])
            if len(chosen) > MOST_IN_TABLE:
                ui.label(f"The first {MOST_IN_TABLE} of {len(chosen)} rows.").classes("soft")

    def _table(self, rows: Any) -> None:
        state, fit = self.state, self.state.fit
        data = state.observations.data
        names = list(data.columns)
        shown = [
            {
                "row": int(state.numbers[i]),
                "state": "set aside" if state.aside[i] else "",
                **{f"c{k}": _cell(data.columns[name], i) for k, name in enumerate(names)},
                **{f"r{k}": f"{fit.residuals[i, k]:.4g}" for k in range(fit.residuals.shape[1])},
            }
            for i in rows
        ]
        columns: list[dict[str, Any]] = [
            {"name": "row", "label": data.counted, "field": "row", "sortable": True},
            *(
                {"name": f"r{k}", "label": f"residual {name} [{fit.unit}]", "field": f"r{k}"}
                for k, name in enumerate(fit.machine.measurand.labels)
            ),
            *(
                {"name": f"c{k}", "label": data.columns[name].text, "field": f"c{k}"}
                for k, name in enumerate(names)
            ),
            {"name": "state", "label": "state", "field": "state"},
        ]
        table = ui.table(columns=columns, rows=shown, row_key="row", pagination=8).classes("w-full")
        table.props(
            'dense flat :rows-per-page-options="[8]" role=group aria-label="Rows of the measurements"'
        )

    def _rule(self) -> None:
        drivers = self._drivers()
        with ui.element("div").classes("line"):
            name = ui.select([*drivers], value=next(iter(drivers)), label="Rule").props(
                "dense options-dense outlined"
            )
            name.style("min-width:110px")
            sign = ui.select([">", "<", "="], value=">").props('dense outlined aria-label="Comparison"')
            value = ui.input("Value").props("dense outlined").style("width:90px")
            button("Select", partial(self._by_rule, name, sign, value), label="Select by the rule")

    async def _by_rule(self, name: Any, sign: Any, value: Any) -> None:
        driver = {d.name: d for d in self.state.observations.drivers()} | dict(
            DrawnRows(self.state.fit, most=10**9).drivers
        )
        found = driver[name.value]
        text = str(value.value or "").strip()
        unit, comparison = found.unit, "=" if found.categories else sign.value
        if found.categories:
            if text not in found.categories:
                raise RodgenError(f"no {name.value} {text!r}; expected {listed(found.categories)}")
            mask = found.values == found.categories.index(text)
        else:
            try:
                limit = float(text)
            except ValueError:
                raise RodgenError(
                    f"value {text!r}; expected a number, in {found.unit or 'the unit of the column'}"
                ) from None
            noted = np.asarray(found.noted, float)
            mask = {">": noted > limit, "<": noted < limit, "=": noted == limit}[sign.value]
        rows: set[int] = set(np.flatnonzero(mask).tolist())
        rule = {"where": f"{name.value} {comparison} {text} {unit}".strip()}
        of_column = name.value in self.state.data.columns
        self.ruled = (rows, {"run": text} if name.value == "run" else rule) if of_column else (set(), {})
        await self.select(rows)

    def _which(self, rows: set[int]) -> dict[str, Any]:
        """Return how an action names rows: by their rule where they are all that it selected."""
        selected, rule = self.ruled
        if rule and selected == self.selected:
            return rule
        return {"rows": self.state.numbers[sorted(rows)].tolist()}

    async def _aside(self, why: Any) -> None:
        said = self._which(self.selected)
        self.selected = set()
        await self.desk.do(Aside(**said, why=str(why.value or "")[:200]))

    async def _back(self) -> None:
        gone = self.selected & set(np.flatnonzero(self.state.aside).tolist())
        await self.desk.do(Back(**self._which(gone)) if self.selected else Back())

    async def _none(self) -> None:
        await self.select(set())

    # doing -------------------------------------------------------------------------------------------------------

    async def _undo(self) -> None:
        await self.desk.undo()

    async def _redo(self) -> None:
        await self.desk.redo()

    async def _key(self, event: Any) -> None:
        if not event.action.keydown or not (event.modifiers.ctrl or event.modifiers.meta):
            return
        if event.key == "z" and not event.modifiers.shift:
            await self._undo()
        elif event.key == "y" or (event.key == "Z" and event.modifiers.shift):
            await self._redo()

    def _fill_doing(self) -> None:
        with anew(self.doing, "Done so far"):
            actions = [state.action for state in self.desk.session.done if state.action]
            for action in actions:
                ui.label(f"{action.title}{f' ({action.why})' if action.why else ''}")
            if not actions:
                ui.label("Nothing yet.").classes("soft")

    def _fill_wrong(self) -> None:
        check = self.state.__dict__.get("check")
        self.wrong.set_visibility(check is not None and check.wrong)
        if check is None or not check.wrong:
            return
        with anew(self.wrong):
            ui.label(check.sentence)
            with ui.element("div").classes("line"):
                for repair in check.repairs[:4]:
                    if not repair.of_data:
                        button(f"Repair: {repair.words}", partial(self._repair, repair.words))
            if any(repair.of_data for repair in check.repairs[:1]):
                ui.label(
                    f"The data are at fault; the command 'rodgen check {self.state.file} {self.desk.session.data_file} "
                    "--repaired-data FILE' writes repaired ones."
                ).classes("soft")

    async def _repair(self, words: str) -> None:
        await self.desk.do(Repair(words))
        await asyncio.to_thread(lambda: self.state.check)
        self._fill_wrong()

    # in the background -------------------------------------------------------------------------------------------

    def _fill_work(self) -> None:
        work = self.desk.work
        self.working.set_visibility(work is not None)
        self.asking.set_enabled(work is None)
        if work is not None:
            with anew(self.working), ui.element("div").classes("line"):
                ui.spinner(size="1.2em")
                text = ui.label(work.text).props('role="status"')
                button("Stop", partial(_stopped, work))
                ui.timer(0.5, lambda: text.set_text(work.text))
        self._fill_suggested()

    def _fill_suggested(self) -> None:
        found = self.desk.diagnosis
        self.suggested.set_visibility(found is not None)
        if found is None:
            return
        state, diagnosis = found
        with anew(self.suggested, "Suggestions of the diagnosis"):
            if state is not self.state:
                ui.label("Of the model as it was when it was asked for.").classes("soft")
            there = {effect.identity for effect in self.state.machine.effects}
            for one in diagnosis.found:
                with ui.element("div").classes("suspect"):
                    take = button("Take", partial(self._take, one), label=f"Take {one.effect.title}")
                    take.set_enabled(one.effect.identity not in there)
                    with ui.element("div").classes("what"):
                        ui.label(one.effect.title)
                        said = f"odds {odds_text(one.odds)}, leaves {sized(one.rms, state.fit.unit)}"
                        ui.label(said).classes("soft")
            if rows := diagnosis.outlier_rows:
                count = counted(len(rows), "outlier")
                with ui.element("div").classes("suspect"):
                    take = button("Set aside", partial(self._exclude, rows), label=f"Set aside {count}")
                    take.set_enabled(state is self.state)
                    ui.label(count).classes("what")
            with ui.expansion("What it says").props("dense").classes("w-full"):
                shown_blocks(diagnosis.document().blocks)

    async def _exclude(self, rows: list[int]) -> None:
        from rodgen.calibration.diagnosis import EXCLUDED

        await self.desk.do(Aside(rows=rows, why=EXCLUDED))

    async def _take(self, one: Any) -> None:
        await self.desk.do(Add(keys(one.effect, self.state.machine), why="diagnosis"))

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
    title = state.action.title if state.action else THE_FILE
    if "rung" not in state.__dict__:
        return ErrorModel(title, state.fit.rms, None)
    rung = state.rung
    odds = odds_text(rung.step.odds) if rung.step else ""
    return ErrorModel(title, rung.fit.rms, rung.held_out.rms, odds)


def _in_cell(kind: str, words: str) -> None:
    with ui.element(kind):
        ui.label(words)


def _cell(column: Any, row: int) -> Any:
    value = column.take([row]).values[0]
    return str(value) if isinstance(value, str) else f"{value:.10g}"


async def _stopped(work: Any) -> None:
    work.stop()
