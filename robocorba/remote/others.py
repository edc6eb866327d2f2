"""The other robots, as the program of one sees them: events on its channel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from robocorba.control.runner import Heard
from robocorba.errors import MotionFailed, NotReachable
from robocorba.event_client import Event, EventClient, EventSubscription
from robocorba.orb import Orb
from robocorba.programs.icons import Icon, kind

#: How long a channel is waited for, s.
CHANNEL_LIMIT_S = 5.0


class RobotChannel:
    """The channel called `channel`, empty for none, to which the robot `name` is connected when it first needs it."""

    def __init__(self, orb: Orb, channel: str, name: str) -> None:
        self._orb, self._channel, self._name = orb, channel, name
        self._client: EventClient | None = None
        self._subscription: EventSubscription | None = None

    def listen(self, patterns: Sequence[tuple[str, str]], hear: Callable[[Heard], None]) -> None:
        """Raises EventError, NotReachable."""
        if self._subscription:
            self._subscription.end()
            self._subscription = None
        if not patterns:
            return

        def receive(event: Event) -> None:
            hear(Heard(event.type, event.source, event.payload))

        self._subscription = self._connected().subscribe(receive, *patterns)

    def say(self, type: str, payload: Any) -> None:
        """Raises EventError, NotReachable."""
        self._connected().push(type, payload, retry_s=CHANNEL_LIMIT_S)

    def cooperate(self, icon: Icon) -> None:
        """Raises MotionFailed: a robot by itself leads no mission."""
        raise MotionFailed(f"{kind(icon)} needs other robots, and nobody leads a mission here")

    def close(self) -> None:
        if self._client:
            self._client.close()

    def _connected(self) -> EventClient:
        if not self._channel:
            raise NotReachable("the robot was given no event channel")
        if self._client is None:
            self._client = EventClient(self._orb, self._channel, self._name, CHANNEL_LIMIT_S)
        return self._client
