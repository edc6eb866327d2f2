"""What a viewer is sent over its WebSocket, by the messages that it sends."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from robocorba.console.live_sensors import Wanted
from robocorba.console.sensor_feed import NOTHING
from robocorba.console.viewers import TRY_AGAIN_LATER, Viewers


class State:
    def rows(self) -> dict[str, Any]:
        return {}


class Floors:
    """The floors and the map, empty."""

    names: tuple[str, ...] = ()
    problem = ""
    version = 1

    def __init__(self) -> None:
        self.watched: list[list[str]] = []

    def watch(self, viewer: object, floors: Any) -> None:
        self.watched.append(list(floors))

    def floor(self, name: str) -> Floors:
        return self

    def frame_since(self, version: int) -> tuple[int, bytes]:
        return 1, b"" if version else b"frame"


class Sensors:
    """Sensors with news on each floor, once."""

    problem = ""

    def __init__(self) -> None:
        self.wanted: list[Wanted] = []

    def want(self, viewer: object, wanted: Wanted) -> None:
        self.wanted.append(wanted)

    def scans_message(self, floor: str, version: int) -> tuple[int, str]:
        return 7, json.dumps({"scans": floor}) if version == NOTHING else ""

    def postures_message(self, floor: str, version: int) -> tuple[int, str]:
        return 7, json.dumps({"postures": floor}) if version == NOTHING else ""

    def reservations_message(self, version: int) -> tuple[int, str]:
        return 7, json.dumps({"reservations": []}) if version == NOTHING else ""


class Socket:
    """A browser that sends what a test gives it; it leaves when `is_done` of what it got."""

    def __init__(self, messages: list[str], is_done: Callable[[list[Any]], bool]) -> None:
        self._messages, self._is_done = messages, is_done
        self.got: list[Any] = []
        self.closed = 0, ""
        self.done = asyncio.Event()

    async def accept(self) -> None: ...

    async def close(self, code: int = 1000, reason: str = "") -> None:
        self.closed = code, reason

    async def receive_text(self) -> str:
        if self._messages:
            return self._messages.pop(0)
        await self.done.wait()
        raise RuntimeError("left")

    async def send_text(self, text: str) -> None:
        self._take(json.loads(text))

    async def send_bytes(self, frame: bytes) -> None:
        self._take(frame)

    def _take(self, message: Any) -> None:
        self.got.append(message)
        if self._is_done(self.got):
            self.done.set()


def serve(*messages: str, is_done: Callable[[list[Any]], bool]) -> tuple[list[Any], Sensors, Floors]:
    """What the browser gets until it leaves, and what was wanted of sensors and floors."""
    sensors, floors = Sensors(), Floors()

    async def run() -> list[Any]:
        viewers: Any = Viewers(State())
        viewers.attach(floors, floors, sensors)
        socket: Any = Socket(list(messages), is_done)
        await asyncio.wait_for(viewers.serve(socket), 20.0)
        assert viewers.count == 0
        return list(socket.got)

    return asyncio.run(run()), sensors, floors


def test_a_viewer_gets_what_it_wants() -> None:
    wanted = {"watch": ["L1"], "scans": ["L1", "L2"], "postures": ["L2"], "reservations": True}
    got, sensors, floors = serve(json.dumps(wanted), is_done=lambda got: {"reservations": []} in got)
    for message in (b"frame", {"scans": "L1"}, {"scans": "L2"}, {"postures": "L2"}, {"reservations": []}):
        assert got.count(message) == 1
    assert sensors.wanted == [Wanted(("L1", "L2"), ("L2",), True), Wanted()]
    assert floors.watched == [["L1"], []]


@pytest.mark.parametrize("others", [{}, {"scans": False}, {"scans": None, "postures": "L1", "reservations": 1}])
def test_watching_alone_is_enough(others: dict[str, Any]) -> None:
    got, sensors, _ = serve(json.dumps({"watch": ["L1"], **others}), is_done=lambda got: b"frame" in got)
    assert b"frame" in got
    assert sensors.wanted[0] == Wanted()


@pytest.mark.parametrize("message", ["no json", "[]", "5", "{}", "null", "[" * 3000, "x" * 5000])
def test_a_viewer_that_sends_nonsense_is_disconnected(message: str) -> None:
    _, sensors, _ = serve(message, is_done=lambda got: False)
    assert sensors.wanted == [Wanted()]


def test_a_viewer_too_many_is_refused_until_another_one_leaves() -> None:
    async def run() -> None:
        viewers: Any = Viewers(State(), limit=2)
        viewers.attach(Floors(), Floors(), Sensors())
        sockets: list[Any] = [Socket([], lambda got: False) for _ in range(4)]
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
