"""Groups of simulated machines, each draw reproducible by its group and number: files, and what is true of them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import rodgen
from physics import machines, parts
from physics.chain import Array, Fault, Model, Rows, Title
from physics.faults import Random

Table = dict[str, Array]
INVISIBLE, LARGEST = 0.002, 1.0  # sizes of faults that are no faults, and that no such machine has
KNOWN = 0.1  # what an effect that the file has may leave, over the noise: the error rises by half a percent
NEEDED = 1.1  # by how much the error rises without an effect that must be named


class UnfitError(Exception):
    """A machine that cannot have what its group asks for: the next one is drawn."""


@dataclass(frozen=True)
class Group:
    """What the draws of a group have in common."""

    name: str
    effects: int = 0
    raises: tuple[float, float] = (1.0, 1.0)  # RMS over noise, of each effect alone
    outside: bool = False
    layout: str | None = None
    kind: Callable[[Random], Model] | None = None
    wanders: bool = False
    shared: bool = False
    idle: bool = False
    outliers: float = 0.0
    runs: bool = False
    few: bool = False


GROUPS = (
    Group("innocent: white noise"),
    Group("innocent: pose-shared errors", shared=True),
    Group("innocent: wandering set-up", wanders=True),
    Group("innocent: idle covariates", idle=True),
    Group("innocent: 2 % outliers", outliers=0.02),
    Group("innocent: 5 % outliers", outliers=0.05),
    Group("innocent: repeated positions", layout="repeated"),
    Group("innocent: runs with remounted targets", runs=True),
    Group("innocent: smooth robot program", layout="program", kind=machines.robot),
    Group("innocent: few poses", few=True),
    Group("innocent: serpentine scan", layout="serpentine"),
    Group("one effect: RMS x 1.05", 1, (1.05, 1.05)),
    Group("one effect: RMS x 1.2", 1, (1.2, 1.2)),
    Group("one effect: RMS x 2", 1, (2, 2)),
    Group("one effect: RMS x 5", 1, (5, 5)),
    Group("one effect, wandering: RMS x 2", 1, (2, 2), wanders=True),
    Group("one effect, 2 % outliers: RMS x 2", 1, (2, 2), outliers=0.02),
    Group("one effect, 5 % outliers: RMS x 2", 1, (2, 2), outliers=0.05),
    Group("one effect, repeated positions: RMS x 2", 1, (2, 2), layout="repeated"),
    Group("one effect, few poses: RMS x 3", 1, (3, 3), few=True),
    Group("one effect, robot program: RMS x 3", 1, (3, 3), layout="program", kind=machines.robot),
    Group("two effects", 2, (1.3, 3)),
    Group("three effects", 3, (1.3, 3)),
    Group("outside: RMS x 1.5", 1, (1.5, 1.5), outside=True),
    Group("outside: RMS x 3", 1, (3, 3), outside=True),
)


@dataclass(frozen=True)
class Draw:
    """A simulated machine: what is measured, and the truth."""

    group: str
    number: int
    machine: str  # text of the file
    data: Table
    further: Table  # other poses of the same machine
    noiseless: Table  # the data without any error of reading
    sigma: float  # of a scalar reading, with what wanders, in file units
    truth: tuple[Title, ...]
    equal: dict[Title, tuple[Title, ...]]
    values: dict[str, float]
    drivers: frozenset[str]
    where: str | None
    outside: bool
    outliers: frozenset[int]
    raises: tuple[float, ...]
    remainder: float  # error of the true effects by the catalogue's formulas, over sigma
    sizes: tuple[float, ...] = ()

    @property
    def case(self) -> str:
        return f"{self.group} {self.number}"

    def write(self, folder: Path) -> tuple[Path, Path, Path]:
        """Write machine.toml, data.csv and further.csv."""
        folder.mkdir(parents=True, exist_ok=True)
        files = tuple(folder / name for name in ("machine.toml", "data.csv", "further.csv"))
        files[0].write_text(self.machine)
        for file, table in zip(files[1:], (self.data, self.further), strict=True):
            file.write_text(as_text(table))
        return files  # type: ignore[return-value]


def as_text(table: Table) -> str:
    """Return a table as CSV."""
    lines = [",".join(table)]
    lines += [
        ",".join(str(x) for x in row)
        for row in zip(*(column.tolist() for column in table.values()), strict=True)
    ]
    return "\n".join(lines) + "\n"


# -- what is commanded ---------------------------------------------------------------------------------------------


def commands(model: Model, layout: str, n: int, random: Random) -> Array:
    """Return commands of about n poses (n, J) in file units."""
    low, high = np.array([a.travel for a in model.axes]).T
    J = len(low)
    if layout == "there and back":
        way = np.linspace(low, high, max(n // 4, 6), endpoint=not model.axes[0].turns)
        return np.concatenate([way, way[::-1]] * 2)
    if layout in ("serpentine", "strips"):
        span = (high - low) * (0.92 if model.kind != "direction" else 1.0)
        counts = np.full(J, 2 if J > 3 else max(2, round(n ** (1 / J))))
        if J == 2:
            counts = np.array([max(2, round(n**0.4)), max(4, round(n**0.6))])
        steps = [lo + 0.04 * s + s * np.linspace(0, 1, k) for lo, s, k in zip(low, span, counts, strict=True)]
        rows: list[list[float]] = [[]]
        for axis in steps:
            rows = [[*row, x] for i, row in enumerate(rows) for x in (axis if i % 2 == 0 else axis[::-1])]
        return np.array(rows)
    if layout == "program":
        t = np.linspace(0, 1, n)[:, None]
        waves = sum(
            random.uniform(0.3, 1, J)
            * np.sin(2 * np.pi * (random.uniform(0.5, 4, J) * t + random.uniform(0, 1, J)))
            for _ in range(3)
        )
        waves = waves / np.abs(waves).max(0)
        return (low + high) / 2 + 0.42 * (high - low) * waves
    count = max(8, n // int(random.integers(3, 6))) if layout == "repeated" else n
    found = low + (high - low) * random.random((30 * count, J))
    if model.allowed is not None:
        found = found[model.allowed(np.deg2rad(found))]
    found = found[:count]
    if layout == "repeated":
        found = np.concatenate([random.permutation(found) for _ in range(max(2, n // count))])
    return found


@dataclass
class Plan:
    """What of a session stays the same for further data: which columns there are, and how they come about."""

    layout: str
    poses: int
    repeats: int  # readings of a target in each pose
    needs: set[str]
    approached: bool
    hours: float
    runs: int
    remounted: bool
    idle: bool
    shown: set[str] = field(default_factory=set)


def session(model: Model, plan: Plan, random: Random) -> tuple[Rows, Table]:
    """Return the rows of a session, and their columns but for the readings."""
    q = commands(model, plan.layout, plan.poses, random)
    if plan.layout in ("serpentine", "strips") and model.allowed is not None:
        q = q[model.allowed(np.deg2rad(q))]
    unit = np.array([np.pi / 180 if a.turns else 1.0 for a in model.axes])
    q = np.round(q, 6)
    m, J = q.shape
    t = np.round(np.linspace(0, plan.hours * 3600, m), 1)
    run = np.minimum(np.arange(m) * plan.runs // m, plan.runs - 1)
    step = np.diff(q, axis=0, prepend=2 * q[:1] - q[1:2])
    side = np.sign(step)
    for k in range(1, m):
        side[k] = np.where(side[k] == 0, side[k - 1], side[k])
    for k in range(
        m - 2, -1, -1
    ):  # before its first motion a joint stands as if it came from where that goes on
        side[k] = np.where(side[k] == 0, side[k + 1], side[k])
    if plan.approached:
        side = random.choice([-1.0, 1.0], (m, J))
    v = np.round(side * random.uniform(0.005, 0.1, (m, J)) * np.ptp(q, axis=0), 4)
    power = np.repeat(random.random((m // 8 + 1, J)) < 0.6, 8, 0)[:m].astype(float)
    T = np.stack(
        [parts.warming(t, power[:, j], random.uniform(3, 12), 0.25 * plan.hours * 3600) for j in range(J)], 1
    )
    T = np.round(T + 0.3 * parts.wander(t, plan.hours * 1200, J, random), 2)
    load = random.choice([0.0, 0.5, 1.0], m) * np.round(0.15 * sum(a.weight for a in model.axes[-3:]), 0)
    columns: Table = {}
    for a, x in zip(model.axes, q.T, strict=True):
        columns[f"{a.name} [{'deg' if a.turns else 'mm'}]"] = x
    if "t" in plan.needs:
        columns["t [s]"] = t
    if "run" in plan.needs:
        columns["run"] = run + 1
    for j, a in enumerate(model.axes):
        if f"T_{a.name}" in plan.needs:
            columns[f"T_{a.name} [degC]"] = np.round(20 + T[:, j], 2)
        if "dir" in plan.needs:
            columns[f"dir_{a.name}"] = side[:, j].astype(int)
        if "v" in plan.needs:
            columns[f"v_{a.name} [{'deg' if a.turns else 'mm'}/s]"] = v[:, j]
    if "load" in plan.needs:
        columns["load [N]"] = load
    more: Table = {}
    if "p_oil [bar]" in plan.needs:
        more["p_oil [bar]"] = np.round(55 + 10 * np.clip(parts.wander(t, 600, 1, random)[:, 0], -2, 2), 2)
    if plan.idle:
        day = 2 * np.pi * t / 86400
        more["humidity [%]"] = np.round(45 + 5 * parts.wander(t, 3000, 1, random)[:, 0], 1)
        more["T_hall [degC]"] = np.round(21 + np.sin(day) + 0.2 * parts.wander(t, 1000, 1, random)[:, 0], 2)
        more["p_air [mbar]"] = np.round(1000 + 3 * parts.wander(t, 20000, 1, random)[:, 0], 1)
        more["I_pump [A]"] = np.round(random.normal(4, 0.3, m), 2)
    columns |= more
    count = len(model.targets) // (plan.runs if plan.remounted else 1)
    each = np.tile(np.arange(count), plan.repeats)
    pose = np.repeat(np.arange(m), len(each))
    target = np.tile(each, m)
    if plan.remounted:
        target = target + run[pose] * count
    rows = Rows(
        (q * unit)[pose], target, pose, t[pose], T[pose], load[pose] * ("load" in plan.needs), run[pose], side[pose],
        (v * unit)[pose] * ("v" in plan.needs), plan.approached, {header: x[pose] for header, x in more.items()},
    )  # fmt: skip
    table = {header: x[pose] for header, x in columns.items()}
    if len(model.targets) > 1:
        table["target"] = np.array([*model.targets])[target]
    return rows, table


# -- what is read --------------------------------------------------------------------------------------------------


def components(kind: str) -> tuple[str, ...]:
    return {
        "point": ("x [mm]", "y [mm]", "z [mm]"), "direction": ("ux", "uy", "uz"), "distance": ("d [mm]",),
        "angle": ("angle [deg]",), "pose": ("x [mm]", "y [mm]", "z [mm]", "rx [deg]", "ry [deg]", "rz [deg]"),
    }[kind]  # fmt: skip


def tangents(read: Array) -> Array:
    """Return two directions across each reading (n, 2, 3)."""
    other = np.where(np.abs(read[:, 2:]) < 0.9, [[0, 0, 1.0]], [[1.0, 0, 0]])
    u = np.cross(read, other)
    u = u / np.linalg.norm(u, axis=1)[:, None]
    v = np.cross(read / np.linalg.norm(read, axis=1)[:, None], u)
    return np.stack([u, v], 1)


def disturbed(model: Model, read: Array, by: Array, attitude: Array | None = None) -> Array:
    """Return readings that are off by numbers (n, k): lengths, or angles across a direction or about axes."""
    if model.kind == "direction":
        off = read + np.einsum("nk,nkj->nj", by, tangents(read))
        return off / np.linalg.norm(off, axis=1)[:, None]
    if model.kind == "pose":
        turned = parts.rotation(attitude) @ read[:, 3:].reshape(-1, 3, 3)
        return np.concatenate([read[:, :3] + by, turned.reshape(-1, 9)], 1)
    return read + by


def freedoms(model: Model) -> int:
    return {"point": 3, "direction": 2, "distance": 1, "angle": 1, "pose": 3}[model.kind]


def with_readings(model: Model, columns: Table, read: Array) -> Table:
    """Return a table with its readings as a file has them."""
    if model.kind == "pose":
        read = np.concatenate(
            [read[:, :3], np.rad2deg(parts.rotation_vector(read[:, 3:].reshape(-1, 3, 3)))], 1
        )
    if model.kind == "angle":
        read = np.rad2deg(read)
    digits = 12 if model.kind == "direction" else 9 if model.kind in ("angle", "pose") else 7
    return columns | dict(zip(components(model.kind), np.round(read, digits).T, strict=True))


def noisy(
    model: Model, rows: Rows, read: Array, group: Group, scale: dict[str, float], random: Random
) -> tuple[Array, frozenset[int]]:
    """Return readings with the errors of the group, and which rows are gross errors."""
    n, k = len(rows), freedoms(model)
    by = model.noise * random.standard_normal((n, k))
    if model.station is not None:  # a beam measures its length better than its direction
        beam = read[:, :3] / np.linalg.norm(read[:, :3], axis=1)[:, None]
        along = (by * beam).sum(1)[:, None] * beam
        ratio = scale["along"]
        by = ratio * along + np.sqrt((3 - ratio**2) / 2) * (by - along)
    attitude = None
    if model.kind == "pose":
        attitude = float(model.measured["attitude_noise"]) * random.standard_normal((n, 3))  # type: ignore[arg-type]
    if group.wanders:
        off = parts.wander(rows.t, scale["tau"], 3, random) * model.noise * scale["wander"]
        if model.kind == "direction":
            read = (parts.rotation(off) @ read[..., None])[..., 0]
        else:
            by = by + off[:, :k]
    wrong = frozenset[int]()
    if group.outliers:
        count = max(1, round(group.outliers * n))
        picked = random.choice(n, count, replace=False)
        to = random.standard_normal((count, k))
        to /= np.linalg.norm(to, axis=1)[:, None]
        by[picked] += to * model.noise * scale["rise"] * random.uniform(10, 80, (count, 1))
        wrong = frozenset(map(int, picked))
    return disturbed(model, read, by, attitude), wrong


def scatter(model: Model, rows: Rows, read: Array, size: float, random: Random) -> None:
    """Let joints stop beside their commands, each pose anew, so that readings are off by size times the noise."""
    by = random.standard_normal((rows.pose.max() + 1, len(model.axes)))[rows.pose]
    by *= [1e-6 if a.turns else 1e-6 * model.size for a in model.axes]
    stops = [Fault((), "drive", lambda rows, state, s, j=j: s * by[:, j], j) for j in range(len(model.axes))]  # type: ignore[misc]
    moved = model.read(rows, [(stop, 1.0) for stop in stops])[:, :3] - read[:, :3]
    rms = np.sqrt((moved**2).sum() / len(rows) / freedoms(model))
    factor = size * model.noise / rms
    for j in range(len(model.axes)):
        rows.q[:, j] += factor * by[:, j]


# -- files ---------------------------------------------------------------------------------------------------------


def _number(x: float) -> str:
    return repr(round(float(x), 9) + 0.0)


def _text(x: object) -> str:
    if isinstance(x, str):
        return f'"{x}"'
    if isinstance(x, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_text(part) for part in x) + "]"
    return _number(x) if isinstance(x, float) else str(x)


def machine_text(model: Model, *, stated: bool) -> str:
    """Return the machine file, which knows nothing of the faults that are hidden."""
    factor = 1.0 if model.kind in ("point", "distance", "pose") else 180 / np.pi
    lines = [f'name = "{model.name}"', "", "[units]", 'length = "mm"', 'angle = "deg"', ""]
    lines += ["[environment]", f"gravity = {_text(list(model.gravity))}", ""]
    for a in model.axes:
        lines += [
            "[[joint]]",
            f'name = "{a.name}"',
            f'type = "{a.kind}"',
            f"axis = {_text([float(x) for x in a.axis])}",
        ]
        if a.turns and model.kind not in ("direction", "angle"):
            lines.append(f"point = {_text([float(x) for x in a.point])}")
        lines.append(f"travel = {_text([float(x) for x in a.travel])}")
        lines += [*(f"{key} = {_text(x)}" for key, x in a.text.items()), ""]
    for name, p in model.targets.items():
        lines += ["[[target]]", f'name = "{name}"']
        lines += [f"point = {_text([float(x) for x in p])}", ""] if model.kind != "angle" else [""]
    measured = {"kind": model.kind, "frame": model.frame} | model.measured
    if stated:
        measured["noise"] = model.noise * factor
    if "attitude_noise" in measured:
        measured["attitude_noise"] = float(measured["attitude_noise"]) * 180 / np.pi  # type: ignore[arg-type]
    lines += ["[measured]", *(f"{key} = {_text(x)}" for key, x in measured.items()), ""]
    lines += ["[estimate]", f"parameters = {_text(model.estimate)}", ""]
    for fault, _ in model.effects:
        for name, place in fault.titles:
            lines += ["[[effect]]", f'name = "{name}"', *([f'joint = "{place}"'] if place else []), ""]
    return "\n".join(lines)


# -- a draw --------------------------------------------------------------------------------------------------------


def loaded(text: str) -> Any:
    """Return the machine of a file's text."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        file = Path(folder) / "machine.toml"
        file.write_text(text)
        return rodgen.Machine.load(file)


