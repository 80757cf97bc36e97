"""Rules for where an effect may be in a machine, and the errors that name the rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rodgen.data.units import unit_factor
from rodgen.errors import UnexpectedError, listed, nearest_name, shown, suggestion
from rodgen.limits import NUMBER
from rodgen.machines.effects.catalogue import CATALOGUE, NAMES, TERMS
from rodgen.machines.effects.custom import WORDS
from rodgen.machines.effects.definition import ALL_OF_A_LOOP, OF_A_LOOP, SKY, EffectDefinition
from rodgen.machines.effects.symbols import own_term, symbols
from rodgen.machines.measured import READING_COLUMNS
from rodgen.machines.mounts import names_of_terms
from rodgen.machines.parts import Effect, MachineData
from rodgen.machines.structure import TENSION

_JOINTS = frozenset({"revolute", "prismatic", *OF_A_LOOP})

_KEY_WORDS = frozenset({"axis", "point", "target", "frame"})
"""Words that are in the keys of parameters instead of an effect's name."""

_SAME_FREEDOM = {"axis": "axis", "point": "point", "target": "target"}
"""A component, and what [estimate] calls the same freedom."""

_OF_A_LEG: Mapping[str, tuple[set[str], Sequence[str]]] = {
    "reading": ({"zero_offset", "leg_zero_offset"}, ()),
    "base_joint": ({"base_joint_offset"}, [f"B{k}" for k in range(1, 7)]),
    "platform_joint": ({"platform_joint_offset"}, [f"P{k}" for k in range(1, 7)]),
}
"""The component of an effect of all legs: effects of one leg, and numbers in [estimate], that are the same there."""

_ON_A_LEG = {"thermal_expansion": "leg_thermal_expansion", "thermal_offset": "leg_thermal_expansion"}
"""Names at a leg of effects of joints, where it is not the same name after ``leg_``."""


class UnfitEffectError(UnexpectedError):
    """An effect that cannot stand where it should: the key of its block, what was found, what was expected."""

    def __init__(self, key: str, found: str, expected: str) -> None:
        self.key = key
        super().__init__(found, expected)
        self.args = (key, found, expected)

    def __str__(self) -> str:
        return f"{self.key}: {self.found}; expected {self.expected}"


def unknown_name(name: str) -> UnfitEffectError:
    """Return the error for a name that is not in the catalogue, with the most similar one."""
    near = nearest_name(name, [*NAMES, *TERMS])
    hint = f"{near!r}, perhaps; " if near else ""
    if known_symbols := symbols(name):
        names = listed([symbol.definition.name for symbol in known_symbols])
        hint = f"{names}, its name here; "
    elif own_term(name):
        hint = f"what 'rodgen effects {name}' shows, as an effect of your own; "
    return UnfitEffectError(
        "name",
        f"no effect {shown(name)} in the catalogue",
        f"{hint}a name that 'rodgen effects' lists, or component and formula of your own",
    )


def catalogue_effect(machine: MachineData, name: str, place: str | None, hold: Mapping[str, float]) -> Effect:
    """Return an effect of the catalogue in its place; `hold` in the units of the machine file.

    A name of TPOINT or ISO 230 that means one effect will do; where such a name says the joint, so will no place.

    Raises
    ------
    UnfitEffectError
    """
    if known_symbols := symbols(name):
        if len(known_symbols) > 1:
            names = listed([symbol.definition.name for symbol in known_symbols])
            raise UnfitEffectError("name", f"{shown(name)}, which is several effects", names)
        name, joint = known_symbols[0].definition.name, known_symbols[0].joint
        if place is None and any(each.name == joint for each in machine.joints):
            place = joint
    same_name = [definition for definition in CATALOGUE if definition.name == name]
    if not same_name:
        raise unknown_name(name)
    kind = _kind_of(machine, place)
    definition = next((d for d in same_name if machine.kinds_of(place) & d.at), None)
    if definition is None:
        raise _wrong_place(machine, same_name, kind, place)
    terms = names_of_terms(machine, definition, place)
    effect = Effect(definition.for_measurand(machine.measurand), place, terms=terms)
    return replace(effect, hold=held(machine, effect, hold))


def held(machine: MachineData, effect: Effect, hold: Mapping[str, float]) -> dict[str, float]:
    """Return held parameters in internal units, given in those of the machine file."""
    units = effect.units(machine)
    values = {}
    for name, value in hold.items():
        if name not in units:
            some = suggestion(name, units) if units else "no hold: it has no parameters"
            raise UnfitEffectError(f"hold.{name}", f"no parameter of {effect.name}", some)
        _, dimension = unit_factor(units[name], machine.length_unit)
        values[name] = float(value) * machine.file_factor(dimension)
        if not abs(values[name]) < NUMBER:
            raise UnfitEffectError(f"hold.{name}", f"{value:g}", "a number of a usual size")
    return values


