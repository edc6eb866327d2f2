"""The WebSocket of each viewer: frames of the floors that it watches, and news of everything else as JSON."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from robocorba.console.live_floors import LiveFloors
from robocorba.console.live_missions import LiveMissions
from robocorba.console.live_plans import LivePlans
from robocorba.console.live_sensors import LiveSensors, Topic
from robocorba.console.monitor_state import MonitorState
from robocorba.console.sensor_feed import NOTHING
from robocorba.console.settings import DEFAULT_VIEWERS
from robocorba.errors.paths import UnknownFloor

_log = logging.getLogger(__name__)

#: Interval between messages with the state of servers and robots [s].
STATE_INTERVAL_S = 0.5
#: WebSocket close code for "try again later", of a viewer too many; its reason has at most 123 bytes.
TRY_AGAIN_LATER = 1013
#: The missions, beside the topics of LiveSensors.
MISSIONS: Topic = ("missions", "")


class Viewers:
    """All viewers of a console, at most `limit`.

    `attach` is called in the thread of the event loop, `notify` in any."""

    def __init__(self, state: MonitorState, limit: int = DEFAULT_VIEWERS) -> None:
        self._state, self._limit = state, limit
        self._loop: asyncio.AbstractEventLoop | None = None
        self._viewers: set[Viewer] = set()
        self._state_text: tuple[float, str] = 0.0, ""
        self.floors: LiveFloors
        self.plans: LivePlans
        self.sensors: LiveSensors
        self.missions: LiveMissions

    def attach(self, floors: LiveFloors, plans: LivePlans, sensors: LiveSensors, missions: LiveMissions) -> None:
        """Serve viewers of these floors, plans, sensors and missions with the running event loop."""
        self.floors, self.plans, self.sensors, self.missions = floors, plans, sensors, missions
        self._loop = asyncio.get_running_loop()

    @property
    def count(self) -> int:
        return len(self._viewers)

    def notify(self) -> None:
        """Wake all viewers: there is something new."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has been closed
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for viewer in self._viewers:
            viewer.news.set()

    def state_text(self) -> str:
        """The state as a message; the same one for all viewers within STATE_INTERVAL_S."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._state_text[0] >= STATE_INTERVAL_S * 0.9:
            self._state_text = now_s, json.dumps({"state": self._state.rows()}, separators=(",", ":"))
        return self._state_text[1]

    def overview(self) -> str:
        """Floors, map version and problems as a message."""
        problems = {
            "floors": self.floors.problem,
            "map": self.plans.problem,
            "sensors": self.sensors.problem,
            "missions": self.missions.problem,
        }
        return json.dumps({"floors": self.floors.names, "map": self.plans.version, "problems": problems})

    async def serve(self, socket: WebSocket) -> None:
        """Serve a viewer until it leaves; one beyond the limit is refused."""
        await socket.accept()  # browsers get the reason of a refusal only after this
        if self.count >= self._limit:
            reason = f"this console serves {self._limit} pages at a time; close one, or start it with more --viewers"
            await socket.close(TRY_AGAIN_LATER, reason)
            return
        viewer = Viewer(self, socket)
        self._viewers.add(viewer)
        try:
            await serve_page(socket, "a viewer", viewer.send(), viewer.receive())
        finally:
            self._viewers.discard(viewer)
            self.floors.watch(viewer, ())
            self.sensors.want(viewer, ())
            self.missions.want(viewer, False)

    def message(self, topic: Topic, version: int) -> tuple[int, str]:
        """The present version of a topic, and the message that leads a viewer from `version` there; empty if it is
        there."""
        return self.missions.message(version) if topic == MISSIONS else self.sensors.message(topic, version)


async def serve_page(socket: WebSocket, name: str, *parts: Coroutine[Any, Any, None]) -> None:
    """Run the parts of a page's connection until one of them ends, as when the page leaves; then close the socket.
    name: in the log, if that is a defect."""
    tasks = [asyncio.create_task(part) for part in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            error = task.exception()
            if error is not None and not isinstance(error, WebSocketDisconnect | RuntimeError):
                _log.error("%s was disconnected", name, exc_info=error)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # it has left already
            await socket.close()


class Viewer:
    """One browser page. A slow one skips frames: `send` waits for its socket."""

    def __init__(self, viewers: Viewers, socket: WebSocket) -> None:
        self._viewers, self._socket = viewers, socket
        self.news = asyncio.Event()
        #: Version of each watched floor that the browser has.
        self._sent: dict[str, int] = {}
        #: The same of all else that it wants.
        self._versions: dict[Topic, int] = {}
        self._overview = ""

    async def send(self) -> None:
        loop = asyncio.get_running_loop()
        next_state_s = 0.0
        while True:
            overview = self._viewers.overview()
            if overview != self._overview:
                await self._socket.send_text(overview)
                self._overview = overview
            for name in list(self._sent):
                await self._send_floor(name)
            await self._send_news()
            if loop.time() >= next_state_s:
                next_state_s = loop.time() + STATE_INTERVAL_S
                await self._socket.send_text(self._viewers.state_text())
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self.news.wait(), max(0.0, next_state_s - loop.time()))
            self.news.clear()

    async def _send_floor(self, name: str) -> None:
        try:
            version, frame = self._viewers.floors.floor(name).frame_since(self._sent[name])
        except UnknownFloor:
            return  # it does not exist yet, or any more
        if frame:
            await self._socket.send_bytes(frame)
            if name in self._sent:
                self._sent[name] = version

    async def _send_news(self) -> None:
        for topic, sent in list(self._versions.items()):
            version, text = self._viewers.message(topic, sent)
            if text:
                await self._socket.send_text(text)
                if topic in self._versions:
                    self._versions[topic] = version

    async def receive(self) -> None:
        while True:
            text = await self._socket.receive_text()
            if len(text) > 4096:
                return
            try:
                wanted = json.loads(text)
                names, robots = _names(wanted["watch"]), _names(wanted.get("robots"))
                topics = [(kind, name) for kind in ("scans", "postures") for name in _names(wanted.get(kind))]
                topics += [("reservations", "")] if wanted.get("reservations") is True else []
                wants_missions = wanted.get("missions") is True
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
                return
            self._sent = {name: self._sent.get(name, 0) for name in names}
            self._viewers.floors.watch(self, names)
            self._viewers.sensors.want(self, topics, robots)
            self._viewers.missions.want(self, wants_missions)
            all_topics = [*topics, MISSIONS] if wants_missions else topics
            self._versions = {topic: self._versions.get(topic, NOTHING) for topic in all_topics}
            self.news.set()


def _names(names: Any) -> list[str]:
    """The names of floors or robots in a message, at most 64; none if it is no list."""
    return [name for name in names if isinstance(name, str)][:64] if isinstance(names, list) else []
