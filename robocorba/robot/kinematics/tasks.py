"""Arms in missions: named postures, and poses of two hands that grip a table or hand over a sheet."""

from __future__ import annotations

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import Side

#: Joints of one arm (7,) [rad]. Both arms can take the same posture simultaneously. `tuck` keeps the arms above
#: the base, for narrow passages.
POSTURES: dict[str, Floats] = {
    name: np.radians(degrees)
    for name, degrees in {
        "home": (0, 0, 0, 0, 0, 0, 0),
        "ready": (5, 0, 0, 80, 0, 5, 0),
        "reach": (70, 0, 0, 15, 0, 5, 0),
        "carry": (-25, 0, 0, 110, 0, 5, 0),
        "tuck": (-44, 0, 0, 128, 0, 40, 0),
    }.items()
}

#: Distance by which the fingers extend over a gripped edge [m].
GRIP_DEPTH_M = 0.03
#: Long side of an A4 sheet of paper [m].
SHEET_M = 0.297


def grip_table(height_m: float, distance_m: float, spacing_m: float) -> dict[Side, HandPose]:
    """Target poses of both hands on the edge of a table in front of the robot, fingers above and below the board.

    height_m: height of the board's middle above the floor. distance_m: from the base's centre to the edge.
    spacing_m: between the hands. Tables lower than 0.9 m need the lumbar."""
    ahead, aside = distance_m + GRIP_DEPTH_M, spacing_m / 2
    return {Side.LEFT: HandPose(ahead, aside, height_m), Side.RIGHT: HandPose(ahead, -aside, height_m)}


def hand_over(between_m: float, height_m: float, aside_m: float = 0.0) -> tuple[HandPose, HandPose]:
    """Target poses of the giver's and the taker's hand, each in the frame of its own robot, at the two ends of a level
    sheet, half way between the robots, which face each other.

    between_m: distance between the centres of the bases. height_m: height of the sheet above the floor. aside_m:
    offset to the left of the giver, which is the taker's right. The taker grips before the giver lets go;
    `HandPose.moved` gives the poses before and after."""
    ahead = (between_m - SHEET_M) / 2 + GRIP_DEPTH_M
    return HandPose(ahead, aside_m, height_m), HandPose(ahead, -aside_m, height_m)