def _kind_of(machine: MachineData, place: str | None) -> str:
    places = [joint.name for joint in machine.joints] + [target.name for target in machine.targets]
    if place is not None and place not in places:
        raise UnfitEffectError("place", f"no joint or target {shown(place)}", suggestion(place, places))
    return machine.kind_of(place)


# a wrong place ---------------------------------------------------------------------------------------------------


def _wrong_place(
    machine: MachineData, definitions: list[EffectDefinition], kind: str, place: str | None
) -> UnfitEffectError:
    """Return the error for an effect at a wrong place: where it acts, and what this machine has there."""
    at = frozenset[str]().union(*(definition.at for definition in definitions))
    name = definitions[0].name
    if place is None and at <= ALL_OF_A_LOOP.keys():
        found = f"{name} on a machine without {' or '.join(sorted(at))}"
        return UnfitEffectError("name", found, "another effect")
    if at & {"machine", *ALL_OF_A_LOOP}:
        key = "target" if kind == "target" else "joint"
        return UnfitEffectError(key, f"{shown(place)}, but {name} acts on the whole machine", f"no {key}")
    if "target" in at:
        names = [target.name for target in machine.targets]
        if place is None:
            return UnfitEffectError("target", "missing", f"the target that is off: {listed(names)}")
        return UnfitEffectError(
            "joint", f"{shown(place)}, but {name} acts on a target", f"target = {names[0]!r}"
        )
    types = {joint.type for joint in machine.joints} & at or at & _JOINTS
    chain = " or ".join(sorted(types - OF_A_LOOP.keys()))
    words = [f"a {chain} joint"] * bool(chain) + [word for x, word in OF_A_LOOP.items() if x in types]
    names = [joint.name for joint in machine.joints if joint.type in at]
    some = " or ".join(words) + (f": {listed(names)}" if names else ", which this machine does not have")
    if place is None:
        return UnfitEffectError("joint", "missing", some)
    if kind == "target":
        return UnfitEffectError("target", f"{shown(place)}, but {name} acts on a joint", some)
    # The catalogue may have the same effect under another name for such a joint.
    twins = [d.name for d in CATALOGUE if kind in d.at and d.component == definitions[0].component == "axis"]
    if kind == "leg":
        twins = [d.name for d in CATALOGUE if kind in d.at and d.name == _ON_A_LEG.get(name, f"leg_{name}")]
        some = some if twins == [] else ""
    on = OF_A_LOOP.get(kind, f"a {kind} joint")
    hint = f"{shown(twins[0])}, its name on {on}" + (", or " if some else "") if twins else ""
    return UnfitEffectError("joint", f"{shown(place)}, {on}", f"{hint}{some}")


# rules -----------------------------------------------------------------------------------------------------------


def check_effect(machine: MachineData, effect: Effect) -> None:
    """Check that an effect can be added to a machine.

    Raises
    ------
    UnfitEffectError
    """
    for rule in (
        _check_place,
        _check_own,
        _check_acts,
        _check_drive,
        _check_before,
        _check_once,
        _check_freedom,
        _check_hold,
    ):
        rule(machine, effect)


def _check_place(machine: MachineData, effect: Effect) -> None:
    kind = _kind_of(machine, effect.place)
    if not machine.kinds_of(effect.place) & effect.definition.at:
        raise _wrong_place(machine, [effect.definition], kind, effect.place)


def _check_acts(machine: MachineData, effect: Effect) -> None:
    measurand, definition = machine.measurand, effect.definition
    nothing = measurand.unchanged_by.get(definition.component)
    if not measurand.is_direction and definition.of_directions:
        nothing = f"no {measurand.kind}: it is an error of lines of sight"
    if definition.component == "plate" and measurand.kind != "height":
        nothing = f"no {measurand.kind}: it is seen in heights over a plate"
    if not measurand.moving:
        slides = machine.kind_of(effect.place) == "prismatic"
        if slides and definition.component in {"reading", "axis"}:
            nothing = "no direction: a prismatic joint only moves"
        if TENSION in definition.formula.names and not definition.own:
            nothing = "no direction: it takes a load at a point"
    if definition.of_all_legs and effect.name not in machine.kinematics.of_all_legs:
        numbers = listed(list(machine.kinematics.numbers))
        raise UnfitEffectError(
            "name", f"{effect.name} on a {machine.kinematics.family}", f"its numbers in [estimate]: {numbers}"
        )
    outwards = definition.of_all_legs and "U" in definition.formula.names
    if outwards and machine.kinematics.dimension(effect.name) is None:
        found = f"{effect.name} of joints that lie in no plane across z"
        raise UnfitEffectError("name", found, "another effect")
    if nothing:
        found = f"{effect.name} where measured is {measurand.kind!r}, which changes {nothing}"
        raise UnfitEffectError("name", found, "another effect")


