"""How likely each effect is on a machine before any data, its usual size, and the size that no machine exceeds.

Measurements of a machine often cannot tell effects apart: over a telescope's range of elevation a sagging tube, a scale
error and an eccentric encoder bend alike. An engineer then names the one that such machines have. The table here holds
that knowledge: odds of an effect compared with the commonest ones, by kind of machine; its usual and its largest size,
from the texts `usual_size` of the catalogue; the sign, where physics gives one. Keys of a joint (``encoder``,
``drive``, ``passive``) change the odds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rodgen.data.units import LENGTH, Dimension, UnitError, number_and_unit, unit_factor
from rodgen.errors import shown
from rodgen.machines.effects.catalogue import NAMES, WINDUPS
from rodgen.machines.parts import Effect, MachineData, StatedPlausibility
from rodgen.machines.rules import UnfitEffectError, catalogue_effect, unknown_name

PREFERRED = 1e6
"""Factor on the odds of an effect that a user prefers: above that of any other in the table."""
FEWEST_JOINTS_OF_A_ROBOT = 5
"""Revolute joints of a robot: machine tools have two or three."""


BALANCED = frozenset({"gravity_windup"})
"""Effects of weight that a counterweight or a spring may turn round."""


EVERYWHERE = frozenset({("tube_flexure", "telescope"), ("refraction", "telescope")})
"""Effects that every machine of a kind has: a tube sags, and air refracts."""


class Size(NamedTuple):
    """The sizes that a parameter may have, internal units."""

    usual: float
    """Half of the machines that have the effect have more."""
    largest: float
    """That no machine exceeds."""
    positive: bool = False
    """Whether physics says that it is positive."""


@dataclass(frozen=True)
class Plausibility:
    """What is known of an effect at its place before any data."""

    log_odds: float = 0.0
    """Natural logarithm of its odds, compared with the commonest effects; -inf where it cannot be."""
    sizes: Mapping[str, Size] = field(default_factory=dict, hash=False)
    """By parameter."""
    certain: bool = False
    """Whether every such machine has it, so that it is no choice among many."""

    def usual(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the usual sizes of parameters, (k,); NaN where it is not known."""
        return np.array([self.sizes[n].usual if n in self.sizes else np.nan for n in names])

    def size_cost(self, names: Sequence[str], values: ArrayLike) -> float:
        """Return -2 ln of the density of a size, compared with that of a small one.

        Sizes have Cauchy's distribution about zero, of which the usual size is the half-width: ten times that costs 9.

        Parameters
        ----------
        names : sequence of str, length k
            Of parameters.
        values : array_like, shape (k,)
            Internal units.
        """
        times = np.abs(np.asarray(values, float)) / self.usual(names)
        largest = float(np.max(times, where=np.isfinite(times), initial=0.0))
        return 2 * math.log1p(largest**2)


# The table -------------------------------------------------------------------------------------------------------


class _Row(NamedTuple):
    """Odds on a machine tool, a robot and a telescope; sizes "usual < largest", those of angles and lengths apart."""

    odds: tuple[float, float, float]
    sizes: tuple[str, ...]
    positive: frozenset[str] = frozenset()
    robot: tuple[str, ...] = ()


def _row(odds: tuple[float, float, float], *sizes: str, positive: str = "", robot: str = "") -> _Row:
    return _Row(odds, sizes, frozenset(positive.split()), (robot,) if robot else ())


_KINDS = ("machine tool", "robot", "telescope")

