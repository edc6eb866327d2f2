"""Joints for tests."""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

import mujoco
import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.link_tree import links
from robocorba.robot.kinematics.smartpal import JOINT_LOWER, JOINT_UPPER, JOINTS
from robocorba.robot.kinematics.urdf import urdf

HOME = np.zeros(len(JOINTS))
X, Y, Z = np.eye(3)


def at(**degrees: float) -> Floats:
    """Zero angles but for those named."""
    joints = HOME.copy()
    for name, angle in degrees.items():
        joints[JOINTS.index(name)] = np.radians(angle)
    return joints


def within_limits(joints: Floats) -> bool:
    return np.allclose(joints, np.clip(joints, JOINT_LOWER, JOINT_UPPER), rtol=0.0, atol=1e-9)


def anywhere(count: int, seed: int) -> Floats:
    """Random joints (count, 18) within limits."""
    return np.random.default_rng(seed).uniform(JOINT_LOWER, JOINT_UPPER, (count, len(JOINTS)))


def shift(*at: float) -> Floats:
    """A frame (4, 4) at x, y, z [m]."""
    frame = np.eye(4)
    frame[:3, 3] = at
    return frame


def turn(axis: Floats, angle: float) -> Floats:
    """A frame (4, 4) that is turned about an axis of length 1 [rad]."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    frame = np.eye(4)
    frame[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return frame


def links_by_urdf(base: tuple[float, float, float], joints: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Position [m] and attitude (quaternion w, x, y, z) of all links but the base, from the URDF on a base that stands
    at x, y [m], heading [rad]."""
    robot = ElementTree.fromstring(urdf())
    SubElement(robot, "link", name="map")
    stands = SubElement(robot, "joint", name="stands", type="fixed")
    SubElement(stands, "parent", link="map")
    SubElement(stands, "child", link="base")
    SubElement(stands, "origin", xyz=f"{base[0]} {base[1]} 0", rpy=f"0 0 {base[2]}")
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, "unicode"))
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in JOINTS]] = joints
    mujoco.mj_kinematics(model, data)
    bodies = [data.body(number) for number in range(1, model.nbody)]
    own = {link.name for link in links()}
    return {body.name: (body.xpos.copy(), body.xquat.copy()) for body in bodies if body.name in own}
