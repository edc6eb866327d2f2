"""What the monitor shows beside the floors: the state of the system, robots that have left, the times to look back."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from robocorba.console.contacts import Contact, contacts_since
from robocorba.console.happenings import Happenings
from robocorba.console.history import KEPT_S, History
from robocorba.console.system_state import SystemState
from robocorba.map_editor.model import Building
from robocorba.system.repeating import Repeating

#: Maximum number of robots that are remembered after they have logged off.
MAX_GONE = 500


class MonitorState:
    """Adds to the state of the system what was seen before, from `start` to `close`. Thread-safe.

    building: returns the map, whose walls name what robots collide with."""

    def __init__(
        self, state: SystemState, history: History, building: Callable[[], Building] = lambda: Building("")
    ) -> None:
        self._state, self._history, self._building = state, history, building
        self.happenings = Happenings(self._contacts)
        self._lock = threading.Lock()
        #: The last record of each robot that has logged on, and when it was there [s, monotonic], the oldest first.
        self._clients: dict[str, tuple[dict[str, Any], float]] = {}
        self._task = Repeating("console happenings", self.update, 0.5)

    def start(self) -> None:
        self._state.start()
        self._task.start()

    def close(self) -> None:
        self._task.close()
        self._state.close()

    def update(self) -> None:
        """Remember who is there now, and notice what has changed."""
        rows = self._state.rows()
        self.happenings.note(rows, time.monotonic())
        self._remember(rows)

    def forget(self, robot: str) -> None:
        """Drop a robot that has left."""
        self._state.forget(robot)
        with self._lock:
            self._clients.pop(robot, None)

    def rows(self) -> dict[str, Any]:
        """As SystemState.rows, with more members.

        `gone`: the last `client` record of each robot that has logged off, with its `age` [s]. `past`: POSIX times
        between which one can look back [s]; `gaps`: those between which no console was there. `happenings`: number of
        the last one."""
        rows = self._state.rows()
        now_s, monotonic_s = time.time(), time.monotonic()
        present = {client["name"] for client in (rows["server"]["state"] or {"clients": ()})["clients"]}
        with self._lock:
            gone = {
                name: {"client": client, "age": monotonic_s - seen_s}
                for name, (client, seen_s) in self._clients.items()
                if name not in present
            }
        began_s, _ = self._history.span()
        past = [max(began_s, now_s - KEPT_S), now_s] if began_s else [now_s, now_s]
        return {**rows, "gone": gone, "past": past, "gaps": self._history.gaps(), "happenings": self.happenings.last}

    def _contacts(self, monotonic_s: float) -> list[Contact]:
        """Who has begun to touch whom just before this time: a collision is counted at most 1.5 s after the bodies have
        met."""
        at_s = monotonic_s + self._history.epoch()
        return contacts_since(self._history, self._building(), at_s - 1.5, at_s)

    def _remember(self, rows: dict[str, Any]) -> None:
        server = rows["server"]
        if not server["state"] or server["problem"]:
            return
        now_s = time.monotonic()
        with self._lock:
            for client in server["state"]["clients"]:
                self._clients.pop(client["name"], None)
                self._clients[client["name"]] = client, now_s
            while len(self._clients) > MAX_GONE:
                del self._clients[next(iter(self._clients))]
