"""Tells the event channel of the simulation server what happens: events of type floor.changed and simulation.*."""

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
from robocorba.simulation.building import Happening
from robocorba.simulation.omni_database import OmniDatabase
from robocorba.spatial.floor_format import as_map
from robocorba.spatial.floor_update import FloorUpdate

#: Floors that changed are told so often, s.
EVERY_S = 0.1
#: How long a channel is waited for, s, and happenings that wait meanwhile.
CHANNEL_LIMIT_S, MOST_WAITING = 0.5, 10_000
#: After this many seconds nobody wants to know any more how a floor was.
EXPIRY_S = 2.0
SOURCE = "simulation"
_log = logging.getLogger(__name__)


class Announcer:
    """Pushes to the channel called `channel`; what a channel that is away misses is lost."""

    def __init__(self, orb: Orb, channel: str, database: OmniDatabase) -> None:
        self._orb, self._channel, self._database = orb, channel, database
        self._events: EventClient | None = None
        self._versions: dict[str, int] = {}
        self._happened: deque[Happening] = deque(maxlen=MOST_WAITING)
        self._repeating = Repeating("announcer", self._announce, EVERY_S)
        self._is_told = False

    def start(self) -> None:
        self._repeating.start()

    def happened(self, happening: Happening) -> None:
        """Does not wait."""
        self._happened.append(happening)

    def close(self) -> None:
        self._repeating.close()
        if self._events:
            self._events.close()

    def _announce(self) -> None:
        happened = []
        while self._happened:
            happened.append(self._happened.popleft())
        updates = [update for floor in self._database.floors if (update := self._changes(floor))]
        if not happened and not updates:
            return
        try:
            if self._events is None:
                self._events = EventClient(self._orb, self._channel, SOURCE, CHANNEL_LIMIT_S)
            for update in updates:
                self._push(update.floor, "floor.changed", [as_map(update)])
            for kind in {happening.kind for happening in happened}:
                found = [happening._asdict() for happening in happened if happening.kind == kind]
                self._push(SOURCE, f"simulation.{kind.replace(' ', '_')}", found)
            self._is_told = False
        except (NotReachable, EventError) as wrong:
            self._events = None
            if not self._is_told:
                _log.warning("event channel %s is not told what happens: %s", self._channel, wrong)
            self._is_told = True

    def _push(self, source: str, kind: str, payloads: list[Any]) -> None:
        assert self._events
        self._events.source = source
        self._events.push_many(kind, payloads, expiry_s=EXPIRY_S, retry_s=0.0)

    def _changes(self, floor: str) -> FloorUpdate | None:
        """What changed since it was told last; at first the whole floor."""
        with contextlib.suppress(UnknownFloor):
            since = self._versions.get(floor)
            update = self._database.changes(floor, since or 0)
            self._versions[floor] = update.version
            return update if since != update.version else None
        return None
