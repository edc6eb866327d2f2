"""Where the links are, from the figures and against a product of matrices of its own, and what collides."""

from __future__ import annotations

import math

import pytest

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, LUMBAR, Side

from .postures import HOME, X, Y, Z, anywhere, shift, turn


def test_hands_against_a_product_of_matrices(body: SmartPalBody) -> None:
    for joints in [HOME, *anywhere(60, 3)]:
        for side in Side:
            assert body.hand(side, joints).distance(by_matrices(side, joints)) == pytest.approx((0, 0), abs=1e-9)


def test_poses_there_and_back_and_how_far_they_are_apart(body: SmartPalBody) -> None:
    for joints in anywhere(60, 4):
        pose = body.hand(Side.LEFT, joints)
        assert HandPose.of(pose.position, pose.rotation).distance(pose) == pytest.approx((0, 0), abs=1e-7)
        ahead = pose.moved(0.1)
        assert pose.rotation.T @ (ahead.position - pose.position) == pytest.approx([0.1, 0, 0])
        assert ahead.moved(-0.1).distance(pose) == pytest.approx((0, 0), abs=1e-7)
    up = HandPose(0, 0, 0, 0.3, -math.pi / 2, 0.5)
    assert HandPose.of(up.position, up.rotation).distance(up) == pytest.approx((0, 0), abs=1e-7)
    for angle in (0.0, 1e-6, 0.5, 3.0, math.pi):
        assert HandPose(0, 0, 0).distance(HandPose(0, 3, 4, 0, 0, angle)) == pytest.approx((5.0, angle), abs=1e-12)


def by_matrices(side: Side, joints: Floats) -> HandPose:
    """Forward kinematics written down a second time: 4 x 4 matrices in a row, from the figures of the robot."""
    left = 1 if side is Side.LEFT else -1
    one, two, three, four, five, six, seven = joints[ARM[side]]
    lower, upper = joints[LUMBAR]
    whole = (
        shift(0, 0, 0.38) @ turn(Y, lower) @ shift(0, 0, 0.37) @ turn(Y, upper)
        @ shift(-0.025, left * 0.2, 1.1265 - 0.75) @ turn(Y, -one) @ turn(X, -left * two) @ turn(Z, -left * three)
        @ shift(-0.02, 0, -0.25) @ turn(Y, -four) @ shift(0.02, 0, 0) @ turn(Z, -left * five)
        @ shift(0, 0, -0.28) @ turn(Y, -six) @ turn(X, left * seven) @ shift(0, 0, -0.056 - 0.11)
        @ turn(Y, math.pi / 2)
    )  # fmt: skip
    return HandPose.of(whole[:3, 3], whole[:3, :3])
