"""Goals in frames of ROS as poses in the building; the diagnostics of robots; and the times of their messages: those of
their floors, forward only."""

from __future__ import annotations

import math
from collections import defaultdict
from types import SimpleNamespace
from typing import Any

import pytest

from robocorba.bridges.ros2.bag import BagTopics
from robocorba.bridges.ros2.diagnostics import ERROR, OK, robot_status
from robocorba.bridges.ros2.frames import Frames
from robocorba.bridges.ros2.goals import goal_in_building
from robocorba.bridges.ros2.messages import heading_of, yaw
from robocorba.bridges.ros2.publisher import RosPublisher
from robocorba.errors.robots import RobotError
from robocorba.map_editor.spatial.floor_update import FloorUpdate
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.motion.robot_state import RobotState
from robocorba.simulation.system_changes import SystemChanges
from robocorba.simulation.system_view import RobotPlace
from tests.simulation.test_system_view import HOUSE, update

PLACE = RobotPlace("A", "L2", 3.0, 2.0, 4.0, math.pi / 2, (0.0, 0.0, 0.0))
FLOORS = {"floor/L1": "L1", "floor/L2": "L2"}


@pytest.mark.parametrize("frame", ["map", "/map", "A/odom", "A/base_link", "base_link", "floor/L1"])
def test_goals_in_frames(frame: str) -> None:
    goal = Pose("L1" if frame == "floor/L1" else "L2", 1.0, 0.5, 0.25)
    if "base_link" in frame:
        goal = Pose("L2", 2.5, 3.0, math.pi / 2 + 0.25)
    frames = Frames(is_namespaced=frame == "base_link")
    found = goal_in_building(frame, 1.0, 0.5, 0.25, PLACE, frames, "A", FLOORS)
    assert found.floor == goal.floor
    assert found[1:] == pytest.approx(goal[1:])


def test_what_is_no_goal() -> None:
    with pytest.raises(RobotError, match=r"'B/base_link'; known are map, A/odom, A/base_link, floor/L1, floor/L2"):
        goal_in_building("B/base_link", 1.0, 0.0, 0.0, PLACE, Frames(), "A", FLOORS)
    with pytest.raises(RobotError, match="not finite"):
        goal_in_building("map", math.nan, 0.0, 0.0, PLACE, Frames(), "A", FLOORS)
    for x, w, why in ((0.0, 0.0, "no rotation"), (math.nan, 1.0, "no rotation"), (-1.0, 1.0, "tilted by 90 degrees")):
        with pytest.raises(RobotError, match=why):
            heading_of(x, 0.0, 0.0, w)


@pytest.mark.parametrize("heading", [0.0, 1.0, -3.0, math.pi])
def test_headings_of_quaternions_of_any_length(heading: float) -> None:
    for length in (1.0, 3.0):
        assert heading_of(*(length * part for part in yaw(heading))) == pytest.approx(heading)


# ---- diagnostics: what its touch panel shows ----


@pytest.mark.parametrize("kind", DisplayKind)
def test_a_robot_has_an_error_if_it_is_exceptional(kind: DisplayKind) -> None:
    at = Pose("L1", 0.0, 0.0, 0.0)
    state = AgentState("A", "simulated", AgentCondition.IDLE, "", at, RobotState(), 1.0, 0.0, ProgramReport("fetch"))
    messages: Any = SimpleNamespace(status=lambda *members: members)
    level, name, text, values = robot_status(messages, state, Display(kind, "waiting for B"))
    assert (name, text, values["display"]) == ("A", "waiting for B", kind.name.lower())
    assert level == (ERROR if kind is DisplayKind.EXCEPTIONAL else OK)


# ---- times ----


class Topics(BagTopics):
    """Keeps messages by topic."""

    def __init__(self) -> None:
        super().__init__(None)  # type: ignore[arg-type]
        self.sent: dict[str, list[Any]] = defaultdict(list)

    def publish(self, topic: str, type: str, message: Any, time_s: float, is_latched: bool = False) -> None:
        self.sent[topic].append(message)

    def odometry(self, robot: str) -> list[tuple[float, float]]:
        """Times and places x of a robot's messages."""
        return [(seconds(m.header.stamp), m.pose.pose.position.x) for m in self.sent[f"/{robot}/odom"]]

    def transforms(self, child: str) -> list[float]:
        """Times of the transforms of a frame."""
        sent = [each for message in self.sent["/tf"] for each in message.transforms]
        return [seconds(each.header.stamp) for each in sent if each.child_frame_id == child]


def seconds(stamp: Any) -> float:
    return round(float(stamp.sec + stamp.nanosec * 1e-9), 6)


def published(*changes: list[FloorUpdate]) -> Topics:
    topics = Topics()
    publisher = RosPublisher(topics, HOUSE)
    for updates in changes:
        publisher.publish(SystemChanges(updates, [], [], []))
    return topics


def test_robots_have_the_times_of_their_floors() -> None:
    topics = published(
        [update("L1", 1, 1.0, came="A", x=3.0), update("L2", 1, 0.98, came="B", x=5.0)],
        [update("L1", 2, 1.05)],
        [update("L2", 2, 1.02), update("L1", 3, 1.1)],
    )
    assert topics.odometry("A") == [(1.0, 3.0), (1.05, 3.0), (1.1, 3.0)]
    assert topics.odometry("B") == [(0.98, 5.0), (1.02, 5.0)]  # none of another floor's time, none twice
    assert topics.transforms("B/base_link") == topics.transforms("B/odom") == [0.98, 1.02]
    assert [seconds(message.clock) for message in topics.sent["/clock"]] == pytest.approx([1.0, 1.05, 1.1])
    again = published(*([update("L1", 1, time_s, came="A")._replace(since=0)] for time_s in (100.0, 50.0)))
    assert [time_s for time_s, _ in again.odometry("A")] == [100.0, 50.0], "a server that begins again earlier"


def test_links_move_with_the_base() -> None:
    standing = update("L1", 1, 1.0, came="A")
    driving = update("L1", 2, 1.05)._replace(motions=standing.motions.copy())
    driving.motions["vx"] = 0.5
    stopped = update("L1", 4, 1.15)._replace(motions=standing.motions)
    topics = published([standing], [driving], [update("L1", 3, 1.1)], [stopped])
    assert topics.transforms("A/trunk") == topics.transforms("A/base_link")[:-1] == [1.0, 1.05, 1.1]


def test_a_robot_that_comes_to_a_floor_that_lags_behind_waits_for_it() -> None:
    topics = published(
        [update("L1", 1, 1.0, came="A"), update("L2", 1, 0.9)],
        [update("L2", 2, 0.95, came="A", x=7.0), update("L1", 2, 1.05, went=[ord("A")])],
        [update("L2", 3, 1.01)],
    )
    assert topics.odometry("A") == [(1.0, 1.0), (1.01, 7.0)]
    assert [message.data for message in topics.sent["/A/floor"]] == ["L1", "L2"]
