"""Machines, drawn at random: how they are built, what their files say of them, and what may be wrong with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from physics import faults as f
from physics.chain import Array, Axis, Fault, Model
from physics.faults import Random
from physics.parts import ARCSEC, rotation

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _misplace(axes: list[Axis], names: list[str], tilt: float, offset: float, random: Random) -> None:
    """Let axes that a fit estimates stand elsewhere than in the file."""
    for a in axes:
        n = np.array(a.axis, float)
        if f"{a.name}.axis" in names:
            w = random.uniform(-1, 1, 3) * tilt
            a.seat = rotation(w - (w @ n) * n)
        if f"{a.name}.point" in names:
            a.place = np.array(a.point) + random.uniform(-1, 1, 3) * offset


def _tracker(random: Random, distance: float) -> tuple[Array, Array]:
    """Return how an instrument stands that was set up by hand."""
    to = random.uniform(0, 2 * np.pi)
    place = np.array([np.cos(to) * distance, np.sin(to) * distance, random.uniform(0, 0.5) * distance])
    return rotation(np.array([0, 0, random.uniform(-np.pi, np.pi)]) + random.uniform(-0.02, 0.02, 3)), place


def telescope(random: Random) -> Model:
    """An alt-azimuth mount, a fork on a polar axis, or a German mount."""
    form = random.choice(["altaz", "fork", "german"])
    noise = np.exp(random.uniform(np.log(0.4), np.log(6))) * ARCSEC
    if form == "altaz":
        axes = [
            Axis("AZ", "revolute", (0, 0, -1), travel=(0, 360)),
            Axis("EL", "revolute", X, travel=(0, 90)),
        ]
        gravity, boresight = (0.0, 0.0, -1.0), np.array(Y)
        axes[1].weight, axes[1].centre = 5000.0, (0, 60.0, random.uniform(-30, 30))
    else:
        axes = [
            Axis("HA", "revolute", (0, 0, -1), travel=(-110, 110)),
            Axis("DEC", "revolute", (0, -1, 0), travel=(-50, 90)),
        ]
        latitude = np.deg2rad(random.uniform(25, 60))
        gravity, boresight = (-float(np.cos(latitude)), 0.0, -float(np.sin(latitude))), np.array(X)
    g = np.array(gravity)
    drives = [random.choice(["worm", "friction", "direct"]) for _ in axes]
    wrong: list[Fault] = [f.bent_light(g, random)]
    for j, (a, drive) in enumerate(zip(axes, drives, strict=True)):
        if random.random() < 0.7:
            a.text["drive"] = str(drive)
        if drive == "direct" or random.random() < 0.5:
            if random.random() < 0.7:
                a.text["encoder"] = "axis"
            alike = (("gravity_windup", a.name),) if form == "altaz" and j == 1 else ()
            wrong += [f.disc(axes, j, random, 60.0, alike), f.oval(axes, j, random)]
        else:
            a.text["encoder"] = "motor"
            if drive == "worm":
                teeth = int(random.choice([90, 120, 180, 360]))
                a.text["period"] = 360 / teeth
                wrong += [f.worm(axes, j, random, teeth), f.backlash(axes, j, 90 * ARCSEC)]
            else:
                wrong.append(f.ratio_error(axes, j, random))
    if form == "altaz":
        alike = (("tube_flexure", None), ("encoder_eccentricity", "EL"))
        if axes[1].text.get("encoder") == "motor":
            wrong.append(f.soft_gear(axes, 1, 5000 * 60 / (120 * ARCSEC), alike))
        wrong.append(f.three_pads(axes, 0, random))
    elif form == "fork":
        wrong.append(f.sinking_fork(axes))
    else:
        wrong.append(f.sinking_shaft(axes))
    tube = f.drooping_tube(g, (("gravity_windup", "EL"),) if form == "altaz" else ())
    known: list[tuple[Fault, float]] = []
    if random.random() < 0.5:
        known.append((tube, random.uniform(0.1, 0.6)))
    else:
        wrong.append(tube)
    for name in ("linear_drift", "warm_up_drift"):
        wrong.append(f.moving_frame(random, name, 3.0, 60 * ARCSEC, turns=True))
    if axes[0].text.get("encoder") == "motor":
        wrong.append(f.tight_cable(axes, 0, random))
    estimate = [f"{a.name}.axis" for a in axes] + ["target"]
    _misplace(axes, estimate, 900 * ARCSEC, 0.0, random)
    off = rotation(random.uniform(-1, 1, 3) * 900 * ARCSEC) @ boresight
    lowest = random.uniform(15, 25)

    def above(q: Array) -> Array:
        line = (
            rotation(np.array(axes[0].axis) * q[:, :1])
            @ rotation(np.array(axes[1].axis) * q[:, 1:])
            @ boresight
        )
        altitude = np.rad2deg(np.arcsin(-line @ g))
        return (altitude > lowest) & (altitude < 87)

    return Model(
        f"Telescope ({form})", axes, {"boresight": boresight}, "direction", "machine", noise, estimate, wrong,
        gravity, effects=known, layouts=("random", "random", "strips"), allowed=above,
        true_targets={"boresight": off},
    )  # fmt: skip


def _linear_faults(axes: list[Axis], random: Random, wrong: list[Fault]) -> None:
    """Add what may be wrong with any slide."""
    for j, a in enumerate(axes):
        lead = float(random.choice([10, 16, 20, 25]))
        a.text["drive"] = "screw"
        if random.random() < 0.5:
            a.text |= {"encoder": "motor"} | ({"period": lead} if random.random() < 0.8 else {})
            wrong += [
                f.screw(axes, j, random, lead), f.backlash(axes, j, 0.05), f.twisted_screw(axes, j),
                f.ratio_error(axes, j, random), f.expansion(axes, j), f.bracket(axes, j),
            ]  # fmt: skip
        else:
            a.text |= {"encoder": "axis"}
            wrong += [f.ratio_error(axes, j, random), f.expansion(axes, j), f.bracket(axes, j)]
        if random.random() < 0.4:
            wrong.append(f.lag(axes, j))


def machine_tool(random: Random) -> Model:
    """A gantry with a spindle on its ram, or a bed, a column and a level ram; a ball or two in its spindle."""
    gantry = random.random() < 0.5
    a, b, c = random.uniform(400, 1500), random.uniform(400, 1000), random.uniform(300, 600)
    if gantry:
        axes = [
            Axis("X", "prismatic", X, travel=(0, a), weight=8000, centre=(0, 0, 0)),
            Axis("Y", "prismatic", Y, travel=(0, b), weight=2000, centre=(0, 0, 0)),
            Axis("Z", "prismatic", Z, travel=(-c, 0), weight=500, centre=(0, 0, 300)),
        ]
        targets = {"ball": np.array([0, 0, -random.uniform(50, 250)])}
    else:
        axes = [
            Axis("X", "prismatic", X, travel=(0, a), weight=9000, centre=(0, -200, 0)),
            Axis("Z", "prismatic", Z, travel=(0, c), weight=2000, centre=(0, -100, 0)),
            Axis("Y", "prismatic", Y, travel=(0, b), weight=800, centre=(0, -100, 0)),
        ]
        targets = {"ball": np.array([0, random.uniform(100, 300), 0])}
    if random.random() < 0.5:
        targets["second_ball"] = targets["ball"] + np.array(
            [random.uniform(80, 200), 0, random.uniform(40, 150)]
        )
    noise = np.exp(random.uniform(np.log(0.5), np.log(6))) * 1e-3
    wrong: list[Fault] = []
    _linear_faults(axes, random, wrong)
    wrong += [f.seat(axes, 1, random, 60 * ARCSEC), f.seat(axes, 2, random, 60 * ARCSEC)]
    wrong += [f.bent_rail(axes, j, random) for j in range(3)]
    wrong += [f.twisted_rails(axes, j, random, 500.0) for j in range(2)]
    wrong += [f.rail_step(axes, 0, random), f.rail_step(axes, 1, random), f.bimetal(axes, 0)]
    wrong.append(f.pitching_rails(axes, 0, random))
    if gantry:
        wrong.append(f.sinking(axes, 1, random, "bridge"))
    else:
        wrong += [f.sinking(axes, 2, random, "ram"), f.soft_blocks(axes, 2)]
    free = random.random() < 0.4
    names = ("linear_drift", "warm_up_drift", "frame_shift")
    wrong += [f.moving_frame(random, name, 2.0, 0.05) for name in names if not free or name != "frame_shift"]
    if free:
        wrong.append(f.wrong_air(random))
    true = {name: p + random.uniform(-0.1, 0.1, 3) for name, p in targets.items()}
    return Model(
        "Gantry" if gantry else "Boring mill", axes, targets, "point", "free" if free else "machine", noise,
        ["target"], wrong, layouts=("random", "serpentine", "serpentine", "repeated"),
        station=_tracker(random, 3000.0) if free else None, true_targets=true, size=a,
    )  # fmt: skip


def slide(random: Random) -> Model:
    """One axis under an interferometer."""
    axes = [Axis("X", "prismatic", X, travel=(0, random.uniform(400, 2000)), weight=1000)]
    wrong: list[Fault] = []
    _linear_faults(axes, random, wrong)
    if axes[0].text.get("encoder") == "axis":
        wrong.append(f.lag(axes, 0))
    return Model(
        "Slide", axes, {"mirror": np.array([0.0, 0, 0])}, "distance", "machine",
        np.exp(random.uniform(np.log(0.2), np.log(2))) * 1e-3, ["target"], wrong,
        measured={"from": [-500.0, 0.0, 0.0]}, layouts=("there and back", "random", "repeated"),
        true_targets={"mirror": np.array([random.uniform(-0.5, 0.5), 0, 0])}, size=axes[0].travel[1],
    )  # fmt: skip


def _rotary_faults(axes: list[Axis], j: int, random: Random, wrong: list[Fault]) -> None:
    """Add what may be wrong with the drive and the encoder of a rotary axis."""
    if random.random() < 0.5:
        axes[j].text["encoder"] = "axis"
        wrong += [f.disc(axes, j, random, 50.0), f.oval(axes, j, random)]
        return
    axes[j].text["encoder"] = "motor"
    drive = random.choice(["worm", "gear", "belt"])
    axes[j].text["drive"] = str(drive)
    if drive == "worm":
        teeth = int(random.choice([72, 90, 120, 180]))
        axes[j].text["period"] = 360 / teeth
        wrong += [f.worm(axes, j, random, teeth), f.backlash(axes, j, 60 * ARCSEC)]
    elif drive == "gear":
        ratio = int(random.integers(4, 9))
        wrong += [
            f.pinion(axes, j, random, ratio),
            f.backlash(axes, j, 60 * ARCSEC),
            f.wheel(axes, j, random),
        ]
    else:
        wrong.append(f.ratio_error(axes, j, random))


def trunnion(random: Random) -> Model:
    """A tilting table that carries a rotary one, seen from the spindle or by a measuring machine."""
    height = random.uniform(0, 120)
    axes = [
        Axis("A", "revolute", X, (0, 0, -height), (-110, 40), 1500, (0, 20, -height - 60)),
        Axis("C", "revolute", Z, (0, 0, 0), (0, 360), 600, (0, 0, 0)),
    ]
    names = ["ball_1", "ball_2", "ball_3"][: int(random.integers(1, 4))]
    targets = {
        name: np.array([110 * np.cos(2 * k + 1), 110 * np.sin(2 * k + 1), random.uniform(60, 220)])
        for k, name in enumerate(names)
    }
    noise = np.exp(random.uniform(np.log(0.8), np.log(5))) * 1e-3
    axes[1].centre = tuple(np.mean([*targets.values()], 0) * (0.3, 0.3, 1))
    wrong: list[Fault] = []
    for j in range(2):
        _rotary_faults(axes, j, random, wrong)
    weight = axes[1].weight * 150
    wrong += [
        f.v_journal(axes, 0, random), f.footstep(axes, 1, random), f.three_pads(axes, 1, random),
        f.v_journal(axes, 1, random), f.soft_bearing(axes, 1, weight / (30 * ARCSEC)), f.bracket(axes, 0),
        f.hot_housing(axes, 0, random), f.hot_housing(axes, 1, random), f.oil_film(axes, 1),
        f.moving_frame(random, "linear_drift", 2.0, 0.05),
        f.moving_frame(random, "warm_up_drift", 2.0, 0.05),
    ]  # fmt: skip
    if axes[0].text["encoder"] == "motor":
        wrong = [x for x in wrong if x.titles != (("backlash", "A"),)]  # weight holds it on one flank
        wrong.append(f.tight_cable(axes, 0, random))
        wrong += [
            f.soft_gear(axes, 0, 3 * weight / (90 * ARCSEC)),
            f.loaded_gear(axes, 0, 3 * weight / (90 * ARCSEC)),
        ]
    estimate = ["A.axis", "A.point", "C.axis", "C.point", "target"]
    if random.random() < 0.4:
        estimate = ["target"]
        wrong += [f.seat(axes, 0, random, 60 * ARCSEC), f.seat(axes, 1, random, 60 * ARCSEC)]
        wrong += [f.beside(axes, 0, random, 0.1), f.beside(axes, 1, random, 0.1)]
    _misplace(axes, estimate, 60 * ARCSEC, 0.1, random)
    true = {name: p + random.uniform(-0.1, 0.1, 3) for name, p in targets.items()}
    return Model(
        "Trunnion table", axes, targets, "point", "machine", noise, estimate, wrong,
        layouts=("random", "serpentine", "repeated"), true_targets=true, size=300.0,
    )  # fmt: skip


def table(random: Random) -> Model:
    """A rotary table with balls on a measuring machine, or under an autocollimator and a polygon."""
    angle = random.random() < 0.3
    axes = [Axis("C", "revolute", Z, (0, 0, 0), (0, 360), 800, (0, 0, 50))]
    wrong: list[Fault] = []
    _rotary_faults(axes, 0, random, wrong)
    if angle:
        wrong += [f.bracket(axes, 0), f.lag(axes, 0)]
        targets = {"polygon": np.zeros(3)}
        return Model(
            "Rotary table and polygon", axes, targets, "angle", "machine",
            np.exp(random.uniform(np.log(0.2), np.log(2))) * ARCSEC, ["target"], wrong,
            measured={"about": list(Z)}, layouts=("there and back", "random", "repeated"), true_targets=targets,
        )  # fmt: skip
    count = int(random.integers(3, 6))
    targets = {
        f"ball_{k + 1}": np.array(
            [r * np.cos(6.28 * k / count), r * np.sin(6.28 * k / count), random.uniform(20, 200)]
        )
        for k, r in enumerate(random.uniform(80, 250, count))
    }
    noise = np.exp(random.uniform(np.log(0.5), np.log(4))) * 1e-3
    certified = random.random() < 0.5
    wrong += [
        f.footstep(axes, 0, random), f.v_journal(axes, 0, random), f.three_pads(axes, 0, random),
        f.hot_housing(axes, 0, random), f.bracket(axes, 0), f.oil_film(axes, 0),
        f.askew_instrument(random), f.unequal_scales(random),
        f.moving_frame(random, "linear_drift", 2.0, 0.05),
        f.moving_frame(random, "warm_up_drift", 2.0, 0.05),
    ]  # fmt: skip
    estimate = ["C.axis", "C.point"] + ([] if certified else ["target"])
    _misplace(axes, estimate, 60 * ARCSEC, 0.1, random)
    if certified:
        wrong.append(f.moved_ball(list(targets), random))
        true = targets
    else:
        true = {name: p + random.uniform(-0.1, 0.1, 3) for name, p in targets.items()}
        wrong.append(f.moving_frame(random, "frame_shift", 2.0, 0.05))
    return Model(
        "Rotary table with balls", axes, targets, "point", "machine", noise, estimate, wrong,
        layouts=("there and back", "random", "repeated"), true_targets=true, size=300.0,
    )  # fmt: skip


def robot(random: Random) -> Model:
    """An arm of six or seven joints with one to three reflectors, or a body whose pose is read."""
    seven = random.random() < 0.35
    scale = random.uniform(0.6, 2.2)
    s = lambda *p: tuple(float(scale * x) for x in p)  # noqa: E731
    if seven:
        kinds = [Z, Y, Z, (0.0, -1.0, 0.0), Z, Y, Z]
        points = [
            s(0, 0, 0),
            s(0, 0, 360),
            s(0, 0, 360),
            s(0, 0, 780),
            s(0, 0, 780),
            s(0, 0, 1180),
            s(0, 0, 1180),
        ]
        centres = [
            s(0, 0, 200),
            s(0, 20, 480),
            s(0, 20, 680),
            s(0, 20, 880),
            s(0, 0, 1050),
            s(0, 10, 1180),
            s(0, 0, 1260),
        ]
        weights = [40, 40, 30, 28, 18, 18, 8]
        reach = [170, 100, 160, 110, 170, 110, 170]
        tool = np.array(s(0, 0, 1300))
    else:
        kinds = [Z, Y, Y, X, Y, X]
        points = [
            s(0, 0, 0),
            s(150, 0, 450),
            s(150, 0, 1050),
            s(400, 0, 1200),
            s(800, 0, 1200),
            s(800, 0, 1200),
        ]
        centres = [
            s(60, 0, 350),
            s(150, 60, 750),
            s(250, 0, 1150),
            s(600, 0, 1200),
            s(820, 0, 1200),
            s(900, 0, 1200),
        ]
        weights = [900, 500, 450, 250, 100, 50]
        reach = [160, 75, 80, 170, 110, 170]
        tool = np.array(s(950, 0, 1200))
    heavy = scale**2
    axes = [
        Axis(
            f"J{k + 1}",
            "revolute",
            kinds[k],
            points[k],
            (-reach[k], reach[k]),
            weights[k] * heavy,
            centres[k],
        )
        for k in range(len(kinds))
    ]
    pose = random.random() < 0.25
    count = 1 if pose else int(random.integers(1, 4))
    arms = scale * np.array([[0, 0, 60.0], [40, 90, 0], [-30, -80, 30]])
    targets = {f"reflector_{k + 1}": tool + arms[k] for k in range(count)}
    noise = np.exp(random.uniform(np.log(0.015), np.log(0.15)))
    bodies = [j for j in range(len(axes)) if abs(np.dot(axes[j].axis, Z)) < 0.5]  # weight turns these
    low = [j for j in bodies if j < 4][:2]
    moment = {j: sum(a.weight for a in axes[j:]) * 500 * scale for j in range(len(axes))}
    wrong: list[Fault] = []
    for j, a in enumerate(axes):
        if random.random() < 0.5:
            a.text["drive"], a.text["encoder"] = "harmonic", "motor"
            ratio = int(random.choice([51, 81, 101]))
            if random.random() < 0.8:
                a.text["period"] = 180 / ratio
                wrong.append(f.wave_gear(axes, j, random, ratio))
        else:
            a.text["encoder"] = "motor"
            a.text["drive"] = "gear"
            wrong.append(f.wheel(axes, j, random))
            if j in (0, 3, 5):
                wrong.append(f.backlash(axes, j, 240 * ARCSEC))
    wrong += [f.tight_cable(axes, j, random) for j in (0, len(axes) - 1)]
    wrong += [f.coupled(axes, j, random) for j in (len(axes) - 2, len(axes) - 1)]
    wrong.append(f.soft_bearing(axes, 0, moment[0] / (120 * ARCSEC)))
    known: list[tuple[Fault, float]] = []
    for j in low:
        spring = f.soft_gear(axes, j, moment[j] / (400 * ARCSEC))
        wrong.append(f.loaded_gear(axes, j, moment[j] / (800 * ARCSEC)))
        if random.random() < 0.4:
            known.append((spring, random.uniform(0.1, 0.7)))
        else:
            wrong += [spring, f.leaning_gear(axes, j)]
    joints = [f"{a.name}.{what}" for a in axes for what in ("axis", "point")]
    estimate = ["target"]
    if random.random() < 0.4:
        estimate = [*joints, "target"]
    else:
        wrong += [f.zero(axes, j, random) for j in range(1, len(axes) - 1)]
        wrong += [f.seat(axes, j, random, 300 * ARCSEC) for j in (1, 2, 4)]
        wrong += [f.beside(axes, j, random, 1.0) for j in (1, 2)]
    wrong += [
        f.moving_frame(random, name, 2.0, 0.8) for name in ("linear_drift", "warm_up_drift", "frame_shift")
    ]
    wrong.append(f.wrong_air(random))
    _misplace(axes, estimate, 300 * ARCSEC, 0.5, random)
    true = {name: p + random.uniform(-1, 1, 3) for name, p in targets.items()}
    measured: dict[str, object] = {}
    if pose:
        measured["attitude_noise"] = noise / (scale * 150)
    return Model(
        f"Robot with {len(axes)} joints", axes, targets, "pose" if pose else "point", "free", noise, estimate, wrong,
        measured=measured, effects=known, layouts=("random", "random", "program"),
        station=_tracker(random, 2500.0 * scale), true_targets=true, size=1000 * scale,
    )  # fmt: skip


KINDS: tuple[tuple[Callable[[Random], Model], float], ...] = (
    (telescope, 3), (machine_tool, 3), (slide, 1), (trunnion, 2), (table, 2), (robot, 3)
)  # fmt: skip


def machine(random: Random) -> Model:
    """Draw a machine."""
    shares = np.array([share for _, share in KINDS])
    return KINDS[int(random.choice(len(KINDS), p=shares / shares.sum()))][0](random)
