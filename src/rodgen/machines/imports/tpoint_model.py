"""Models of TPOINT as effects of a mount, and back.

A model has a caption, a line of what was fitted, a line a term (its name, its value in arcsec, and unless it is fixed,
``=``, its standard deviation), and END. A term moves what is seen by its formula: the star is where the axes say, and
the sum of the terms.

Each term is a parameter of an effect, as ``rodgen effects TERM`` says. Those that tilt the whole mount (AN, AW, ME, MA)
tilt the first axis alone in a machine file, where what follows stays as it is given; so the second axis and its zero
are turned with it: with w the tilt and n the second axis, its axis_tilt by the part of w across n, its zero_offset by
w·n. Terms are formulas to first order in small angles, and so is what is made of them.
"""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from rodgen.data.units import ARCSEC
from rodgen.errors import InputFileError, MissingOptionError, RodgenError, joined, nearest_name, shown
from rodgen.files import decoded, read_input
from rodgen.machines.effects.catalogue import TERMS
from rodgen.machines.effects.formula import Formula
from rodgen.machines.effects.symbols import OwnTerm, own_term
from rodgen.machines.files.read import effect_of
from rodgen.machines.imports.imported import Imported, one_line
from rodgen.machines.imports.tpoint_data import Pointings, read_pointings
from rodgen.machines.machine import Machine
from rodgen.machines.measured import Measured
from rodgen.machines.mounts import (
    ALTAZ,
    BORESIGHT,
    EQUATORIAL,
    GEOMETRY,
    MOUNTS,
    OF_NASMYTH,
    Mount,
    relation_of,
)
from rodgen.machines.parts import Effect, Joint, Target
from rodgen.machines.rigid import complete_basis

_EXPECTED = "a model of TPOINT"
_LINE = re.compile(r"(?P<flags>[=&]*)\s*(?P<name>[A-Z][A-Z0-9]*)\s+(?P<value>[-+.\dEe]+)(?:\s+[-+.\dEe]+)*")
_Key: TypeAlias = tuple[str, str | None, str]
"""Effect, place and parameter of a number."""
_TILTS = {"altaz": ("AN", "AW"), "equatorial": ("MA", "ME")}


@dataclass(frozen=True)
class TpointModel:
    """A model of TPOINT."""

    caption: str
    terms: dict[str, float]
    """Values in arcsec."""
    lines: dict[str, int]
    """Where each term stands."""

    @property
    def mount(self) -> Mount | None:
        """The mount whose terms these are; None where they are of both."""
        for name, geometry in GEOMETRY.items():
            if any(_is_of(term, name) for term in self.terms if term not in ("TF", "TX")) or any(
                term in self.terms for term in geometry
            ):
                return MOUNTS[name]
        return None


def _is_of(term: str, mount: str) -> bool:
    """Return whether a term of the catalogue, or of one's own, is at an axis of a mount."""
    if term in TERMS:
        relation = relation_of(term, TERMS[term], MOUNTS[mount])
        return relation is not None and relation.place is not None
    parsed = own_term(term)
    return parsed is not None and parsed.joint in MOUNTS[mount].joints


def _is_term_for(term: str, mount: Mount) -> bool:
    """Return whether a term of the catalogue is one of this mount, or of both."""
    return _is_of(term, mount.name) or not any(_is_of(term, mount_name) for mount_name in MOUNTS)


def is_model(start: bytes) -> bool:
    """Return whether the first bytes of a file are those of a model: END, and a term that is known."""
    lines = [line.partition("!")[0].strip() for line in start.decode("utf-8", "replace").splitlines()]
    terms = [match["name"] for line in lines[2:] if (match := _LINE.fullmatch(line))]
    return "END" in lines and any(term in TERMS or own_term(term) is not None for term in terms)


def read_model(path: str | os.PathLike[str]) -> TpointModel:
    """Return a model of TPOINT.

    Raises
    ------
    InputFileError
        With the line that cannot be read.
    """
    file = os.fspath(path)
    lines = decoded(read_input(file, _EXPECTED), file).splitlines()
    terms: dict[str, float] = {}
    where: dict[str, int] = {}
    for number, line in enumerate(lines[2:], start=3):
        text = line.partition("!")[0].strip()
        if text.upper() == "END":
            break
        match = _LINE.fullmatch(text)
        if not text:
            continue
        try:
            value = float(match["value"]) if match else math.nan
        except ValueError:
            value = math.nan
        if match is None or not abs(value) < 1e7:
            raise InputFileError(
                file, f"line {number}", shown(line), "a term, its value and its sigma in arcsec, or END"
            )
        if match["name"] in terms:
            raise InputFileError(file, f"line {number}", f"a second {match['name']}", "each term once")
        terms[match["name"]], where[match["name"]] = value, number
    if not terms:
        raise InputFileError(
            file, "file", "no terms", f"{_EXPECTED}: a caption, a line of the fit, then a term a line"
        )
    return TpointModel(one_line(lines[0]) or "Telescope", terms, where)


