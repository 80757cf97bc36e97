"""What is wrong with machines: faults of parts, with the names that an expert signs and the size of the largest.

In laws, r are the rows, s is the state, and z the size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from physics import parts
from physics.chain import Array, Axis, Fault, Law, Title
from physics.parts import ARCSEC

STEEL = 11.5e-6  # 1/K
Axes = list[Axis]
Random = np.random.Generator
Curve = Callable[[Array, float], Array]


def fault(
    axes: Axes, j: int, name: str, acts: str, law: Law, values: dict[str, float] | None = None, *needs: str
) -> Fault:
    """Return a fault of one joint, whose parameters are proportional to its size."""
    place = axes[j].name
    keys = {f"{place}.{name}.{key}": float(x) for key, x in (values or {}).items()}
    return Fault(((name, place),), acts, law, j, keys, needs=frozenset(needs))


def wave(
    axes: Axes, j: int, name: str, curve: Curve, per_turn: float, equal: tuple[Title, ...] = ()
) -> Fault:
    """Return a fault that puts a joint ahead by a curve of its coordinate, with so many waves a turn (or mm)."""
    low, high = axes[j].travel
    q = np.linspace(low, high, 4000) * (np.pi / 180 if axes[j].turns else 1.0)
    turn = per_turn * q * (1.0 if axes[j].turns else 2 * np.pi)
    A = np.stack([np.cos(turn), np.sin(turn), np.ones_like(q)], 1)
    cosine, sine = np.linalg.lstsq(A, curve(q, 0.3) / 0.3, rcond=None)[0][:2] / (
        ARCSEC if axes[j].turns else 1.0
    )
    values = {"a": sine, "b": cosine} if name == "periodic_drive_error" else {"a": cosine, "b": sine}
    made = fault(axes, j, name, "drive", lambda r, s, z: curve(r.q[:, j], z), values)
    return Fault(made.titles, made.acts, made.law, j, made.values, equal)


def unit(axes: Axes, j: int) -> float:
    return ARCSEC if axes[j].turns else 1.0


def cross_axes(n: Sequence[float]) -> tuple[Array, Array]:
    """Return u and v of formats.md for a joint along a machine axis."""
    along, u = np.array(n, float), np.roll(np.eye(3), -1, 0)[int(np.argmax(np.abs(n)))]
    return u, np.cross(along, u)


def across(n: Array, vectors: Array) -> Array:
    """Return the parts of vectors across a unit vector."""
    return vectors - (vectors @ n)[:, None] * n


# -- encoders and drives -------------------------------------------------------------------------------------------


def disc(axes: Axes, j: int, random: Random, radius: float, equal: tuple[Title, ...] = ()) -> Fault:
    """The graduation sits up to 40 µm per 50 mm of radius beside the axis."""
    phase = random.uniform(0, 2 * np.pi)
    curve = lambda q, z: parts.eccentric_disc(q, radius, 8e-4 * radius * z, phase)  # noqa: E731
    return wave(axes, j, "encoder_eccentricity", curve, 1, equal)


def wheel(axes: Axes, j: int, random: Random) -> Fault:
    """The last wheel of a gear runs out, behind an encoder on the motor: one wave a turn."""
    phase = random.uniform(
        0, 2 * np.pi
    )  # seen from the wheel, the pinion goes round it: the gears the other way about
    curve = lambda q, z: parts.eccentric_pinion(q, 120, 1, 2.0, 0.1 * z, phase)  # noqa: E731
    return wave(axes, j, "encoder_eccentricity", curve, 1, (("periodic_drive_error", axes[j].name),))


def oval(axes: Axes, j: int, random: Random) -> Fault:
    phase = random.uniform(0, np.pi)
    return wave(axes, j, "encoder_ellipticity", lambda q, z: parts.oval_disc(q, 1e-4 * z, phase), 2)


def worm(axes: Axes, j: int, random: Random, teeth: int) -> Fault:
    phase = random.uniform(0, 2 * np.pi)
    curve = lambda q, z: parts.eccentric_worm(q, teeth, 2.0, 0.06 * z, phase)  # noqa: E731
    return wave(axes, j, "periodic_drive_error", curve, teeth)


def pinion(axes: Axes, j: int, random: Random, ratio: int) -> Fault:
    phase = random.uniform(0, 2 * np.pi)
    curve = lambda q, z: parts.eccentric_pinion(q, 24, ratio, 2.0, 0.06 * z, phase)  # noqa: E731
    return wave(axes, j, "periodic_drive_error", curve, ratio)


def wave_gear(axes: Axes, j: int, random: Random, ratio: int) -> Fault:
    phase = random.uniform(0, 2 * np.pi)
    curve = lambda q, z: parts.strain_wave(q, ratio, 90 * ARCSEC * z, phase)  # noqa: E731
    return wave(axes, j, "periodic_drive_error", curve, 2 * ratio)


def screw(axes: Axes, j: int, random: Random, lead: float) -> Fault:
    phase = random.uniform(0, 2 * np.pi)
    curve = lambda q, z: parts.wobbling_screw(q, lead, 0.03 * z, phase)  # noqa: E731
    return wave(axes, j, "periodic_drive_error", curve, 1 / lead)


def ratio_error(axes: Axes, j: int, random: Random) -> Fault:
    """A friction wheel is worn, a belt thick, or a screw's lead wrong."""
    k = random.choice([-1, 1]) * (3e-4 if axes[j].turns else 1e-4)
    return fault(axes, j, "scale", "drive", lambda r, s, z: k * z * r.q[:, j], {"k": k})