_LEG = (1.0, 1.0, 1.0)
_TABLE: Mapping[tuple[str, str], _Row] = {
    ("axis_tilt", "revolute"): _row((1, 1, 1), "20 arcsec < 5 deg", robot="200 arcsec < 5 deg"),
    ("axis_offset", "revolute"): _row((1, 1, 1), "0.05 mm < 50 mm", robot="0.5 mm < 50 mm"),
    ("zero_offset", "revolute"): _row((1, 1, 1), "60 arcsec < 180 deg", robot="0.2 deg < 180 deg"),
    ("scale", "revolute"): _row((0.1, 0.01, 0.03), "1e-4 < 0.05"),
    ("encoder_eccentricity", "revolute"): _row((0.5, 0.2, 0.1), "20 arcsec < 3 deg"),
    ("encoder_ellipticity", "revolute"): _row((0.1, 0.05, 0.03), "5 arcsec < 0.5 deg"),
    ("encoder_harmonics", "revolute"): _row((0.05, 0.03, 0.03), "5 arcsec < 0.5 deg"),
    ("periodic_drive_error", "revolute"): _row((0.3, 0.3, 0.1), "20 arcsec < 0.5 deg"),
    ("radial_error_motion", "revolute"): _row((0.2, 0.05, 0.1), "5 um < 0.1 mm"),
    ("axial_error_motion", "revolute"): _row((0.2, 0.05, 0.1), "5 um < 0.1 mm"),
    ("tilt_error_motion", "revolute"): _row((0.2, 0.05, 0.1), "5 arcsec < 0.1 deg"),
    ("backlash", "revolute"): _row((0.5, 0.5, 0.2), "30 arcsec < 2 deg", robot="100 arcsec < 2 deg"),
    ("backlash_gradient", "revolute"): _row((0.03, 0.03, 0.01), "4e-6 < 0.01"),
    ("servo_lag", "revolute"): _row((0.3, 0.2, 0.2), "10 ms < 5 s"),
    ("acceleration_lag", "revolute"): _row((0.3, 0.2, 0.2), "1e-4 s**2 < 1 s**2"),
    ("gravity_windup", "revolute"): _row(
        (0.3, 1, 0.03), "20 arcsec < 2 deg", positive="k", robot="2 arcmin < 2 deg"
    ),
    ("load_windup", "revolute"): _row((0.3, 0.5, 0.1), "1 arcsec/N < 1000 arcsec/N", positive="k"),
    ("lateral_windup", "revolute"): _row(
        (0.05, 0.1, 0.03), "10 arcsec < 1 deg", positive="a", robot="60 arcsec < 1 deg"
    ),
    ("coupling", "revolute"): _row((0.02, 0.1, 0.01), "1e-4 < 2"),
    ("thermal_offset", "revolute"): _row((0.3, 0.2, 0.2), "1 arcsec/K < 5 arcmin/K"),
    ("thermal_axis_drift", "revolute"): _row((0.3, 0.2, 0.1), "5 um/K < 1 mm/K"),
    ("squareness", "prismatic"): _row((1, 1, 1), "20 arcsec < 5 deg"),
    ("zero_offset", "prismatic"): _row((1, 1, 1), "0.1 mm < 100 mm"),
    ("scale", "prismatic"): _row((1, 1, 1), "3e-5 < 0.05"),
    ("periodic_drive_error", "prismatic"): _row((0.5, 0.3, 0.3), "5 um < 1 mm"),
    ("straightness", "prismatic"): _row((0.5, 0.5, 0.5), "5 um < 5 mm"),
    ("angular_error_motion", "prismatic"): _row((0.5, 0.5, 0.5), "10 arcsec < 1 deg"),
    ("backlash", "prismatic"): _row((0.5, 0.5, 0.5), "10 um < 5 mm"),
    ("backlash_gradient", "prismatic"): _row((0.05, 0.05, 0.05), "5e-6 < 0.01"),
    ("servo_lag", "prismatic"): _row((0.3, 0.2, 0.2), "10 ms < 5 s"),
    ("acceleration_lag", "prismatic"): _row((0.3, 0.2, 0.2), "1e-4 s**2 < 1 s**2"),
    ("thermal_offset", "prismatic"): _row((0.5, 0.3, 0.3), "5 um/K < 1 mm/K"),
    ("thermal_expansion", "prismatic"): _row((0.5, 0.5, 0.5), "1.2e-5 1/K < 2e-4 1/K"),
    ("gravity_sag", "prismatic"): _row((0.3, 0.3, 0.3), "20 um < 10 mm", positive="tip own mid"),
    ("load_sag", "prismatic"): _row((0.3, 0.3, 0.3), "0.1 um/N < 0.1 mm/N", positive="k0 k3"),
    ("guide_windup", "prismatic"): _row((0.2, 0.2, 0.2), "10 arcsec < 0.5 deg", positive="a"),
    ("warm_up_drift", "machine"): _row((0.3, 0.3, 0.3), "20 um < 10 mm", "10 arcsec < 1 deg"),
    ("linear_drift", "machine"): _row((0.5, 0.5, 0.5), "5 um/h < 10 mm/h", "5 arcsec/h < 1 deg/h"),
    ("frame_shift", "machine"): _row((0.5, 0.5, 0.5), "0.1 mm < 100 m", "30 arcsec < 180 deg"),
    ("instrument_scale", "machine"): _row((0.2, 0.2, 0.2), "1e-5 < 0.01"),
    ("instrument_axis_scales", "machine"): _row((0.1, 0.05, 0.05), "1e-5 < 0.01"),
    ("instrument_squareness", "machine"): _row((0.2, 0.05, 0.05), "10 arcsec < 0.5 deg"),
    ("plate_bowl", "machine"): _row((0.5, 0.5, 0.5), "1e-5 1/mm < 1e-2 1/mm"),
    ("plate_warp", "machine"): _row((0.5, 0.5, 0.5), "1e-5 1/mm < 1e-2 1/mm"),
    ("bearing_waves", "revolute"): _row((0.01, 0.01, 0.1), "5 arcsec < 0.1 deg"),
    ("axis_flexure", "revolute"): _row((0.01, 0.01, 0.3), "20 arcsec < 2 deg"),
    ("fork_flexure", "revolute"): _row((0.01, 0.01, 0.3), "20 arcsec < 2 deg"),
    ("tube_flexure", "machine"): _row((0.01, 0.01, 1), "20 arcsec < 2 deg"),
    ("refraction", "machine"): _row((0.01, 0.01, 1), "10 arcsec < 120 arcsec"),
    ("target_offset", "target"): _row((0.5, 0.5, 0.5), "0.1 mm < 100 mm", "60 arcsec < 5 deg"),
    ("target_remounting", "target"): _row((0.3, 0.3, 0.3), "0.1 mm < 100 mm", "60 arcsec < 180 deg"),
    ("base_joint_offset", "leg"): _row(_LEG, "0.1 mm < 50 mm"),
    ("platform_joint_offset", "leg"): _row(_LEG, "0.1 mm < 50 mm"),
    ("leg_zero_offset", "leg"): _row(_LEG, "0.1 mm < 100 mm"),
    ("leg_scale", "leg"): _row(_LEG, "3e-5 < 0.05"),
    ("leg_thermal_expansion", "leg"): _row(_LEG, "1.2e-5 1/K < 2e-4 1/K"),
    ("leg_backlash", "leg"): _row(_LEG, "10 um < 5 mm"),
    ("leg_compliance", "leg"): _row(_LEG, "5e-5 mm/N < 0.1 mm/N", positive="c"),
    ("base_radius", "machine"): _row(_LEG, "0.1 mm < 50 mm"),
    ("platform_radius", "machine"): _row(_LEG, "0.1 mm < 50 mm"),
    ("platform_shift", "machine"): _row((0.5, 0.5, 0.5), "0.1 mm < 100 mm"),
    ("common_zero_offset", "machine"): _row(_LEG, "0.3 mm < 100 mm", "0.1 deg < 180 deg"),
    ("zero_offset", "tower"): _row(_LEG, "0.3 mm < 100 mm"),
    ("zero_offset", "arm"): _row(_LEG, "0.1 deg < 180 deg"),
    ("scale", "tower"): _row((0.3, 0.3, 0.3), "3e-4 < 0.05"),
    ("scale", "arm"): _row((0.1, 0.1, 0.1), "3e-4 < 0.05"),
    ("backlash", "tower"): _row((0.5, 0.5, 0.5), "0.03 mm < 5 mm"),
    ("backlash", "arm"): _row((0.5, 0.5, 0.5), "100 arcsec < 2 deg"),
    **{("delta_radius", at): _row(_LEG, "0.3 mm < 50 mm") for at in ("tower", "arm")},
    **{("delta_angle", at): _row(_LEG, "0.2 deg < 10 deg") for at in ("tower", "arm")},
    **{("rod_length", at): _row(_LEG, "0.1 mm < 50 mm") for at in ("tower", "arm")},
    ("arm_length", "arm"): _row(_LEG, "0.1 mm < 50 mm"),
    ("tower_lean", "tower"): _row((0.5, 0.5, 0.5), "0.1 deg < 10 deg"),
}
"""By name and place. Odds are those of one scale, compared with effects that nearly every such machine has:

1        whatever is set, mounted or dimensioned: zeros, places and directions of axes, lengths of legs, linear scales
0.5      most machines, as far as it was not compensated: straightness, play, drift, a set-up that moved
0.2-0.3  faults that are met in one of a few machines: waves of drives, lags, warm-up, weight that yields
0.05-0.1 seldom, or hidden by other parts: error motions of good bearings beside geometry, a second harmonic
0.01-0.03 another kind of machine, or the change over the travel of an effect that is itself not everywhere

Where kinds of machines differ, the reasons are:

- Telescopes: a tube that sags and air that refracts are in every pointing model (TPOINT's basic one has TF, and TX
  where refraction is not exact), so 1; on other machines nothing is seen through them, so 0.01. Flexures of axis and
  fork are further terms (DAF, FO) of large or old equatorial mounts, 0.3. TPOINT has terms for the centring of a
  graduation (ACES, ECEC and so on), which two heads and tapes on drums remove on large telescopes, 0.1; it has none
  for a scale, as a circle closes, 0.03, nor for a drive that winds up, as axes are balanced and read on the axis, 0.03.
  They run in preloaded bearings, of which a race or a track that is not flat makes waves, 0.1.
- Robots: every joint that bears weight yields by its gear (calibrations by Whitney, by Judd and Knasinski, and by
  Khalil and Dombre begin with it), 1, against 0.3 of a stiff or balanced machine tool; wrists are coupled through their
  gears, 0.1; error motions of bearings are a hundredth of their other errors, 0.05; gears and encoders have whole
  numbers of teeth and lines, which the control knows: a ratio is right, or wrong by a whole tooth, which is seen at
  once, so that a small scale error is next to impossible, 0.01.
- Error motions: rolling bearings of the loosest class of clearance, C5, have a radial play of some 0.2 mm at a bore of
  0.2 m: 0.1 mm to either side, which tilts an axis by 0.1 degrees over 0.1 m. No axis moves by more in a turn.
- Axes of the instrument: a machine tool is measured by its own probe or on a measuring machine, whose axes are square
  within 1 to 20 arcsec and whose scales differ; robots and telescopes by instruments that measure angles, 0.05.
- Machine tools: encoders on the axis, eccentric by some micrometres, are the rule, 0.5; on robots they sit behind the
  gear, where an eccentricity turns with the motor, 0.2.

These are grades, not frequencies that somebody counted: a factor of three either way is a guess, and costs or gains 2.2
in chi-square."""

