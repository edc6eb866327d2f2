"""The event channel of a robot's sub-network, for its programs and missions."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event, EventClient, EventSubscription
from robocorba.events.queue import QueuePolicy
from robocorba.orb.orb import Orb
from robocorba.system.repeating import Repeating

#: Interval between checks that the channel still has the subscription [s], and between attempts to subscribe.
CHECK_INTERVAL_S, RETRY_S = 5.0, 2.0
#: Queue of a robot in the channel; beyond its size the oldest events are discarded.
QUEUE = QueuePolicy(size=1000)


_log = logging.getLogger(__name__)


class RobotChannel:
    """The channel `channel` (empty for none) for the robot `name`; it is resolved on first use."""

    def __init__(self, orb: Orb, channel: str, name: str) -> None:
        self._orb, self._channel, self._name = orb, channel, name
        self._client: EventClient | None = None
        self._subscription: EventSubscription | None = None
        self._receiver: Callable[[str, str, Any, str], None] = lambda type, source, payload, origin: None
        self._is_checked = False
        self._patterns: Sequence[tuple[str, str]] = ()
        self._lock = threading.Lock()
        #: Why the last attempt to subscribe failed.
        self._problem = ""
        self._check = Repeating(
            f"subscription of {name}", self._renew, lambda: CHECK_INTERVAL_S if self._subscription else RETRY_S
        )

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[str, str, Any, str], None]) -> None:
        """Call `receive` with type, source, payload and origin of each event that matches one of `patterns`.

        Replaces the earlier patterns and receiver. A subscription that the channel has ended, because it did not reach
        the robot for a while, is made again. Raises EventError, NotReachable."""
        with self._lock:
            self._receiver, self._patterns = receive, patterns
            self._subscribe()
            if self._subscription:
                self._start_checks()

    def keep_subscribed(
        self, patterns: Sequence[tuple[str, str]], receive: Callable[[str, str, Any, str], None]
    ) -> None:
        """The same, from the moment on in which the channel answers."""
        with self._lock:
            self._receiver, self._patterns = receive, patterns
            self._start_checks()

    def _start_checks(self) -> None:
        if not self._is_checked:
            self._is_checked = True
            self._check.start()

    def _subscribe(self) -> None:
        if self._subscription and (not self._patterns or self._subscription.is_lost()):
            self._subscription.end()
            self._subscription = None
        if self._subscription:
            self._subscription.change(*self._patterns)
        elif self._patterns:
            self._subscription = self._connected().subscribe(self._receive, *self._patterns, queue=QUEUE)

    def _renew(self) -> None:
        with self._lock:
            try:
                if self._patterns and (self._subscription is None or self._subscription.is_lost()):
                    if self._subscription:
                        _log.warning("%s subscribes again to %s, which has ended it", self._name, self._channel)
                    self._subscribe()
                self._problem = ""
            except (NotReachable, EventError) as error:
                if str(error) != self._problem:
                    self._problem = str(error)
                    _log.info("%s can't subscribe to %s, it keeps trying: %s", self._name, self._channel, error)

    def _receive(self, event: Event) -> None:
        self._receiver(event.type, event.source, event.payload, event.origin)

    def publish(self, type: str, payload: Any, retry_s: float, expiry_s: float = 0.0) -> None:
        """Publish an event; retries for `retry_s`. expiry_s: 0 for never. Raises EventError, NotReachable."""
        self._connected().push(type, payload, retry_s=retry_s, expiry_s=expiry_s)

    def close(self) -> None:
        self._check.close()
        if self._client:
            self._client.close()

    def _connected(self) -> EventClient:
        if not self._channel:
            raise NotReachable("the robot has no event channel")
        if self._client is None:
            self._client = EventClient(self._orb, self._channel, self._name, 1.0)
        return self._client
