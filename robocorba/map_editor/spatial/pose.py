"""Points, poses, motion and motion limits of a base: values that every package uses."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import msgspec

#: Radius of the circle around SmartPal's base [m], the default robot of path requests and map checks.
SMARTPAL_RADIUS_M = 0.40
#: Mass that one robot carries [kg]: a SmartPal grips with both hands, 2 kg each; and number of robots that carry
#: together at most.
PAYLOAD_KG, MAX_CARRIERS = 4.0, 6

#: A point of a floor: x and y [m].
XY: TypeAlias = tuple[float, float]
#: x and y [m], heading [rad].
Pose2D: TypeAlias = tuple[float, float, float]


class Pose(NamedTuple):
    """Pose on a floor: x, y [m], heading [rad] counter-clockwise from +x."""

    floor: str
    x: float
    y: float
    heading: float = 0.0


class RobotMotion(msgspec.Struct, frozen=True, gc=False):
    """Pose and velocity of a robot: velocity ahead, to the left [m/s] and turn [rad/s]; `time` is simulated [s]."""

    time: float
    pose: Pose
    velocity: tuple[float, float, float]


class Limits(NamedTuple):
    """Motion limits of a robot's base [m/s, rad/s, m/s^2, rad/s^2]; the defaults are SmartPal's, with assumed
    accelerations."""

    speed: float = 1.0
    turn_speed: float = math.radians(100)
    acceleration: float = 1.0
    turn_acceleration: float = math.radians(100)
