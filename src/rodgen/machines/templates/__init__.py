"""Machine files to begin with, with comments: a file of this folder for each kind, and machine tools by their code.

The code of a machine tool is that of ISO 10791: its axes in order from the workpiece w, over the bed b, to the tool t,
such as ``[w C A b X Y Z t]``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from importlib import resources

from rodgen.errors import UnexpectedError, shown, suggestion
from rodgen.machines.files.schema import decimal, toml_string
from rodgen.machines.mounts import EQUATORIAL

__all__ = ["CODES", "KINDS", "machine_template"]

KINDS = {
    "alt-azimuth": "mount of a telescope or an antenna",
    "equatorial-fork": "mount with a fork; --latitude",
    "equatorial-german": "mount with a counterweight; --latitude",
    "linear-axis": "one axis under a laser interferometer (ISO 230-2)",
    "rotary-axis": "one axis whose angle is read (ISO 230-2)",
    "3-axis": "machine tool [w X Y b Z t], or by --code",
    "table-table": "five-axis machine tool [w C A b X Y Z t], or by --code",
    "head-table": "five-axis machine tool [w C b X Y Z B t], or by --code",
    "head-head": "five-axis machine tool [w b X Y Z C A t], or by --code",
    "gantry-rotary": "gantry with a rotary axis",
    "turntable": "rotary table with balls on it",
    "positioner": "two rotary axes",
    "arm-6r": "robot with six rotary joints",
    "tricept": "three legs and a passive one in the middle",
    "3-sps-s": "platform on a ball and three legs",
    "hexapod": "platform on six legs (6-UPS)",
    "linear-delta": "printer or robot whose rods hang on three towers",
    "rotary-delta": "robot whose rods hang on three arms (Clavel)",
}
"""What there is, and what it is."""

CODES = {name: found[0] for name, words in KINDS.items() if (found := re.findall(r"\[w [^]]*\]", words))}
"""The kinds that are machine tools, with the code that each has where no other is given."""

_AXES = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}
_TURNS = {"A": "X", "B": "Y", "C": "Z"}
_TRAVEL = {"X": 300, "Y": 250, "Z": 200, "A": 110, "B": 110, "C": 180}
_PIVOT = 150
_UNITS = '''
[units]                      # of every number below that has none
length = "mm"
angle  = "deg"'''
_NOISE = "# noise = 0.002              # standard deviation of a coordinate, mm; without it, it is estimated"
_ON_THE_AXES = """\
# An axis is the direction in which a joint moves what it carries. By ISO 841 a positive command moves the tool in the
# positive direction as the workpiece sees it, so that joints of the table, which carry the workpiece, have negative
# axes. Where the control counts an axis of the table by its own turning, write that axis with the other sign.
"""


def machine_template(
    kind: str,
    *,
    code: str | None = None,
    latitude: float | None = None,
    balls: int | None = None,
    ballbar: bool = False,
) -> str:
    """Return the text of a machine file with comments.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    code : str, optional
        Of a machine tool, after ISO 10791.
    latitude : float, optional
        Of an equatorial mount, rad.
    balls : int, optional
        How many balls on a machine tool's table its spindle probes; None where the tool's place is measured.
    ballbar : bool
        Whether a ballbar measures the tool's distance from a ball on a machine tool's table.

    Raises
    ------
    UnexpectedError
        When there is no such kind, the latitude is missing, the code is none, or the table has no rotary axis.

    Examples
    --------
    >>> print(machine_template("turntable").splitlines()[2])
    name = "Turntable"
    """
    if kind not in KINDS:
        raise UnexpectedError(f"no kind {shown(kind)}", suggestion(kind, KINDS))
    if code is not None and kind not in CODES:
        raise UnexpectedError(f"a code of {kind}", "none: it is no machine tool")
    if (balls is not None or ballbar) and kind not in CODES:
        raise UnexpectedError(f"balls of {kind}", "none: it is no machine tool")
    if balls is not None and ballbar:
        raise UnexpectedError("balls and a ballbar", "one of the two")
    if kind in CODES:
        return _machine_tool(code or CODES[kind], balls, ballbar=ballbar)
    text = resources.files(__name__).joinpath(f"{kind}.toml").read_text(encoding="utf-8")
    if kind.startswith("equatorial"):
        if latitude is None or not abs(latitude) <= math.pi / 2:
            site = "no latitude" if latitude is None else f"the latitude {math.degrees(latitude):g} deg"
            raise UnexpectedError(f"{site} of an equatorial mount", "--latitude, such as 31.7deg")
        gravity = ", ".join(decimal(round(x, 9)) for x in EQUATORIAL.gravity(latitude))
        text = text.replace("{gravity}", f"[{gravity}]")
        text = text.replace("{latitude}", decimal(round(math.degrees(latitude), 6)))
    return text


def _machine_tool(code: str, balls: int | None, *, ballbar: bool) -> str:
    """Return the file of a machine tool: a chain from the workpiece to the tool, or the table under balls."""
    axes = re.findall(r"\(.*?\)|[A-Za-z]'?", code)  # what is in parentheses is a spindle
    names = [axis.removesuffix("'") for axis in axes if not axis.startswith("(")]
    letters = [name for name in names if name not in ("w", "b", "t")]
    right = names[:1] == ["w"] and names[-1:] == ["t"] and "b" in names and len(names) == len(letters) + 3
    if not right or not set(letters) <= _TRAVEL.keys() or len(set(letters)) != len(letters) or not letters:
        expected = "axes X, Y, Z, A, B, C, each once, from the workpiece w over the bed b to the tool t"
        raise UnexpectedError(f"the code {shown(code)}", f"{expected}, such as '[w C A b X Y Z t]'")
    if balls is not None:
        return "\n".join(_table_lines(names, letters, balls))
    return "\n".join(_tool_lines(names, letters, ballbar=ballbar))


def _tool_lines(names: list[str], letters: list[str], *, ballbar: bool) -> Iterator[str]:
    table = letters[: names.index("b") - 1]
    turning = [axis for axis in letters if axis in _TURNS]
    header = ",".join(f"{axis} [{'deg' if axis in _TURNS else 'mm'}]" for axis in letters)
    yield f"# A machine tool [{' '.join(names)}], in order from the workpiece w over the bed b to the tool t."
    yield from _ON_THE_AXES.splitlines()
    yield f"# A row of measurements: {header},{'d [mm]' if ballbar else 'x [mm],y [mm],z [mm]'}"
    yield f'name = "Machine tool {" ".join(names)}"'
    yield _UNITS
    for branch, carried in (("workpiece", table[::-1]), ("tool", letters[len(table) :])):
        yield ""
        yield f"[[branch]]                   # from the bed to the {branch}"
        yield f'name   = "{branch}"'
        yield f"joints = [{', '.join(map(toml_string, carried))}]"
    for axis in letters:
        yield from _joint_lines(axis, "table" if axis in table else "tool")
    yield ""
    yield "[[target]]"
    yield 'name  = "tool"'
    yield "point = [0, 0, 0]            # the tool's tip, with all joints at zero: where the table's axes meet"
    yield ""
    yield "[measured]"
    if ballbar:
        yield 'kind  = "distance"'
        yield "from  = [0, 0, 0]            # the ball on the table, with all joints at zero: the circle's centre"
    else:
        yield 'kind  = "point"'
    yield 'frame = "machine"            # free: the readings are in a frame of the instrument'
    yield 'instrument = "workpiece"     # the tool is seen; "tool": sensors in the spindle see targets on the table'
    yield _NOISE
    slides = [axis for axis in letters if axis not in _TURNS]
    estimated = [f"{axis}.{what}" for axis in turning for what in ("axis", "point")]
    estimated += [] if turning else [f"{axis}.axis" for axis in slides[1:]]
    yield from _estimate_lines(estimated)


def _table_lines(names: list[str], letters: list[str], balls: int) -> Iterator[str]:
    table = letters[: names.index("b") - 1]
    turning = [axis for axis in letters if axis in _TURNS]
    if not turning or turning != table[: len(turning)] or balls < 1:
        expected = "one or more, and all rotary axes next to the workpiece w, such as [w C A b X Y Z t]"
        raise UnexpectedError(f"balls of [{' '.join(names)}]", expected)
    turning.reverse()
    header = ",".join(f"{axis} [deg]" for axis in turning)
    yield f"# The table of a machine tool [{' '.join(names)}], with balls on it whose centres the spindle probes."
    yield "# The linear axes are the instrument: a reading is where they stand at the centre of a ball."
    yield "# By ISO 841 a positive motion is that of the tool relative to the workpiece: the table turns the other way."
    yield f"# A row of measurements: {header},target,x [mm],y [mm],z [mm]"
    yield f'name = "Table {" ".join(turning)}"'
    yield _UNITS
    for axis in turning:
        yield from _joint_lines(axis, "table", "# ")
    for k in range(balls):
        angle = 2 * math.pi * k / balls
        at = [round(150 * math.cos(angle)), round(150 * math.sin(angle)), 30 + 80 * (k % 2)]
        yield ""
        yield "[[target]]                   # with all joints at zero; roughly, as it is estimated"
        yield f'name  = "ball_{k + 1}"'
        yield f"point = {at}"
    yield ""
    yield "[measured]"
    yield 'kind  = "point"'
    yield 'frame = "machine"            # the linear axes'
    yield _NOISE
    estimated = [f"{axis}.{what}" for axis in turning for what in ("axis", "point")]
    yield from _estimate_lines(estimated)


def _estimate_lines(names: list[str]) -> Iterator[str]:
    yield ""
    yield "[estimate]"
    yield f"parameters = [{', '.join(map(toml_string, [*names, 'target']))}]"
    yield ""


def _joint_lines(axis: str, of: str, mark: str = "") -> Iterator[str]:
    turns, sign = axis in _TURNS, (-1 if of == "table" else 1)
    yield ""
    yield f"[[joint]]                    # of the {of}"
    yield f'name   = "{axis}"'
    yield f'type   = "{"revolute" if turns else "prismatic"}"'
    yield f"axis   = {[sign * x for x in _AXES[_TURNS.get(axis, axis)]]}"
    if turns:
        yield f"point  = {[0, 0, 0] if of == 'table' else [0, 0, _PIVOT]}  # on the axis, with all joints at zero"
    yield f"{mark}travel = [{-_TRAVEL[axis]}, {_TRAVEL[axis]}]  # default: that of the readings"
    yield f'# drive = "{"direct" if turns else "screw"}"'