# terms to effects -------------------------------------------------------------------------------------------


def with_terms(machine: Machine, mount: Mount, model: TpointModel, latitude: float, file: str) -> Machine:
    """Return a mount with the terms of a model as effects, their parameters held.

    Parameters
    ----------
    machine : Machine
        As :func:`mount_machine` makes it.
    latitude : float
        rad.
    file : str
        The model's, for error messages.

    Raises
    ------
    InputFileError
        When a term is not known, or of another mount.
    """
    holds: dict[tuple[str, str | None], dict[str, float]] = {}

    def add(name: str, place: str | None, parameter: str, value: float) -> None:
        held = holds.setdefault((name, place), {})
        held[parameter] = held.get(parameter, 0.0) + value

    harmonics = [(term, value) for term, value in model.terms.items() if term not in TERMS]
    for term in model.terms:
        if term in TERMS and not _is_term_for(term, mount):
            line, expected = f"line {model.lines[term]}", f"terms of an {mount.words}"
            raise InputFileError(file, line, f"{term}, of another mount", expected)
    parts = [
        (part, times * value)
        for term, value in model.terms.items()
        for part, times in OF_NASMYTH.get(term, {term: 1.0}).items()
        if term in TERMS
    ]
    for term, value in parts:
        name, place, parameter, factor = _parameter(term, mount, latitude)
        add(name, place, parameter, factor * value)
        if (relation := relation_of(term, TERMS[term], mount)) and relation.has_period:
            holds[name, place]["P"] = 9 * 3600.0
        if term in _TILTS[mount.name]:
            for follower in _followers(mount, parameter, factor * value):
                add(*follower)
    machine = replace(machine, estimate=())
    for (effect, where), held in holds.items():
        full = {x: held.get(x, 0.0) / 3600 for x in machine.effect(effect, where).units(machine)}
        machine = machine.with_effect(machine.effect(effect, where, hold=full))
    for term, value in harmonics:
        machine = machine.with_effect(_own(machine, term, value, f"line {model.lines[term]}", file))
    return machine


def _parameter(term: str, mount: Mount, latitude: float) -> tuple[str, str | None, str, float]:
    """Return the effect of a term, its place and its parameter, and the parameter's value for each unit of the term."""
    relation = relation_of(term, TERMS[term], mount)
    assert relation is not None  # of this mount, as _is_term_for says
    factor = relation.sign / (math.cos(latitude) if relation.of_latitude else 1.0)
    return TERMS[term].name, relation.place, relation.parameter, factor


def _followers(mount: Mount, parameter: str, value: float) -> Iterator[tuple[str, str, str, float]]:
    """Yield by what the second axis follows a tilt of the first one."""
    tilt = complete_basis(mount.axes[0])["ab".index(parameter)] * value
    name, axis = mount.joints[1], np.array(mount.axes[1])
    yield "zero_offset", name, "a", float(tilt @ axis)
    for x, direction in zip("ab", complete_basis(axis), strict=True):
        yield "axis_tilt", name, x, float(tilt @ direction)


def _own_term(machine: Machine, term: str) -> OwnTerm | None:
    return own_term(term, tuple(x.tolist() for x in complete_basis(-np.array(machine.gravity))))


def _is_own_term(machine: Machine, effect: Effect) -> bool:
    """Return whether an effect of a user's is the term of its name, by its formulas."""
    definition = effect.definition
    term = _own_term(machine, effect.name) if definition.own else None
    formulas = {(definition.component, definition.formula), *definition.others}
    return term is not None and formulas == {
        (x, Formula.parse(f, file="", place="")) for x, f in term.formulas
    }


def _own(machine: Machine, term: str, value: float, place: str, file: str) -> Effect:
    term_parsed = _own_term(machine, term)
    names = [*TERMS, "FLOP", "DNP", "HDSH5", "X2HC"]
    if term_parsed is None and re.fullmatch(r"P[HDXAESZ](?:[HDAEZ][1-9]?){1,2}", term):
        found, expected = f"{term}, a polynomial of azimuths", "harmonics of azimuths, such as HACA or HASA2"
        raise InputFileError(file, place, found, expected)
    if term_parsed is None:
        near = nearest_name(term, names)
        expected = (
            f"{near!r}, perhaps, or one that 'rodgen effects TERM' knows"
            if near
            else "one that 'rodgen effects TERM' knows"
        )
        raise InputFileError(file, place, f"the term {shown(term)}, which is not known", expected)
    if term_parsed.joint is not None and term_parsed.joint not in {joint.name for joint in machine.joints}:
        raise InputFileError(file, place, f"{term}, at an axis {term_parsed.joint}", "a term of this mount")
    block = tomllib.loads(term_parsed.block)["effect"][0] | {"hold": {"a": value / 3600}}
    return effect_of(machine, block, file, place)


