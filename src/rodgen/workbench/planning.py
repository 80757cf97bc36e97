"""What to measure next: the dialog that asks for a plan, and the card that shows it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from nicegui import ui

from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.machine import Effect
from rodgen.output import figures
from rodgen.workbench.desk import LIMITS, Window, Wish
from rodgen.workbench.parts import anew, button, card, completing, dialog, downloaded, shown_blocks, soft

_EXAMPLE = 'allowed = ["altitude > 20 deg"]\n[limits]\nC = [0, 270]\n[session]\nreadings = 20'
PART = 8
"""Readings at most to part effects."""


class Planning:
    """The dialog and the card, in one window.

    Parameters
    ----------
    page : Window
    """

    def __init__(self, page: Window) -> None:
        self.page = page
        self.card = card("Plan")
        with dialog("What to measure next") as self.dialog:
            self.number = ui.number("Readings at most", value=12, min=1, max=500, step=1)
            self.wanted = ui.input("To sharpen, or empty", placeholder="C.axis.a, C.backlash")
            self.limits = ui.textarea("Constraints, or empty", placeholder=_EXAMPLE, on_change=self._check)
            self.limits.without_auto_validation()
            completing(self.wanted, self._keys)
            for each in (self.number, self.wanted, self.limits):
                each.props("dense outlined stack-label maxlength=4000").classes("w-full")
            self.limits.props("debounce=300 rows=5").classes("mono")
            soft(
                "What is to be sharpened are parameters, or effects that the model may lack; left empty, what the last "
                "diagnosis leaves open, else all parameters. Constraints are those of 'rodgen plan --constraints'."
            )
            with ui.element("div").classes("line"):
                self.make = button("Make the plan", self._make)

    async def open(self) -> None:
        """Show the dialog."""
        self.dialog.open()

    def _keys(self) -> list[str]:
        """Return what may be sharpened."""
        suspects = self.page.desk.suspects
        lacking = [s.effect.key("").rstrip(".") for s in suspects.listed] if suspects else []
        return [*self.page.state.fit.estimates, *lacking]

    def _check(self) -> None:
        """Say at the constraints what is wrong with them."""
        from rodgen.calibration.plan.constraints import constraints_of

        text, reason = str(self.limits.value or "").strip(), None
        try:
            if text:
                constraints_of(text, LIMITS, self.page.state.machine)
        except InputFileError as error:
            reason = f"{error.place}: {error.found}; expected {error.expected}"
        self.limits.error = reason
        self.make.set_enabled(reason is None)

    def _wish(self, n: int, wanted: Sequence[str] = (), alternatives: Sequence[Effect] = ()) -> Wish:
        return Wish(n, tuple(wanted), tuple(alternatives), str(self.limits.value or "").strip())

    async def _make(self) -> None:
        if self.number.value is None:
            raise RodgenError("no number of readings; expected one from 1 to 500")
        wanted = [key.strip() for key in str(self.wanted.value or "").split(",") if key.strip()]
        self.dialog.close()
        await self.page.desk.make_plan(self._wish(int(self.number.value), wanted))

    async def part(self, effects: Sequence[Effect]) -> None:
        """Plan what tells effects apart."""
        await self.page.desk.make_plan(self._wish(PART, alternatives=effects))

    def fill(self) -> None:
        """Fill the card anew."""
        planned, page = self.page.desk.plan, self.page
        self.card.set_visibility(planned is not None)
        if planned is None:
            return
        state, plan, _ = planned
        with anew(self.card, "Plan"):
            if state is not page.state:
                soft("Of the model as it was when it was asked for.")
            drawing = figures.planned_poses(state.fit, plan)
            page.plots.pop("plan", None)
            if drawing is not None:
                page.show("plan", ui.element("div").classes("plot"), drawing)
            shown_blocks(plan.document().blocks)
            with ui.element("div").classes("line"):
                if plan.count:
                    save = partial(downloaded, plan.csv(), "plan.csv")
                    button("Save the list", save, label="Download the plan as a table")
                button("Discard", page.desk.discard_plan, label="Discard the plan")
