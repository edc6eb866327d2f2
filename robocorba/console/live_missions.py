"""The missions of the building as the console shows them: followed while a viewer wants them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable

from robocorba.console.following import Following
from robocorba.console.sensor_feed import Feed
from robocorba.errors.base import RoboCorbaError
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl

#: Interval between requests for all missions, which show what was removed [s].
ALL_INTERVAL_S = 30.0


class LiveMissions(Following):
    """The missions of a running system, read while a viewer wants them. Thread-safe."""

    def __init__(self, source: RemoteMissionControl, changed: Callable[[], None]) -> None:
        super().__init__("console missions", 0.5, changed)
        self._source = source
        self._lock = threading.Lock()
        self._wanted_by: set[object] = set()
        #: The row of each mission.
        self._rows = Feed()
        #: Version of mission control.
        self._remote_version = 0

    def want(self, viewer: object, is_wanted: bool) -> None:
        """Whether a viewer wants the missions from now on."""
        with self._lock:
            (self._wanted_by.add if is_wanted else self._wanted_by.discard)(viewer)

    def message(self, since: int) -> tuple[int, str]:
        """The present version, and the message that leads a viewer from version `since` there; empty if it is there, or
        no mission is known yet."""
        with self._lock:
            if since == self._rows.version or not self._rows.is_known:
                return since, ""
            version, changes = self._rows.version, self._rows.since(since)
        rows, gone = ",".join(changes.entries.values()), json.dumps(changes.gone)
        head = f'"whole":{json.dumps(changes.is_whole)},"gone":{gone},"now":{time.time()}'
        return version, f'{{"missions":[{rows}],{head}}}'

    def _read_news(self) -> bool:
        if not self._wanted_by:
            return False
        now_s = time.monotonic()
        is_all = now_s >= self._rows.all_at_s
        try:
            states = self._source.missions_since(0 if is_all else self._remote_version)
        except RoboCorbaError:
            self._rows.all_at_s = 0.0  # it may come back with other missions
            raise
        if is_all:
            self._rows.all_at_s = now_s + ALL_INTERVAL_S
        self._remote_version = max((state.version for state in states), default=self._remote_version)
        with self._lock:
            before = self._rows.version if self._rows.is_known else None
            self._rows.update(
                {state.name: {"name": state.name, **state.content.state_json()} for state in states}, is_all
            )
            return self._rows.version != before
