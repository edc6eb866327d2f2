"""SmartPal V as a MuJoCo model, for kinematics and for dynamics.

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

import math
from collections.abc import Sequence

from robocorba.robot.kinematics.mujoco_headless import mujoco
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
ACROSS = (0, 1, 0)
#: Dimensions of a finger, and half the gap between parallel fingers [m]: closed fingers meet at their tips.
_FINGER_LENGTH_M, _FINGER_M = 0.090, 0.006
_GAP_M = _FINGER_LENGTH_M * math.tan(JOINT_UPPER[-1]) / 2
#: Middle of the fixed finger in the hand's frame [m].
FIXED_FINGER_M = (-_GAP_M - _FINGER_M, 0.0, -WRIST_M - HAND_M - 0.006 + _FINGER_LENGTH_M / 2)

#: armature, damping: inertia [kg m^2] and friction [N m s/rad] that motors and gears add to a joint. Assumed.
_EMPTY_MODEL = """
<mujoco model="smartpal">
  <compiler angle="radian"/>
  <default><joint armature="0.05" damping="0.5"/></default>
</mujoco>
"""
Vector = Sequence[float]
_WHITE, _DARK, _BLUE = (0.92, 0.92, 0.90, 1), (0.25, 0.27, 0.30, 1), (0.20, 0.45, 0.75, 1)


def specification() -> mujoco.MjSpec:
    """SmartPal without actuators and without a floor, to compile or to extend. The base has no joints; dynamics adds
    them to the body `base`.

    Bodies are the links: base, waist, trunk, head, and of each side upper_arm, forearm, hand, finger, such as
    left_forearm. Joints have the names of `smartpal.JOINTS`, in another order. Sites: left_hand and right_hand
    (control points, x out of the hand, z up when the forearm is level), laser, proximity_1 to _8 (x out,
    counter-clockwise from ahead)."""
    spec = mujoco.MjSpec.from_string(_EMPTY_MODEL)
    base = spec.worldbody.add_body(name="base")
    middle, half = (BASE_BACK_M + BASE_FRONT_M) / 2, (BASE_FRONT_M - BASE_BACK_M) / 2
    half_sides = half, BASE_HALF_WIDTH_M, (BASE_HEIGHT_M - 0.03) / 2
    _box(base, (middle, 0, (BASE_HEIGHT_M + 0.03) / 2), half_sides, 73.0, _DARK)
    for number in range(PROXIMITY_COUNT):
        bearing = number * math.tau / PROXIMITY_COUNT
        x, y = middle + round(math.cos(bearing)) * half, round(math.sin(bearing)) * BASE_HALF_WIDTH_M
        turned = (math.cos(bearing / 2), 0, 0, math.sin(bearing / 2))
        base.add_site(name=f"proximity_{number + 1}", pos=(x, y, PROXIMITY_HEIGHT_M), quat=turned, size=[0.01] * 3)

    waist = _link(base, "waist", (0, 0, LUMBAR_LOWER_HEIGHT_M), ("lumbar_lower", ACROSS))
    lumbar = LUMBAR_UPPER_HEIGHT_M - LUMBAR_LOWER_HEIGHT_M
    _capsule(waist, (0, 0, 0), (0, 0, lumbar), 0.09, 10.0, _WHITE)
    waist.add_site(name="laser", pos=(*LASER_M[:2], LASER_M[2] - LUMBAR_LOWER_HEIGHT_M), size=[0.02] * 3)

    trunk = _link(waist, "trunk", (0, 0, lumbar), ("lumbar_upper", ACROSS))
    shoulder = SHOULDER_M[2] - LUMBAR_UPPER_HEIGHT_M
    _box(trunk, (-0.025, 0, shoulder / 2 + 0.04), (0.095, 0.130, shoulder / 2), 21.0, _WHITE)
    _box(trunk, (0.077, 0, shoulder - 0.09), (0.012, 0.110, 0.080), 2.0, _BLUE)  # the panel on its chest
    head = _link(trunk, "head", (-0.025, 0, HEIGHT_M - LUMBAR_UPPER_HEIGHT_M - 0.09))
    head.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.09, 0, 0], mass=3.0, rgba=_WHITE)

    for side in Side:
        _arm(trunk, side, shoulder)
    # Neighbouring links touch. MuJoCo ignores contacts of parent and child, but not if the parent can't move.
    for one, other in (("base", "waist"), ("waist", "head")):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return spec


def _arm(trunk: mujoco.MjsBody, side: Side, shoulder_m: float) -> None:
    """From the shoulder down to the finger. The mirrored quantities are y and the axes other than across."""
    name = side.value
    left = 1 if side is Side.LEFT else -1
    back, inwards, down = (0, -1, 0), (-left, 0, 0), (0, 0, -left)

    joints = ((f"{name}_1", back), (f"{name}_2", inwards), (f"{name}_3", down))
    upper_arm = _link(trunk, f"{name}_upper_arm", (SHOULDER_M[0], left * SHOULDER_M[1], shoulder_m), *joints)
    _capsule(upper_arm, (0, 0, 0), (0, 0, -UPPER_ARM_M), 0.048, 4.0, _WHITE)

    forearm = _link(upper_arm, f"{name}_forearm", (ELBOW_OFFSET_M, 0, -UPPER_ARM_M), (f"{name}_4", back))
    line = -ELBOW_OFFSET_M
    _add_joint(forearm, f"{name}_5", down, (line, 0, 0))
    _capsule(forearm, (line, 0, -0.02), (line, 0, -FOREARM_M + 0.02), 0.040, 3.5, _WHITE)

    outwards = (left, 0, 0)
    hand = _link(forearm, f"{name}_hand", (line, 0, -FOREARM_M), (f"{name}_6", back), (f"{name}_7", outwards))
    _box(hand, (0, 0, -0.045), (0.028, 0.035, 0.035), 1.2, _DARK)
    tip, aside = -WRIST_M - HAND_M - 0.006, _GAP_M + _FINGER_M
    size = (_FINGER_M, 0.015, _FINGER_LENGTH_M / 2)
    _box(hand, FIXED_FINGER_M, size, 0.15, _BLUE)
    ahead = (math.sqrt(0.5), 0, math.sqrt(0.5), 0)
    hand.add_site(name=f"{name}_hand", pos=(0, 0, -WRIST_M - HAND_M), quat=ahead, size=[0.008] * 3)

    finger = _link(hand, f"{name}_finger", (aside, 0, tip + _FINGER_LENGTH_M), (f"{name}_grip", ACROSS))
    _box(finger, (0, 0, -_FINGER_LENGTH_M / 2), size, 0.15, _BLUE)


def _link(parent: mujoco.MjsBody, name: str, at: Vector, *joints: tuple[str, Vector]) -> mujoco.MjsBody:
    body = parent.add_body(name=name, pos=at)
    for joint, axis in joints:
        _add_joint(body, joint, axis)
    return body


def _add_joint(body: mujoco.MjsBody, name: str, axis: Vector, at: Vector = (0, 0, 0)) -> None:
    row = JOINTS.index(name)
    body.add_joint(name=name, axis=axis, pos=at, range=(JOINT_LOWER[row], JOINT_UPPER[row]), limited=True)


def _capsule(body: mujoco.MjsBody, start: Vector, end: Vector, radius_m: float, mass_kg: float, colour: Vector) -> None:
    shape = mujoco.mjtGeom.mjGEOM_CAPSULE
    body.add_geom(type=shape, fromto=[*start, *end], size=[radius_m, 0, 0], mass=mass_kg, rgba=colour)


def _box(body: mujoco.MjsBody, middle: Vector, half_sides: Vector, mass_kg: float, colour: Vector) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=middle, size=half_sides, mass=mass_kg, rgba=colour)
