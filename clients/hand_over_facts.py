"""Checks the hand-over of a sheet of paper by the poses of two robots' hands and the times of their grippers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import GRIP, SHUT_RAD, Side
from robocorba.robot.kinematics.tasks import GRIP_DEPTH_M, SHEET_M
from robocorba.robot.motion.robot_state import RobotState

#: The hands of giver and taker that hold the sheet.
GIVING, TAKING = Side.RIGHT, Side.LEFT
#: Distance between the hands along the sheet [m].
HAND_DISTANCE_M = SHEET_M - 2 * GRIP_DEPTH_M
#: Tolerances of the hands' distance and height [m], and of their direction [rad].
TOLERANCE_M, TOLERANCE_RAD = 0.005, math.radians(2)
#: Minimum distance by which the hands are drawn back [m].
MIN_DRAWN_BACK_M = 0.05
#: Tolerance of a shut gripper [rad].
_SHUT_TOLERANCE_RAD = math.radians(3)


class Moment(NamedTuple):
    """The states of both robots in the building's frame, `seconds` after the start."""

    seconds: float
    giver: RobotState
    taker: RobotState


class Facts(NamedTuple):
    """Measurements of a hand-over.

    gripped_s: when the taker's gripper was shut; released_s: when the giver's was open again; infinite if never.
    Largest errors while both were shut, NaN if they never were: distance_error_m: of the distance between the hands;
    height_error_m: between the hands; angle_error_rad: between a hand and the line to the other one.
    At the end: end_distance_m: between the hands; is_taken: whether the taker's gripper was shut."""

    gripped_s: float
    released_s: float
    distance_error_m: float
    height_error_m: float
    angle_error_rad: float
    end_distance_m: float
    is_taken: bool


def facts(moments: Sequence[Moment]) -> Facts:
    """Evaluate the moments of a hand-over."""
    body = SmartPalBody()
    gripped = _first(moments, 0, lambda moment: is_shut(moment.taker, TAKING))
    giving = _first(moments, 0, lambda moment: is_shut(moment.giver, GIVING))
    let_go = _first(moments, giving, lambda moment: not is_shut(moment.giver, GIVING))
    distance_error_m = height_error_m = angle_error_rad = -math.inf if gripped < let_go else math.nan
    for moment in moments[gripped:let_go]:
        (giver, ahead), (taker, back) = _hands(body, moment)
        line = taker - giver
        distance_error_m = max(distance_error_m, abs(math.hypot(*line) - HAND_DISTANCE_M))
        height_error_m = max(height_error_m, abs(line[2]))
        angle_error_rad = max(angle_error_rad, _between(ahead, line), _between(back, -line))
    (giver, _), (taker, _) = _hands(body, moments[-1])
    times = [*(moment.seconds for moment in moments), math.inf]
    end_distance_m, is_taken = math.dist(giver, taker), is_shut(moments[-1].taker, TAKING)
    return Facts(
        times[gripped], times[let_go], distance_error_m, height_error_m, angle_error_rad, end_distance_m, is_taken
    )


def faults(found: Facts) -> list[str]:
    """The faults of a hand-over; empty if it was correct."""
    distance_mm, height_mm = 1000 * found.distance_error_m, 1000 * found.height_error_m
    angle_deg = math.degrees(found.angle_error_rad)
    checks = {
        "the taker's gripper was not shut before the giver's opened": found.gripped_s < found.released_s < math.inf,
        f"the hands were {distance_mm:.1f} mm from where the sheet's ends are": found.distance_error_m <= TOLERANCE_M,
        f"one hand was {height_mm:.1f} mm over the other": found.height_error_m <= TOLERANCE_M,
        f"the hands were {angle_deg:.1f} deg misaligned": found.angle_error_rad <= TOLERANCE_RAD,
        "the hands were not drawn back": found.end_distance_m >= HAND_DISTANCE_M + MIN_DRAWN_BACK_M,
        "the taker does not hold the sheet in the end": found.is_taken,
    }
    return [fault for fault, is_met in checks.items() if not is_met]


def is_shut(state: RobotState, side: Side) -> bool:
    """Whether the gripper of a hand is shut."""
    return bool(state.joints[GRIP[side]] > SHUT_RAD - _SHUT_TOLERANCE_RAD)


def _first(moments: Sequence[Moment], start: int, is_met: Callable[[Moment], bool]) -> int:
    return next((number for number in range(start, len(moments)) if is_met(moments[number])), len(moments))


def _hands(body: SmartPalBody, moment: Moment) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Control point (3,) [m] and direction (3,) of the giver's and of the taker's hand."""
    return _hand(body, moment.giver, GIVING), _hand(body, moment.taker, TAKING)


def _hand(body: SmartPalBody, state: RobotState, side: Side) -> tuple[Floats, Floats]:
    hand = body.hand(side, state.joints)
    at, tip = in_building(np.array([hand.position, hand.position + hand.rotation[:, 0]]), state)
    return at, tip - at


def _between(one: Floats, other: Floats) -> float:
    """The angle between two directions, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def in_building(points: Floats, state: RobotState) -> Floats:
    """Points (n, 3) [m] from a robot's frame to the building's frame."""
    c, s = math.cos(state.heading), math.sin(state.heading)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + (state.x, state.y, 0.0)
