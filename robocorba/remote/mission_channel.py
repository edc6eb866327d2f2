"""The event channel of a robot's sub-network, as missions use it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from robocorba.event_client import Event, EventClient, EventSubscription
from robocorba.events.queue import QueuePolicy
from robocorba.orb import Orb

CHANNEL_LIMIT_S = 1.0
#: Orders and states come again and again: of many that wait, only the newest matter.
QUEUE = QueuePolicy(size=500)


class MissionChannel:
    """Of the channel called `channel`, for the robot `name`; it is found when it is first needed."""

    def __init__(self, orb: Orb, channel: str, name: str) -> None:
        self._orb, self._channel, self._name = orb, channel, name
        self._client: EventClient | None = None
        self._subscription: EventSubscription | None = None

    def listen(self, patterns: Sequence[tuple[str, str]], hear: Callable[[str, str, Any, str], None]) -> None:
        """Raises EventError, NotReachable."""

        def receive(event: Event) -> None:
            hear(event.type, event.source, event.payload, event.origin)

        if self._subscription:
            self._subscription.change(*patterns)
        else:
            self._subscription = self._connected().subscribe(receive, *patterns, queue=QUEUE)

    def say(self, type: str, payload: Any, retry_s: float) -> None:
        """Raises EventError, NotReachable."""
        self._connected().push(type, payload, retry_s=retry_s)

    def close(self) -> None:
        if self._client:
            self._client.close()

    def _connected(self) -> EventClient:
        if self._client is None:
            self._client = EventClient(self._orb, self._channel, self._name, CHANNEL_LIMIT_S)
        return self._client
