"""What the kernels of a machine depend on, and nothing else: its structure.

Two machines with the same joints, estimated freedoms and effects share their kernels, whatever their numbers are; the
numbers are inputs. A structure is plain data without SymPy, so that kernels that were compiled before are found in
the cache by it.

A kernel reads three vectors:

- ``rows``: what differs from row to row (commanded coordinates, direction of approach, readings, weights),
- ``g``: the geometry of the machine with the current values of the estimated freedoms,
- ``e``: the parameters of the effects.

It differentiates with respect to the *slots*: the freedoms of the geometry first, then all of ``e``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

from rodgen.machines.coupling import Coupling, couplings_of
from rodgen.machines.effects.definition import SKY
from rodgen.machines.effects.formula import Formula
from rodgen.machines.families.kinematics import Chain, Kinematics, beyond, carriers
from rodgen.machines.layout import Part, layout
from rodgen.machines.measured import Measurand
from rodgen.machines.parts import Effect, MachineData

GEOMETRY = {"axis", "point", "target", "frame_shift", "remounting"}
"""Components that change a fixed part of the machine: slots of the geometry, not terms of a row."""

CLOSED = {"base_joint", "platform_joint", "heading", "arm", "rod"}
"""Components that change a dimension of a closed chain."""

BEAM = {"zeta", "L", "P1", "P2", "P3", "P4"}
"""Names of the catalogue that need the joint's travel."""

MOMENTS = {"M", "M_perp", "M_across", "M_guide"}
"""Names of the catalogue that need the moment about the joint's axis."""

GRAVITY = {"bend", "fork"}
"""Names of the catalogue that need the direction of gravity as the joint sees it."""

TENSION = "leg_tension"
"""Name of the catalogue for the force in a leg, tension positive, per unit load along gravity at the target."""


@dataclass(frozen=True)
class JointStructure:
    """One joint."""

    revolute: bool
    """Whether it turns; else it slides."""
    axis: bool
    point: bool
    """Whether the two freedoms of its axis, and of its point, are slots."""


@dataclass(frozen=True)
class Term:
    """An effect as a kernel sees it."""

    joint: int | None
    """Where it acts; None for the whole machine, or for a target."""
    target: bool
    """Whether it acts on one target only."""
    component: str
    formula: str
    slope: str
    """As in the catalogue; `slope` is empty but for a beam."""
    parameters: tuple[str, ...]
    """In the order in which they are in ``e``."""
    columns: tuple[tuple[str, tuple[str, int | str]], ...]
    """The column that each such name of the formula is, as in :attr:`Structure.columns`; ``("c", joint)`` is a
    coordinate that is no column, as it follows from readings."""
    own: bool
    """Whether a user wrote it: then the catalogue's names have no special meaning."""
    others: tuple[tuple[str, str], ...] = ()
    """Further components that it changes, with their formulas."""
    sky: bool = False
    """Whether a user's formula has the zenith angle or the azimuth of the line of sight."""
    weights: tuple[str, ...] = ()
    """The last of the parameters: the weights that the joint carries."""

    @cached_property
    def names(self) -> frozenset[str]:
        """Every name in the formulas."""
        texts = (self.formula, self.slope, *(text for _, text in self.others))
        return frozenset().union(*(_names(text) for text in texts if text))

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Every component that it changes, with the formula."""
        return ((self.component, self.formula), *self.others)

    def _uses(self, names: Iterable[str]) -> bool:
        return not self.own and bool(self.names & set(names))

    @property
    def uses_travel(self) -> bool:
        """Whether the joint's travel is needed."""
        return self._uses(BEAM)

    @property
    def uses_moment(self) -> bool:
        """Whether the ideal pose, gravity and the mean of the targets are needed."""
        return self._uses(MOMENTS) or self.component == "sag"

    @property
    def uses_directions(self) -> bool:
        """Whether the unit vectors that complete the axis are needed."""
        return self._uses({"U", "V"})

    @property
    def uses_gravity(self) -> bool:
        """Whether gravity is needed, but no lever arm."""
        return self.sky or self.component == "lift" or self._uses(GRAVITY | {TENSION})

    @property
    def uses_tension(self) -> bool:
        """Whether the forces in the legs are needed."""
        return self._uses({TENSION})