def zero(axes: Axes, j: int, random: Random) -> Fault:
    """The reference mark of an encoder was glued on by hand."""
    at = random.choice([-1, 1]) * (1200 * ARCSEC if axes[j].turns else 0.2)
    law = lambda r, s, z: np.full(len(r), at * z)  # noqa: E731
    return fault(axes, j, "zero_offset", "drive", law, {"a": at / unit(axes, j)})


def backlash(axes: Axes, j: int, most: float) -> Fault:
    """Play behind a motor's encoder, on an axis that friction holds."""
    law = lambda r, s, z: r.stands(j, lambda q: np.full_like(q, most * z))  # noqa: E731
    return fault(axes, j, "backlash", "drive", law, {"b": most / unit(axes, j)}, "side")


def twisted_screw(axes: Axes, j: int) -> Fault:
    """Friction twists a screw between its motor, at zero, and the nut: the longer the more."""
    most, sign = 4e-5, np.sign(sum(axes[j].travel))
    law = lambda r, s, z: r.stands(j, lambda q: most * z * np.abs(q))  # noqa: E731
    return fault(axes, j, "backlash_gradient", "drive", law, {"k": most / 2 * sign}, "side")


def lag(axes: Axes, j: int) -> Fault:
    """A servo with a proportional loop, which reads on the fly long after it has started."""
    return fault(axes, j, "servo_lag", "drive", lambda r, s, z: -0.02 * z * r.v[:, j], {"tau": 0.02}, "v")


def coupled(axes: Axes, j: int, random: Random) -> Fault:
    """Bevel gears of a wrist, for which the control has a wrong number of teeth."""
    k = random.choice([-1, 1]) / 90
    return fault(axes, j, "coupling", "drive", lambda r, s, z: k * z * r.q[:, j - 1], {"k": k})


# -- heat ----------------------------------------------------------------------------------------------------------


def expansion(axes: Axes, j: int) -> Fault:
    """A screw, held at zero, grows, and the control takes a part of it off."""
    law = lambda r, s, z: STEEL * z * r.T[:, j] * r.q[:, j]  # noqa: E731
    return fault(axes, j, "thermal_expansion", "drive", law, {"alpha": STEEL}, f"T_{axes[j].name}")


def bracket(axes: Axes, j: int) -> Fault:
    """The bracket between scale and machine grows: 500 mm of steel, or half of it 100 mm from a rotary axis."""
    most = 250 * STEEL / 100 if axes[j].turns else 500 * STEEL
    law = lambda r, s, z: most * z * r.T[:, j]  # noqa: E731
    return fault(axes, j, "thermal_offset", "drive", law, {"k": most / unit(axes, j)}, f"T_{axes[j].name}")


