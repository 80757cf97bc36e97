"""The card of the suspects: effects that the model may lack, by what they explain; what chance explains is folded."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from rodgen.calibration.words import odds_text, sized
from rodgen.errors import counted
from rodgen.machines.machine import Effect
from rodgen.workbench.actions import Add
from rodgen.workbench.model import keys
from rodgen.workbench.parts import anew, button, card, soft, unfolding, waiting

if TYPE_CHECKING:
    from rodgen.calibration.fit import Fit
    from rodgen.calibration.suspects import Suspect
    from rodgen.workbench.desk import Window
    from rodgen.workbench.planning import Planning

__all__ = ["Suspecting"]

STRENGTHS = (
    (1.0, "chance"),
    (3.0, "hardly any"),
    (20.0, "some"),
    (150.0, "strong"),
    (float("inf"), "very strong"),
)
"""Odds below which evidence is called so (Kass and Raftery 1995)."""


class Suspecting:
    """The card, in one window.

    Parameters
    ----------
    page : Window
    planning : Planning
    preview : callable
        Draws what an effect would explain; of None nothing any more.
    """

    def __init__(self, page: Window, planning: Planning, preview: Callable[[Effect | None], object]) -> None:
        self.page, self.planning, self.preview = page, planning, preview
        self.card = card("Suspects").classes("second")

    def fill(self) -> None:
        """Fill it anew."""
        suspects = self.page.desk.suspects
        with anew(self.card, "Suspects"):
            if suspects is None:
                waiting("Every effect of the catalogue is tested …")
                return
            groups: list[list[Suspect]] = []
            for suspect in suspects.listed:
                if suspect.like is None:
                    groups.append([])
                groups[-1].append(suspect)
            first = [group for group in groups if group[0].chosen or group[0].odds >= 1]
            heading = "How strong the evidence for each is, alone, and the error that it would leave."
            soft(heading if first else "No effect of the catalogue explains more than chance does.")
            self._groups(first)
            if others := [group for group in groups if group not in first]:
                with ui.element("div").classes("edge w-full"):
                    count = counted(sum(map(len, others)), "effect")
                    title = f"Below this, chance explains as much: {count}"
                    unfolding(title, partial(self._groups, others))

    def _groups(self, groups: Sequence[Sequence[Suspect]]) -> None:
        for group in groups:
            self._group(group)

    def _group(self, group: Sequence[Suspect]) -> None:
        """Show an effect, and folded those that these data cannot distinguish from it."""
        leader, *others = group
        self._suspect(leader)
        if others:
            with ui.element("div").classes("like"):
                title = f"or {counted(len(others), 'other')}, indistinguishable"
                unfolding(title, partial(self._others, group))

    def _others(self, group: Sequence[Suspect]) -> None:
        leader, *others = group
        for suspect in others:
            self._suspect(suspect)
        button(
            "Where to measure to tell them apart",
            partial(self.planning.part, [s.effect for s in group]),
            icon="add_location",
            label=f"Plan what tells {leader.effect.title} from {counted(len(others), 'other')}",
        )

    def _suspect(self, suspect: Suspect) -> None:
        effect, fit = suspect.effect, self.page.state.fit
        with ui.element("div").classes("suspect") as row:
            button(
                "Add", partial(self._add, effect), icon="add", label=f"Add {effect.title}", look="bare plain"
            )
            ui.html(_about(suspect, fit), sanitize=False).classes("what")
        for event in ("mouseenter", "focusin"):
            row.on(event, partial(self.preview, effect), args=[])
        for event in ("mouseleave", "focusout"):
            row.on(event, partial(self.preview, None), args=[])

    async def _add(self, effect: Effect) -> None:
        await self.page.desk.do(Add(keys(effect, self.page.state.machine)))


def _about(suspect: Suspect, fit: Fit) -> str:
    """Return what there is to say of a suspect: its names, what it would leave, its evidence; and folded what it is."""
    effect, about = suspect.effect, suspect.effect.definition
    strength = next(words for limit, words in STRENGTHS if suspect.odds < limit)
    iso = f" <span class=soft>ISO 230: {html.escape(about.iso)}</span>" * bool(
        about.iso and not effect.term_names
    )
    size = f"Usual size: {about.usual_size}." * bool(about.usual_size)
    return (
        f"<details><summary><span class=both><b>{html.escape(effect.title)}{iso}</b>"
        f"<span>{sized(suspect.rms, fit.unit)}</span></span><span class=left aria-hidden=true>"
        f"<i style='width:{100 * min(suspect.rms / (fit.rms or 1.0), 1.0):.0f}%'></i></span>"
        f"<span class=soft>{strength}, {odds_text(suspect.odds)} to 1</span></summary>"
        f"{''.join(f'<p>{html.escape(text)}</p>' for text in (about.meaning, size) if text)}</details>"
    )
