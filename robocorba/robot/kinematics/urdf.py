"""SmartPal as a URDF: links, joints and masses of its model, and its looks from the same part list as the browser's.

URDF has one joint between two links, while some links of the model have up to three: between them are links of their
own, such as left_upper_arm_1, with the small mass that physics engines demand. URDF has no ellipsoids and cones without
mesh files, so round parts are stacks of cylinders with circular sections.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.appearance import PAINTS, Part, Shape, Vector, parts
from robocorba.robot.kinematics.model import Link, LinkJoint, Solid, links
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import JOINT_EFFORT, JOINT_SPEED

#: Mass of a link between two joints of a link of the model [kg]; taken off its mass.
_JOINT_MASS_KG = 0.01


def urdf() -> str:
    """The robot as a URDF document; angles of zero, limits and names of the joints are those of the model."""
    robot = Element("robot", name="smartpal")
    # MuJoCo's own settings: keep all links and visual shapes. Other readers skip this element.
    extension = SubElement(robot, "mujoco")
    SubElement(extension, "compiler", discardvisual="false", fusestatic="false", strippath="false")
    for name, colour in PAINTS.items():
        SubElement(SubElement(robot, "material", name=name), "color", rgba=_numbers((*colour, 1.0)))
    by_link: dict[str, list[Part]] = {}
    for part in parts():
        by_link.setdefault(part.link, []).append(part)
    for link in links():
        if link.parent:
            robot.extend(_chain(link))
        robot.append(_link(link, by_link.get(link.name, ())))
    ElementTree.indent(robot)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(robot, "unicode") + "\n"


def _chain(link: Link) -> Iterator[Element]:
    """The joints from a link's parent to the link, and the links between them."""
    if not link.joints:
        yield _fixed(f"{link.name}_mount", link.parent, link.name, link.at)
        return
    parent, origin = link.parent, np.array(link.at)
    has_offset = any(link.joints[-1].at)
    for index, joint in enumerate(link.joints):
        is_last = index == len(link.joints) - 1 and not has_offset
        child = link.name if is_last else f"{link.name}_{index + 1}"
        if not is_last:
            between = Element("link", name=child)
            between.append(_inertial(_JOINT_MASS_KG, np.zeros(3), np.eye(3) * 1e-5))  # [kg m^2]
            yield between
        yield _revolute(joint, parent, child, origin + joint.at)
        parent, origin = child, -np.array(joint.at)
    if has_offset:
        yield _fixed(f"{link.name}_mount", parent, link.name, origin)


def _fixed(name: str, parent: str, child: str, at: Iterable[float]) -> Element:
    joint = Element("joint", name=name, type="fixed")
    SubElement(joint, "origin", xyz=_numbers(at), rpy="0 0 0")
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint


def _revolute(of: LinkJoint, parent: str, child: str, at: Iterable[float]) -> Element:
    joint = _fixed(of.name, parent, child, at)
    joint.set("type", "revolute")
    SubElement(joint, "axis", xyz=_numbers(of.axis))
    effort, speed = float(JOINT_EFFORT[of.number]), float(JOINT_SPEED[of.number])
    limits = {"lower": of.lower, "upper": of.upper, "effort": effort, "velocity": speed}
    SubElement(joint, "limit", {name: _number(value) for name, value in limits.items()})
    return joint


def _link(link: Link, looks: Sequence[Part]) -> Element:
    element = Element("link", name=link.name)
    between = len(link.joints) - (not any(link.joints[-1].at)) if link.joints else 0
    mass_kg = sum(solid.mass_kg for solid in link.solids)
    middle = sum((solid.mass_kg * np.array(solid.at) for solid in link.solids), np.zeros(3)) / mass_kg
    inertia = sum((_inertia(solid, middle) for solid in link.solids), np.zeros((3, 3)))
    element.append(_inertial(mass_kg - between * _JOINT_MASS_KG, middle, inertia))
    for part in looks:
        for shape, at in _shapes(part):
            visual = _placed("visual", at, part.rpy, shape)
            SubElement(visual, "material", name=part.paint)
            element.append(visual)
    for solid in link.solids:
        element.extend(_collisions(solid))
    return element


