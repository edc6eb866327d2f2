"""What the 3D page shows of one robot beside the live floors: the floor in its data pool, and the path that it drives.

A WebSocket for each page and robot: frames as in `frames.py`, and JSON: {"path": [{"floor", "x", "y", "heading"},
...]}, {"pool": {"floor", "lag", "joints": {robot: [rad]}}}, {"problem": why there is nothing newer}. Only changes are
sent."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from fastapi import WebSocket

from robocorba.console.frames import update_frame
from robocorba.console.viewers import serve_page
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.floor_update import WHOLE
from robocorba.robot.corba.remote_data_pool import RemotePool

#: Interval between requests for path and postures [s].
SLOW_INTERVAL_S = 0.4
#: Pause after a robot did not answer [s].
RETRY_S = 1.0
#: Pages that may watch a robot at the same time.
MAX_VIEWS = 32
Message = bytes | dict[str, Any]


class RobotView:
    """What has changed of a robot since the last call; `poll` blocks. with_pool: also the floor in its data pool."""

    def __init__(self, connect: Callable[[], RemotePool], with_pool: bool) -> None:
        self._connect, self._with_pool = connect, with_pool
        self._robot: RemotePool | None = None
        self._path: list[dict[str, Any]] | None = None
        self._version, self._floor, self._posture_time = WHOLE, "", -1.0
        self._problem = ""
        self._next_slow_s = 0.0

    def poll(self, now_s: float) -> tuple[list[Message], float]:
        """New messages, and the pause before the next call [s]."""
        messages: list[Message] = []
        try:
            if self._robot is None:
                self._robot = self._connect()
            is_slow_due = now_s >= self._next_slow_s
            if self._with_pool:
                messages += self._pool_frames(self._robot)
            if is_slow_due:
                self._next_slow_s = now_s + SLOW_INTERVAL_S
                messages += self._slow(self._robot)
            problem, pause_s = "", 0.1 if self._with_pool else SLOW_INTERVAL_S
        except RoboCorbaError as error:
            self._robot, self._version, self._posture_time = None, WHOLE, -1.0
            problem, pause_s = str(error), RETRY_S
        if problem != self._problem:
            self._problem = problem
            messages.append({"problem": problem})
        return messages, pause_s

    def _pool_frames(self, robot: RemotePool) -> list[Message]:
        update = robot.changes(self._version)
        if update.floor != self._floor and update.since != WHOLE:  # versions of two floors don't compare
            update = robot.changes(WHOLE)
        if (update.floor, update.version) == (self._floor, self._version):
            return []
        self._floor, self._version = update.floor, update.version
        return [update_frame(update)]

    def _slow(self, robot: RemotePool) -> list[Message]:
        messages: list[Message] = []
        path = robot.path()
        if path != self._path:
            self._path = path
            messages.append({"path": path})
        if self._with_pool:
            postures = robot.postures(self._posture_time)
            self._posture_time = max((posture.time for posture in postures), default=self._posture_time)
            joints = {posture.robot: posture.joints for posture in postures}
            messages.append({"pool": {"floor": robot.floor, "lag": robot.lag_s, "joints": joints}})
        return messages


class RobotViews:
    """Serves the views of all pages until `close`. connect: finds a robot by name; raises NotReachable."""

    def __init__(self, connect: Callable[[str], RemotePool]) -> None:
        self._connect = connect
        self._count = 0
        # Threads of its own: a robot that hangs holds up its own pages only.
        self._threads = ThreadPoolExecutor(MAX_VIEWS, "console robot view")

    def close(self) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def serve(self, socket: WebSocket, robot: str, with_pool: bool) -> None:
        """Serve a page until it leaves."""
        await socket.accept()
        if not 0 < len(robot) <= 200:
            await socket.close(1008, "this is no robot's name")
            return
        if self._count >= MAX_VIEWS:
            await socket.close(
                1013, f"this console shows the robots' paths and data pools on {MAX_VIEWS} pages at a time"
            )
            return
        self._count += 1
        view = RobotView(lambda: self._connect(robot), with_pool)
        try:
            await serve_page(socket, f"a view of {robot!r}", self._send(socket, view), _until_left(socket))
        finally:
            self._count -= 1

    async def _send(self, socket: WebSocket, view: RobotView) -> None:
        loop = asyncio.get_running_loop()
        while True:
            messages, pause_s = await loop.run_in_executor(self._threads, view.poll, loop.time())
            for message in messages:
                if isinstance(message, bytes):
                    await socket.send_bytes(message)
                else:
                    await socket.send_text(json.dumps(message, separators=(",", ":")))
            await asyncio.sleep(pause_s)


async def _until_left(socket: WebSocket) -> None:
    """Returns by an exception when the page leaves; it has nothing to say."""
    while True:
        await socket.receive_text()
