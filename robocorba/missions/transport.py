"""The transport layer: a robot's messages to the other robots of a mission, as events on its channel.

The ORB's threads deliver events into a bounded queue, from which the thread of the mission takes them."""

from __future__ import annotations

import contextlib
import logging
import queue
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidMission
from robocorba.missions.clock import OWN_CLOCK
from robocorba.missions.messages import Message, message_of, payload, sender_of, type_of

#: Messages in the queue; newer ones are dropped when it is full.
MAX_QUEUED = 1000

_log = logging.getLogger(__name__)


class MissionChannel(Protocol):
    """The event channel of the robot's sub-network, as missions use it."""

    def publish(self, type: str, payload: Any, retry_s: float) -> None:
        """Publish an event. Raises EventError, NotReachable after `retry_s`."""

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[str, str, Any, str], None]) -> None:
        """Subscribe to events by patterns of type and source, in place of earlier patterns; `receive` gets the
        type, source, payload and origin of each event. Raises EventError, NotReachable."""


class Received(NamedTuple):
    """A received message: its sender, when it was received by the local clock, and the channel that it came from."""

    source: str
    message: Message
    received_at: float
    origin: str


class Transport:
    """Publishes and receives the messages of the robot `name`. received: the latest messages, for the report.

    Only one thread may call `receive`; any thread may publish."""

    def __init__(self, channel: MissionChannel, name: str) -> None:
        self._channel, self.name = channel, name
        self._queue: queue.Queue[Received | None] = queue.Queue(MAX_QUEUED)
        self.received: deque[Received] = deque(maxlen=5000)

    def subscribe(self, patterns: Sequence[tuple[type[Message], str]]) -> None:
        """Subscribe to these messages from these robots, * for all, in place of earlier subscriptions.

        Raises EventError, NotReachable."""
        self._channel.subscribe([(type_of(kind), source) for kind, source in patterns], self._receive)

    def publish(self, message: Message, retry_s: float = 0.0) -> bool:
        """Publish a message, stamped with the time; return whether the channel accepted it."""
        message = msgspec.structs.replace(message, sent=OWN_CLOCK.now())
        try:
            self._channel.publish(type_of(message), payload(message), retry_s)
        except (NotReachable, EventError) as error:
            _log.info("%s was not published: %s", type_of(message), error)
            return False
        return True

    def receive(self, timeout_s: float | None) -> Received | None:
        """The next message; None after a timeout or `wake`. Without a timeout it waits for one of them."""
        try:
            return self._queue.get(timeout=None if timeout_s is None else max(0.0, timeout_s))
        except queue.Empty:
            return None

    def wake(self) -> None:
        """Let a waiting `receive` return None."""
        with contextlib.suppress(queue.Full):  # it does not wait
            self._queue.put_nowait(None)

    def _receive(self, type: str, source: str, content: Any, origin: str) -> None:
        now = OWN_CLOCK.now()
        try:
            received = Received(source, message_of(type, content), now, origin)
        except InvalidMission as error:
            _log.warning("invalid message from %s dropped: %s", source, error)
            return
        if source != sender_of(received.message):
            _log.warning("%s of %s dropped: %s sent it", type, sender_of(received.message), source)
            return
        self.received.append(received)
        try:
            self._queue.put_nowait(received)
        except queue.Full:
            _log.warning("queue of %d messages is full: %s from %s dropped", MAX_QUEUED, type, source)
