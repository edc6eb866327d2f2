"""SmartPal's data: its joints, their limits, its base. As published for SmartPal V, unless marked as assumed.

The model built from them is in `model.py`, the hardware adaptor in `robot/smartpal_adaptor.py`, the stand-in for the
robot in `smartpal_stand_in/`. The origin of the robot's frame is on the floor under the centre of the base, x ahead,
y to the left, z up. Both arms have the same limits: equal angles give postures that mirror each other."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M, Limits


class Side(Enum):
    """Side of an arm, a hand, a gripper."""

    LEFT = "left"
    RIGHT = "right"


#: Number of joints of an arm.
ARM_JOINTS = 7
#: Order of every array of joints (18,): the arms from shoulder to wrist, the lumbar, the grippers.
JOINTS = (
    *(f"left_{number}" for number in range(1, ARM_JOINTS + 1)),
    *(f"right_{number}" for number in range(1, ARM_JOINTS + 1)),
    "lumbar_lower",
    "lumbar_upper",
    "left_grip",
    "right_grip",
)
#: Indices in JOINTS of each arm, of the lumbar, and of each gripper.
ARM = {Side.LEFT: slice(0, 7), Side.RIGHT: slice(7, 14)}
LUMBAR = slice(14, 16)
GRIP = {Side.LEFT: 16, Side.RIGHT: 17}

_ARM_DEGREES = ((-45, 180), (-109.5, 14.5), (-120, 120), (-1.5, 129.5), (-120, 120), (-15.5, 44), (-89.5, 59))
_LUMBAR_DEGREES = ((-11.5, 0.5), (-0.5, 120.5))
_GRIP_DEGREES = (-58, 8)
_DEGREES = (*_ARM_DEGREES, *_ARM_DEGREES, *_LUMBAR_DEGREES, _GRIP_DEGREES, _GRIP_DEGREES)
#: Limits of the joints (18,) [rad].
JOINT_LOWER: Floats = np.radians([lower for lower, _ in _DEGREES])
JOINT_UPPER: Floats = np.radians([upper for _, upper in _DEGREES])
#: Angles of an open and of a closed gripper [rad]; negative angles open.
OPEN_RAD, SHUT_RAD = math.radians(-58), math.radians(8)

#: Limits of the joints' speed [rad/s] and acceleration [rad/s^2] (18,), assumed.
JOINT_SPEED: Floats = np.radians([*[90.0] * 14, *[30.0] * 2, *[120.0] * 2])
JOINT_ACCELERATION: Floats = np.radians([*[180.0] * 14, *[60.0] * 2, *[480.0] * 2])
#: Limits of their torque [Nm] (18,), assumed: they accelerate so in any posture, against 1.25 times the robot's weight.
JOINT_EFFORT: Floats = np.array([*(2 * [60.0, 60.0, 25.0, 25.0, 8.0, 8.0, 8.0]), 300.0, 300.0, 5.0, 5.0])

#: Radius of the circle around the base [m], mass [kg] and height [m].
RADIUS_M, MASS_KG, HEIGHT_M = SMARTPAL_RADIUS_M, 127.0, 1.325
#: Motion limits of the base.
BASE_LIMITS = Limits()
