"""``rodgen apply``: a function of arrays on the rows of a table.

A function is a line of `_FUNCTIONS`: the arguments that are columns, and what it returns. Each is a port of `_PORTS`,
which says its columns and what they measure; all other arguments have one value, of ``--set``.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
from collections.abc import Callable, Sequence
from itertools import compress
from typing import Any

import numpy as np

from rodgen.cli._console import OK, Command, argument, flag, located, refused, repeated, show
from rodgen.cli._machine import SCHEDULER
from rodgen.cli._tables import OUTPUT, Columns, map_rows, named, table
from rodgen.data.units import conversion_factor, number_and_unit
from rodgen.document import Document, Table
from rodgen.errors import in_file, listed, shown, suggestion

_PORTS = {
    "rho": "length: rho_x rho_y rho_z",
    "rho_prime": "length: rho_prime_x rho_prime_y rho_prime_z",
    "rotated": "length: rotated_x rotated_y rotated_z",
    "angle": "angle: angle",
    "axes": "number: e1_x e1_y e1_z e2_x e2_y e2_z",
    "axis": "number: axis_x axis_y axis_z",
    "theta": "number: theta_x theta_y theta_z",
    "matrix": "number: r11 r12 r13 r21 r22 r23 r31 r32 r33",
    "quaternion": "number: q0 qx qy qz",
    "Q": "length: Qx Qy Qz",
    "pose": "angle: alpha beta; length: z",
    "rods": "length: A0 A1 A-1",
    "legs": "length: L1 L2 L3",
    "angles": "angle: alpha beta gamma",
    "angle_rates": "rate: alpha_rate beta_rate gamma_rate",
    "omega": "rate: omega_x omega_y omega_z",
    "chi": "angle: chi_x chi_y chi_z",
    "nearest": "angle: nearest_x nearest_y nearest_z",
    "signed": "angle: signed_x signed_y signed_z",
    "chi_rate": "rate: chi_x_rate chi_y_rate chi_z_rate",
    "ridges": "; ".join(f"number: {c}r_x {c}r_y {c}r_z; length: {c}r_mx {c}r_my {c}r_mz" for c in "XYZ"),
    **{c: f"number: {c.upper()}r_x {c.upper()}r_y {c.upper()}r_z" for c in "xyz"},
    "joints": "angle: q1 q2 q3 q4 q5 q6",
    "lengths": "length: l1 l2 l3 l4",
    "wrist": "length: wrist_x wrist_y wrist_z",
    "point": "length: x y z",
    "tilt_torsion": "angle: azimuth tilt torsion",
    "direction": "number: direction_x direction_y direction_z",
    "normal": "number: n_x n_y n_z",
    "other_normal": "number: m_x m_y m_z",
    "screw": "number: S_x S_y S_z; length: S0_x S0_y S0_z",
    "a_screw": "number: a_x a_y a_z; length: a0_x a0_y a0_z",
    "b_screw": "number: b_x b_y b_z; length: b0_x b0_y b0_z",
    "alpha4": "angle: alpha_1 alpha_2 alpha_3 alpha_4",
    "alpha5": "angle: alpha_1 alpha_2 alpha_3 alpha_4 alpha_5",
    "theta4": "angle: theta_1 theta_2 theta_3 theta_4",
    "theta5": "angle: theta_1 theta_2 theta_3 theta_4 theta_5",
    "near": "number: n11 n12 n13 n21 n22 n23 n31 n32 n33",
    "start": "number: s11 s12 s13 s21 s22 s23 s31 s32 s33",
    "limits": "length: least greatest",
    "q": "length: q_x q_y q_z",
    **{
        name: f"angle: {name}"
        for name in "azimuth tilt torsion misfit theta_4 theta_5 angle_tolerance".split()
    },
    **{name: f"length: {name}" for name in "R r h pitch length distance other_distance product".split()},
    **{
        name: f"number: {name}"
        for name in "length_tolerance tolerance margin side oriented ratio condition determinant length_mismatch "
        "cosine_distance A B D".split()
    },
    "one_theta": "angle: theta",
    **{name: f"count: {name}" for name in "reachable left".split()},
}
"""What the columns of each argument or result measure, and their names."""

_FORMS = {
    "axis_angle": "axis angle",
    "rodrigues_vector": "theta",
    "matrix": "matrix",
    "quaternion": "quaternion",
}

_FUNCTIONS = {
    "solve_axis": "rho rho_prime angle -> axes AxisStatus",
    "length_mismatch": "rho rho_prime -> length_mismatch",
    "axis_condition": "rho rho_prime angle -> condition",
    "rotate": "rho theta -> rotated",
    "rodrigues_vector": "axis angle -> theta RotationStatus",
    **{
        f"{target}_from_{source}": f"{_FORMS[source]} -> {_FORMS[target]} RotationStatus"
        for target in _FORMS
        for source in _FORMS
        if source != target and (target, source) != ("rodrigues_vector", "axis_angle")
    },
    "tricept.pose": "point=Q -> pose rods TriceptStatus",
    "tricept.inverse": "point=Q -> *pose *rods *TriceptStatus",
    "tricept.direct": "legs=rods -> pose TriceptStatus",
    "tricept.direct_all": "legs=rods -> *pose -",
    "tricept.point": "pose -> Q",
    "tricept.rotation": "pose -> matrix",
    "tricept.legs": "pose -> rods",
    "tricept.reachable": "point=Q -> reachable",
    "tricept.singularity": "pose -> - ratio - - condition",
    "instantaneous_euler.angles_from_matrix": "matrix -> chi AngleStatus",
    "instantaneous_euler.angles_from_quaternion": "quaternion -> chi AngleStatus",
    "instantaneous_euler.angles_from_euler": "angles -> chi AngleStatus",
    "instantaneous_euler.euler_from_matrix": "matrix -> angles MotionStatus",
    "instantaneous_euler.euler_from_quaternion": "quaternion -> angles MotionStatus",
    "instantaneous_euler.motion_from_euler": "angles angle_rates -> matrix omega",
    "instantaneous_euler.rates": "matrix omega -> chi_rate determinant MotionStatus",
    "instantaneous_euler.angular_velocity": "matrix rate=chi_rate -> omega MotionStatus",
    "instantaneous_euler.ridge_lines": "matrix point -> ridges RidgeStatus/xyz",
    "instantaneous_euler.rotations": "chi -> *quaternion - RotationsStatus cosine_distance nearest",
    "instantaneous_euler.choose": "chi x y z -> quaternion misfit left ChoiceStatus",
    "instantaneous_euler.trajectory": "quaternions=quaternion -> chi signed PathStatus/xyz - - -",
    "instantaneous_euler.arm_pose": "joints -> matrix point wrist",
    "three_sps_s.legs": "rotation=matrix -> legs",
    "three_sps_s.legs_from_quaternion": "quaternion -> legs",
    "three_sps_s.direct": "legs -> matrix DirectStatus",
    "three_sps_s.direct_all": "legs -> *matrix - DirectStatus",
    "three_sps_s.follow": "legs -> matrix DirectStatus",
    "three_sps_s.orientation_status": "rotation=matrix -> OrientationStatus determinant",
    "three_sps_s.tilt_torsion": "rotation=matrix -> tilt_torsion",
    "three_sps_s.rotation_from_tilt_torsion": "azimuth tilt torsion -> matrix",
    "screws.line_along": "point direction pitch -> screw",
    "screws.line_of_planes": "normal distance other_normal other_distance -> screw",
    "screws.reciprocal_product": "a=a_screw b=b_screw -> product",
    "screws.screw_axis": "screw -> direction point pitch ScrewStatus",
    "spatial.solve_trig": "A B D -> *one_theta TrigStatus",
    "spatial.spherical_quadrilateral": "alpha=alpha4 theta_4 -> *theta4 PolygonStatus",
    "spatial.spherical_pentagon": "alpha=alpha5 theta_4 theta_5 -> *theta5 PolygonStatus",
}
"""Arguments that are columns, ``parameter=port``, and results in their order: a port, - (not written), or a status,
``/xyz`` of several; a * before those that have an axis of solutions after that of the rows."""

_BY_ORDER = ("instantaneous_euler.trajectory", "three_sps_s.follow")
"""Functions whose results depend on the rows before."""

_UNITS = {"length": " [mm]", "angle": " [deg]", "rate": " [deg/s]"}

_TEXT = """\
Call a function of rodgen on every row of a table, CSV (gzip or not) or Parquet, and write it with the results added.
'rodgen apply FUNCTION --help' shows what one does, the columns it reads and adds, and what --set sets. Each column has
its unit in brackets, such as angle [deg]. Lengths are written in the unit of the first length column, angles in that of
the first angle column. A column with the name of a result becomes 'given NAME'.

