"""Goals in frames of ROS as poses in the building."""

from __future__ import annotations

import math

import pytest

from robocorba.ros2.frames import Frames
from robocorba.ros2.goals import InvalidGoal, goal_in_building
from robocorba.ros2.messages import heading_of, yaw
from robocorba.simulation.system_view import RobotPlace
from robocorba.spatial.pose import Pose

PLACE = RobotPlace("A", "L2", 3.0, 2.0, 4.0, math.pi / 2, (0.0, 0.0, 0.0))
FLOORS = {"floor/L1": "L1", "floor/L2": "L2"}


@pytest.mark.parametrize(
    ("frame", "goal"),
    [
        ("map", Pose("L2", 1.0, 0.5, 0.25)),
        ("/map", Pose("L2", 1.0, 0.5, 0.25)),
        ("A/odom", Pose("L2", 1.0, 0.5, 0.25)),
        ("A/base_link", Pose("L2", 2.5, 3.0, math.pi / 2 + 0.25)),
        ("floor/L1", Pose("L1", 1.0, 0.5, 0.25)),
    ],
)
def test_frames(frame: str, goal: Pose) -> None:
    found = goal_in_building(frame, 1.0, 0.5, 0.25, PLACE, Frames(), "A", FLOORS)
    assert found.floor == goal.floor
    assert found[1:] == pytest.approx(goal[1:])


def test_plain_frames() -> None:
    found = goal_in_building("base_link", 1.0, 0.0, 0.0, PLACE, Frames(is_namespaced=True), "A", FLOORS)
    assert found[1:3] == pytest.approx((3.0, 3.0))


def test_what_is_no_goal() -> None:
    with pytest.raises(InvalidGoal, match=r"'B/base_link'; known are map, A/odom, A/base_link, floor/L1, floor/L2"):
        goal_in_building("B/base_link", 1.0, 0.0, 0.0, PLACE, Frames(), "A", FLOORS)
    with pytest.raises(InvalidGoal, match="not finite"):
        goal_in_building("map", math.nan, 0.0, 0.0, PLACE, Frames(), "A", FLOORS)


@pytest.mark.parametrize("heading", [0.0, 1.0, -3.0, math.pi])
def test_headings_of_quaternions_of_any_length(heading: float) -> None:
    x, y, z, w = yaw(heading)
    assert heading_of(x, y, z, w) == pytest.approx(heading)
    assert heading_of(3 * x, 3 * y, 3 * z, 3 * w) == pytest.approx(heading)