def misfit(machine: Any, table: Table, noise: float) -> float:
    """Return the error of a fit over the noise (mm or rad), by degrees of freedom."""
    fitted = machine.fit(table)
    readings, free = fitted.residuals.size, fitted.degrees_of_freedom
    if free < 0.3 * readings:
        raise UnfitError("too few readings for what is estimated")
    return float(fitted.rms * fitted.unit_factor / noise * np.sqrt(readings / free))


def error(fitted: Any, further: Any, draw: Draw) -> float:
    """Return the error of a fit on further readings, over the noise; of poses that of their places."""
    place, table = fitted.predict(further).place, draw.further
    if "angle [deg]" in table:
        off = np.rad2deg(np.angle(np.exp(1j * (np.deg2rad(table["angle [deg]"]) - place[:, 0]))))
        return float(np.sqrt(np.mean(off**2)) / draw.sigma)
    names = [name for name in ("ux", "uy", "uz", "x [mm]", "y [mm]", "z [mm]", "d [mm]") if name in table]
    squares = (np.stack([table[name] for name in names], 1) - place) ** 2
    if "ux" in table:
        return float(np.rad2deg(np.sqrt(squares.sum() / len(place) / 2)) / draw.sigma)
    return float(np.sqrt(squares.mean()) / draw.sigma)