_DRIVEN = ("periodic_drive_error", "backlash", "backlash_gradient")
_BY_KEY: Mapping[tuple[str, object], Mapping[str, float]] = {
    ("encoder", "axis"): {
        "scale": 0.0,
        "coupling": 0.0,
        **dict.fromkeys(_DRIVEN, 0.0),
        **dict.fromkeys(WINDUPS, 0.3),
    },
    ("encoder", "motor"): {
        "scale": 0.3,
        "encoder_eccentricity": 0.2,
        "encoder_ellipticity": 0.2,
        "encoder_harmonics": 0.2,
        **dict.fromkeys([*_DRIVEN, *WINDUPS], 3.0),
    },
    ("drive", "direct"): {"scale": 0.0, "coupling": 0.0, **dict.fromkeys(_DRIVEN, 0.0)},
    ("drive", "worm"): {"periodic_drive_error": 3.0, "backlash": 3.0},
    ("drive", "gear"): {"periodic_drive_error": 2.0, "backlash": 2.0},
    ("drive", "belt"): {"scale": 3.0, "backlash": 0.3},
    ("drive", "friction"): {"scale": 10.0, **dict.fromkeys(_DRIVEN, 0.1)},
    ("drive", "screw"): {"periodic_drive_error": 2.0},
    ("drive", "harmonic"): {"periodic_drive_error": 3.0, "backlash": 0.3, **dict.fromkeys(WINDUPS, 3.0)},
    ("passive", True): {
        "servo_lag": 0.0,
        "acceleration_lag": 0.0,
    },  # errors of a drive are refused there anyway
}
"""Factors on the odds by what a joint's block says. An encoder on the axis sees what the drive does, so that neither
play nor windup of the drive is an error of the reading (what the axis carries may bend, still), and has a whole number
of lines in a turn."""


