"""The card of the model: its effects and parameters, what is held or bounded, and formulas of the user's own."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from rodgen.calibration.pointing import pointing
from rodgen.data.units import UNITS
from rodgen.errors import InputFileError, RodgenError, joined
from rodgen.machines.effects.custom import OWN_COMPONENTS, WORDS
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.known import parameters_to_tie
from rodgen.machines.machine import Effect, Machine
from rodgen.workbench.actions import Add, Known, Remove, Tie, Written
from rodgen.workbench.parts import anew, button, card, completing, dialog

if TYPE_CHECKING:
    from rodgen.calibration.fit import Estimate
    from rodgen.workbench.desk import Window

__all__ = ["Model", "keys"]

LONGEST = 2000
"""Characters of a formula at most."""


def keys(effect: Effect, machine: Machine) -> dict[str, Any]:
    """Return the keys of the ``[[effect]]`` of an effect, as a machine file has them."""
    import tomllib

    from rodgen.machines.files.write import effect_text

    block: dict[str, Any] = tomllib.loads(effect_text(machine, effect))["effect"][0]
    return block


class Model:
    """The card, in one window.

    Parameters
    ----------
    page : Window
    """

    def __init__(self, page: Window) -> None:
        self.page = page
        self.card = card("Model").classes("last")
        self.own = _Own(page)

    def fill(self) -> None:
        """Fill it anew."""
        machine, fit = self.page.state.machine, self.page.state.fit
        may_follow = parameters_to_tie(machine)
        with anew(self.card, "Model"):
            for effect in machine.effects:
                with ui.element("div").classes("suspect"):
                    button("Remove", partial(self._remove, effect), label=f"Remove {effect.title}")
                    with ui.element("div").classes("what"):
                        ui.label(effect.title)
                        if effect.definition.own:
                            ui.label(effect.definition.equation).classes("soft")
            if not machine.effects:
                ui.label("It has no effects yet.").classes("soft")
            with ui.expansion(f"{len(fit.parameters)} parameters", value=len(fit.parameters) <= 12).props(
                "dense"
            ):
                for estimate in fit.estimates.values():
                    others = [key for key in may_follow if key != estimate.key and key not in machine.ties]
                    self._parameter(estimate, others if estimate.key in may_follow else [])
            if on_sky := pointing(fit):
                with ui.expansion("Terms of TPOINT", value=True).props("dense"):
                    ui.label(on_sky.sentence()).classes("soft")
                    for term, estimate in on_sky.terms.items():
                        ui.label(f"{term} {estimate.text}")

    def _parameter(self, estimate: Estimate, others: list[str]) -> None:
        """Add the row of a parameter, which can be tied to others."""
        with ui.element("div").classes("suspect"):
            with ui.element("div").classes("what"):
                ui.label(estimate.key)
                ui.label(estimate.text).classes("soft")
            if estimate.tied_to:
                button("Untie", partial(self._tie, estimate.key, ""), label=f"Untie {estimate.key}")
                return
            owner = next((e for e in self.page.state.machine.effects if e.owns(estimate.key)), None)
            name = estimate.key.rpartition(".")[2]
            if owner is not None and name in owner.definition.parameters:
                if name in owner.hold:
                    button("Free", partial(self._hold, owner, name, None), label=f"Estimate {estimate.key}")
                else:
                    ask = partial(self._ask, owner, estimate)
                    button("Hold", ask, label=f"Hold {estimate.key}")
            if not estimate.held:
                button("Bound", partial(self._ask, None, estimate), label=f"Bound {estimate.key}")
                if others:
                    button("Tie", partial(self._ask_tie, estimate, others), label=f"Tie {estimate.key}")

    async def _remove(self, effect: Effect) -> None:
        await self.page.desk.do(Remove(effect.name, effect.place))

    async def _tie(self, key: str, to: str) -> None:
        await self.page.desk.do(Tie(key, to))

    async def _ask_tie(self, estimate: Estimate, others: list[str]) -> None:
        """Ask what a parameter follows from."""
        with dialog(f"Tie {estimate.key}", opened=True) as asked:
            to = ui.input("A sum of multiples of other parameters", placeholder=f"2 * {others[0]}")
            to.props("dense outlined maxlength=2000").classes("w-full")
            completing(to, lambda: others)
            ui.label(f"Others: {joined(others)}.").classes("soft")

            async def done() -> None:
                if not str(to.value or "").strip():
                    raise RodgenError(f"nothing; expected another parameter, such as {others[0]}")
                await self._tie(estimate.key, str(to.value).strip())
                asked.close()

            with ui.element("div").classes("line"):
                button("Tie", done, label="Tie it")
                ui.button("Cancel", on_click=asked.close).props("flat dense no-caps")

    async def _hold(self, effect: Effect, name: str, value: float | None) -> None:
        block = keys(effect, self.page.state.machine)
        held = {key: x for key, x in block.pop("hold", {}).items() if key != name}
        if value is not None:
            held[name] = value
        await self.page.desk.do(Written(block | ({"hold": held} if held else {})))

    async def _ask(self, owner: Effect | None, estimate: Estimate) -> None:
        """Ask for the value at which a parameter is held, or for its bounds or prior."""
        with dialog(f"{'Bound' if owner is None else 'Hold'} {estimate.key}", opened=True) as asked:
            if owner is not None:
                ui.label("In the units of the machine file.").classes("soft")
                first = ui.input("Value", value="0").props("dense outlined")
            else:
                ui.label("With units; left empty, nothing is known.").classes("soft")
                first = ui.input("Lowest", placeholder=f"-10 {estimate.unit}").props("dense outlined")
                second = ui.input("Highest", placeholder=f"10 {estimate.unit}").props("dense outlined")
                third = ui.input("Or a prior", placeholder=f"0 ± 5 {estimate.unit}").props("dense outlined")

            async def done() -> None:
                if owner is not None:
                    name = estimate.key.rpartition(".")[2]
                    await self._hold(owner, name, _number(first.value))
                else:
                    content: dict[str, Any] = {}
                    if first.value or second.value:
                        content["bounds"] = [first.value or "-inf", second.value or "inf"]
                        content["bounds"] = [
                            float(x) if x in {"inf", "-inf"} else x for x in content["bounds"]
                        ]
                    if third.value:
                        content["prior"] = third.value
                    await self.page.desk.do(Known(estimate.key, content))
                asked.close()

            with ui.element("div").classes("line"):
                button("Do it", done)
                ui.button("Cancel", on_click=asked.close).props("flat dense no-caps")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RodgenError(f"value {text!r}; expected a number") from None


class _Own:
    """The card of a formula of the user's own: checked while it is typed."""

    def __init__(self, page: Window) -> None:
        self.page = page
        machine = page.state.machine
        places = {joint.name: f"joint {joint.name}" for joint in machine.joints}
        places |= {target.name: f"target {target.name}" for target in machine.targets}
        places |= {"": "the whole machine"}
        with (
            card("Formula of your own").classes("last"),
            ui.expansion("Formula of your own").props("dense").classes("w-full"),
        ):
            with ui.element("div").classes("line"):
                self.name = self._input("Name", "own", 60).style("width:110px")
                self.place = ui.select(places, value=next(iter(places)), label="At", on_change=self.check)
                self.component = ui.select(
                    [*OWN_COMPONENTS], value="reading", label="Changes", on_change=self.check
                )
                for each in (self.place, self.component):
                    each.props("dense options-dense outlined").style("min-width:110px")
            self.formula = (
                self._input("Formula", "", LONGEST).props('placeholder="k*cos(q)"').classes("w-full")
            )
            self.parameters = self._input("Parameters and units", "", LONGEST).classes("w-full")
            self.parameters.props('placeholder="k: arcsec, m: arcsec/deg"')
            names = [*machine.quantities, *page.state.observations.covariates]
            words = f"Words: {', '.join(sorted(WORDS))}; {', '.join(dict.fromkeys(names))}."
            functions = [f"{word}(" for word in FUNCTION_NAMES]
            completing(self.formula, lambda: {*WORDS - FUNCTION_NAMES, *functions, *names, *self._named()})
            completing(self.parameters, lambda: UNITS)
            ui.label(words).classes("soft")
            self.fault = ui.label().props('role="alert"').classes("alert")
            self.add = button("Add the formula", self._add)
            self.add.set_enabled(False)

    def _named(self) -> dict[str, str]:
        """Return the parameters that were typed, with their units."""
        given = {}
        for each in filter(str.strip, str(self.parameters.value or "").split(",")):
            parameter, _, unit = each.replace("=", ":").partition(":")
            given[parameter.strip()] = unit.strip() or "1"
        return given

    def _input(self, label: str, value: str, longest: int) -> ui.input:
        made = ui.input(label, value=value, on_change=self.check)
        made.without_auto_validation()
        return made.props(f"dense outlined maxlength={longest} debounce=300")

    def action(self) -> Add:
        """Return the action that adds it.

        Raises
        ------
        RodgenError
            When something is too long to be read.
        """
        texts = [str(each.value or "") for each in (self.name, self.formula, self.parameters)]
        if max(map(len, texts)) > LONGEST:
            raise RodgenError(f"{max(map(len, texts))} characters; expected {LONGEST} at most")
        name, formula, _ = texts
        block: dict[str, Any] = {"name": name, "component": self.component.value, "formula": formula}
        machine = self.page.state.machine
        if place := self.place.value:
            kind = "target" if machine.kind_of(place) == "target" else "joint"
            block = {"name": name, kind: place} | block
        return Add(block | {"parameters": self._named()})

    def check(self, _: Any = None) -> None:
        """Say where it is wrong, at the place where that was typed."""
        fault: RodgenError | None = None
        try:
            self.action().made(self.page.state.machine)
        except RodgenError as error:
            fault = error
        empty = not self.formula.value
        key = fault.place.rpartition(", ")[2] if isinstance(fault, InputFileError) else ""
        said = (
            f"{fault.found}; expected {fault.expected}"
            if isinstance(fault, InputFileError)
            else str(fault or "")
        )
        fields = {"name": self.name, "formula": self.formula, "parameters": self.parameters}
        for name, each in fields.items():
            each.error = said if key.startswith(name) and not empty else None
        other = not any(key.startswith(name) for name in fields)
        self.fault.set_text(said if fault is not None and other and not empty else "")
        self.add.set_enabled(fault is None)

    async def _add(self) -> None:
        await self.page.desk.do(self.action())