@dataclass(frozen=True)
class Structure:
    """What the kernels depend on."""

    measurand: Measurand
    joints: tuple[JointStructure, ...]
    target: bool
    """Whether the freedoms of the target are slots."""
    frame: bool
    """Whether the frame of the measurements is free."""
    shift: bool
    """Whether there is a frame shift."""
    remounting: bool
    """Whether targets sit differently in each run."""
    terms: tuple[Term, ...]
    kinematics: type[Kinematics] = Chain
    numbers: tuple[str, ...] = ()
    """Those numbers of a closed chain's geometry that are slots."""
    correlated: bool = False
    """Whether the errors of the components of a reading are correlated."""
    line: bool = False
    """Whether the axis about which angles are read, or the vertical, is free."""
    inner: int = 0
    """How many joints, the first ones, carry the instrument. The chain runs from it to the bed, and from there to the
    target; so these are passed backwards."""
    couplings: tuple[Coupling | None, ...] = ()
    """How the coordinate of each joint follows from readings, None where it is the reading; empty where all are."""

    def carriers(self, j: int) -> range:
        """Return the numbers of the joints that carry joint j, the bed's first."""
        return carriers(j, self.inner)

    def beyond(self, j: int) -> range:
        """Return the numbers of the joints that joint j carries, the next one first."""
        return beyond(j, self.inner, len(self.joints))

    @cached_property
    def moving(self) -> bool:
        """Whether points are carried, not directions."""
        return self.measurand.moving

    @property
    def components(self) -> int:
        """Number of residuals of a row."""
        return len(self.measurand.components)

    @cached_property
    def slots(self) -> tuple[tuple[str, int], ...]:
        """The geometry's freedoms, in the order of the Jacobian's columns: (``"axis.a"``, joint), ..."""
        free = ((part, j) for part, j in layout(self) if part.free(self, j))
        return tuple((f"{part.slot or part.name}.{x}", j) for part, j in free for x in part.freedoms(self))

    @property
    def by_run(self) -> bool:
        """Whether set-ups of the measurements have parameters of their own."""
        return self.shift or self.remounting

    @cached_property
    def centre(self) -> bool:
        """Whether the mean of the targets is needed."""
        return any(term.uses_moment for term in self.terms)

    @cached_property
    def weights(self) -> bool:
        """Whether there are weights at later joints: these have lever arms even where only directions are measured."""
        return any(term.weights for term in self.terms)

    @cached_property
    def parameters(self) -> tuple[tuple[int, str], ...]:
        """The components of ``e``: number of the term, name."""
        return tuple((n, name) for n, term in enumerate(self.terms) for name in term.parameters)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "parts"}  # these hold functions

    @cached_property
    def parts(self) -> tuple[tuple[Part, int], ...]:
        """The parts of ``g`` in their order, each with the number of its joint or term."""
        return tuple((part, j) for part, j in layout(self) if part.there(self, j))

    @cached_property
    def geometry(self) -> tuple[tuple[str, int, int], ...]:
        """The layout of ``g``: name, number (of a joint or term), length."""
        return tuple((part.name, j, part.length) for part, j in self.parts)

    @cached_property
    def columns(self) -> tuple[tuple[str, int | str], ...]:
        """The layout of ``rows``: ``("q", joint)``, ``("s", joint)``, ..., ``("x", column)``, readings, weights.

        Of a closed chain also ``("start", i)``: the pose on the nominal machine, near which the model's own is.
        """
        used: dict[tuple[str, int | str], None] = {("q", j): None for j in range(len(self.joints))}
        used |= {("start", i): None for i in range(self.kinematics.pose_numbers)}
        used |= {column: None for term in self.terms for _, column in term.columns if column[0] != "c"}
        return (
            *used,
            *(("reading", i) for i in range(self.measurand.inputs)),
            *(("whitening", i) for i in range(self.components**2 if self.correlated else 0)),
            *(("weight", i) for i in range(self.components)),
        )