# What it says of a machine ---------------------------------------------------------------------------------------


def kind_of_machine(machine: MachineData) -> str:
    """Return ``"telescope"``, ``"robot"`` or ``"machine tool"``, which stands for any other machine.

    A telescope has two revolute joints at least, and directions are measured; a robot has five at least.
    """
    turning = sum(joint.revolute for joint in machine.joints)
    if machine.measurand.is_direction and turning > 1:
        return "telescope"
    return "robot" if turning >= FEWEST_JOINTS_OF_A_ROBOT else "machine tool"


def plausibility(
    machine: MachineData, effect: Effect, prefer: Collection[tuple[str, str | None]] = ()
) -> Plausibility:
    """Return what is known of an effect of the catalogue at its place in a machine before any data.

    Parameters
    ----------
    effect : Effect
        One that a user wrote, or that the table lacks, is as likely as the commonest and of any size.
    prefer : collection of (name, place)
        Effects that a user holds for the likeliest; place None is every place.
    """
    at = machine.kind_of(effect.place)
    row = _TABLE.get((effect.name, at))
    if row is None or effect.definition.own:
        return Plausibility()
    kind = kind_of_machine(machine)
    stated = machine.plausible.get(effect.key(""), machine.plausible.get(effect.name, StatedPlausibility()))
    odds = row.odds[_KINDS.index(kind)]
    if stated.odds is not None:
        odds = stated.odds
    elif at in {"revolute", "prismatic"}:
        joint = machine.joint(str(effect.place))
        for (key, value), factors in _BY_KEY.items():
            if getattr(joint, key, None) == value:
                odds *= factors.get(effect.name, 1.0)
    if effect.identity in prefer or (effect.name, None) in prefer:
        odds = PREFERRED
    sizes = dict(_sizes(machine, effect, row, kind, stated))
    certain = (effect.name, kind) in EVERYWHERE and stated.odds is None
    return Plausibility(math.log(odds) if odds > 0 else -math.inf, sizes, certain)


