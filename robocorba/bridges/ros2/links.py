"""The links of SmartPal as frames of ROS, and its URDF with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from robocorba.bridges.ros2.frames import BASE
from robocorba.bridges.ros2.messages import Quaternion
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.kinematics.urdf import urdf

Vector = tuple[float, float, float]


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
    for parent, child, at, axis, number in _joints():
        half_rad = float(joints[number]) / 2.0 if number >= 0 else 0.0
        x, y, z = (math.sin(half_rad) * each for each in axis)
        yield parent, child, at, (x, y, z, math.cos(half_rad))


@cache
def _joints() -> list[tuple[str, str, Vector, Vector, int]]:
    """Parent and child of each joint, its place in the frame of the parent [m], its axis, and the number of its angle
    among JOINTS; of a fixed joint (0, 0, 0) and -1."""
    return [_joint(element) for element in ElementTree.fromstring(urdf()).iter("joint")]


def _joint(element: Element) -> tuple[str, str, Vector, Vector, int]:
    name = element.get("name", "")
    return (
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
    return BASE if link == "base" else link


def _vector(text: str) -> Vector:
    x, y, z = map(float, text.split())
    return x, y, z