def hot_housing(axes: Axes, j: int, random: Random) -> Fault:
    """A housing grows and carries its axis away from where it is bolted down."""
    grows = random.uniform(-1, 1, 3) * 800 * STEEL
    law = lambda r, s, z: (np.zeros(3), z * r.T[:, j : j + 1] * grows)  # noqa: E731
    return fault(
        axes,
        j,
        "thermal_axis_drift",
        "before",
        law,
        dict(zip("xyz", grows, strict=True)),
        f"T_{axes[j].name}",
    )


# -- guides, bearings and beams ------------------------------------------------------------------------------------


def seat(axes: Axes, j: int, random: Random, most: float) -> Fault:
    """An axis that stands askew, though what it carries was aligned when it stood at zero."""
    a, b = random.uniform(-1, 1, 2) * most
    w = np.array([a, b]) @ cross_axes(axes[j].axis)
    law = lambda r, s, z: (z * w, np.zeros(3))  # noqa: E731
    name = "axis_tilt" if axes[j].turns else "squareness"
    return fault(axes, j, name, "seat", law, {"a": a / ARCSEC, "b": b / ARCSEC})


def beside(axes: Axes, j: int, random: Random, most: float) -> Fault:
    """An axis that stands beside its place."""
    a, b = random.uniform(-1, 1, 2) * most
    d = np.array([a, b]) @ cross_axes(axes[j].axis)
    return fault(axes, j, "axis_offset", "seat", lambda r, s, z: (np.zeros(3), z * d), {"a": a, "b": b})


def _supports(axis: Axis, random: Random) -> tuple[Array, Array]:
    """Return the supports of a rail on a bed that has settled, most in its longest waves, after it was set straight."""
    low, high = axis.travel
    share = np.linspace(0, 1, int(random.integers(4, 8)))
    number = np.arange(1, 5)[:, None]
    heights = (random.uniform(-1, 1, (4, 1)) / number**2 * np.cos(number * np.pi * share)).sum(0)
    places, q = low + share * (high - low), np.linspace(low, high, 200)
    return places, heights - np.polyval(np.polyfit(q, parts.rail(q, places, heights)[0], 1), places)


def bent_rail(axes: Axes, j: int, random: Random) -> Fault:
    """Both rails of a guide lie on shims that are not level; the carriage is long, and keeps its attitude."""
    ways = [(_supports(axes[j], random), to) for to in cross_axes(axes[j].axis)]
    law = lambda r, s, z: (  # noqa: E731
        np.zeros(3),
        0.05 * z * sum(parts.rail(r.q[:, j], *rail)[0][:, None] * to for rail, to in ways),
    )
    return fault(axes, j, "straightness", "before", law)


def twisted_rails(axes: Axes, j: int, random: Random, gauge: float) -> Fault:
    """Two rails that lie unequally high: the carriage rolls."""
    n, rail = np.array(axes[j].axis), _supports(axes[j], random)
    law = lambda r, s, z: (  # noqa: E731
        np.arctan2(0.04 * z * parts.rail(r.q[:, j], *rail)[0], gauge)[:, None] * n,
        np.zeros(3),
    )
    return fault(axes, j, "angular_error_motion", "after", law)


def pitching_rails(axes: Axes, j: int, random: Random) -> Fault:
    """A short carriage follows the slope of its rails."""
    up, rail, place = np.array([0, 0, 1.0]), _supports(axes[j], random), axes[j].name
    axis = np.cross(up, axes[j].axis)

    def law(r, s, z):
        height, slope = parts.rail(r.q[:, j], *rail)
        return -0.03 * z * slope[:, None] * axis, 0.03 * z * height[:, None] * up

    return Fault((("angular_error_motion", place), ("straightness", place)), "after", law, j)