def mount_machine(mount: Mount, title: str, latitude: float, *, temperature: float = 20.0) -> Machine:
    """Return the ideal machine of a mount, whose axes and boresight a base fit adjusts.

    Parameters
    ----------
    latitude : float
        rad.
    temperature : float
        Reference temperature, degrees Celsius.
    """
    return Machine(
        title,
        "mm",
        "deg",
        mount.gravity(latitude),
        temperature,
        tuple(Joint(name, "revolute", axis) for name, axis in zip(mount.joints, mount.axes, strict=True)),
        (Target(BORESIGHT, mount.boresight),),
        Measured("direction", "machine"),
        estimate=(*(f"{name}.axis" for name in mount.joints), "target"),
    )


# effects to terms -------------------------------------------------------------------------------------------


def terms_of(machine: Machine, mount: Mount, latitude: float, *, others: bool = False) -> dict[str, float]:
    """Return the terms of TPOINT, in arcsec, that the numbers of a mount's model are, held or fitted.

    Parameters
    ----------
    machine : Machine
        With the ideal axes of the mount; fitted or with effects whose parameters are held.
    latitude : float
        rad.
    others : bool
        Whether it may have effects that are no terms; these are left out.

    Raises
    ------
    RodgenError
        When it has an effect that is no term of TPOINT.
    """
    numbers = _numbers_of(machine)
    terms = {
        effect.name.upper(): numbers.pop((effect.name, effect.place, "a"), 0.0)
        for effect in machine.effects
        if _is_own_term(machine, effect)
    }
    units: dict[str, dict[_Key, float]] = {}
    for term in (*_TILTS[mount.name], *GEOMETRY[mount.name], *TERMS):
        if term in units or term in OF_NASMYTH or not _is_term_for(term, mount):
            continue
        name, place, parameter, factor = _parameter(term, mount, latitude)
        key = name, place, parameter
        is_known = key in numbers or term in GEOMETRY[mount.name]
        if is_known and not any(key in unit for unit in units.values() if len(unit) == 1):
            units[term] = {key: factor}
            if term in _TILTS[mount.name]:
                units[term] |= {(n, at, x): y for n, at, x, y in _followers(mount, parameter, factor)}
    every = [*units.values(), *_changing_nothing(mount)]
    keys = list(dict.fromkeys([key for unit in every for key in unit] + [*numbers]))
    matrix = np.array([[unit.get(key, 0.0) for unit in every] for key in keys])
    values = np.array([numbers.get(key, 0.0) for key in keys])
    of_units = np.linalg.lstsq(matrix, values, rcond=None)[0]
    left = [
        f"{name} at {place}" if place else name
        for (name, place, x), v in zip(keys, values - matrix @ of_units, strict=True)
        if abs(v) > 1e-9 and x != "P"
    ]
    if left and not others:
        raise RodgenError(
            f"{joined(sorted(set(left)))}: no term of TPOINT; expected effects that 'rodgen effects' lists with one"
        )
    terms = dict(zip(units, of_units.tolist(), strict=False)) | terms
    return {term: value for term, value in terms.items() if abs(value) > 1e-9}


def _changing_nothing(mount: Mount) -> Iterator[dict[_Key, float]]:
    """Yield numbers that together move nothing: the zero of an axis, and the same turn of all that it carries."""
    first, second = mount.joints
    n1, n2 = (np.array(axis) for axis in mount.axes)
    across, beside = complete_basis(n2), complete_basis(np.array(mount.boresight))
    tilts: dict[_Key, Any] = {("axis_tilt", second, x): d for x, d in zip("ab", across, strict=True)}
    offsets: dict[_Key, Any] = {("target_offset", BORESIGHT, x): d for x, d in zip("ab", beside, strict=True)}
    for axis, turned, carried in ((first, n1, tilts | offsets), (second, n2, offsets)):
        yield {("zero_offset", axis, "a"): -1.0} | {key: float(d @ turned) for key, d in carried.items()}