LAGS = frozenset({"servo_lag", "acceleration_lag"})
"""Effects of a servo."""


def _check_drive(machine: MachineData, effect: Effect) -> None:
    of_reading = effect.name.startswith("encoder_") or effect.name in LAGS
    if of_reading and not effect.definition.own and not machine.joint(str(effect.place)).is_read:
        found = f"{effect.title}, an error of readings, where the joint has none"
        raise UnfitEffectError("name", found, "another effect, or a joint with a reading")
    if effect.definition.of_drive and machine.joint(str(effect.place)).passive:
        found = f"{effect.title}, an error of drives, where the joint is passive"
        raise UnfitEffectError("name", found, "another effect, or a joint that is not passive")


def _check_before(machine: MachineData, effect: Effect) -> None:
    if effect.definition.own or not effect.definition.formula.names & {"fork", "q_before"}:
        return
    before = machine.carriers(machine.number_of(str(effect.place)))
    if not before or not machine.joints[before[-1]].revolute:
        raise UnfitEffectError(
            "joint", f"{shown(effect.place)}, which no other axis carries", "a joint behind a revolute joint"
        )


def _check_once(machine: MachineData, effect: Effect) -> None:
    if any(e.identity == effect.identity for e in machine.effects):
        raise UnfitEffectError("name", f"{effect.title} twice", "it once")


def _check_freedom(machine: MachineData, effect: Effect) -> None:
    """Refuse a second name for one freedom: the two would share it in any proportion."""
    if effect.name == "platform_shift" and (len(machine.targets) == 1 or "target" in machine.estimate):
        raise UnfitEffectError(
            "name", f"{effect.name}, which moves the targets alike", "target_offset, or 'target'"
        )
    free = [e for e in (*machine.effects, effect) if not (e.hold or e.definition.own)]
    for common in (e for e in free if e.definition.of_all_legs):
        names, numbers = _OF_A_LEG[common.definition.component]
        legs = [joint.name for joint in machine.joints]
        each = {e.place for e in free if e.name in names}
        each |= {j for j, x in zip(legs, numbers, strict=False) if {"geometry", x} & {*machine.estimate}}
        if each >= {*legs}:
            found = f"{common.title} and the same of each {machine.kinematics.leg} alone, one freedom twice"
            raise UnfitEffectError("name", found, "one of the two")
    freedom = _SAME_FREEDOM.get(effect.definition.component)
    if freedom is None:
        return
    estimated = "target" if freedom == "target" else f"{effect.place}.{freedom}"
    if estimated in machine.estimate:
        raise UnfitEffectError(
            "name", f"{effect.title}, the same freedom as {estimated!r} in [estimate]", "one of the two"
        )


def _check_hold(machine: MachineData, effect: Effect) -> None:
    units = effect.units(machine)
    for name, value in effect.hold.items():
        if name not in units:
            raise UnfitEffectError(f"hold.{name}", f"no parameter of {effect.name}", listed(units))
        if name in effect.definition.searched and not effect.definition.own and not value > 0:
            raise UnfitEffectError(f"hold.{name}", f"{value:g}", "a positive number")
    for name, key in effect.definition.given_by_joint.items():
        if name in effect.hold and effect.given(machine, name) is not None:
            found = f"given together with {key} of joint {effect.place}"
            raise UnfitEffectError(f"hold.{name}", found, "one of the two")


# what a user wrote -----------------------------------------------------------------------------------------------


def _check_own(machine: MachineData, effect: Effect) -> None:
    definition = effect.definition
    if not definition.own:
        return
    joints = {joint.name for joint in machine.joints}
    if effect.name in _KEY_WORDS | joints | {target.name for target in machine.targets}:
        raise UnfitEffectError("name", f"{shown(effect.name)}, which names something else", "another name")
    names = frozenset[str]().union(*(formula.names for formula in definition.formulas))
    for name in sorted(names - definition.parameters.keys()):
        if name in WORDS & joints:
            raise UnfitEffectError(
                "formula",
                f"{name!r}, a word of formulas and the name of a joint",
                "another name for the joint",
            )
        readings = READING_COLUMNS | machine.measurand.read_columns
        if name in readings and not (machine.measurand.is_direction and name in SKY):
            raise UnfitEffectError("formula", f"{name!r}, the reading itself", "what the reading depends on")


# what a base fit adjusts -----------------------------------------------------------------------------------------


def check_estimate(machine: MachineData, entry: str) -> tuple[str, str] | None:
    """Return what is wrong with an entry of [estimate], as what was found and what was expected, or None."""
    freedoms = machine.kinematics.freedoms([joint.name for joint in machine.joints])
    return None if entry in freedoms else (shown(entry), suggestion(entry, freedoms))
