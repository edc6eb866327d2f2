"""The missions of the building as the console shows them: followed while a viewer wants them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from robocorba.errors.base import RoboCorbaError
from robocorba.simulation.mission_record import MissionState
from robocorba.system.repeating import Repeating

#: Interval between requests for changes [s], and between requests for all missions, which show what was removed.
INTERVAL_S, ALL_INTERVAL_S = 0.5, 30.0
Row = dict[str, Any]


class MissionSource(Protocol):
    """Mission control, as the console reads it."""

    def missions_since(self, version: int) -> list[MissionState]:
        """The missions that changed after a version; with 0 all. Raises NotReachable."""


class LiveMissions:
    """Follows the missions of a running system from `start` to `close`, while a viewer wants them. Thread-safe.

    changed: called in the thread that follows, after changes of the missions or of `problem`."""

    def __init__(self, source: MissionSource, changed: Callable[[], None]) -> None:
        self._source, self._changed = source, changed
        self._lock = threading.Lock()
        self._wanted_by: set[object] = set()
        #: Each mission's row, with the console's own version in which it changed, oldest change first.
        self._rows: dict[str, tuple[int, Row]] = {}
        #: The console's version; the one after the last removal; the version of mission control.
        self._version = self._oldest = 0
        self._remote_version = 0
        self._all_at_s = 0.0
        #: Why mission control does not answer; empty while it does, or is not asked.
        self.problem = ""
        self._task = Repeating("console missions", self.follow, INTERVAL_S)

    def start(self) -> None:
        self._task.start()

    def close(self) -> None:
        self._task.close()

    def want(self, viewer: object, is_wanted: bool) -> None:
        """Whether a viewer wants the missions from now on."""
        with self._lock:
            (self._wanted_by.add if is_wanted else self._wanted_by.discard)(viewer)

    def message(self, since: int) -> tuple[int, str]:
        """The present version, and the rows that changed after version `since` as a message for browsers, empty if
        there are none. A viewer that has nothing yet says -1."""
        with self._lock:
            version, is_whole = self._version, since < self._oldest
            if since == version or not version:
                return version if version else since, ""
            rows = [row for changed_in, row in self._rows.values() if is_whole or changed_in > since]
        news = {"missions": rows, "whole": is_whole, "version": version, "now": time.time()}
        return version, json.dumps(news, separators=(",", ":"))

    def follow(self) -> None:
        """Read what has changed, if a viewer wants it."""
        if not self._wanted_by:
            return
        now_s = time.monotonic()
        is_all = not self._version or now_s >= self._all_at_s
        try:
            states = self._source.missions_since(0 if is_all else self._remote_version)
        except RoboCorbaError as error:
            self._all_at_s = 0.0  # it may come back with other missions
            self._set_problem(str(error))
            return
        if is_all:
            self._all_at_s = now_s + ALL_INTERVAL_S
        if self._apply(states, is_all):
            self._changed()
        self._set_problem("")

    def _apply(self, states: list[MissionState], is_all: bool) -> bool:
        """Whether the rows have changed."""
        self._remote_version = max((state.version for state in states), default=self._remote_version)
        rows = {state.name: _row(state) for state in states}
        with self._lock:
            removed = self._rows.keys() - rows.keys() if is_all else set()
            changed = {name: row for name, row in rows.items() if name not in self._rows or self._rows[name][1] != row}
            if not (removed or changed) and self._version:
                return False
            self._version += 1
            if removed or self._version == 1:
                self._oldest = self._version
            for name in removed | changed.keys():
                self._rows.pop(name, None)
            self._rows.update((name, (self._version, row)) for name, row in changed.items())
            return True

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._changed()


class MissionFeed:
    """The missions as one viewer gets them."""

    def __init__(self, missions: LiveMissions | None) -> None:
        self._missions, self._sent = missions, -1
        self._is_wanted = False

    def want(self, is_wanted: bool) -> None:
        """Whether the viewer wants them from now on; after an interruption it gets all of them again."""
        if self._missions and is_wanted != self._is_wanted:
            self._is_wanted, self._sent = is_wanted, -1
            self._missions.want(self, is_wanted)

    def message(self) -> str:
        """What the viewer does not have yet, as a message; empty for nothing."""
        if not self._missions or not self._is_wanted:
            return ""
        self._sent, message = self._missions.message(self._sent)
        return message


def _row(state: MissionState) -> Row:
    return {"name": state.name, **state.content.state_json()}