@lru_cache(maxsize=1024)
def _names(formula: str) -> frozenset[str]:
    return Formula.parse(formula, file="catalogue", place="formula").names


def row_effects(machine: MachineData) -> list[Effect]:
    """Return the effects that are terms of a row, in the order of :attr:`Structure.terms`."""
    return [effect for effect in machine.effects if effect.definition.component not in GEOMETRY]


def structure_of(machine: MachineData) -> Structure:
    """Return the structure of a machine, with its effects.

    Parameters
    ----------
    machine : MachineData
        As it was read; its numbers do not matter.
    """
    tilted = {e.place for e in machine.effects if e.definition.component == "axis"}
    offset = {e.place for e in machine.effects if e.definition.component == "point"}
    joints = tuple(
        JointStructure(
            revolute=joint.type == "revolute",
            axis=joint.name in tilted or f"{joint.name}.axis" in machine.estimate,
            point=joint.name in offset or f"{joint.name}.point" in machine.estimate,
        )
        for joint in machine.joints
    )
    components = {e.definition.component for e in machine.effects}
    couplings = couplings_of(machine)
    return Structure(
        measurand=machine.measurand,
        joints=joints,
        target="target" in machine.estimate or bool({"target", "remounting"} & components),
        frame=machine.measured.frame == "free" and not machine.measurand.has_zero,
        shift="frame_shift" in components,
        remounting="remounting" in components,
        terms=tuple(
            _term(machine, effect, couplings.of if couplings else ()) for effect in row_effects(machine)
        ),
        kinematics=type(machine.kinematics),
        numbers=_free_numbers(machine),
        correlated=machine.measured.correlation is not None,
        line=machine.measured.frame == "free" and machine.measurand.has_zero,
        inner=machine.inner,
        couplings=couplings.of if couplings else (),
    )


def _free_numbers(machine: MachineData) -> tuple[str, ...]:
    """Return the numbers of a closed chain's geometry that a fit adjusts."""
    return tuple(name for name in machine.kinematics.numbers if {"geometry", name} & set(machine.estimate))


def _term(machine: MachineData, effect: Effect, coupled: Sequence[Coupling | None]) -> Term:
    definition = effect.definition
    names = [joint.name for joint in machine.joints]
    joint = names.index(effect.place) if effect.place in names else None
    texts = definition.formulas
    quantities = {of.column: ("q", j) for j, of in enumerate(machine.joints)}
    quantities |= {
        of.name: ("c" if coupled and coupled[j] else "q", j) for j, of in enumerate(machine.joints)
    }
    columns: dict[str, tuple[str, int | str]] = {}
    sky = frozenset[str]()
    if definition.own and machine.measurand.is_direction and not machine.kinematics.is_closed:
        sky = SKY - quantities.keys() - definition.parameters.keys()
    for name in sorted(frozenset().union(*(f.names for f in texts))):
        if name in definition.parameters or name == "pi" or name in sky:
            continue
        if joint is not None and name in {"q", "s", "v", "T"}:
            columns[name] = (name, joint)
        elif joint is not None and name == "q_before" and not definition.own:
            columns[name] = ("q", machine.carriers(joint)[-1])
        elif joint is not None and name == "acc" and not definition.own:
            columns[name] = ("x", f"a_{machine.joints[joint].column}")
        elif name in {"t", "F"}:
            columns[name] = (name, 0)
        elif definition.own:
            columns[name] = quantities.get(name, ("x", name))
    if joint is not None and any(f.names & BEAM for f in texts) and not definition.own:
        columns["q"] = ("q", joint)
    weights = definition.weights([names[k] for k in machine.beyond(joint)]) if joint is not None else ()
    return Term(
        joint=joint,
        target=effect.place is not None and joint is None,
        component=definition.component,
        formula=definition.formula.text,
        slope=definition.slope.text if definition.slope is not None else "",
        parameters=(*definition.parameters, *weights),
        columns=tuple(columns.items()),
        own=definition.own,
        sky=bool(sky & frozenset().union(*(f.names for f in texts))),
        others=tuple((component, formula.text) for component, formula in definition.others),
        weights=weights,
    )
