"""What the 3D page gets of a robot: changes only, whole floors after a change of floors, and problems once."""

from __future__ import annotations

import asyncio
import contextlib
import json
import struct
from typing import Any

import numpy as np
import pytest

from robocorba.console.robot_views import RETRY_S, SLOW_INTERVAL_S, RobotView, RobotViews
from robocorba.errors.services import NotReachable
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate
from robocorba.spatial.posture import Posture

POINT = {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}


class FakeRobot:
    def __init__(self) -> None:
        self.on, self.version, self.way = "L1", 5, [POINT]
        self.angles = [Posture("A", 3.0, (0.1,))]
        self.asked: list[int] = []
        self.hangs = False

    def path(self) -> list[dict[str, Any]]:
        if self.hangs:
            raise NotReachable("A does not answer")
        return list(self.way)

    @property
    def floor(self) -> str:
        return self.on

    @property
    def lag_s(self) -> float:
        return 0.02

    def changes(self, since: int) -> FloorUpdate:
        if self.hangs:
            raise NotReachable("A does not answer")
        self.asked.append(since)
        start = since if since == self.version else WHOLE
        return FloorUpdate(self.on, start, self.version, 1.0, 1, [], [], np.empty(0, MOTION), {})

    def postures(self, time_s: float) -> list[Posture]:
        return [posture for posture in self.angles if posture.time > time_s]


@pytest.fixture
def robot() -> FakeRobot:
    return FakeRobot()


def jsons(messages: list[Any]) -> dict[str, Any]:
    return {key: value for message in messages if isinstance(message, dict) for key, value in message.items()}


def frames(messages: list[Any]) -> list[dict[str, Any]]:
    found = [message for message in messages if isinstance(message, bytes)]
    return [json.loads(frame[4 : 4 + struct.unpack("<I", frame[:4])[0]]) for frame in found]


def test_a_path_is_sent_when_it_changes(robot: FakeRobot) -> None:
    view = RobotView(lambda: robot, with_pool=False)
    assert view.poll(0.0) == ([{"path": [POINT]}], SLOW_INTERVAL_S)
    assert view.poll(1.0)[0] == []
    robot.way = []
    assert view.poll(2.0)[0] == [{"path": []}]
    assert robot.asked == []  # nobody asked for the pool


def test_the_pool_is_sent_whole_and_then_by_changes(robot: FakeRobot) -> None:
    view = RobotView(lambda: robot, with_pool=True)
    first = view.poll(0.0)[0]
    assert [frame["floor"] for frame in frames(first)] == ["L1"]
    assert jsons(first)["pool"] == {"floor": "L1", "lag": 0.02, "joints": {"A": (0.1,)}}
    later = view.poll(1.0)[0]
    assert frames(later) == []
    assert jsons(later)["pool"]["joints"] == {}  # known already
    assert robot.asked == [WHOLE, 5]


def test_after_a_ride_the_pools_new_floor_is_sent_whole(robot: FakeRobot) -> None:
    view = RobotView(lambda: robot, with_pool=True)
    view.poll(0.0)
    robot.on = "L2"  # the same version number, of another floor
    assert [(frame["floor"], frame["whole"]) for frame in frames(view.poll(0.1)[0])] == [("L2", True)]
    assert robot.asked == [WHOLE, 5, WHOLE]


def test_a_lost_robot_is_said_once_and_found_again(robot: FakeRobot) -> None:
    view = RobotView(lambda: robot, with_pool=True)
    view.poll(0.0)
    robot.hangs = True
    assert view.poll(1.0) == ([{"problem": "A does not answer"}], RETRY_S)
    assert view.poll(2.0) == ([], RETRY_S)
    robot.hangs = False
    again = view.poll(3.0)[0]
    assert jsons(again)["problem"] == ""
    assert [frame["whole"] for frame in frames(again)] == [True]


class Socket:
    """A page that stays, with nothing to say."""

    is_closed = False
    closed = 0, ""

    async def accept(self) -> None: ...

    async def receive_text(self) -> str:
        await asyncio.Event().wait()
        raise AssertionError("it said something")

    async def close(self, code: int = 1000, reason: str = "") -> None:
        self.is_closed, self.closed = True, (code, reason)


def test_a_defect_of_a_view_closes_its_page_and_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    def connect(robot: str) -> FakeRobot:
        raise KeyError("a defect")

    async def run(socket: Any) -> None:
        with contextlib.closing(RobotViews(connect)) as views:
            await asyncio.wait_for(views.serve(socket, "R1", with_pool=False), 20.0)

    socket = Socket()
    asyncio.run(run(socket))
    assert socket.is_closed
    assert "a view of 'R1' was disconnected" in caplog.text
    assert "a defect" in caplog.text
