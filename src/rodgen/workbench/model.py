"""The card of the model: its effects and parameters, what is held or bounded, and formulas of the user's own."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from rodgen.calibration.pointing import pointing
from rodgen.data.units import UNITS
from rodgen.errors import InputFileError, RodgenError
from rodgen.machines.effects.custom import OWN_COMPONENTS, WORDS
from rodgen.machines.effects.formula import FUNCTION_NAMES
from rodgen.machines.known import parameters_to_tie
from rodgen.machines.machine import Effect, Machine
from rodgen.output.numbers import minus
from rodgen.workbench.actions import Add, Known, Remove, Tie, Written
from rodgen.workbench.parts import (
    anew,
    button,
    card,
    cell,
    completing,
    dialog,
    field,
    folded,
    soft,
    unfolding,
)

if TYPE_CHECKING:
    from rodgen.calibration.fit import Estimate
    from rodgen.workbench.desk import Window

__all__ = ["Model", "keys"]

LONGEST = 2000
"""Characters of a formula at most."""
FEW = 12
"""Parameters up to which they are shown at once."""


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
        with anew(self.card, "Model"):
            for effect in machine.effects:
                with ui.element("div").classes("suspect"):
                    remove = partial(self.page.desk.do, Remove(effect.name, effect.place))
                    button("Remove", remove, icon="close", label=f"Remove {effect.title}", look="bare plain")
                    with ui.element("div").classes("what"):
                        ui.label(effect.title)
                        if effect.definition.own:
                            soft(effect.definition.equation)
            if not machine.effects:
                soft("It has no effects yet: add a suspect, or take what a diagnosis finds.")
            title = f"{len(fit.parameters)} parameters"
            unfolding(title, self._fill_parameters, opened=len(fit.parameters) <= FEW)
            if on_sky := pointing(fit):
                with folded("Terms of TPOINT", opened=True):
                    soft(on_sky.sentence())
                    with ui.element("table").classes("grid"):
                        for term, estimate in on_sky.terms.items():
                            with ui.element("tr"):
                                cell(term)
                                cell(minus(estimate.text))

    def _fill_parameters(self) -> None:
        with ui.element("table").classes("grid"):
            for estimate in self.page.state.fit.estimates.values():
                with ui.element("tr"):
                    cell(estimate.key)
                    cell(minus(estimate.text))
                    with ui.element("td"):
                        ask, label = partial(self._ask, estimate), f"Change {estimate.key}"
                        button("Change", ask, icon="more_horiz", label=label, look="bare")

    async def _ask(self, estimate: Estimate) -> None:
        """Ask what is known of a parameter: a value, bounds, a prior, or others that it follows."""
        machine, key = self.page.state.machine, estimate.key
        owner = next((e for e in machine.effects if e.owns(key)), None)
        name = key.rpartition(".")[2]
        may_follow = parameters_to_tie(machine)
        others = [k for k in may_follow if k != key and k not in machine.ties] if key in may_follow else []
        about = f" {estimate.unit}"
        ways = {"free": ("is estimated", "")}
        if not estimate.tied_to:
            ways["bounds"] = "is between bounds", f"-10{about}, 10{about}"
            ways["prior"] = "is known about so well", f"0 ± 5{about}"
            if owner is not None and name in owner.definition.parameters:
                ways["held"] = "is held at a value, in the unit of the machine file", "0"
            if others:
                ways["tied"] = "is a sum of multiples of others", f"2 * {others[0]}"
        with dialog(f"Change {key}", opened=True) as asked:
            words = {way: words for way, (words, _) in ways.items()}
            kind = ui.select(words, value="free", label="It").props("dense options-dense outlined")
            value = field("What")
            value.bind_visibility_from(kind, "value", backward=lambda way: way != "free")
            kind.on_value_change(lambda event: value.props.update(placeholder=ways[event.value][1]))
            completing(value, lambda: others if kind.value == "tied" else ())

            async def done() -> None:
                text = str(value.value or "").strip()
                if kind.value != "free" and not text:
                    raise RodgenError(f"nothing; expected something such as {ways[kind.value][1]}")
                await self._change(estimate, owner, kind.value, text)
                asked.delete()

            button("Apply", done, look="first")

    async def _change(self, estimate: Estimate, owner: Effect | None, kind: str, text: str) -> None:
        key, do = estimate.key, self.page.desk.do
        if kind == "tied":
            await do(Tie(key, text))
        elif kind == "bounds":
            low, _, high = (part.strip() for part in text.partition(","))
            ends = [float(x) if x in {"inf", "-inf"} else x for x in (low or "-inf", high or "inf")]
            await do(Known(key, {"bounds": ends}))
        elif kind == "prior":
            await do(Known(key, {"prior": text}))
        elif estimate.tied_to:
            await do(Tie(key))
        elif owner is not None and (kind == "held" or key.rpartition(".")[2] in owner.hold):
            block = keys(owner, self.page.state.machine)
            held = {k: x for k, x in block.pop("hold", {}).items() if owner.key(k) != key}
            held |= {key.rpartition(".")[2]: _number(text)} if kind == "held" else {}
            await do(Written(block | ({"hold": held} if held else {})))
        else:
            await do(Known(key))


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
        with card("Formula of your own").classes("last"), folded("Formula of your own"):
            with ui.element("div").classes("line"):
                self.name = self._input("Name", value="own", most=60)
                self.place = ui.select(places, value=next(iter(places)), label="At", on_change=self.check)
                self.component = ui.select(
                    [*OWN_COMPONENTS], value="reading", label="Changes", on_change=self.check
                )
                for each in (self.place, self.component):
                    each.props("dense options-dense outlined").style("min-width:110px")
            self.formula = self._input("Formula", example="k*cos(q)")
            self.parameters = self._input("Parameters and units", example="k: arcsec, m: arcsec/deg")
            names = [*machine.quantities, *page.state.observations.covariates]
            words = f"Words: {', '.join(sorted(WORDS))}; {', '.join(dict.fromkeys(names))}."
            functions = [f"{word}(" for word in FUNCTION_NAMES]
            completing(self.formula, lambda: {*WORDS - FUNCTION_NAMES, *functions, *names, *self._named()})
            completing(self.parameters, lambda: UNITS)
            soft(words)
            self.fault = ui.label().props('role="alert"').classes("alert")
            self.add = button("Add the formula", self._add)
            self.add.set_enabled(False)

    def _named(self) -> dict[str, str]:
        """Return the parameters that were typed, with their units."""
        units = {}
        for each in filter(str.strip, str(self.parameters.value or "").split(",")):
            parameter, _, unit = each.replace("=", ":").partition(":")
            units[parameter.strip()] = unit.strip() or "1"
        return units

    def _input(self, label: str, **given: Any) -> ui.input:
        text_field = field(label, on_change=self.check, **given)
        text_field.without_auto_validation()
        return text_field.props("debounce=300")

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
        reason = (
            f"{fault.found}; expected {fault.expected}"
            if isinstance(fault, InputFileError)
            else str(fault or "")
        )
        fields = {"name": self.name, "formula": self.formula, "parameters": self.parameters}
        for name, each in fields.items():
            each.error = reason if key.startswith(name) and not empty else None
        elsewhere = not any(key.startswith(name) for name in fields)
        self.fault.set_text(reason if fault is not None and elsewhere and not empty else "")
        self.add.set_enabled(fault is None)

    async def _add(self) -> None:
        await self.page.desk.do(self.action())
