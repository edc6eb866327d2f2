"""The event channel of a robot's sub-network, for its programs and missions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from robocorba.corba.event_client import Event, EventClient, EventSubscription
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.events.queue import QueuePolicy

#: Timeout to resolve the channel [s].
RESOLVE_TIMEOUT_S = 1.0
#: Queue of a robot in the channel; beyond its size the oldest events are discarded.
QUEUE = QueuePolicy(size=1000)


class RobotChannel:
    """The channel `channel` (empty for none) for the robot `name`; it is resolved on first use."""

    def __init__(self, orb: Orb, channel: str, name: str) -> None:
        self._orb, self._channel, self._name = orb, channel, name
        self._client: EventClient | None = None
        self._subscription: EventSubscription | None = None
        self._receiver: Callable[[str, str, Any, str], None] = lambda type, source, payload, origin: None

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[str, str, Any, str], None]) -> None:
        """Call `receive` with type, source, payload and origin of each event that matches one of `patterns`.

        Replaces the earlier patterns and receiver. Raises EventError, NotReachable."""
        self._receiver = receive
        if self._subscription and patterns:
            self._subscription.change(*patterns)
        elif self._subscription:
            self._subscription.end()
            self._subscription = None
        elif patterns:
            self._subscription = self._connected().subscribe(self._receive, *patterns, queue=QUEUE)

    def _receive(self, event: Event) -> None:
        self._receiver(event.type, event.source, event.payload, event.origin)

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        """Publish an event; retries for `retry_s`. Raises EventError, NotReachable."""
        self._connected().push(type, payload, retry_s=retry_s)

    def close(self) -> None:
        if self._client:
            self._client.close()

    def _connected(self) -> EventClient:
        if not self._channel:
            raise NotReachable("the robot has no event channel")
        if self._client is None:
            self._client = EventClient(self._orb, self._channel, self._name, RESOLVE_TIMEOUT_S)
        return self._client
