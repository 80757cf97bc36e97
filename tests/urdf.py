"""A machine file from a URDF: the chain of moving joints, axes and points at zero, as the drawing has them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


def chain_of(urdf: str | Path, tip: str) -> tuple[list[dict[str, Any]], list[float]]:
    """Return the joints from the root to a link, and where that link is at zero, mm.

    Parameters
    ----------
    urdf : path
    tip : str
        A link that joints carry.

    Returns
    -------
    joints : list of dict
        name, axis and point of each joint that turns.
    point : list of float
    """
    by_child = {}
    for joint in ElementTree.parse(urdf).getroot().iter("joint"):
        child = joint.find("child")
        if child is not None:  # a transmission has joints, too
            by_child[child.get("link")] = joint
    links, at = [], tip
    while at in by_child:
        links.append(by_child[at])
        at = by_child[at].find("parent").get("link")
    turn, place, joints = Rotation.identity(), np.zeros(3), []
    for joint in reversed(links):
        origin = joint.find("origin")
        place = place + turn.apply(_numbers(origin, "xyz"))
        turn = turn * Rotation.from_euler("xyz", _numbers(origin, "rpy"))  # about fixed axes, x first
        if joint.get("type") == "revolute":
            axis = turn.apply(_numbers(joint.find("axis"), "xyz"))
            joints.append(
                {
                    "name": joint.get("name"),
                    "axis": axis.round(9).tolist(),
                    "point": (1000 * place).round(6).tolist(),
                }
            )
    return joints, (1000 * place).round(6).tolist()


def _numbers(element: Any, name: str) -> np.ndarray:
    return np.array([float(x) for x in element.get(name).split()])
