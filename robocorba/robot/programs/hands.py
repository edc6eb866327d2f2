"""Target joints of the icons for hands, lumbar and grippers, for both the check and the run of a program."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from robocorba.errors.robots import InvalidProgram
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, GRIP, JOINTS, LUMBAR, Side
from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.programs.icons import Gripper, Lumbar, MhandJoints, MhandOffset, MhandPose, MhandPosture, sides

if TYPE_CHECKING:  # with kernels, which programs that are not checked do without
    from robocorba.robot.kinematics.inverse import InverseKinematics

#: The icons that move arms and lumbar, and with the grippers all that move joints.
ArmIcon = MhandJoints | MhandPose | MhandOffset | MhandPosture | Lumbar
HandIcon = ArmIcon | Gripper
#: The parameters of each icon that determine its target joints, as a finding names them.
TARGET_PARAMETERS: dict[type, str] = {
    MhandPose: "x, y, z",
    MhandOffset: "dx, dy, dz",
    MhandJoints: "joints",
    MhandPosture: "posture",
    Lumbar: "lower, upper",
}
#: Distance between the points of a straight line for which the inverse kinematics is solved [m].
LINE_STEP_M = 0.01


def joints_of(icon: HandIcon) -> list[int]:
    """Indices of the 18 joints that an icon moves."""
    if isinstance(icon, Lumbar):
        return [*range(LUMBAR.start, LUMBAR.stop)]
    if isinstance(icon, Gripper):
        return [GRIP[side] for side in sides(icon.hand)]
    return [joint for side in sides(icon.hand) for joint in range(ARM[side].start, ARM[side].stop)]


def home() -> Floats:
    """Joints (18,) of a robot that stands upright with both arms in the posture `home`."""
    joints = np.zeros(len(JOINTS))
    for side in Side:
        joints[ARM[side]] = POSTURES["home"]
    return joints


def joint_path(icon: HandIcon, joints: Floats, kinematics: InverseKinematics) -> list[Floats]:
    """The postures (18,) that an icon passes after `joints`; between two postures all joints move in proportion.

    A straight line of a hand has a posture every LINE_STEP_M, other icons have only their target. Raises Unreachable;
    InvalidProgram, without the icon's path, for an unknown posture."""
    if isinstance(icon, MhandOffset):
        return _straight_line(icon, joints, kinematics)
    if isinstance(icon, MhandPose):
        return [_hand_pose(icon, joints, kinematics)]
    goal = joints.copy()
    if isinstance(icon, Lumbar):
        goal[LUMBAR] = icon.lower, icon.upper
        return [goal]
    for side in sides(icon.hand):
        if isinstance(icon, Gripper):
            goal[GRIP[side]] = icon.angle_rad
        elif isinstance(icon, MhandJoints):
            goal[ARM[side]] = icon.joints
        elif icon.posture in POSTURES:
            goal[ARM[side]] = POSTURES[icon.posture]
        else:
            known = ", ".join(POSTURES)
            raise InvalidProgram("", "posture", f"unknown posture {icon.posture!r}; known are {known}")
    return [goal]


def _hand_pose(icon: MhandPose, joints: Floats, kinematics: InverseKinematics) -> Floats:
    pose = HandPose(icon.x, icon.y, icon.z, icon.roll or 0.0, icon.pitch or 0.0, icon.yaw or 0.0)
    targets = dict.fromkeys(sides(icon.hand), pose)
    if icon.hand == "both":
        targets[Side.RIGHT] = pose.mirrored()
    for side, target in targets.items():
        joints = kinematics.solve({side: target}, joints, with_attitude=icon.roll is not None)
    return joints


def _straight_line(icon: MhandOffset, joints: Floats, kinematics: InverseKinematics) -> list[Floats]:
    start = {side: kinematics.body.hand(side, joints) for side in sides(icon.hand)}
    steps = max(2, math.ceil(math.hypot(icon.dx, icon.dy, icon.dz) / LINE_STEP_M))
    found = []
    for share in np.linspace(0.0, 1.0, steps + 1)[1:].tolist():
        for side, at in start.items():
            target = at._replace(x=at.x + share * icon.dx, y=at.y + share * icon.dy, z=at.z + share * icon.dz)
            joints = kinematics.solve({side: target}, joints, allow_restarts=False)
        found.append(joints)
    return found
