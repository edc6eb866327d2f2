"""SmartPal V: its links, joints, solids and mounts, for kinematics, collisions and dynamics.

The model's frame is the robot's: origin on the floor under the centre of the base, x ahead, y to the left, z up. At
zero angles the robot stands upright with both arms hanging, palms inwards. The arms mirror each other, so that equal
angles give mirror images:

    joint            axis, arm hanging     a positive angle
    1 roll           across the body       lifts the arm ahead
    2 bend           along the body        brings the arm towards the body (a negative one lifts it sideways)
    3 roll           along the upper arm   turns the bent forearm inwards
    4 bend           across                bends the elbow
    5 roll           along the forearm     turns the hand inwards
    6 bend           across                lifts the hand
    7 bend           along                 turns the hand outwards
    lumbar           across, both          leans ahead
    grip             across                closes

Shoulders, lengths of the arms, footprint, height, total mass and joint ranges are published. Assumed are: the
distribution of the mass, the shapes of the links, friction, the positions of the lumbar joints and that both bend
about the same axis, the signs of angles, that the elbow's axis is behind the lines of both upper arm and forearm, that
one finger moves and the other is fixed, and the positions of laser and proximity sensors.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

from robocorba.robot.kinematics.smartpal import HEIGHT_M, JOINT_LOWER, JOINT_UPPER, JOINTS, Side

#: Position of the left shoulder, and distances from there to elbow, wrist, end of the arm and control point [m].
SHOULDER_M = (-0.025, 0.200, 1.1265)
UPPER_ARM_M, FOREARM_M, WRIST_M, HAND_M = 0.250, 0.280, 0.056, 0.110
ELBOW_OFFSET_M = -0.02
#: Footprint of the base: its back and front edge (x), and half its width [m].
BASE_BACK_M, BASE_FRONT_M, BASE_HALF_WIDTH_M = -0.376, 0.237, 0.2775
#: Assumed heights of the lumbar joints, of the base and of the proximity sensors [m].
LUMBAR_LOWER_HEIGHT_M, LUMBAR_UPPER_HEIGHT_M, BASE_HEIGHT_M, PROXIMITY_HEIGHT_M = 0.38, 0.75, 0.30, 0.15
#: Assumed position of the laser at the waist [m].
LASER_M = (0.13, 0.0, 0.60)
#: Number of proximity sensors around the base.
PROXIMITY_COUNT = 8

#: Axis of the joints that bend across the body.
ACROSS = (0.0, 1.0, 0.0)
#: Dimensions of a finger, and half the gap between parallel fingers [m]: closed fingers meet at their tips.
_FINGER_LENGTH_M, _FINGER_M = 0.090, 0.006
_GAP_M = _FINGER_LENGTH_M * math.tan(JOINT_UPPER[-1]) / 2
#: Middle of the fixed finger in the hand's frame [m].
FIXED_FINGER_M = (-_GAP_M - _FINGER_M, 0.0, -WRIST_M - HAND_M - 0.006 + _FINGER_LENGTH_M / 2)

Vector = tuple[float, float, float]
#: Red, green, blue and opacity from 0 to 1.
Colour = tuple[float, float, float, float]
_WHITE, _DARK, _BLUE = (0.92, 0.92, 0.90, 1.0), (0.25, 0.27, 0.30, 1.0), (0.20, 0.45, 0.75, 1.0)


class LinkJoint(NamedTuple):
    """A revolute joint. number: its index in `smartpal.JOINTS`. axis: unit vector. at: a point of the axis [m].
    lower, upper: limits [rad]. All in the link's frame."""

    number: int
    name: str
    axis: Vector
    at: Vector
    lower: float
    upper: float


class Solid(NamedTuple):
    """What is within `radius_m` of a box along the link's axes: a box with radius 0, a capsule along z if only `half`'s
    z is not 0, a sphere if all are. at: its middle, half: half its sides [m]."""

    at: Vector
    half: Vector
    radius_m: float
    mass_kg: float
    colour: Colour


class Mount(NamedTuple):
    """A place on a link with axes of its own; x out of hand or sensor. at: [m]. attitude: quaternion w, x, y, z. Both
    in the link's frame."""

    name: str
    at: Vector
    attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class Link(NamedTuple):
    """A link. parent: empty for the base. at: origin of its frame in its parent's at zero angles [m]; frames are
    parallel then. joints: between parent and link, that of the parent's side first."""

    name: str
    parent: str
    at: Vector
    joints: tuple[LinkJoint, ...]
    solids: tuple[Solid, ...]
    mounts: tuple[Mount, ...] = ()