def _inertia(solid: Solid, about: Floats) -> Floats:
    """The inertia (3, 3) of a solid about a point [kg m^2]."""
    x, y, z = np.square(solid.half) / 3
    own, radius, half = np.array([y + z, x + z, x + y]), solid.radius_m, solid.half[2]
    if radius:  # a cylinder, and a ball cut into two ends
        ball = 2 * radius / (2 * radius + 3 * half)
        across = (1 - ball) * (radius**2 / 4 + half**2 / 3) + ball * (0.4 * radius**2 + half**2 + 0.75 * half * radius)
        own = np.array([across, across, (1 - ball) * radius**2 / 2 + ball * 0.4 * radius**2])
    away = solid.at - about
    return np.asarray(solid.mass_kg * (np.diag(own + away @ away) - np.outer(away, away)))


def _inertial(mass_kg: float, at: Floats, inertia: Floats) -> Element:
    element = Element("inertial")
    SubElement(element, "origin", xyz=_numbers(at), rpy="0 0 0")
    SubElement(element, "mass", value=_number(mass_kg))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    SubElement(element, "inertia", {name: _number(inertia[place]) for name, place in entries.items()})
    return element


def _shapes(part: Part) -> Iterator[tuple[Element, Vector]]:
    """A part's shapes, each with its middle in the link's frame."""
    if part.shape is Shape.BOX:
        yield Element("box", size=_numbers(part.size)), part.at
        return
    rotation = HandPose(0, 0, 0, *part.rpy).rotation
    for low, high, radius in _slices(part):
        x, y, z = (float(value) for value in rotation @ (0, 0, (low + high) / 2) + part.at)
        yield Element("cylinder", radius=_number(radius), length=_number(high - low)), (x, y, z)


def _slices(part: Part) -> Iterator[tuple[float, float, float]]:
    """Lower and upper end and radius of the cylinders that replace a round part, along its own z [m]."""
    if part.shape is Shape.ELLIPSOID:
        x, y, half = part.size
        count, height = 7, 2 * half
    else:
        x, y, top, height = part.size
        half, count = height / 2, 1 if top == 1.0 else 4
    for index in range(count):
        middle = (index + 0.5) / count
        share = math.sqrt(1 - (2 * middle - 1) ** 2) if part.shape is Shape.ELLIPSOID else 1 + (top - 1) * middle
        yield height * index / count - half, height * (index + 1) / count - half, share * math.sqrt(x * y)


def _collisions(solid: Solid) -> Iterator[Element]:
    """A capsule is a cylinder with a sphere at each end."""
    upright, half = (0.0, 0.0, 0.0), solid.half[2]
    if not solid.radius_m:
        yield _placed("collision", solid.at, upright, Element("box", size=_numbers(2 * side for side in solid.half)))
        return
    if half:
        cylinder = Element("cylinder", radius=_number(solid.radius_m), length=_number(2 * half))
        yield _placed("collision", solid.at, upright, cylinder)
    x, y, z = solid.at
    for end in (-half, half) if half else (0.0,):
        yield _placed("collision", (x, y, z + end), upright, Element("sphere", radius=_number(solid.radius_m)))


def _placed(kind: str, at: Iterable[float], rpy: Iterable[float], shape: Element) -> Element:
    element = Element(kind)
    SubElement(element, "origin", xyz=_numbers(at), rpy=_numbers(rpy))
    SubElement(element, "geometry").append(shape)
    return element


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _number(value: float) -> str:
    """Short, and exact to 1e-12: 0.25 instead of 0.25000000000000006."""
    rounded = round(float(value), 12)
    return f"{rounded:.12g}" if rounded else "0"
