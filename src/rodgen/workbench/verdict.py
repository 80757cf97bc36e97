"""The bar below the header: what a check or a diagnosis says, and the buttons that follow from it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from rodgen.calibration.diagnosis import EXCLUDED
from rodgen.calibration.diagnosis_text import statements
from rodgen.calibration.words import capitalized, fall, odds_text, sized
from rodgen.errors import counted
from rodgen.workbench.actions import Action, Add, Aside, Repair
from rodgen.workbench.model import keys
from rodgen.workbench.parts import anew, button, card, folded, shown_blocks, soft

if TYPE_CHECKING:
    from rodgen.calibration.diagnosis import DiagnosedEffect, Diagnosis, Unexplained
    from rodgen.workbench.desk import Window, Work

__all__ = ["Verdict"]

LOOKS = {
    "nothing_missing": ("good", "verified"),
    "effects_missing": ("found", "troubleshoot"),
    "indistinguishable": ("found", "call_split"),
    "unknown_effect": ("ask", "travel_explore"),
    "cannot_tell": ("none", "help_outline"),
    "wrong_geometry": ("bad", "report"),
    "wrong_file": ("bad", "report"),
    "working": ("found", ""),
    "taken": ("found", "task_alt"),
    "": ("none", "insights"),
}
"""By verdict: its colour and its icon."""


class Verdict:
    """The bar, in one window.

    Parameters
    ----------
    page : Window
    """

    def __init__(self, page: Window) -> None:
        self.page = page
        self.bar = card("Verdict")

    def fill(self) -> None:
        """Fill it anew."""
        desk, check = self.page.desk, self.page.state.__dict__.get("check")
        with anew(self.bar):
            if desk.work is not None:
                self._working(desk.work)
            elif check is not None and check.wrong:
                self._begin("wrong_file", "The machine file or the measurements are wrong.", check.sentence)
                with ui.element("div").classes("line"):
                    for repair in check.repairs[:4]:
                        if not repair.of_data:
                            button(f"Repair: {repair.words}", partial(self._repair, repair.words))
                if any(repair.of_data for repair in check.repairs[:1]):
                    command = f"rodgen check {self.page.state.file} {desk.session.data_file}"
                    sentence = (
                        f"The data are at fault; '{command} --repaired-data FILE' writes repaired ones."
                    )
                    soft(sentence)
            elif desk.diagnosis is not None:
                self._diagnosed(desk.diagnosis[1], current=desk.diagnosis[0] is self.page.state)
            else:
                sentence = "A diagnosis tests every effect of the catalogue, alone and together with others."
                self._begin("", "What does the model miss?", sentence)
                with ui.element("div").classes("line"):
                    self._diagnose(first=True)

    def _begin(self, verdict: str, title: str, more: str) -> ui.label:
        """Write the icon and the sentence; return what follows that."""
        look, icon = LOOKS[verdict]
        self.bar.classes(replace=f"card verdict {look}")
        if icon:
            ui.icon(icon).props('aria-hidden="true"')
        else:
            ui.spinner()
        with ui.element("div").props('role="status"'):
            TextElement(tag="strong", text=title)
            return soft(more)

    def _working(self, work: Work) -> None:
        place = self._begin("working", f"{work.what} is running", work.text)
        with ui.element("div").classes("line"):
            button("Stop", partial(_stopped, work))
        ui.timer(0.5, lambda: place.set_text(work.text))

    def _diagnose(self, *, first: bool) -> None:
        button("Diagnose", self.page.desk.diagnose, icon="troubleshoot", look="first" if first else "plain")

    def _diagnosed(self, diagnosis: Diagnosis, *, current: bool) -> None:
        *before, (what, error) = statements(diagnosis)
        there = {effect.identity for effect in self.page.state.machine.effects}
        left = [one for one in diagnosis.found if one.effect.identity not in there]
        open_ = diagnosis.verdict == "effects_missing" and diagnosis.open_questions.alternatives
        sentence = " ".join([*("".join(one) for one in before), capitalized(error.lstrip(";: "))])
        look = "indistinguishable" if open_ else diagnosis.verdict
        if diagnosis.found and not left:
            fallen = fall(diagnosis.base.rms, self.page.state.fit.rms, diagnosis.rms.unit)
            look, what, sentence = (
                "taken",
                "All that the diagnosis found is in the model",
                f"The error {fallen}.",
            )
        elif not current:
            sentence += " That is of the model as it was when it was asked for."
        self._begin(look, f"{what}.", sentence)
        rows = diagnosis.outlier_rows if current else []
        with ui.element("div").classes("line"):
            if left or rows:
                all_ = [*([Aside(rows=rows, why=EXCLUDED)] if rows else []), *map(self._adding, left)]
                look = "first" if current else "plain"
                button("Take all", partial(self.page.desk.do, *all_), icon="done_all", look=look)
            if not current or not diagnosis.found:
                self._diagnose(first=not current)
        with folded("Show the whole answer"):
            for one in left:
                with ui.element("div").classes("suspect"):
                    take = partial(self.page.desk.do, self._adding(one))
                    button("Take", take, label=f"Take {one.effect.title}")
                    sentence = f"odds {odds_text(one.odds)} to 1, leaves {sized(one.rms, diagnosis.rms.unit)}"
                    ui.label(f"{one.effect.title}: {sentence}").classes("what")
            if rows:
                count = counted(len(rows), "outlier")
                exclude = partial(self.page.desk.do, Aside(rows=rows, why=EXCLUDED))
                button(f"Exclude {count}", exclude)
            shown_blocks(diagnosis.document().blocks)

    def _adding(self, one: DiagnosedEffect | Unexplained) -> Action:
        return Add(keys(one.effect, self.page.state.machine), why="diagnosis")

    async def _repair(self, words: str) -> None:
        await self.page.desk.do(Repair(words))
        await self.page.desk.check()


async def _stopped(work: Work) -> None:
    work.stop()
