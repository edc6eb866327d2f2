"""What SmartPal looks like: one list of parts by link, from which the browser and URDF draw it.

Parts are in the frames of their links (see `model.specification`); at zero angles all frames are parallel to the
robot's: x ahead, y to the left, z up. Lengths are metres. The look is after the pictures of SmartPal IV and V; it has
no part in kinematics, dynamics or collisions.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from robocorba.robot.kinematics.model import (
    BASE_BACK_M,
    BASE_FRONT_M,
    BASE_HALF_WIDTH_M,
    BASE_HEIGHT_M,
    ELBOW_OFFSET_M,
    FIXED_FINGER_M,
    FOREARM_M,
    HEIGHT_M,
    LASER_M,
    LUMBAR_LOWER_HEIGHT_M,
    LUMBAR_UPPER_HEIGHT_M,
    PROXIMITY_COUNT,
    PROXIMITY_HEIGHT_M,
    SHOULDER_M,
    UPPER_ARM_M,
)
from robocorba.robot.kinematics.smartpal import Side

Vector = tuple[float, float, float]


class Shape(Enum):
    """What `Part.size` means. Box: its sides along x, y, z. Cone, upright: radii along x and y at the bottom, those at
    the top relative to these (1: a cylinder), and height. Ellipsoid: its radii."""

    BOX = "box"
    CONE = "cone"
    ELLIPSOID = "ellipsoid"


class Part(NamedTuple):
    """A part of a link. at: its middle [m]. rpy: roll, pitch, yaw, about fixed axes in this order [rad].
    paint: its name in PAINTS; `display` changes with the robot's state."""

    link: str
    shape: Shape
    size: tuple[float, ...]
    at: Vector
    rpy: Vector = (0.0, 0.0, 0.0)
    paint: str = "white"


#: Colours, red, green, blue from 0 to 1.
PAINTS: dict[str, Vector] = {
    "white": (0.93, 0.93, 0.91),
    "grey": (0.62, 0.65, 0.68),
    "dark": (0.17, 0.18, 0.20),
    "blue": (0.16, 0.40, 0.70),
    "glass": (0.05, 0.07, 0.10),
    "display": (0.20, 0.55, 0.85),
}
_QUARTER = math.pi / 2


def parts() -> list[Part]:
    """All parts of the robot."""
    return [*_base(), *_waist(), *_trunk(), *_head(), *(part for side in Side for part in _arm(side))]


def _base() -> list[Part]:
    middle, half, wide = (BASE_BACK_M + BASE_FRONT_M) / 2, (BASE_FRONT_M - BASE_BACK_M) / 2, BASE_HALF_WIDTH_M
    found = [
        _cone("base", (half * 0.96, wide * 0.96), 1.0, 0.05, (middle, 0, 0.055), "dark"),  # the rim above the wheels
        _cone("base", (half, wide), 0.95, 0.13, (middle, 0, 0.145), "white"),  # the skirt
        _cone("base", (half * 0.95, wide * 0.95), 0.74, 0.07, (middle, 0, 0.245), "white"),
        _cone("base", (half * 0.70, wide * 0.70), 0.80, 0.03, (middle, 0, 0.295), "grey"),
        _cone("base", (0.15, 0.16), 0.86, 0.06, (0, 0, 0.335), "dark"),  # under the bellows
        _box("base", (0.10, 0.26, 0.05), (BASE_BACK_M + 0.115, 0, BASE_HEIGHT_M - 0.045), "grey"),  # the battery's lid
        _box("base", (0.02, 0.16, 0.02), (BASE_BACK_M + 0.065, 0, BASE_HEIGHT_M - 0.03), "dark"),  # and its handle
    ]
    for wheel in range(4):
        bearing = math.pi / 4 + wheel * _QUARTER
        at = (middle + 0.20 * math.cos(bearing), 0.18 * math.sin(bearing), 0.05)
        found.append(Part("base", Shape.CONE, (0.05, 0.05, 1.0, 0.05), at, (_QUARTER, 0, bearing), "glass"))
    for sensor in range(PROXIMITY_COUNT):  # their windows in the skirt
        bearing = sensor * math.tau / PROXIMITY_COUNT
        at = (middle + math.cos(bearing) * half * 0.968, math.sin(bearing) * wide * 0.968, PROXIMITY_HEIGHT_M)
        found.append(Part("base", Shape.BOX, (0.016, 0.09, 0.045), at, (0, 0, bearing), "glass"))
    return found


def _waist() -> list[Part]:
    length = LUMBAR_UPPER_HEIGHT_M - LUMBAR_LOWER_HEIGHT_M
    bellows = [
        _cone("waist", (0.105, 0.125), 1.0, 0.018, (0, 0, 0.02 + ring * (length - 0.08) / 8), "dark")
        for ring in range(9)
        if abs(LUMBAR_LOWER_HEIGHT_M + 0.02 + ring * (length - 0.08) / 8 - LASER_M[2]) >= 0.02
    ]
    laser = (LASER_M[0] - 0.03, LASER_M[1], LASER_M[2] - LUMBAR_LOWER_HEIGHT_M)
    return [
        *bellows,
        _cone("waist", (0.085, 0.105), 1.0, length, (0, 0, length / 2), "glass"),
        _box("waist", (0.10, 0.12, 0.05), (laser[0] - 0.03, 0, laser[2] - 0.045), "grey"),
        _cone("waist", (0.045, 0.045), 0.9, 0.05, laser, "glass"),
        _cone("waist", (0.047, 0.047), 0.9, 0.02, (laser[0], 0, laser[2] + 0.035), "blue"),  # the laser's cap
        *_disc("waist", (0, 0, 0), 0.14),
    ]