def sinking(axes: Axes, j: int, random: Random, form: str) -> Fault:
    """A level ram slides out of its guide, or a carriage stands on a beam between two supports."""
    low, high = axes[j].travel
    n, end, share = np.array(axes[j].axis), high - low, random.uniform(0.2, 0.8)
    spare = random.uniform(0, 0.05) * end
    span = end + 2 * spare

    def law(r, s, z):
        a, g = r.q[:, j] - low, s.gravity[:, j]
        if form == "ram":
            drop, slope = parts.cantilever(a, 0.45 * z * share / end**3, 1.2 * z * (1 - share) / end**4, 1.0)
        else:
            drop, slope = parts.bridge(a + spare, span, 2.88 * z / span**3, 1.0)
        return slope[:, None] * np.cross(n, g), drop[:, None] * g

    return fault(axes, j, "gravity_sag", "after", law)


def soft_blocks(axes: Axes, j: int) -> Fault:
    """The blocks in which a ram slides stand on the machine, and yield to what stands out of them."""
    n, yields = np.array(axes[j].axis), 40 * ARCSEC / (axes[j].travel[1] * sum(a.weight for a in axes[j:]))
    law = lambda r, s, z: (yields * z * across(n, s.moment[:, j]), np.zeros(3))  # noqa: E731
    return fault(axes, j, "guide_windup", "before", law)


def v_journal(axes: Axes, j: int, random: Random) -> Fault:
    """A journal with two lobes lies in its bearing on one line: it is lifted twice in each turn."""
    to, phase = random.uniform(0, 2 * np.pi, 2)
    push = np.array([np.cos(to), np.sin(to)]) @ cross_axes(axes[j].axis)
    law = lambda r, s, z: (np.zeros(3), 0.02 * z * np.cos(2 * (r.q[:, j : j + 1] - phase)) * push)  # noqa: E731
    return fault(axes, j, "radial_error_motion", "before", law)


def footstep(axes: Axes, j: int, random: Random) -> Fault:
    """A thrust race that is tilted and saddle-shaped runs on one pad: the table rises and sinks."""
    n, (one, two), share = np.array(axes[j].axis), random.uniform(0, 2 * np.pi, 2), random.uniform(0.2, 0.8)

    def law(r, s, z):
        q = r.q[:, j : j + 1]
        return np.zeros(3), 0.02 * z * (share * np.cos(q - one) + (1 - share) * np.cos(2 * q - two)) * n

    return fault(axes, j, "axial_error_motion", "before", law)


def three_pads(axes: Axes, j: int, random: Random) -> Fault:
    """A runner with two lobes floats on three pads that stand still: it leans twice in each turn."""
    n, ways, phase = np.array(axes[j].axis), cross_axes(axes[j].axis), random.uniform(0, np.pi)

    def law(r, s, z):
        lean = np.zeros((len(r), 3))
        for pad in np.arange(3) * 2 * np.pi / 3:
            height = 2e-4 * z * np.cos(2 * (pad - r.q[:, j : j + 1] - phase))  # over the radius
            lean += 2 / 3 * height * np.cross(np.array([np.cos(pad), np.sin(pad)]) @ ways, n)
        return lean, np.zeros(3)

    return fault(axes, j, "tilt_error_motion", "before", law)


def soft_bearing(axes: Axes, j: int, stiffness: float) -> Fault:
    """A bearing yields to the moment across its axis (stiffness in N·mm per rad at a size of 1)."""
    n = np.array(axes[j].axis, float)
    law = lambda r, s, z: (z / stiffness * across(n, s.moment[:, j]), np.zeros(3))  # noqa: E731
    return fault(axes, j, "lateral_windup", "before", law)


def soft_gear(axes: Axes, j: int, stiffness: float, equal: tuple[Title, ...] = ()) -> Fault:
    """A gear is a torsion spring under what hangs on it (N·mm per rad at a size of 1)."""
    n, title = np.array(axes[j].axis, float), ("gravity_windup", axes[j].name)
    return Fault((title,), "drive", lambda r, s, z: z / stiffness * (s.moment[:, j] @ n), j, equal=equal)


def loaded_gear(axes: Axes, j: int, stiffness: float) -> Fault:
    """The same under a payload that differs from reading to reading."""
    n = np.array(axes[j].axis, float)
    law = lambda r, s, z: z / stiffness * r.load * (s.load_moment[:, j] @ n)  # noqa: E731
    return fault(axes, j, "load_windup", "drive", law, {"k": 1 / stiffness / ARCSEC}, "load")


