"""The parameters of a machine's model: what a fit adjusts, what it holds, and where each enters a kernel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rodgen.data.units import unit_factor
from rodgen.machines.effects.definition import StartSearch
from rodgen.machines.measured import TURNS
from rodgen.machines.parts import Effect, Known, MachineData, known_of
from rodgen.machines.structure import GEOMETRY, Structure, row_effects


@dataclass(frozen=True)
class Parameter:
    """One number of the model."""

    key: str
    """Its name in every output, such as ``"C.encoder_eccentricity.a"``."""
    unit: str
    """What it is shown in; :attr:`factor` brings it from there to internal units."""
    factor: float
    """Internal value of one `unit`."""
    hold: float | None
    """Internal value when it is not estimated."""
    slot: tuple[object, ...]
    """Where it enters: (slot, joint number), ("target", target number, component), ("shift", run number, component),
    ("remounting", target number, run number, component), ("frame", component) or ("e", term number, name)."""
    place: str | None = None
    effect: str | None = None
    """Joint or target, and the effect that it belongs to; no effect for what a base fit adjusts."""
    searched: StartSearch | None = None
    """What search its start comes from."""
    optional: bool = False
    """Whether it is taken in only where the data call for it."""
    prior: tuple[float, float] | None = None
    bounds: tuple[float, float] | None = None
    """What is known of it; see :class:`rodgen.machines.parts.Known`."""


def parameters_of(machine: MachineData, structure: Structure, runs: Sequence[str]) -> tuple[Parameter, ...]:
    """Return the parameters of a machine, geometry first, the frame before the effects.

    Parameters
    ----------
    structure : Structure
        Of this machine.
    runs : sequence of str
        Names of the set-ups in the data. A frame shift has parameters for each when there are two or more, the
        remounting of a target for each but the first.
    """
    every = tuple(_parameters(machine, structure, runs))
    if not machine.known:
        return every
    known = [known_of(machine.known, p.key) if p.slot[0] != "frame" else Known() for p in every]
    return tuple(replace(p, prior=k.prior, bounds=k.bounds) for p, k in zip(every, known, strict=True))


def _parameters(machine: MachineData, structure: Structure, runs: Sequence[str]) -> Iterator[Parameter]:
    moving = structure.moving
    length, angle = machine.length_unit, "arcsec"

    def made(key: str, unit: str, *slot: object, **more: object) -> Parameter:
        factor, _ = unit_factor(unit, machine.length_unit)
        return Parameter(key, unit, factor, slot=slot, **{"hold": None, **more})  # type: ignore[arg-type]

    geometric = {
        (e.definition.component, e.place): e for e in machine.effects if e.definition.component in GEOMETRY
    }
    for name in structure.numbers:
        for x in structure.kinematics.numbers[name]:
            key = f"geometry.{name}.{x}" if x else f"geometry.{name}"
            yield made(key, length, f"geometry.{name}{x}", 0)
    for j, joint in enumerate(machine.joints):
        for component, unit in (("axis", angle), ("point", length)):
            effect = geometric.get((component, joint.name))
            if effect is not None or f"{joint.name}.{component}" in machine.estimate:
                for x in "ab":
                    key = effect.key(x) if effect else f"{joint.name}.{component}.{x}"
                    more = _of_effect(machine, effect, x) if effect else {"place": joint.name}
                    yield made(key, unit, f"{component}.{x}", j, **more)
    for k, target in enumerate(machine.targets):
        effect = geometric.get(("target", target.name))
        for x in machine.measurand.freedoms:
            unit = machine.angle_unit if x in {*TURNS, "zero"} else machine.measurand.unit(length)
            if "target" in machine.estimate:
                yield made(f"target.{target.name}.{x}", unit, "target", k, x, place=target.name)
            elif effect is not None:
                yield made(effect.key(x), unit, "target", k, x, **_of_effect(machine, effect, x))
        again = geometric.get(("remounting", target.name))
        for r, run in enumerate(runs[1:] if again is not None else (), 1):
            assert again is not None
            for x, unit in again.units(machine).items():
                more = _of_effect(machine, again, x)
                yield made(f"{again.key('')}[{run}].{x}", unit, "remounting", k, r, x, **more)
    if structure.frame:
        for x in machine.measurand.rigid:
            yield made(f"frame.{x}", machine.angle_unit if x in TURNS else length, "frame", x)
    if structure.line:
        line = machine.measurand.line
        yield from (made(f"{line}.{x}", angle, f"{line}.{x}", 0) for x in "ab")
    if structure.shift:
        effect = geometric["frame_shift", None]
        for r, run in enumerate(runs if len(runs) > 1 else [""]):
            prefix = f"{effect.key('')}[{run}]" if len(runs) > 1 else effect.key("")
            for component in machine.measurand.rigid:
                x = component if moving else component.removeprefix("r")
                unit = angle if component in TURNS else length
                yield made(f"{prefix}.{x}", unit, "shift", r, component, **_of_effect(machine, effect, x))
    for n, (effect, term) in enumerate(zip(row_effects(machine), structure.terms, strict=True)):
        units = effect.units(machine)
        for name in term.parameters:
            more = _of_effect(machine, effect, name) | {"optional": name in term.weights}
            yield made(effect.key(name), units[name], "e", n, name, **more)


def _of_effect(machine: MachineData, effect: Effect, name: str) -> dict[str, object]:
    hold = effect.hold.get(name, effect.given(machine, name))
    searched = effect.definition.searched.get(name) if hold is None else None
    return {"effect": effect.name, "place": effect.place, "hold": hold, "searched": searched}