@functools.cache
def links() -> tuple[Link, ...]:
    """All links, each after its parent: base, waist, trunk, head, and of each side upper_arm, forearm, hand, finger,
    such as left_forearm. Mounts: left_hand and right_hand (control points, x out of the hand, z up when the forearm is
    level), laser, proximity_1 to _8 (x out, counter-clockwise from ahead). The base has no joints; dynamics adds
    them."""
    middle, half = (BASE_BACK_M + BASE_FRONT_M) / 2, (BASE_FRONT_M - BASE_BACK_M) / 2
    sensors = []
    for number in range(PROXIMITY_COUNT):
        bearing = number * math.tau / PROXIMITY_COUNT
        x, y = middle + round(math.cos(bearing)) * half, round(math.sin(bearing)) * BASE_HALF_WIDTH_M
        turned = (math.cos(bearing / 2), 0.0, 0.0, math.sin(bearing / 2))
        sensors.append(Mount(f"proximity_{number + 1}", (x, y, PROXIMITY_HEIGHT_M), turned))
    half_sides = half, BASE_HALF_WIDTH_M, (BASE_HEIGHT_M - 0.03) / 2
    on_wheels = _box((middle, 0.0, (BASE_HEIGHT_M + 0.03) / 2), half_sides, 73.0, _DARK)

    lumbar = LUMBAR_UPPER_HEIGHT_M - LUMBAR_LOWER_HEIGHT_M
    laser = Mount("laser", (*LASER_M[:2], LASER_M[2] - LUMBAR_LOWER_HEIGHT_M))
    shoulder = SHOULDER_M[2] - LUMBAR_UPPER_HEIGHT_M
    chest = _box((-0.025, 0.0, shoulder / 2 + 0.04), (0.095, 0.130, shoulder / 2), 21.0, _WHITE)
    panel = _box((0.077, 0.0, shoulder - 0.09), (0.012, 0.110, 0.080), 2.0, _BLUE)
    head = (-0.025, 0.0, HEIGHT_M - LUMBAR_UPPER_HEIGHT_M - 0.09)
    return (
        Link("base", "", (0.0, 0.0, 0.0), (), (on_wheels,), tuple(sensors)),
        Link(
            *("waist", "base", (0.0, 0.0, LUMBAR_LOWER_HEIGHT_M), (_joint("lumbar_lower", ACROSS),)),
            *((_capsule(0.0, 0.0, lumbar, 0.09, 10.0),), (laser,)),
        ),
        Link("trunk", "waist", (0.0, 0.0, lumbar), (_joint("lumbar_upper", ACROSS),), (chest, panel)),
        Link("head", "trunk", head, (), (Solid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.09, 3.0, _WHITE),)),
        *(link for side in Side for link in _arm(side, shoulder)),
    )


def _arm(side: Side, shoulder_m: float) -> tuple[Link, ...]:
    """From the shoulder down to the finger. The mirrored quantities are y and the axes other than across."""
    name = side.value
    left = 1.0 if side is Side.LEFT else -1.0
    back, inwards, down, outwards = (0.0, -1.0, 0.0), (-left, 0.0, 0.0), (0.0, 0.0, -left), (left, 0.0, 0.0)
    line = -ELBOW_OFFSET_M
    tip, aside = -WRIST_M - HAND_M - 0.006, _GAP_M + _FINGER_M
    size = (_FINGER_M, 0.015, _FINGER_LENGTH_M / 2)
    palm = _box((0.0, 0.0, -0.045), (0.028, 0.035, 0.035), 1.2, _DARK)
    ahead = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    return (
        Link(
            *(f"{name}_upper_arm", "trunk", (SHOULDER_M[0], left * SHOULDER_M[1], shoulder_m)),
            (_joint(f"{name}_1", back), _joint(f"{name}_2", inwards), _joint(f"{name}_3", down)),
            (_capsule(0.0, -UPPER_ARM_M, 0.0, 0.048, 4.0),),
        ),
        Link(
            *(f"{name}_forearm", f"{name}_upper_arm", (ELBOW_OFFSET_M, 0.0, -UPPER_ARM_M)),
            (_joint(f"{name}_4", back), _joint(f"{name}_5", down, (line, 0.0, 0.0))),
            (_capsule(line, -FOREARM_M + 0.02, -0.02, 0.040, 3.5),),
        ),
        Link(
            *(f"{name}_hand", f"{name}_forearm", (line, 0.0, -FOREARM_M)),
            (_joint(f"{name}_6", back), _joint(f"{name}_7", outwards)),
            (palm, _box(FIXED_FINGER_M, size, 0.15, _BLUE)),
            (Mount(f"{name}_hand", (0.0, 0.0, -WRIST_M - HAND_M), ahead),),
        ),
        Link(
            *(f"{name}_finger", f"{name}_hand", (aside, 0.0, tip + _FINGER_LENGTH_M)),
            (_joint(f"{name}_grip", ACROSS),),
            (_box((0.0, 0.0, -_FINGER_LENGTH_M / 2), size, 0.15, _BLUE),),
        ),
    )


def _joint(name: str, axis: Vector, at: Vector = (0.0, 0.0, 0.0)) -> LinkJoint:
    number = JOINTS.index(name)
    return LinkJoint(number, name, axis, at, float(JOINT_LOWER[number]), float(JOINT_UPPER[number]))


def _capsule(x_m: float, low_m: float, high_m: float, radius_m: float, mass_kg: float) -> Solid:
    """Around the line from z = low_m to high_m."""
    return Solid((x_m, 0.0, (low_m + high_m) / 2), (0.0, 0.0, (high_m - low_m) / 2), radius_m, mass_kg, _WHITE)


def _box(middle: Vector, half_sides: Vector, mass_kg: float, colour: Colour) -> Solid:
    return Solid(middle, half_sides, 0.0, mass_kg, colour)
