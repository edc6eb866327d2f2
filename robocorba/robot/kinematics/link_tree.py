"""SmartPal's links, joints and looks as JSON: for viewers that move the links themselves."""

from __future__ import annotations

from typing import Any

from robocorba.robot.kinematics.appearance import PAINTS, parts
from robocorba.robot.kinematics.model import links
from robocorba.robot.kinematics.smartpal import JOINTS


def as_json() -> dict[str, Any]:
    """Links, mounts, joints, parts and paints for a viewer; lengths in m, angles in rad."""
    return {
        "links": [
            {
                "name": link.name,
                "parent": link.parent,
                "at": link.at,
                "joints": [{"number": joint.number, "axis": joint.axis, "at": joint.at} for joint in link.joints],
            }
            for link in links()
        ],
        "mounts": [
            {"name": mount.name, "link": link.name, "at": mount.at, "attitude": mount.attitude}
            for link in links()
            for mount in link.mounts
        ],
        "joints": JOINTS,
        "parts": [part._asdict() | {"shape": part.shape.value} for part in parts()],
        "paints": PAINTS,
    }
