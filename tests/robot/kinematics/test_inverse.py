"""Inverse kinematics, checked by forward kinematics of another implementation (MuJoCo's).

One arm gets wherever it can be; of both arms at once, or with the lumbar, one pose of a thousand may be missed, so that
those tests always ask for the same ones."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, GRIP, JOINT_LOWER, JOINT_UPPER, JOINTS, LUMBAR, Side
from robocorba.robot.kinematics.tasks import POSTURES

from .postures import HOME, anywhere, at, within_limits

BODY, INVERSE = SmartPalBody(), InverseKinematics()
SIDES = st.sampled_from(list(Side))
SEEDS = st.integers(0, 2**32 - 1)
READY = at()
READY[ARM[Side.LEFT]] = READY[ARM[Side.RIGHT]] = POSTURES["ready"]


@settings(max_examples=40, deadline=None)
@given(SIDES, SEEDS)
def test_where_a_hand_can_be_it_gets_also_without_an_attitude(side: Side, seed: int) -> None:
    truth = HOME.copy()
    truth[ARM[side]] = anywhere(1, seed)[0][ARM[side]]
    target = BODY.hand(side, truth)
    found = INVERSE.solve({side: target}, HOME, avoid_collisions=False)
    assert is_at(side, found, target)
    rest = np.setdiff1d(np.arange(len(JOINTS)), np.arange(len(JOINTS))[ARM[side]])
    assert np.array_equal(found[rest], HOME[rest])
    x, y, z, *_ = target
    found = INVERSE.solve({side: HandPose(x, y, z)}, HOME, with_attitude=False, avoid_collisions=False)
    assert math.dist(BODY.hand(side, found)[:3], (x, y, z)) < 1e-5
    assert within_limits(found)


def test_nearly_all_poses_of_clear_postures_are_reached_clear() -> None:
    for side in Side:
        solved = asked = 0
        for joints in anywhere(70, 11):
            truth = HOME.copy()
            truth[ARM[side]] = joints[ARM[side]]
            if BODY.collisions(truth):
                continue
            asked += 1
            try:
                found = INVERSE.solve({side: BODY.hand(side, truth)}, HOME)
            except Unreachable:
                continue
            assert is_at(side, found, BODY.hand(side, truth))
            assert BODY.collisions(found) == []
            solved += 1
        assert asked > 50
        assert solved >= 0.99 * asked


@settings(max_examples=40, deadline=None, derandomize=True)
@given(SIDES, SEEDS, SEEDS)
def test_from_anywhere_with_the_lumbar(side: Side, seed: int, other: int) -> None:
    truth, start = anywhere(1, seed)[0], anywhere(1, other)[0]
    target = BODY.hand(side, truth)
    found = INVERSE.solve({side: target}, start, use_lumbar=True, avoid_collisions=False)
    assert is_at(side, found, target)
    untouched = [*range(len(JOINTS))[ARM[_other(side)]], *GRIP.values()]
    assert np.array_equal(found[untouched], start[untouched])


@settings(max_examples=40, deadline=None, derandomize=True)
@given(SEEDS)
def test_both_hands_at_once(seed: int) -> None:
    truth = anywhere(1, seed)[0]
    truth[LUMBAR] = 0
    goals = {side: BODY.hand(side, truth) for side in Side}
    found = INVERSE.solve(goals, HOME, avoid_collisions=False)
    for side, goal in goals.items():
        assert is_at(side, found, goal)
    assert np.array_equal(found[LUMBAR], HOME[LUMBAR])


@settings(max_examples=40, deadline=None)
@given(SIDES, st.floats(0.75, 3.0), st.floats(0, math.tau), st.floats(-1.5, 1.5))
def test_what_is_out_of_reach_is_refused(side: Side, far: float, bearing: float, up: float) -> None:
    """Farther from the shoulder than the arm is long."""
    aside = 0.2 if side is Side.LEFT else -0.2
    x = -0.025 + far * math.cos(bearing) * math.cos(up)
    y, z = aside + far * math.sin(bearing) * math.cos(up), 1.1265 + far * math.sin(up)
    with pytest.raises(Unreachable) as refused:
        INVERSE.solve({side: HandPose(x, y, z)}, HOME)
    assert refused.value.hand == side.value
    left = re.fullmatch(r"the best posture misses the target by ([0-9.]+) m and [0-9.]+ deg", refused.value.reason)
    assert left and float(left[1]) >= far - 0.70


def test_a_hand_that_would_have_to_be_in_the_trunk_is_refused() -> None:
    inside = BODY.hand(Side.LEFT, at(left_2=14.5, left_1=5))
    assert is_at(Side.LEFT, INVERSE.solve({Side.LEFT: inside}, HOME, avoid_collisions=False), inside)
    with pytest.raises(Unreachable, match=r"only where .*left_\w+.* collide"):
        INVERSE.solve({Side.LEFT: inside}, HOME)


@pytest.mark.parametrize("field", HandPose._fields)
def test_poses_that_are_none_or_far_beyond(field: str) -> None:
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(Unreachable, match="is no pose"):
            INVERSE.solve({Side.RIGHT: HandPose(0.4, -0.2, 0.9)._replace(**{field: value})}, HOME)
    for far in (1e3, 1e200, -1e308) if field == "x" else ():
        with pytest.raises(Unreachable, match="misses the target"):
            INVERSE.solve({Side.LEFT: HandPose(far, far, far)}, HOME)


def test_awkward_seeds() -> None:
    """A hand that has to turn half round: which way is open; that it is there already is not. And one out of limits."""
    target = BODY.hand(Side.LEFT, at(left_4=90, left_5=-90))
    for seed in (at(left_4=90, left_5=90), at(left_4=90, left_5=90 + 1e-8)):
        assert is_at(Side.LEFT, INVERSE.solve({Side.LEFT: target}, seed), target)
    target = HandPose(0.4, 0.2, 0.9)
    for beyond in (JOINT_UPPER + 1, JOINT_LOWER - 1):
        seed = HOME.copy()
        seed[ARM[Side.LEFT]] = beyond[ARM[Side.LEFT]]
        assert is_at(Side.LEFT, INVERSE.solve({Side.LEFT: target}, seed), target)


def test_the_seed_is_left_alone_the_answer_the_same_and_without_restarts_no_other_is_tried() -> None:
    seed = READY.copy()
    target = BODY.hand(Side.LEFT, anywhere(1, 5)[0] * np.array([1] * 14 + [0] * 4))
    first = INVERSE.solve({Side.LEFT: target}, seed)
    assert np.array_equal(seed, READY)
    assert np.array_equal(first, InverseKinematics().solve({Side.LEFT: target}, seed))
    goals = [BODY.hand(Side.LEFT, joints) for joints in anywhere(30, 6)]
    with pytest.raises(Unreachable):
        for goal in goals:
            INVERSE.solve({Side.LEFT: goal}, HOME, allow_restarts=False, avoid_collisions=False)


def test_a_hand_led_along_a_line_goes_in_small_steps_and_an_arm_left_free_bends_at_ease() -> None:
    # 4.6 mm a step: no joint leaps, and the elbow does not wander where the hand stands.
    joints, start = READY, BODY.hand(Side.LEFT, READY)
    for step in range(1, 31):
        target = start._replace(x=start.x + 0.004 * step, z=start.z + 0.002 * step, y=start.y - 0.001 * step)
        led = INVERSE.solve({Side.LEFT: target}, joints, allow_restarts=False)
        assert np.abs(led - joints).max() < 0.06
        assert is_at(Side.LEFT, led, target)
        joints = led
    assert np.abs(INVERSE.solve({Side.LEFT: target}, joints, allow_restarts=False) - joints).max() < 1e-4
    # Redundant joints end away from their limits where the target leaves it open.
    found = INVERSE.solve({Side.LEFT: BODY.hand(Side.LEFT, READY)}, at(left_3=-60, left_5=60, left_4=60))
    room = np.minimum(found - JOINT_LOWER, JOINT_UPPER - found)[ARM[Side.LEFT]]
    assert room.min() > math.radians(5)


def is_at(side: Side, joints: Floats, target: HandPose) -> bool:
    way, turn = BODY.hand(side, joints).distance(target)
    return way < 1e-5 and turn < 1e-5 and within_limits(joints)


def _other(side: Side) -> Side:
    return Side.RIGHT if side is Side.LEFT else Side.LEFT
