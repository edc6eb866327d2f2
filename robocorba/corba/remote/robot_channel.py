"""The event channel of a robot's sub-network, as its programs and missions use it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from robocorba.corba.event_client import Event, EventClient, EventSubscription
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.events.queue import QueuePolicy

#: How long a channel is waited for, s.
CHANNEL_LIMIT_S = 1.0
#: What waits for a robot: of more than these, only the newest matter.
QUEUE = QueuePolicy(size=1000)


class RobotChannel:
    """Of the channel called `channel`, empty for none, for the robot `name`; it is found when it is first needed."""

    def __init__(self, orb: Orb, channel: str, name: str) -> None:
        self._orb, self._channel, self._name = orb, channel, name
        self._client: EventClient | None = None
        self._subscription: EventSubscription | None = None
        self._hear: Callable[[str, str, Any, str], None] = lambda type, source, payload, origin: None

    def listen(self, patterns: Sequence[tuple[str, str]], hear: Callable[[str, str, Any, str], None]) -> None:
        """Call `hear` with type, source, payload and origin of events of these types and sources, from now on of no
        others, and nobody else any more. Raises EventError, NotReachable."""
        self._hear = hear

        if self._subscription and patterns:
            self._subscription.change(*patterns)
        elif self._subscription:
            self._subscription.end()
            self._subscription = None
        elif patterns:
            self._subscription = self._connected().subscribe(self._receive, *patterns, queue=QUEUE)

    def _receive(self, event: Event) -> None:
        self._hear(event.type, event.source, event.payload, event.origin)

    def say(self, type: str, payload: Any, retry_s: float) -> None:
        """Raises EventError, NotReachable."""
        self._connected().push(type, payload, retry_s=retry_s)

    def close(self) -> None:
        if self._client:
            self._client.close()

    def _connected(self) -> EventClient:
        if not self._channel:
            raise NotReachable("the robot was given no event channel")
        if self._client is None:
            self._client = EventClient(self._orb, self._channel, self._name, CHANNEL_LIMIT_S)
        return self._client