def _trunk() -> list[Part]:
    shoulder = SHOULDER_M[2] - LUMBAR_UPPER_HEIGHT_M
    return [
        *_disc("trunk", (0, 0, 0), 0.13),
        _cone("trunk", (0.10, 0.125), 1.25, shoulder - 0.06, (-0.02, 0, 0.03 + shoulder / 2), "white"),
        Part("trunk", Shape.ELLIPSOID, (0.125, 0.165, 0.09), (-0.025, 0, shoulder - 0.01), paint="white"),
        _box("trunk", (0.09, 0.20, 0.22), (-0.14, 0, shoulder - 0.12), "grey"),  # the computer on its back
        Part("trunk", Shape.BOX, (0.026, 0.21, 0.16), (0.104, 0, shoulder - 0.135), (0, -0.12, 0), "dark"),
        Part("trunk", Shape.BOX, (0.006, 0.18, 0.13), (0.1165, 0, shoulder - 0.1335), (0, -0.12, 0), "display"),
    ]


def _head() -> list[Part]:
    height = HEIGHT_M - SHOULDER_M[2] - 0.03
    return [
        _cone("head", (0.045, 0.045), 0.9, 0.06, (0, 0, -0.085), "dark"),
        Part("head", Shape.ELLIPSOID, (0.085, 0.092, height / 2), (0, 0, 0.09 - height / 2), paint="white"),
        Part("head", Shape.ELLIPSOID, (0.055, 0.075, 0.028), (0.042, 0, 0.01), paint="glass"),  # the visor
        *_disc("head", (0, 0, -0.005), 0.178, 0.030),
    ]


def _arm(side: Side) -> list[Part]:
    name = side.value
    left = 1.0 if side is Side.LEFT else -1.0
    upper_arm, forearm, hand, finger = (f"{name}_{link}" for link in ("upper_arm", "forearm", "hand", "finger"))
    line = -ELBOW_OFFSET_M
    return [
        Part(upper_arm, Shape.ELLIPSOID, (0.068, 0.068, 0.072), (0, 0, 0), paint="white"),
        *_disc(upper_arm, (0, left * 0.03, 0), 0.085),
        _tube(upper_arm, 0.048, 0.042, -0.05, -UPPER_ARM_M + 0.03, 0.0, "white"),
        _cone(upper_arm, (0.050, 0.050), 1.0, 0.02, (0, 0, -0.085), "dark"),
        *_disc(forearm, (0, 0, 0), 0.088),
        Part(forearm, Shape.ELLIPSOID, (0.046, 0.040, 0.050), (line / 2, 0, -0.01), paint="white"),
        _tube(forearm, 0.042, 0.034, -0.03, -FOREARM_M + 0.04, line, "white"),
        _cone(forearm, (0.043, 0.043), 1.0, 0.015, (line, 0, -0.06), "dark"),
        *_disc(hand, (0, 0, 0), 0.066),
        Part(hand, Shape.CONE, (0.036, 0.036, 1.0, 0.07), (0, 0, -0.02), (0, _QUARTER, 0), "dark"),
        _box(hand, (0.054, 0.066, 0.060), (0, 0, -0.050), "grey"),
        Part(hand, Shape.BOX, (0.012, 0.030, 0.090), FIXED_FINGER_M, paint="blue"),
        _box(hand, (0.050, 0.050, 0.012), (0, 0, -0.080), "dark"),
        Part(finger, Shape.BOX, (0.012, 0.030, 0.090), (0, 0, -0.045), paint="blue"),
        Part(finger, Shape.CONE, (0.010, 0.010, 1.0, 0.034), (0, 0, 0), (_QUARTER, 0, 0), "dark"),
    ]


def _disc(link: str, at: Vector, width_m: float, radius_m: float = 0.0) -> list[Part]:
    """A dark disc on both ends of a joint's axis, which is across; at the head where the microphones are."""
    radius = radius_m or width_m * 0.42
    ends = ((1.0, -_QUARTER), (-1.0, _QUARTER))
    return [
        Part(
            link,
            Shape.CONE,
            (radius, radius, 0.85, 0.012),
            (at[0], at[1] + end * width_m / 2, at[2]),
            (roll, 0, 0),
            "dark",
        )
        for end, roll in ends
    ]


def _tube(link: str, top_m: float, bottom_m: float, start_m: float, end_m: float, x_m: float, paint: str) -> Part:
    """A part of an arm that hangs from z = start_m to end_m at x = x_m; radii at both."""
    at = (x_m, 0.0, (start_m + end_m) / 2)
    return Part(link, Shape.CONE, (bottom_m, bottom_m, top_m / bottom_m, start_m - end_m), at, paint=paint)


def _cone(link: str, radii: tuple[float, float], top: float, height_m: float, at: Vector, paint: str) -> Part:
    return Part(link, Shape.CONE, (*radii, top, height_m), at, paint=paint)


def _box(link: str, sides: Vector, at: Vector, paint: str) -> Part:
    return Part(link, Shape.BOX, sides, at, paint=paint)