def _numbers_of(machine: Machine) -> dict[_Key, float]:
    """Return the numbers of effects and of a base fit, in arcsec, by effect, place and parameter."""
    numbers: dict[_Key, float] = {}
    joints = {joint.name for joint in machine.joints}
    for effect in machine.effects:
        for x in effect.units(machine):
            value = effect.hold.get(x, machine.values.get(effect.key(x), 0.0))
            place = effect.place if effect.place in joints else effect.place and BORESIGHT
            numbers[effect.name, place, x] = value / ARCSEC
    for joint in machine.joints:
        for x in "ab":
            key = ("axis_tilt", joint.name, x)
            numbers[key] = numbers.get(key, 0.0) + machine.values.get(f"{joint.name}.axis.{x}", 0.0) / ARCSEC
    for target in machine.targets:
        for x in "ab":
            key = ("target_offset", BORESIGHT, x)
            numbers[key] = (
                numbers.get(key, 0.0) + machine.values.get(f"target.{target.name}.{x}", 0.0) / ARCSEC
            )
    return numbers


def model_text(
    caption: str,
    terms: Mapping[str, float],
    sigma: Mapping[str, float] | None = None,
    *,
    rows: int = 0,
    rms: float = 0.0,
) -> str:
    """Return the file of a model of TPOINT.

    Parameters
    ----------
    terms : mapping of str to float
        In arcsec.
    sigma : mapping of str to float, optional
        Their standard deviations.
    rows : int
        How many observations it was fitted to.
    rms : float
        What it leaves, arcsec on the sky.
    """
    lines = [caption.splitlines()[0], f"T {rows:4d} {rms:10.4f}    0.000    0.0000"]
    lines += [
        f"  {name:<8} {value:+14.4f} {(sigma or {}).get(name, 0):10.5f}" for name, value in terms.items()
    ]
    return "\n".join([*lines, "END"]) + "\n"


# run and model -----------------------------------------------------------------------------------------------------


def machine_from_tpoint(
    run: str | None,
    model: str | None = None,
    *,
    latitude: float | None = None,
    azimuth: str | None = None,
    form: int | None = None,
) -> Imported:
    """Return the mount of a pointing run, or with the terms of a model, or both.

    Parameters
    ----------
    run, model : str or None
        The files; one of them at least.
    latitude : float, optional
        rad; of an equatorial mount, where no run gives it.
    azimuth : {"north", "south"}, optional
        Where azimuths of the run are 0; default: what its comments say, else north.
    form : {1, 2, 3, 4}, optional
        Format of the run's observations; default: that which their numbers fit.

    Returns
    -------
    Imported
        Without a model a base fit adjusts axes and boresight. The terms of a model are effects with held parameters.

    Raises
    ------
    InputFileError
    """
    pointings = read_pointings(run, azimuth=azimuth, form=form) if run else None
    terms = read_model(model) if model else None
    mount = pointings.mount if pointings else (terms and terms.mount) or ALTAZ
    if latitude is None and pointings and pointings.site:
        latitude = pointings.site.latitude
    if latitude is None:
        if mount is EQUATORIAL:
            found, expected = "missing, for an equatorial mount", "such as --latitude 31.7deg"
            raise MissingOptionError(model or run or "", "--latitude", found, expected, "--latitude=")
        latitude = 0.0
    notes: list[str] = []
    if pointings:
        notes.append(f"{os.path.basename(run or '')}: a pointing run, {pointings.counted}, {mount.words}.")
        notes += pointings.notes
    notes.append(f"Axes {mount.joints[0]} and {mount.joints[1]}; {mount.frame}.")
    title = pointings.caption if pointings else terms.caption if terms else mount.words
    machine = mount_machine(mount, title, latitude, temperature=_temperature(pointings))
    if terms:
        notes.append(_on_model(os.path.basename(model or ""), terms))
        machine = with_terms(machine, mount, terms, latitude, model or "")
    return Imported(machine, tuple(notes), _columns(pointings) if pointings else {}, source=run or "")


def _temperature(pointings: Pointings | None) -> float:
    site = pointings.site if pointings else None
    return 20.0 if site is None or site.temperature is None else site.temperature


def _on_model(file: str, terms: TpointModel) -> str:
    return f"{file}: a model, whose terms are held effects: {joined(terms.terms)} (arcsec there, deg here)."


def _columns(pointings: Pointings) -> dict[str, Any]:
    commanded = np.degrees(pointings.commanded).round(10)
    columns: dict[str, Any] = {
        f"{name} [deg]": column for name, column in zip(pointings.mount.joints, commanded.T, strict=True)
    }
    columns |= dict(zip(("ux", "uy", "uz"), pointings.seen.T.round(12), strict=True))
    if pointings.time is not None:
        columns["t [s]"] = pointings.time.round(3)
    columns |= {f"aux_{k}": column for k, column in enumerate(pointings.auxiliary.T, start=1)}
    return columns
