"""What arms do in missions: postures that have a name, and where two hands go to grip a table or hand over a sheet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from robocorba.kinematics.pose import HandPose
from robocorba.spatial.grids import Floats

#: Of one arm (7,), rad; both arms may take any of them at once. tuck keeps the arm over the base, for narrow ways.
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

#: How far the fingers reach over what they grip by its edge, m.
GRIP_DEPTH_M = 0.03
#: The long side of a sheet of paper, A4, m.
SHEET_M = 0.297


class TwoHands(NamedTuple):
    """Where both hands of a robot go, in its frame."""

    left: HandPose
    right: HandPose


class HandOver(NamedTuple):
    """Where the giver's and the taker's hand go, each in the frame of its own robot."""

    giver: HandPose
    taker: HandPose


def grip_table(height_m: float, distance_m: float, spacing_m: float) -> TwoHands:
    """Hands that grip the edge of a table in front of the robot, fingers above and below the board.

    height_m: of the board's middle over the floor. distance_m: from the base's middle to the edge. spacing_m: between
    the hands. Tables lower than 0.9 m need the lumbar's help."""
    ahead, aside = distance_m + GRIP_DEPTH_M, spacing_m / 2
    return TwoHands(HandPose(ahead, aside, height_m), HandPose(ahead, -aside, height_m))


def hand_over(between_m: float, height_m: float, aside_m: float = 0.0, sheet_m: float = SHEET_M) -> HandOver:
    """Hands that hold the two ends of one level sheet, half way between two robots that face each other.

    between_m: from one base's middle to the other's. height_m: of the sheet over the floor. aside_m: how far it lies to
    the left of the giver, which is the taker's right; sheet_m: how long it is. The taker grips before the giver lets
    go; `HandPose.moved` tells where a hand comes from and goes back to."""
    ahead = (between_m - sheet_m) / 2 + GRIP_DEPTH_M
    return HandOver(HandPose(ahead, aside_m, height_m), HandPose(ahead, -aside_m, height_m))
