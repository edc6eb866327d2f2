"""The links of SmartPal as frames of ROS, and its URDF with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from robocorba.bridges.ros2.frames import BASE
from robocorba.bridges.ros2.messages import Quaternion
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.kinematics.urdf import urdf

#: The root of the robot's URDF, which is its base.
_ROOT = "base"
Vector = tuple[float, float, float]


class LinkJoint(NamedTuple):
    """A joint between two links. at: in the frame of the parent [m]. axis: (0, 0, 0) of a fixed joint. number: of its
    angle among JOINTS, -1 of a fixed joint."""

    parent: str
    child: str
    at: Vector
    axis: Vector
    number: int


def description(frame_of: Callable[[str], str]) -> str:
    """The URDF. frame_of: names a link's frame."""
    root = ElementTree.fromstring(urdf())
    for link in root.iter("link"):
        link.set("name", frame_of(_frame(link.get("name", ""))))
    for joint in root.iter("joint"):
        for end in ("parent", "child"):
            element = joint.find(end)
            assert element is not None
            element.set("link", frame_of(_frame(element.get("link", ""))))
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def link_poses(joints: Floats) -> Iterator[tuple[str, str, Vector, Quaternion]]:
    """Parent, child, position [m] and attitude of each link in the frame of its parent. joints: (18,) [rad]."""
    for joint in _joints():
        half_rad = float(joints[joint.number]) / 2.0 if joint.number >= 0 else 0.0
        x, y, z = (math.sin(half_rad) * each for each in joint.axis)
        yield joint.parent, joint.child, joint.at, (x, y, z, math.cos(half_rad))


@cache
def _joints() -> list[LinkJoint]:
    return [_joint(element) for element in ElementTree.fromstring(urdf()).iter("joint")]


def _joint(element: Element) -> LinkJoint:
    name = element.get("name", "")
    return LinkJoint(
        _frame(_attribute(element, "parent", "link")),
        _frame(_attribute(element, "child", "link")),
        _vector(_attribute(element, "origin", "xyz")),
        _vector(_attribute(element, "axis", "xyz") or "0 0 0"),
        JOINTS.index(name) if name in JOINTS else -1,
    )


def _attribute(element: Element, child: str, name: str) -> str:
    found = element.find(child)
    return "" if found is None else found.get(name, "")


def _frame(link: str) -> str:
    return BASE if link == _ROOT else link


def _vector(text: str) -> Vector:
    x, y, z = map(float, text.split())
    return x, y, z
