"""Publishes the events floor.changed and simulation.* of the simulation server on its event channel."""

from __future__ import annotations

import contextlib
import logging
from collections import deque
from typing import Any

from robocorba.corba.event_client import EventClient
from robocorba.corba.orb import Orb
from robocorba.errors.events import EventError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.repeating import Repeating
from robocorba.simulation.building import SimulationEvent
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.spatial.floor_format import as_map
from robocorba.spatial.floor_update import FloorUpdate

#: Interval at which changes of floors are published [s].
PUBLISH_INTERVAL_S = 0.1
#: Timeout for finding the channel [s].
RESOLVE_TIMEOUT_S = 0.5
#: Maximum number of happenings that wait; beyond that the oldest are dropped.
MAX_WAITING = 10_000
#: Expiry of the published events [s]; older states of a floor are useless.
EXPIRY_S = 2.0
SOURCE = "simulation"
_log = logging.getLogger(__name__)


class Announcer:
    """Pushes to the channel `channel`. Events are lost while the channel is not reachable."""

    def __init__(self, orb: Orb, channel: str, database: OmniDatabase) -> None:
        self._orb, self._channel, self._database = orb, channel, database
        self._events: EventClient | None = None
        self._versions: dict[str, int] = {}
        self._happened: deque[SimulationEvent] = deque(maxlen=MAX_WAITING)
        self._repeating = Repeating("announcer", self._publish, PUBLISH_INTERVAL_S)
        self._is_failing = False

    def start(self) -> None:
        self._repeating.start()

    def happened(self, happening: SimulationEvent) -> None:
        """Queue a happening for the next publication; does not block."""
        self._happened.append(happening)

    def close(self) -> None:
        self._repeating.close()
        if self._events:
            self._events.close()

    def _publish(self) -> None:
        happened = []
        while self._happened:
            happened.append(self._happened.popleft())
        updates = [update for floor in self._database.floors if (update := self._changes(floor))]
        if not happened and not updates:
            return
        try:
            if self._events is None:
                self._events = EventClient(self._orb, self._channel, SOURCE, RESOLVE_TIMEOUT_S)
            for update in updates:
                self._push(update.floor, "floor.changed", [as_map(update)])
            for kind in {happening.kind for happening in happened}:
                found = [happening._asdict() for happening in happened if happening.kind == kind]
                self._push(SOURCE, f"simulation.{kind.replace(' ', '_')}", found)
            self._is_failing = False
        except (NotReachable, EventError) as error:
            self._events = None
            if not self._is_failing:
                _log.warning("cannot publish on event channel %s: %s", self._channel, error)
            self._is_failing = True

    def _push(self, source: str, kind: str, payloads: list[Any]) -> None:
        assert self._events
        self._events.source = source
        self._events.push_many(kind, payloads, expiry_s=EXPIRY_S, retry_s=0.0)

    def _changes(self, floor: str) -> FloorUpdate | None:
        """The changes of a floor since the last call; None without changes, the whole floor in the first call."""
        with contextlib.suppress(UnknownFloor):
            since = self._versions.get(floor)
            update = self._database.changes(floor, since or 0)
            self._versions[floor] = update.version
            return update if since != update.version else None
        return None