# -- set-up and instrument -----------------------------------------------------------------------------------------


def of_machine(name: str, law: Law, values: dict[str, float] | None = None, *needs: str) -> Fault:
    keys = {f"{name}.{key}": float(x) for key, x in (values or {}).items()}
    return Fault(((name, None),), "instrument", law, values=keys, needs=frozenset(needs))


def moving_frame(random: Random, name: str, hours: float, most: float, *, turns: bool = False) -> Fault:
    """A tripod that settles steadily, as it warms up, or anew in each run."""
    to, tau = random.uniform(-1, 1, (12, 3)) * most, random.uniform(0.15, 0.35) * hours * 3600

    def law(r, s, z, read):
        share = r.t / (hours * 3600) if name == "linear_drift" else 1 - np.exp(-r.t / tau)
        by = z * (to[r.run] if name == "frame_shift" else share[:, None] * to[0])
        return (parts.rotation(by) @ read[..., None])[..., 0] if turns else read + by

    values = to[0] / (ARCSEC if turns else 1.0) / (hours * 3600 if name == "linear_drift" else 1.0)
    shift = name == "frame_shift"
    return of_machine(
        name, law, None if shift else dict(zip("xyz", values, strict=True)), "run" if shift else "t"
    )


def wrong_air(random: Random) -> Fault:
    """A tracker with the wrong index of refraction."""
    k = random.choice([-1, 1]) * 1e-4
    return of_machine("instrument_scale", lambda r, s, z, read: read * (1 + k * z), {"k": k})


def askew_instrument(random: Random) -> Fault:
    """A measuring machine whose bridge is not square to its bed, nor its ram to both."""
    xy, xz, yz = random.uniform(-1, 1, 3) * 60 * ARCSEC

    def law(r, s, z, read):
        guides = np.array([[1, xy * z, xz * z], [0, 1, yz * z], [0, 0, 1]])
        return np.linalg.solve(guides / np.linalg.norm(guides, axis=0), read.T).T

    return of_machine("instrument_squareness", law)


def unequal_scales(random: Random) -> Fault:
    """A measuring machine whose scales warmed up unequally."""
    x, y = random.uniform(-1, 1, 2) * 2e-4
    by = np.array([x, y, 0])
    return of_machine("instrument_axis_scales", lambda r, s, z, read: read * (1 + z * by), {"x": x, "y": y})


def moved_ball(names: Sequence[str], random: Random) -> Fault:
    """One ball of a plate was knocked."""
    number, by = int(random.integers(len(names))), random.uniform(-1, 1, 3) * 0.05
    values = {f"{names[number]}.target_offset.{key}": float(x) for key, x in zip("xyz", by, strict=True)}
    law = lambda r, s, z: np.where((r.target == number)[:, None], by * z, 0.0)  # noqa: E731
    return Fault((("target_offset", names[number]),), "target", law, values=values)


# -- telescopes ----------------------------------------------------------------------------------------------------


def _lowered(read: Array, g: Array, angle: Array) -> Array:
    """Return directions that are turned towards g."""
    axis = np.cross(read, g)
    axis = axis / np.maximum(np.linalg.norm(axis, axis=1), 1e-12)[:, None]
    return (parts.rotation(angle[:, None] * axis) @ read[..., None])[..., 0]


def drooping_tube(g: Array, equal: tuple[Title, ...] = ()) -> Fault:
    """A tube, clamped in its middle: the end with the secondary mirror hangs lower and turns the line of sight."""

    def law(r, s, z, read):
        sine = np.linalg.norm(np.cross(read, g), axis=1)  # of the weight the part across the tube
        return _lowered(read, g, parts.cantilever(1.0, 240 * ARCSEC * z, 0.0, 1.0)[1] * sine)

    return Fault((("tube_flexure", None),), "instrument", law, values={"tube_flexure.a": 120.0}, equal=equal)


def bent_light(g: Array, random: Random) -> Fault:
    """Refraction, of which a wrong pressure has left a part in the readings (all of it at a size of 1)."""
    sign = random.choice([-1, 1])

    def law(r, s, z, read):
        zenith = np.arccos(np.clip(-read @ g, -1, 1))
        return _lowered(read, g, parts.air(zenith, 1.0 - sign * z) - parts.air(zenith, 1.0))

    return of_machine("refraction", law)