def with_effects(machine: Any, titles: tuple[Title, ...]) -> Any:
    """Return a machine with effects of the catalogue."""
    for title in titles:
        machine = machine.with_effect(machine.effect(*title))
    return machine


def drawn(group: Group, number: int) -> Draw:
    """Return a draw of a group, the same for the same number."""
    random = np.random.default_rng(zlib.crc32(f"physics {group.name} {number}".encode()))
    for _ in range(200):
        try:
            return _drawn(group, number, np.random.default_rng(random.integers(2**62)))
        except UnfitError:
            continue
    raise RuntimeError(f"{group.name} {number}: no machine can have what the group asks for")


def _planned(group: Group, model: Model, chosen: list[Fault], random: Random) -> Plan:
    poses = int(random.integers(15, 41) if group.few else random.integers(50, 161))
    poses = min(poses, 400 // len(model.targets)) if not group.few else poses
    needs = {need for fault in chosen for need in fault.needs}
    backed = "side" in needs or random.random() < 0.3
    approached = backed and (model.kind == "direction" or random.random() < 0.5)
    approached = approached and group.layout != "program"
    if approached:
        needs.add("dir")
    if random.random() < 0.7 or group.wanders:
        needs.add("t")
    if random.random() < 0.3:
        needs |= {f"T_{a.name}" for a in model.axes if random.random() < 0.7}
    if (
        model.name.startswith("Robot")
        and random.random() < 0.3
        and "gravity_windup" not in str(model.effects)
    ):
        needs.add("load")
    runs = int(random.integers(3, 6)) if "run" in needs or group.runs else 1
    if runs > 1:
        needs.add("run")
    layout = group.layout or str(random.choice(model.layouts))
    if group.few and layout == "repeated":
        layout = "random"
    repeats = 2 if group.shared and len(model.targets) < 3 else 1
    hours = float(random.uniform(1, 4))
    for fault in chosen:
        if fault.titles and fault.titles[0][0] in ("linear_drift", "warm_up_drift"):
            hours = 3.0 if model.kind == "direction" else 2.0
    return Plan(layout, poses, repeats, needs, approached, hours, runs, group.runs, group.idle)


def _drawn(group: Group, number: int, random: Random) -> Draw:
    model = group.kind(random) if group.kind else machines.machine(random)
    if group.layout and group.layout not in (*model.layouts, "repeated") and not group.kind:
        raise UnfitError
    if group.layout == "repeated" and model.kind == "direction":
        raise UnfitError  # stars do not come back
    if group.runs and ("target" not in model.estimate or model.kind in ("angle", "distance", "pose")):
        raise UnfitError
    possible = [x for x in model.faults if x.outside == group.outside]
    if group.wanders:
        possible = [
            x
            for x in possible
            if not {"linear_drift", "warm_up_drift", "frame_shift"} & {t for t, _ in x.titles}
        ]
    chosen: list[Fault] = []
    left = group.effects
    for i in random.permutation(len(possible)):
        fault, names = possible[i], max(1, len(possible[i].titles))
        taken = {t for x in chosen for t in (*x.titles, *x.equal)}
        if names <= left and (group.effects > 1 or names == 1) and not taken & set(fault.titles):
            chosen.append(fault)
            left -= names
    if left:
        raise UnfitError
    plan = _planned(group, model, chosen, random)
    if group.runs:
        _remounted(model, plan.runs, random)
    if plan.layout == "program" and plan.poses < 20:
        plan.poses = 20
    seeds = random.integers(2**62, size=4)
    rows, columns = session(model, plan, np.random.default_rng(seeds[0]))
    if len(rows) < 12:
        raise UnfitError
    stated = model.kind == "pose" or random.random() < 0.6
    text = machine_text(model, stated=stated)
    machine = loaded(text)
    scale = {"along": random.uniform(0.6, 1.2), "wander": random.uniform(0.8, 1.5)}
    scale |= {"tau": plan.hours * random.uniform(300, 1200), "rise": 1.0}
    noise = np.sqrt(1 + scale["wander"] ** 2) if group.wanders else 1.0
    if misfit(machine, with_readings(model, columns, model.read(rows, [])), model.noise) > KNOWN:
        raise UnfitError("what the file knows is not all that it is")
    wanted = [float(np.exp(random.uniform(*np.log(group.raises)))) for _ in chosen]
    placed: list[tuple[Fault, float]] = []
    for fault, rise in zip(chosen, wanted, strict=True):
        placed.append((fault, _sized(model, machine, rows, columns, fault, noise * np.sqrt(rise**2 - 1))))
    clean = with_readings(model, columns, model.read(rows, placed))
    truth = tuple(title for fault, _ in placed for title in fault.titles)
    scale["rise"] = np.sqrt(1 + sum(rise**2 - 1 for rise in wanted))
    remainder = _checked(machine, model, clean, truth, noise) if truth else 0.0

    further_rows, further_columns = session(model, plan, np.random.default_rng(seeds[1]))
    calm = replace(group, outliers=0.0)
    tables = []
    wrong = frozenset[int]()
    for r, c, g, seed in ((rows, columns, group, seeds[2]), (further_rows, further_columns, calm, seeds[3])):
        errors = np.random.default_rng(seed)
        if group.shared:
            scatter(model, r, model.read(r, []), scale["wander"], errors)
        read, found = noisy(model, r, model.read(r, placed), g, scale, errors)
        wrong |= found
        tables.append(with_readings(model, c, read))
    known = {key: x * size for fault, size in placed for key, x in fault.values.items()}
    drifts = (
        () if model.station is None else ("linear_drift", "warm_up_drift")
    )  # in axes of the unknown frame
    values = {key: x for key, x in known.items() if not key.startswith(drifts)}
    factor = 1.0 if model.kind in ("point", "distance", "pose") else 180 / np.pi
    return Draw(
        group.name, number, text, tables[0], tables[1], clean, model.noise * noise * factor, truth,
        {title: fault.equal for fault, _ in placed for title in fault.titles}, values,
        frozenset().union(*(fault.drivers for fault, _ in placed)), placed[0][0].where if placed else None,
        group.outside, wrong, tuple(wanted), remainder, tuple(size for _, size in placed),
    )  # fmt: skip


def _remounted(model: Model, runs: int, random: Random) -> None:
    """Let the file have a target of its own for each run, mounted anew."""
    scale = 300 * parts.ARCSEC if model.kind == "direction" else 0.3
    names = [(f"{name}_{k + 1}", name) for k in range(runs) for name in model.targets]
    anew = {}
    for new, name in names:
        off = random.uniform(-1, 1, 3) * scale
        p = model.true_targets[name]
        anew[new] = parts.rotation(off) @ p if model.kind == "direction" else p + off
    model.targets = {new: model.targets[name] for new, name in names}
    model.true_targets = anew


def _sized(model: Model, machine: Any, rows: Rows, columns: Table, fault: Fault, wanted: float) -> float:
    """Return the size at which a fault leaves an error of so many times the noise in a fit without it."""
    size = 0.2
    for _ in range(6):
        left = misfit(machine, with_readings(model, columns, model.read(rows, [(fault, size)])), model.noise)
        if left < 1e-6:
            raise UnfitError  # these readings cannot show it
        if abs(left / wanted - 1) < 0.01:
            return size
        size = float(np.clip(size * wanted / left, 0.3 * INVISIBLE, 3 * LARGEST))
        if not INVISIBLE < size < LARGEST:
            raise UnfitError
    raise UnfitError


def _checked(machine: Any, model: Model, clean: Table, truth: tuple[Title, ...], noise: float) -> float:
    """Return what the catalogue's formulas of the true effects leave; each of several is needed beside the others."""

    def left(titles: tuple[Title, ...]) -> float:
        return misfit(with_effects(machine, titles), clean, model.noise * noise)

    rest = left(truth)
    for title in truth if len(truth) > 1 else ():
        if left(tuple(t for t in truth if t != title)) ** 2 - rest**2 < NEEDED**2 - 1:
            raise UnfitError
    return rest


def all_of(count: int, only: str = "") -> list[tuple[Group, int]]:
    """Return group and number of so many machines of each group whose name contains a text, group after group."""
    return [(group, k) for group in GROUPS if only in group.name for k in range(count)]


def named(case: str) -> tuple[Group, int]:
    """Return group and number of a case such as 'two effects 17'."""
    name, _, number = case.rpartition(" ")
    for group in GROUPS:
        if group.name == name and number.isdigit():
            return group, int(number)
    raise SystemExit(f"{case}: there is no such case; the groups are {', '.join(g.name for g in GROUPS)}")
