"""SmartPal as an SRDF, which planners such as MoveIt read beside the URDF: groups of joints, hands, postures, and links
that touch each other in every posture."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from robocorba.robot.kinematics.model import links
from robocorba.robot.kinematics.smartpal import ARM, GRIP, JOINTS, LUMBAR, OPEN_RAD, SHUT_RAD, Side


def srdf() -> str:
    """The document; names of links and joints are those of the URDF."""
    robot = Element("robot", name="smartpal")
    grippers = {f"{side.value}_gripper": [JOINTS[GRIP[side]]] for side in Side}
    arms = {f"{side.value}_arm": [*JOINTS[ARM[side]]] for side in Side}
    for name, joints in {**arms, "lumbar": [*JOINTS[LUMBAR]], **grippers}.items():
        group = SubElement(robot, "group", name=name)
        for joint in joints:
            SubElement(group, "joint", name=joint)
    whole = SubElement(robot, "group", name="body")
    for name in (*arms, "lumbar"):
        SubElement(whole, "group", name=name)
    postures = [(name, "straight", 0.0, joints) for name, joints in arms.items()]
    for posture, angle in (("open", OPEN_RAD), ("shut", SHUT_RAD)):
        postures += [(name, posture, angle, joints) for name, joints in grippers.items()]
    for group_name, posture, angle, joints in postures:
        state = SubElement(robot, "group_state", name=posture, group=group_name)
        for joint in joints:
            SubElement(state, "joint", name=joint, value=f"{angle:.9g}")
    for arm, gripper, side in zip(arms, grippers, Side, strict=True):
        hand = {"parent_link": f"{side.value}_hand", "group": gripper, "parent_group": arm}
        SubElement(robot, "end_effector", {"name": f"{side.value}_hand", **hand})
    floor = {"type": "planar", "parent_frame": "odom", "child_link": "base"}
    SubElement(robot, "virtual_joint", {"name": "drive", **floor})
    for link in links():
        if link.parent:
            SubElement(robot, "disable_collisions", link1=link.parent, link2=link.name, reason="Adjacent")
    ElementTree.indent(robot)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(robot, "unicode") + "\n"