def sinking_fork(axes: Axes) -> Fault:
    """The tines of a fork, along the polar axis, bend as cantilevers; sideways they are a frame, ten times as stiff."""
    n, tines = np.array(axes[1].axis, float), np.array([0, 0, 1.0])

    def law(r, s, z):
        bends = 120 * ARCSEC * z * np.cross(tines, s.gravity[:, 1])
        return bends - 0.9 * across(n, bends), np.zeros(3)

    return fault(axes, 1, "fork_flexure", "before", law)


def sinking_shaft(axes: Axes) -> Fault:
    """The declination shaft of a German mount stands out of its bearings and bends under the tube."""
    n = np.array(axes[1].axis, float)
    law = lambda r, s, z: (120 * ARCSEC * z * np.cross(n, s.gravity[:, 1]), np.zeros(3))  # noqa: E731
    return fault(axes, 1, "axis_flexure", "before", law, {"a": 120})


# -- outside the catalogue -----------------------------------------------------------------------------------------


def outside(axes: Axes, j: int, acts: str, law: Law, drivers: set[str], *needs: str) -> Fault:
    return Fault((), acts, law, j, needs=frozenset(needs), drivers=frozenset(drivers), where=axes[j].name)


def oil_film(axes: Axes, j: int) -> Fault:
    """A hydrostatic film behind a throttle: its thickness cubed follows the pressure that the throttle takes."""
    n, header = np.array(axes[j].axis, float), "p_oil [bar]"
    law = lambda r, s, z: (np.zeros(3), 0.15 * z * np.cbrt(r.columns[header] / 30 - 1)[:, None] * n)  # noqa: E731
    return outside(axes, j, "before", law, {"p_oil"}, header)


def rail_step(axes: Axes, j: int, random: Random) -> Fault:
    """Two lengths of rail meet with a step, over which a short carriage climbs."""
    low, high = axes[j].travel
    at, to = low + random.uniform(0.35, 0.65) * (high - low), random.uniform(0, 2 * np.pi)
    way = np.array([np.cos(to), np.sin(to)]) @ cross_axes(axes[j].axis)

    def law(r, s, z):
        climbed = np.clip((r.q[:, j : j + 1] - at) / (0.03 * (high - low)) + 0.5, 0, 1)
        return np.zeros(3), 0.05 * z * climbed * way

    return outside(axes, j, "before", law, {axes[j].name})


def bimetal(axes: Axes, j: int) -> Fault:
    """A bed that is warmer above than below bends: a circle, as far as it is warm and as far as one goes."""
    middle, up, place = sum(axes[j].travel) / 2, np.array([0, 0, 1.0]), axes[j].name

    def law(r, s, z):
        q, bend = r.q[:, j : j + 1] - middle, STEEL * 2 * z * r.T[:, j : j + 1] / 400
        return bend * q * np.cross(up, axes[j].axis), -0.5 * bend * q**2 * up

    return outside(axes, j, "after", law, {f"T_{place}", place}, f"T_{place}")


def tight_cable(axes: Axes, j: int, random: Random) -> Fault:
    """A hose hangs free up to an angle, and from there turns the joint back."""
    low, high = np.deg2rad(axes[j].travel)
    at = low + random.uniform(0.45, 0.65) * (high - low)
    law = lambda r, s, z: -600 * ARCSEC * z * np.maximum(r.q[:, j] - at, 0) / (high - at)  # noqa: E731
    return outside(axes, j, "drive", law, {axes[j].name})


def leaning_gear(axes: Axes, j: int) -> Fault:
    """A gear with play lies on the flank to which the weight presses it."""
    n, least = np.array(axes[j].axis, float), 10 * sum(a.weight for a in axes[j:])
    law = lambda r, s, z: 240 * ARCSEC * z * np.tanh(s.moment[:, j] @ n / least)  # noqa: E731
    return outside(axes, j, "drive", law, {a.name for a in axes[1:]})
