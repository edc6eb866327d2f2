"""Viewers of the console and of robots: what each is sent, and what is asked of robots for it."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import struct
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.console import system_state
from robocorba.console.defects import DEFECT
from robocorba.console.live_sensors import Wanted
from robocorba.console.robot_views import RETRY_S, SLOW_INTERVAL_S, RobotView, RobotViews
from robocorba.console.sensor_feed import NOTHING
from robocorba.console.system_state import SystemState
from robocorba.console.viewers import TRY_AGAIN_LATER, Viewers
from robocorba.corba.remote.system_state import agent_is_driving, path_by_floor
from robocorba.errors.services import NotReachable
from robocorba.names import ROBOTS
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate
from robocorba.spatial.posture import Posture
from robocorba.testing.processes import eventually


class Wants:
    """Floors, their map, and sensors with news on each floor, once; what viewers want of them."""

    names: tuple[str, ...] = ()
    problem, version = "", 1

    def __init__(self) -> None:
        self.watched, self.wanted = list[list[str]](), list[Wanted]()
        self.scans_message = functools.partial(self._message, "scans")
        self.postures_message = functools.partial(self._message, "postures")

    def watch(self, viewer: object, floors: Any) -> None:
        self.watched.append(list(floors))

    def floor(self, name: str) -> Wants:
        return self

    def frame_since(self, version: int) -> tuple[int, bytes]:
        return 1, b"" if version else b"frame"

    def want(self, viewer: object, wanted: Wanted) -> None:
        self.wanted.append(wanted)

    def _message(self, kind: str, floor: Any, version: int) -> tuple[int, str]:
        return 7, json.dumps({kind: floor}) if version == NOTHING else ""

    def reservations_message(self, version: int) -> tuple[int, str]:
        return self._message("reservations", [], version)


class Socket:
    """A browser that sends what a test gives it; it leaves when `is_done` of what it got."""

    def __init__(self, messages: list[str], is_done: Callable[[list[Any]], bool] = lambda got: False) -> None:
        self._messages, self._is_done = messages, is_done
        self.got, self.closed, self.done = list[Any](), (0, ""), asyncio.Event()

    async def accept(self) -> None: ...

    async def close(self, code: int = 1000, reason: str = "") -> None:
        self.closed = code, reason

    async def receive_text(self) -> str:
        if self._messages:
            return self._messages.pop(0)
        await self.done.wait()
        raise RuntimeError("left")

    async def send_text(self, text: str) -> None:
        await self.send_bytes(json.loads(text))

    async def send_bytes(self, message: Any) -> None:
        self.got.append(message)
        if self._is_done(self.got):
            self.done.set()


def serve(*messages: str, is_done: Callable[[list[Any]], bool]) -> tuple[list[Any], Wants]:
    """What the browser gets until it leaves, and what was wanted for it."""
    wants = Wants()

    async def run() -> list[Any]:
        viewers, socket = viewers_of(wants), Socket(list(messages), is_done)
        await asyncio.wait_for(viewers.serve(socket), 20.0)
        assert viewers.count == 0
        return list(socket.got)

    return asyncio.run(run()), wants


def viewers_of(wants: Any, **more: Any) -> Any:
    viewers: Any = Viewers(SimpleNamespace(rows=dict), **more)
    viewers.attach(wants, wants, wants)
    return viewers


def test_a_viewer_gets_what_it_wants_unless_it_sends_nonsense() -> None:
    wanted = {"watch": ["L1"], "scans": ["L1", "L2"], "postures": ["L2"], "reservations": True}
    got, wants = serve(json.dumps(wanted), is_done=lambda got: {"reservations": []} in got)
    for message in (b"frame", {"scans": "L1"}, {"scans": "L2"}, {"postures": "L2"}, {"reservations": []}):
        assert got.count(message) == 1
    assert wants.wanted == [Wanted(("L1", "L2"), ("L2",), True), Wanted()]
    assert wants.watched == [["L1"], []]
    for others in ({}, {"scans": False}, {"scans": None, "postures": "L1", "reservations": 1}):
        got, wants = serve(json.dumps({"watch": ["L1"], **others}), is_done=lambda got: b"frame" in got)
        assert b"frame" in got
        assert wants.wanted[0] == Wanted()
    for nonsense in ("no json", "[]", "5", "{}", "null", "[" * 3000, "x" * 5000):
        assert serve(nonsense, is_done=lambda got: False)[1].wanted == [Wanted()]


def test_a_viewer_too_many_is_refused_until_another_one_leaves() -> None:
    async def run() -> None:
        viewers = viewers_of(Wants(), limit=2)
        sockets = [Socket([]) for _ in range(4)]
        tasks = [asyncio.create_task(viewers.serve(socket)) for socket in sockets[:2]]
        while viewers.count < 2:
            await asyncio.sleep(0.001)
        await asyncio.wait_for(viewers.serve(sockets[2]), 20.0)
        code, reason = sockets[2].closed
        assert code == TRY_AGAIN_LATER
        assert "serves 2 pages at a time" in reason
        assert len(reason.encode()) <= 123 - 10
        assert sockets[2].got == []
        assert viewers.count == 2
        sockets[0].done.set()
        await asyncio.wait_for(tasks[0], 20.0)
        tasks.append(asyncio.create_task(viewers.serve(sockets[3])))
        while not sockets[3].got:
            await asyncio.sleep(0.001)
        for socket in sockets:
            socket.done.set()
        await asyncio.wait_for(asyncio.gather(*tasks), 20.0)

    asyncio.run(asyncio.wait_for(run(), 60.0))


POINT = {"floor": "L1", "x": 1.0, "y": 2.0, "heading": 0.0}


class FakeRobot:
    def __init__(self) -> None:
        self.floor, self.version, self.way = "L1", 5, [POINT]
        self.lag_s, self.angles = 0.02, [Posture("A", 3.0, (0.1,))]
        self.asked, self.hangs = list[int](), False

    def path(self) -> list[dict[str, Any]]:
        if self.hangs:
            raise NotReachable("A does not answer")
        return list(self.way)

    def changes(self, since: int) -> FloorUpdate:
        self.path()
        self.asked.append(since)
        start = since if since == self.version else WHOLE
        return FloorUpdate(self.floor, start, self.version, 1.0, 1, [], [], np.empty(0, MOTION), {})

    def postures(self, time_s: float) -> list[Posture]:
        return [posture for posture in self.angles if posture.time > time_s]


def jsons(messages: list[Any]) -> dict[str, Any]:
    return {key: value for message in messages if isinstance(message, dict) for key, value in message.items()}


def frames(messages: list[Any]) -> list[dict[str, Any]]:
    found = [message for message in messages if isinstance(message, bytes)]
    return [json.loads(frame[4 : 4 + struct.unpack("<I", frame[:4])[0]]) for frame in found]


def test_what_a_view_of_a_robot_gets() -> None:
    robot = FakeRobot()
    view = RobotView(lambda: robot, with_pool=False)
    assert view.poll(0.0) == ([{"path": [POINT]}], SLOW_INTERVAL_S)
    assert view.poll(1.0)[0] == []
    robot.way = []
    assert view.poll(2.0)[0] == [{"path": []}]
    assert robot.asked == []  # nobody asked for the pool
    view = RobotView(lambda: robot, with_pool=True)
    first = view.poll(0.0)[0]
    assert [frame["floor"] for frame in frames(first)] == ["L1"]
    assert jsons(first)["pool"] == {"floor": "L1", "lag": 0.02, "joints": {"A": (0.1,)}}
    later = view.poll(1.0)[0]
    assert frames(later) == []
    assert jsons(later)["pool"]["joints"] == {}  # known already
    assert robot.asked == [WHOLE, 5]
    robot.floor = "L2"  # after a ride: the same version number, of another floor
    assert [(frame["floor"], frame["whole"]) for frame in frames(view.poll(1.1)[0])] == [("L2", True)]
    assert robot.asked == [WHOLE, 5, 5, WHOLE]
    view = RobotView(lambda: robot, with_pool=True)
    view.poll(0.0)
    robot.hangs = True
    assert view.poll(1.0) == ([{"problem": "A does not answer"}], RETRY_S)
    assert view.poll(2.0) == ([], RETRY_S)
    robot.hangs = False
    again = view.poll(3.0)[0]
    assert jsons(again)["problem"] == ""
    assert [frame["whole"] for frame in frames(again)] == [True]


def test_a_defect_of_a_view_closes_its_page_and_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    def connect(robot: str) -> FakeRobot:
        raise KeyError("a defect")

    async def run() -> Socket:
        socket: Any = Socket([])
        with contextlib.closing(RobotViews(connect)) as views:
            await asyncio.wait_for(views.serve(socket, "R1", with_pool=False), 20.0)
        return socket

    assert asyncio.run(run()).closed != (0, "")
    assert "a view of 'R1' was disconnected" in caplog.text
    assert "a defect" in caplog.text


def test_paths_are_asked_of_robots_that_may_drive_only_and_split_at_each_change_of_floor() -> None:
    places = (("L1", 1.004, 2.0), ("L1", 3.0, 2.0), ("L2", 3.0, 2.0), ("L1", 9.0, 9.0))
    assert path_by_floor([SimpleNamespace(floor=floor, x=x, y=y) for floor, x, y in places]) == [
        {"floor": "L1", "points": [[1.0, 2.0], [3.0, 2.0]]},
        {"floor": "L2", "points": [[3.0, 2.0]]},
        {"floor": "L1", "points": [[9.0, 9.0]]},
    ]
    assert path_by_floor([]) == []
    for condition, speed, is_driving in (
        *(("IDLE", 0.0, False), ("IDLE", 0.2, True), ("RUNNING", 0.0, True), ("PAUSED", 0.0, True)),
        ("STOPPED", 0.0, False),
    ):
        moving = {"ahead": speed, "left": 0.0, "turn": 0.0}
        assert agent_is_driving({"condition": condition, "actor": {"moving": moving}}) == is_driving


@contextlib.contextmanager
def running(monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], Any]) -> Iterator[tuple[Any, SystemState]]:
    """A naming service with robots, and the state of a system whose robots answer so while they run."""
    orb: Any = SimpleNamespace(robots=[], names=lambda path: list(orb.robots) if path == ROBOTS else [])

    def ask(name: str) -> Any:
        if name not in orb.robots:
            raise NotReachable(name)
        return answer(name)

    monkeypatch.setattr(system_state, "INTERVAL_S", 0.01)
    monkeypatch.setattr(system_state, "server_state", lambda _: dict)
    monkeypatch.setattr(system_state, "robot_state", lambda _, name: lambda: ask(name))
    with contextlib.closing(SystemState(orb)) as state:
        state.start()
        yield orb, state


def test_a_defect_in_a_request_is_logged(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    with running(monkeypatch, lambda name: {}["a defect"]) as (orb, state):
        orb.robots = ["R1"]
        row = eventually(lambda: (row := state.rows()["robots"].get("R1")) and row["problem"] and row)
    assert (row["state"], row["age"], row["problem"]) == (None, None, DEFECT)
    assert "a defect" in caplog.text


def test_robots_that_left_are_forgotten_beyond_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system_state, "MAX_GONE", 2)
    with running(monkeypatch, lambda name: {"name": name}) as (orb, state):

        def row(name: str) -> Any:
            return state.rows()["robots"].get(name, {"state": None, "problem": "", "bound": True})

        for name in ("R0", "R1", "R2", "R3"):
            orb.robots = ["R", name]
            eventually(lambda name=name: row(name)["state"])  # type: ignore[misc]
            orb.robots = ["R"]
            eventually(lambda name=name: row(name)["problem"] and not row(name)["bound"])  # type: ignore[misc]
        assert list(state.rows()["robots"]) == ["R", "R2", "R3"]
