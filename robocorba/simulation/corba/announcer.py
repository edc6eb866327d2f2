"""Publishes the events floor.changed and simulation.* of the simulation server on its event channel.

Changes of a floor are also published as structs of the IDL, of type typed.floor_changed, while somebody asks for them:
not every language reads msgpack."""

from __future__ import annotations

import contextlib
import logging
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors.events import EventError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import EventClient
from robocorba.map_editor.spatial.floor_format import as_map
from robocorba.map_editor.spatial.floor_update import WHOLE, FloorUpdate
from robocorba.orb.orb import Orb
from robocorba.simulation.corba import floors
from robocorba.simulation.emergency_stops import StopEvent
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.stubs import RoboCorba
from robocorba.system.names import STOP_EVENT
from robocorba.system.repeating import Repeating

#: Maximum number of simulation events that wait; beyond that the oldest are dropped.
MAX_WAITING = 10_000
#: Expiry of the published events [s]: older states of a floor are useless.
EXPIRY_S = 2.0
#: How long changes of a floor are published as structs after somebody has asked for them [s].
TYPED_S = 30.0
_log = logging.getLogger(__name__)


class Announcer:
    """Publishes at the event channel `channel`. Events are lost while the channel is not reachable."""

    def __init__(self, orb: Orb, channel: str, database: OmniDatabase) -> None:
        self._orb, self._channel, self._database = orb, channel, database
        self._client: EventClient | None = None
        self._versions: dict[str, int] = {}
        #: Floors that somebody has asked for as structs since the last publication.
        self._asked: deque[str] = deque(maxlen=MAX_WAITING)
        #: Floors that are published as structs: the version that was published last, and until when [s, monotonic].
        self._typed: dict[str, tuple[int, float]] = {}
        self._waiting: deque[SimulationEvent] = deque(maxlen=MAX_WAITING)
        self._stops: deque[StopEvent] = deque(maxlen=MAX_WAITING)
        self._repeating = Repeating("announcer", self._publish, 0.1)  # interval of changes of floors [s]
        self._is_failing = False

    def start(self) -> None:
        self._repeating.start()

    def announce(self, event: SimulationEvent) -> None:
        """Queue an event for the next publication; does not block."""
        self._waiting.append(event)

    def announce_stop(self, robots: Sequence[str], reason: str) -> None:
        """Publish an emergency stop of these robots, without names of all, as soon as possible; does not block."""
        self._stops.append(StopEvent(robots=list(robots), reason=reason))
        self._repeating.wake()

    def publish_typed(self, floor: str) -> float:
        """Publish changes of a floor as structs too, and the whole floor at first. Returns for how long [s]."""
        self._asked.append(floor)
        return TYPED_S

    def close(self) -> None:
        self._repeating.close()
        if self._client:
            self._client.close()

    def _publish(self) -> None:
        events = [self._waiting.popleft() for _ in range(len(self._waiting))]
        known = [(floor, self._versions.get(floor, WHOLE)) for floor in self._database.floors]
        updates = [update for floor, version in known if (update := self._changes(floor, version))]
        self._versions.update((update.floor, update.version) for update in updates)
        stops = [self._stops.popleft() for _ in range(len(self._stops))]
        self._take_asked()
        if not (events or updates or stops or self._typed):
            return
        try:
            if self._client is None:
                self._client = EventClient(self._orb, self._channel, "simulation", timeout_s=0.5)
            if stops:
                self._push(self._client, "simulation", STOP_EVENT, stops)
            for update in updates:
                self._push(self._client, update.floor, "floor.changed", [as_map(update)])
            for floor in self._typed:
                self._push_typed(self._client, floor)
            for kind in {event.kind for event in events}:
                payloads = [payload_of(event) for event in events if event.kind == kind]
                self._push(self._client, "simulation", f"simulation.{kind.replace(' ', '_')}", payloads)
            self._is_failing = False
        except (NotReachable, EventError) as error:
            self._client = None
            if not self._is_failing:
                _log.warning("cannot publish on event channel %s: %s", self._channel, error)
            self._is_failing = True

    @staticmethod
    def _push(client: EventClient, source: str, kind: str, payloads: Sequence[Any]) -> None:
        client.source = source
        client.push_many(kind, payloads, expiry_s=EXPIRY_S, retry_s=0.0)

    def _take_asked(self) -> None:
        """Floors that somebody has asked for as structs begin with the whole floor; those that nobody asks for end."""
        now = time.monotonic()
        for _ in range(len(self._asked)):
            self._typed[self._asked.popleft()] = WHOLE, now + TYPED_S
        self._typed = {floor: (version, until) for floor, (version, until) in self._typed.items() if now < until}

    def _push_typed(self, client: EventClient, floor: str) -> None:
        version, until = self._typed[floor]
        if update := self._changes(floor, version):
            value = CORBA.Any(RoboCorba._tc_TypedFloorUpdate, floors.typed_update(update))
            client.source = floor
            client.push_any("typed.floor_changed", value, expiry_s=EXPIRY_S, retry_s=0.0)
            self._typed[floor] = update.version, until

    def _changes(self, floor: str, since: int) -> FloorUpdate | None:
        """The changes of a floor since a version; None without any, or without the floor."""
        with contextlib.suppress(UnknownFloor):
            update = self._database.changes(floor, since)
            return update if update.version != since else None
        return None


def payload_of(event: SimulationEvent) -> dict[str, Any]:
    """The payload of the event of the channel."""
    return {name: value for name, value in event._asdict().items() if value is not None}
