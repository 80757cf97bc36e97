"""``rodgen mechanism mobility``: freedoms, planar drawing, equivalent spherical mechanism and group."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from rodgen.cli._console import OK, Command, conclude, refused, show, show_json
from rodgen.cli._machine import add_json
from rodgen.cli._plot import add_plot
from rodgen.cli.mechanism._mechanism import MECHANISM_TEXT, add_mechanism, chain_of
from rodgen.errors import RodgenError, listed, shown

if TYPE_CHECKING:
    from rodgen.kinematics.spatial import Mechanism

_TEXT = f"""\
Find the mobility of a mechanism, known exceptions to the mobility formula, the equivalent spherical mechanism, and its
group: the difficulty of the reverse analysis, and the greatest number of solutions.

{MECHANISM_TEXT}

--plot draws the planar representation: lines are links, letters are joints, the fixed link is hatched.
"""


def add_to(command: Command) -> None:
    """Add the command."""
    parser = command("mobility", _run, "freedoms, drawing and group of a mechanism", _TEXT)
    add_mechanism(parser)
    add_plot(parser, "the planar representation")
    parser.add_argument("--input", metavar="JOINT", help="joint to mark as the input in the drawing")
    parser.add_argument("--output", metavar="JOINT", help="joint to mark as the output")
    add_json(parser)


def _run(options: argparse.Namespace) -> int:
    chain = chain_of(options.mechanism, expand=False)
    mechanism = chain.mechanism
    _check_drawing(options, mechanism)
    data = _data(mechanism)
    if options.plot is not None:
        from rodgen.output import figures

        figures.save_figure(
            figures.planar_representation(mechanism, options.input, options.output), options.plot
        )
        conclude(f"{options.plot}: planar representation")
    if options.json:
        show_json(data)
    else:
        show(_text(mechanism, data))
    return OK


def _check_drawing(options: argparse.Namespace, mechanism: Mechanism) -> None:
    for name in ("input", "output"):
        joint = getattr(options, name)
        if joint is not None and options.plot is None:
            raise refused(f"--{name}", "no --plot", "the drawing in which it is marked")
        if joint is not None and joint not in mechanism.names:
            raise refused(f"--{name}", shown(joint), listed(mechanism.names))


def _data(mechanism: Mechanism) -> dict[str, Any]:
    from rodgen.kinematics import spatial

    found = spatial.mobility(mechanism)
    data: dict[str, Any] = {
        "name": mechanism.name,
        "joints": list(mechanism.joints),
        "closed": mechanism.closed,
        "bodies": found.bodies,
        "freedoms": list(found.freedoms),
        "mobility": found.value,
        "formula": found.formula,
        "exception": found.exception or None,
        "passive": found.passive,
        "remarks": list(found.remarks),
        "spherical": None,
        "group": None,
    }
    try:
        equivalent, group = spatial.equivalent_spherical(mechanism), spatial.group(mechanism)
    except RodgenError as error:  # where nothing turns there is no spherical mechanism
        return {**data, "remarks": [*data["remarks"], str(error).partition("; expected ")[0].rstrip(".")]}
    names = mechanism.expanded().names
    data["spherical"] = {
        "joints": [names[j] for j in equivalent.joints],
        "polygon": equivalent.polygon,
        "mobility": equivalent.mobility,
    }
    if group.number < 1:
        return data
    data["group"] = {
        "number": group.number,
        "polygon": group.polygon,
        "most_solutions": group.most_solutions,
        "method": group.method,
    }
    return data


def _text(mechanism: Mechanism, data: dict[str, Any]) -> str:
    kind = "closed loop" if data["closed"] else "open chain"
    total = " + ".join(map(str, data["freedoms"])) + (" - 6" if data["closed"] else "")
    lines = [
        f"{data['name'] or 'mechanism'}: {kind} {''.join(data['joints'])}, {data['bodies']} bodies",
        f"mobility    {data['mobility']}",
        f"formula     {total} = {data['formula']}",
    ]
    lines += [f"            {remark}" for remark in data["remarks"]]
    spherical, group = data["spherical"], data["group"]
    if spherical:
        what = "open chain" if spherical["polygon"] == "open" else spherical["polygon"]
        lines.append(
            f"spherical   {what} of {' '.join(spherical['joints'])}, mobility {spherical['mobility']}"
        )
    if group:
        most = "" if group["most_solutions"] is None else f", at most {group['most_solutions']} solutions"
        lines.append(f"group       {group['number']} ({group['polygon']}){most}")
        lines += [f"            {group['method']}"] if group["method"] else []
    return "\n".join(lines)