def _sizes(
    machine: MachineData, effect: Effect, row: _Row, kind: str, stated: StatedPlausibility
) -> Iterator[tuple[str, Size]]:
    pairs = [text.split(" < ") for text in (row.robot if kind == "robot" and row.robot else row.sizes)]
    for name, unit in effect.units(machine).items():
        if name in effect.definition.searched:
            continue
        dimensions = size_dimensions(machine, effect, name, unit)
        usual = _first_of(machine, dimensions, [*stated.usual, *(usual for usual, _ in pairs)])
        largest = _first_of(machine, dimensions, [*stated.largest, *(largest for _, largest in pairs)])
        if usual is not None and largest is not None:
            # a weight hangs at the point of a joint, and off the line to it on either side
            positive = name in row.positive or name.startswith("k_")
            if stated.sign is not None:
                positive = stated.sign == "positive"
            elif effect.name in BALANCED and _lifts(machine, effect, name, kind):
                positive = False
            yield name, Size(usual, max(usual, largest), positive)


def _first_of(machine: MachineData, dimensions: Sequence[Dimension], texts: Iterable[str]) -> float | None:
    """Return the first size that is of a parameter's dimension, or of what it does at the machine's whole reach."""
    for number, dimension in (_quantity(text, machine.length_unit) for text in texts):
        if dimension in dimensions:
            # the arm in these data may be nearly zero everywhere
            return number / reach(machine) if dimension != dimensions[0] else number
    return None


def _lifts(machine: MachineData, effect: Effect, parameter: str, kind: str) -> bool:
    """Return whether weight may turn a joint upwards.

    Counterweights or springs may, and a mirror's cell on a telescope; at a later joint also what stands behind it, such
    as a counterweight of its link.
    """
    j = machine.number_of(str(effect.place))
    way = [machine.joints[k] for k in (j, *machine.beyond(j))]
    names = [joint.name for joint in way]
    last = names.index(parameter.removeprefix("k_")) if parameter.removeprefix("k_") in names else 0
    return kind == "telescope" or any(joint.counterbalance for joint in way[: last + 1])


@lru_cache
def _quantity(text: str, length_unit: str) -> tuple[float, Dimension]:
    read = number_and_unit(text)
    assert read is not None
    number, unit = read
    factor, dimension = unit_factor(unit or "1", length_unit)
    return number * factor, dimension


def reach(machine: MachineData) -> float:
    """Return the largest distance between two points of a machine, or along which one of its joints slides."""
    points = [joint.point for joint in machine.joints] + [target.point for target in machine.targets]
    at = np.array(points).reshape(-1, 3)
    apart = np.linalg.norm(at[:, None] - at, axis=2)
    ways = [
        joint.travel[1] - joint.travel[0] for joint in machine.joints if joint.travel and not joint.revolute
    ]
    return max(float(apart.max(initial=0.0)), *ways, 0.0) or 1.0


# stated ------------------------------------------------------------------------------------------------------------