--set gives an argument one value for all rows, with its unit: R=330mm, q=0,0,50mm or sequence=ZYZ. It also replaces
columns: angle=90deg. NAME=column reads an argument that has a default. Where a row has several solutions, each has a
row of its own, and column 'solution' says which of the function's slots it is, from 1; 0 where there is none.

  rodgen apply tricept.pose points.csv --set R=330mm --set r=140mm -o rods.csv
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command(
        "apply",
        lambda options: _run(options, parser),
        _TEXT,
        argument("FUNCTION", "such as tricept.pose", nargs="?"),
        table("TABLE", nargs="?"),
        OUTPUT,
        repeated("--set NAME=VALUE", "such as R=330mm"),
        flag("--list", "list the functions"),
        SCHEDULER,
    )
    parser.conflict_handler = "resolve"  # of the group: --help waits until all arguments are known
    about = "explain the command, or a function"
    parser.add_argument_group().add_argument(
        "-h", "--help", nargs="?", const="", metavar="FUNCTION", help=about
    )


def _run(options: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    name = options.help or options.function
    if options.list:
        show(str(Document([Table((), [(each, _summary(each)) for each in _FUNCTIONS])])))
    elif options.help is not None:
        show(_Call(name).help() if name else parser.format_help().rstrip("\n"))
    elif options.table is None:
        found = f"no {'TABLE' if name else 'FUNCTION'}"
        raise refused("rodgen apply", found, "FUNCTION and TABLE; 'rodgen apply --list' has the functions")
    else:
        call = _Call(name, options.set)
        call.check()
        with located("command line", name, f"what 'rodgen apply {name} --help' shows"):
            return map_rows(options, call.columns, call.prepare, by_order=name in _BY_ORDER)
    return OK


def _columns_of(port: str) -> Columns:
    columns: Columns = []
    for part in _PORTS[port].split(";"):
        quantity, names = part.split(":")
        columns += named(quantity.strip(), names)
    return columns


def _header(columns: Columns) -> str:
    return ",".join(name + _UNITS.get(kind, "") for name, kind in columns)


def _shaped(values: Any) -> Any:
    """Return components, (..., n), as functions take them: a number, a vector or a 3x3 matrix."""
    count = values.shape[-1]
    return (
        values[..., 0] if count == 1 else values.reshape(*values.shape[:-1], 3, 3) if count == 9 else values
    )


def _summary(name: str) -> str:
    return (inspect.getdoc(_Call(name).function) or "").partition("\n")[0]


class _Call:
    """A function of `_FUNCTIONS`, and what --set sets."""

    def __init__(self, name: str, settings: Sequence[str] = ()) -> None:
        if name not in _FUNCTIONS:
            raise refused(
                "FUNCTION", shown(name), f"{suggestion(name, _FUNCTIONS)}; see 'rodgen apply --list'"
            )
        import rodgen

        module, _, last = name.rpartition(".")
        self.subject = getattr(rodgen, module) if module else rodgen
        self.function: Callable[..., Any] = getattr(self.subject, last)
        arguments, _, results = _FUNCTIONS[name].partition(" -> ")
        self.ports = {
            key: port or key for key, _, port in (each.partition("=") for each in arguments.split())
        }
        self.results = [token for token in results.split() if token != "-"]
        self.is_written = [token != "-" for token in results.split()]
        defaults = {
            key: p.default is not p.empty for key, p in inspect.signature(self.function).parameters.items()
        }
        self.fields: list[str] = []
        if defaults.pop("geometry", None) is not None:
            fields = dataclasses.fields(self.subject.Geometry)
            self.fields = [field.name for field in fields]
            defaults |= {field.name: field.default is not dataclasses.MISSING for field in fields}
        self.known = [key for key in defaults if key in self.ports or key in _PORTS or key == "sequence"]
        self.set: dict[str, str] = {}
        for text in settings:
            key, sign, value = text.partition("=")
            if not sign or key not in self.known:
                raise refused("--set", shown(text), f"NAME=VALUE, where NAME is {listed(self.known)}")
            if key in self.set:
                raise refused("--set", f"{key} twice", "one value for an argument")
            self.set[key] = value
        self.taken = [
            key for key in self.ports if self.set.get(key, "" if defaults[key] else "column") == "column"
        ]
        self.needed = [key for key in self.known if not defaults.get(key, True) and key not in self.taken]
        self.columns = [column for key in self.taken for column in _columns_of(self.ports[key])]

    def check(self) -> None:
        """Refuse a call without a value that it needs."""
        for key in self.needed:
            if key not in self.set:
                raise refused("--set", f"no {key}", f"one, such as --set {self._example(key)}")
        if not self.columns:
            raise refused("--set", "a value for every argument", "one that is a column of the table")

    def help(self) -> str:
        """Return the docstring, the columns, and what can be set."""
        settable = [self._example(key) for key in self.known if key not in self.taken]
        solutions: Columns = [("solution", "count")] if any(token[0] == "*" for token in self.results) else []
        added = [*solutions, *(column for token in self.results for column in self._result_columns(token))]
        return (
            f"{inspect.getdoc(self.function)}\n\nColumns that are read\n  {_header(self.columns)}\n"
            f"Columns that are added\n  {_header(added)}\nWhat --set sets, such as\n  "
            + ("\n  ".join(settable) or "the columns that are read")
        )

    def _example(self, key: str) -> str:
        if key == "sequence":
            return "sequence=ZYX"
        kinds = [_UNITS.get(kind, "").strip(" []") for _, kind in _columns_of(self.ports.get(key, key))]
        return f"{key}=" + ",".join(f"{n}{kind}" for n, kind in enumerate(kinds, 1))

    def _result_columns(self, token: str) -> Columns:
        name, _, axes = token.lstrip("*").partition("/")
        if name in _PORTS:
            return _columns_of(name)
        return [
            (f"status_{axis}" if axis else "status", getattr(self.subject, name)) for axis in axes or ("",)
        ]

    def prepare(self, unit: str) -> tuple[Columns, Callable[[Any], Any]]:
        """Return the result columns, and the function from the columns read, lengths in `unit`, to an `Answer`."""
        length = unit or self._own_unit()
        fixed = {key: self._value(key, length) for key in self.set if key not in self.taken}
        if self.fields:
            fixed["geometry"] = self.subject.Geometry(**{n: fixed.pop(n) for n in self.fields if n in fixed})
        starred = [token[0] == "*" for token in self.results]
        at = np.cumsum([0, *(len(_columns_of(self.ports[key])) for key in self.taken)])

        def function(values: Any) -> Any:
            read = {key: _shaped(values[:, at[n] : at[n + 1]]) for n, key in enumerate(self.taken)}
            results = self.function(**read, **fixed)
            parts = list(compress(results if isinstance(results, tuple) else (results,), self.is_written))
            if not any(starred):
                return [column for part in parts for column in np.reshape(part, (len(values), -1)).T], None
            first = parts[starred.index(True)]
            there: Any = np.isfinite(np.reshape(first, (*first.shape[:2], -1))).any(axis=-1)
            none = ~there.any(axis=1)
            there[:, 0] |= none
            index, slot = np.nonzero(there)
            rows = [
                part[index, slot] if star else part[index] for part, star in zip(parts, starred, strict=True)
            ]
            number = np.where(none[index], 0, slot + 1)
            return [number, *(column for part in rows for column in part.reshape(len(index), -1).T)], index

        columns: Columns = [("solution", "count")] if any(starred) else []
        columns += [column for token in self.results for column in self._result_columns(token)]
        if not unit:  # of the table; what is set may have one
            columns = [
                (f"{n} [{length}]", "number") if kind == "length" else (n, kind) for n, kind in columns
            ]
        return columns, function

    def _own_unit(self) -> str:
        """Return the first unit of a length that is set."""
        kinds = {key: _columns_of(self.ports.get(key, key))[-1][1] for key in self.set if key != "sequence"}
        lengths = [number_and_unit(self.set[key].split(",")[-1]) for key in kinds if kinds[key] == "length"]
        return next((match[1] for match in lengths if match), "") or "mm"

    def _value(self, key: str, length: str) -> Any:
        """Return what is set, lengths in a unit, and angles in radians."""
        text = self.set[key]
        if key == "sequence":
            return text
        columns = _columns_of(self.ports.get(key, key))
        parts = [number_and_unit(part) for part in text.split(",")]
        numbers, last = [], ""
        for (_, kind), part in zip(reversed(columns), reversed(parts), strict=False):
            if part is None:
                break
            last = part[1] or last
            if bool(last) is (kind == "number"):
                break
            target = {"length": length, "angle": "rad", "rate": "rad/s"}.get(kind, "")
            with in_file("command line", f"--set {key}"):
                numbers.append(part[0] * (conversion_factor(last, kind, target) if target else 1.0))
        if not len(numbers) == len(columns) == len(parts):
            raise refused("--set", shown(f"{key}={text}"), f"a value such as {self._example(key)}")
        return _shaped(np.array(numbers[::-1])).tolist()
