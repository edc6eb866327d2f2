"""Publishes the events floor.changed and simulation.* of the simulation server on its event channel."""

from __future__ import annotations

import contextlib
import logging
from collections import deque
from collections.abc import Sequence
from typing import Any

from robocorba.corba.event_client import EventClient
from robocorba.corba.orb import Orb
from robocorba.errors.events import EventError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.names import STOP_EVENT
from robocorba.repeating import Repeating
from robocorba.simulation.building import SimulationEvent
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.spatial.floor_format import as_map
from robocorba.spatial.floor_update import FloorUpdate

#: Interval at which changes of floors are published [s].
PUBLISH_INTERVAL_S = 0.1
#: Timeout to resolve the channel [s].
RESOLVE_TIMEOUT_S = 0.5
#: Maximum number of simulation events that wait; beyond that the oldest are dropped.
MAX_WAITING = 10_000
#: Expiry of the published events [s]: older states of a floor are useless.
EXPIRY_S = 2.0
SOURCE = "simulation"
_log = logging.getLogger(__name__)


class Announcer:
    """Publishes at the event channel `channel`. Events are lost while the channel is not reachable."""

    def __init__(self, orb: Orb, channel: str, database: OmniDatabase) -> None:
        self._orb, self._channel, self._database = orb, channel, database
        self._client: EventClient | None = None
        self._versions: dict[str, int] = {}
        self._waiting: deque[SimulationEvent] = deque(maxlen=MAX_WAITING)
        self._stops: deque[dict[str, Any]] = deque(maxlen=MAX_WAITING)
        self._repeating = Repeating("announcer", self._publish, PUBLISH_INTERVAL_S)
        self._is_failing = False

    def start(self) -> None:
        self._repeating.start()

    def announce(self, event: SimulationEvent) -> None:
        """Queue an event for the next publication; does not block."""
        self._waiting.append(event)

    def announce_stop(self, robots: Sequence[str], reason: str) -> None:
        """Publish an emergency stop of these robots, without names of all, as soon as possible; does not block."""
        self._stops.append({"robots": list(robots), "reason": reason})
        self._repeating.wake()

    def close(self) -> None:
        self._repeating.close()
        if self._client:
            self._client.close()

    def _publish(self) -> None:
        events = [self._waiting.popleft() for _ in range(len(self._waiting))]
        updates = [update for floor in self._database.floors if (update := self._changes(floor))]
        stops = [self._stops.popleft() for _ in range(len(self._stops))]
        if not (events or updates or stops):
            return
        try:
            if self._client is None:
                self._client = EventClient(self._orb, self._channel, SOURCE, RESOLVE_TIMEOUT_S)
            if stops:
                self._push(SOURCE, STOP_EVENT, stops)
            for update in updates:
                self._push(update.floor, "floor.changed", [as_map(update)])
            for kind in {event.kind for event in events}:
                payloads = [_payload(event) for event in events if event.kind == kind]
                self._push(SOURCE, f"simulation.{kind.replace(' ', '_')}", payloads)
            self._is_failing = False
        except (NotReachable, EventError) as error:
            self._client = None
            if not self._is_failing:
                _log.warning("cannot publish on event channel %s: %s", self._channel, error)
            self._is_failing = True

    def _push(self, source: str, kind: str, payloads: list[Any]) -> None:
        assert self._client
        self._client.source = source
        self._client.push_many(kind, payloads, expiry_s=EXPIRY_S, retry_s=0.0)

    def _changes(self, floor: str) -> FloorUpdate | None:
        """The changes of a floor since the last call; None without changes, the whole floor in the first call."""
        with contextlib.suppress(UnknownFloor):
            since = self._versions.get(floor)
            update = self._database.changes(floor, since or 0)
            self._versions[floor] = update.version
            return update if since != update.version else None
        return None


def _payload(event: SimulationEvent) -> dict[str, Any]:
    return {name: value for name, value in event._asdict().items() if value is not None}