SIGNS = ("any", "positive")
MOST_ODDS = 1e6
"""Odds that a file may state, of which the square is still far from overflow."""
EXAMPLE = 'odds = 0.5, usual = "20 arcsec", largest = "2 deg" or sign = "any"'


def stated_plausibility(machine: MachineData, key: str, content: Mapping[str, Any]) -> StatedPlausibility:
    """Return what an entry of ``[plausibility]`` says.

    Parameters
    ----------
    key : str
        An effect of the catalogue, at a place such as ``"J2.gravity_windup"``, or everywhere: ``"gravity_windup"``.
    content : mapping
        ``odds``, ``usual``, ``largest`` and ``sign``, one of them at least.

    Raises
    ------
    UnfitEffectError
        With the key, what was found and what was expected.
    """
    effects = _effects(machine, key)
    for name in content:
        if name not in {"odds", "usual", "largest", "sign"}:
            raise UnfitEffectError(name, "unknown key", EXAMPLE)
    if not content:
        raise UnfitEffectError("", "nothing", EXAMPLE)
    odds, sign = content.get("odds"), content.get("sign")
    is_number = isinstance(odds, int | float) and not isinstance(odds, bool)
    if odds is not None and not (is_number and 0 <= odds <= MOST_ODDS):
        expected = "a number from 0 (it cannot be there) to 1e6; 1 is as likely as the commonest effects"
        raise UnfitEffectError("odds", shown(str(odds)), expected)
    if sign is not None and sign not in SIGNS:
        raise UnfitEffectError("sign", shown(str(sign)), '"any" or "positive"')
    dimensions = {
        dimension
        for effect in effects
        for parameter, unit in effect.units(machine).items()
        if parameter not in effect.definition.searched
        for dimension in size_dimensions(machine, effect, parameter, unit)
    }
    sizes = {
        name: _stated_sizes(machine, name, content[name], dimensions)
        for name in ("usual", "largest")
        if name in content
    }
    for usual in map(number_and_unit, sizes.get("usual", ())):
        for largest in map(number_and_unit, sizes.get("largest", ())):
            if usual and largest and usual[1] == largest[1] and largest[0] < usual[0]:
                found = f"{f'{largest[0]:g} {largest[1]}'.strip()}, less than the usual {usual[0]:g}"
                raise UnfitEffectError("largest", found, "a size that is no less than the usual one")
    return StatedPlausibility(None if odds is None else float(odds), **sizes, sign=sign)


def _effects(machine: MachineData, key: str) -> list[Effect]:
    """Return the effect that a key stands for, at each of its places."""
    place, _, name = key.rpartition(".")
    if place:
        return [catalogue_effect(machine, name, place, {})]
    if name not in NAMES:
        raise unknown_name(name)
    effects = []
    for at in (*(joint.name for joint in machine.joints), *(target.name for target in machine.targets), None):
        try:
            effects.append(catalogue_effect(machine, name, at, {}))
        except UnfitEffectError:
            continue
    if not effects:
        raise UnfitEffectError("", "an effect that this machine cannot have", "one that it may have")
    return effects


def size_dimensions(machine: MachineData, effect: Effect, name: str, unit: str) -> tuple[Dimension, ...]:
    """Return the dimensions in which the size of a parameter may be given, its own first.

    Of one per lever arm also the dimension of what it does at the machine's whole reach.
    """
    _, dimension = unit_factor(unit, machine.length_unit)
    of_catalogue = effect.definition.parameters.get(name)
    by_arm = of_catalogue is None or (of_catalogue.endswith("/{arm}") and machine.measurand.moving)
    return (dimension, dimension * LENGTH) if by_arm else (dimension,)


def _stated_sizes(machine: MachineData, key: str, value: Any, dimensions: set[Dimension]) -> tuple[str, ...]:
    texts = tuple(value) if isinstance(value, list) and value else (value,)
    expected = 'a size with its unit, such as "20 arcsec", or a list of such'
    for text in texts:
        number = number_and_unit(text) if isinstance(text, str) else None
        if number is None or not number[0] > 0:
            raise UnfitEffectError(key, shown(str(text)), expected)
        try:
            _, dimension = unit_factor(number[1] or "1", machine.length_unit)
        except UnitError as error:
            raise UnfitEffectError(key, error.found, error.expected) from None
        if dimension not in dimensions:
            raise UnfitEffectError(key, f"{shown(text)}, which no parameter of the effect is", expected)
    return texts
