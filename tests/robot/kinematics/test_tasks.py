"""Named postures can be taken, tables be gripped, sheets be handed over."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, RADIUS_M, Side
from robocorba.robot.kinematics.tasks import GRIP_DEPTH_M, POSTURES, SHEET_M, grip_table, hand_over

from .postures import HOME, within_limits


def taking(left: str, right: str) -> Floats:
    joints = HOME.copy()
    joints[ARM[Side.LEFT]], joints[ARM[Side.RIGHT]] = POSTURES[left], POSTURES[right]
    return joints


@pytest.mark.parametrize("other", POSTURES)
@pytest.mark.parametrize("one", POSTURES)
def test_postures_keep_limits_and_they_and_the_ways_between_them_are_clear(
    body: SmartPalBody, one: str, other: str
) -> None:
    assert within_limits(taking(one, other))
    assert body.collisions(taking(one, other)) == []
    for share in np.linspace(0, 1, 41):
        joints = (1 - share) * taking(one, one) + share * taking(other, other)
        assert body.collisions(joints) == []


def test_what_the_postures_are_for(body: SmartPalBody) -> None:
    assert not POSTURES["home"].any()
    hands = {name: body.hand(Side.LEFT, taking(name, name)) for name in POSTURES}
    for name in ("ready", "reach", "carry"):
        assert hands[name][3:] == pytest.approx((0, 0, 0), abs=1e-9)  # level, ahead
    assert hands["reach"].x > hands["ready"].x + 0.2 > hands["carry"].x + 0.3
    tuck = body.links(taking("tuck", "tuck"))
    for x, y, _ in (hands["tuck"][:3], *(position for position, _ in tuck.values())):
        assert math.hypot(x, y) < RADIUS_M


@pytest.mark.parametrize("height_m", [0.6, 0.7, 0.8, 0.9, 1.0])
@pytest.mark.parametrize("spacing_m", [0.3, 0.5])
def test_tables_are_gripped(body: SmartPalBody, inverse: InverseKinematics, height_m: float, spacing_m: float) -> None:
    hands = grip_table(height_m, 0.45, spacing_m)
    joints = inverse.solve(hands, HOME, use_lumbar=True)
    assert within_limits(joints)
    assert body.collisions(joints) == []
    for side, aside in ((Side.LEFT, spacing_m / 2), (Side.RIGHT, -spacing_m / 2)):
        at = body.hand(side, joints)
        assert at == pytest.approx((0.45 + GRIP_DEPTH_M, aside, height_m, 0, 0, 0), abs=1e-5)
    for hand in hands.values():  # hands come from before the edge
        assert hand.moved(-0.1) == pytest.approx(hand._replace(x=hand.x - 0.1))


@pytest.mark.parametrize("between_m", [1.1, 1.3])
@pytest.mark.parametrize("height_m", [0.85, 1.0])
@pytest.mark.parametrize("aside_m", [-0.1, 0.0, 0.15])
def test_both_hold_the_sheet(
    body: SmartPalBody, inverse: InverseKinematics, between_m: float, height_m: float, aside_m: float
) -> None:
    """In one frame: the giver stands at the origin, the taker faces it."""
    giving, taking = hand_over(between_m, height_m, aside_m)
    side = Side.LEFT if aside_m >= 0 else Side.RIGHT
    giver = body.hand(side, inverse.solve({side: giving}, HOME))
    other = Side.RIGHT if aside_m >= 0 else Side.LEFT
    taker = turned_round(body.hand(other, inverse.solve({other: taking}, HOME)), between_m)
    assert giver[1:3] == pytest.approx((aside_m, height_m), abs=1e-5)
    assert taker[1:3] == pytest.approx((aside_m, height_m), abs=1e-5)
    assert taker.x - giver.x == pytest.approx(SHEET_M - 2 * GRIP_DEPTH_M, abs=1e-5)
    assert (giver.x + taker.x) / 2 == pytest.approx(between_m / 2, abs=1e-5)
    assert giver.rotation[:, 0] == pytest.approx(-taker.rotation[:, 0], abs=1e-5)
    assert giver.rotation[:, 2] == pytest.approx([0, 0, 1], abs=1e-5)


def turned_round(pose: HandPose, between_m: float) -> HandPose:
    """From the frame of a robot that stands `between_m` ahead and looks back."""
    return HandPose(between_m - pose.x, -pose.y, *pose[2:5], pose.yaw + math.pi)
