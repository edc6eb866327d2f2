"""The transport layer: a robot's messages to the other robots of a mission, as events on its channel.

Events come in the threads of the ORB; they wait in a bounded queue for the thread that follows the mission."""

from __future__ import annotations

import logging
import queue
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import InvalidMission
from robocorba.missions.messages import Message, message_of, payload, type_of

#: Messages that wait; the newest are dropped where there are more. Of those that came, so many are remembered.
MOST_WAITING, MOST_REMEMBERED = 1000, 5000
_log = logging.getLogger(__name__)


class Channel(Protocol):
    """The event channel of the robot's sub-network."""

    def say(self, type: str, payload: Any, retry_s: float) -> None:
        """An event to everybody who listens to it. Raises EventError, NotReachable after `retry_s`."""

    def listen(self, patterns: Sequence[tuple[str, str]], hear: Callable[[str, str, Any, str], None]) -> None:
        """Call `hear` with type, source, payload and origin of events of these types and sources, from now on only of
        these. Raises EventError, NotReachable."""


class Came(NamedTuple):
    """A message that has come: who says so, when it came by our clock, and by way of which channel."""

    source: str
    message: Message
    came: float
    origin: str


class Transport:
    """`name`: the robot's. `heard` remembers what came, for a report. One thread gets, any thread says."""

    def __init__(self, channel: Channel, name: str) -> None:
        self._channel, self.name = channel, name
        self._waiting: queue.Queue[Came] = queue.Queue(MOST_WAITING)
        self.heard: deque[Came] = deque(maxlen=MOST_REMEMBERED)

    def listen(self, patterns: Sequence[tuple[type[Message], str]]) -> None:
        """To these messages from these robots, * for all. Raises EventError, NotReachable."""
        self._channel.listen([(type_of(kind), source) for kind, source in patterns], self._hear)

    def say(self, message: Message, retry_s: float = 0.0) -> bool:
        """Tell the others; whether the channel has taken it."""
        message = msgspec.structs.replace(message, sent=time.time())
        try:
            self._channel.say(type_of(message), payload(message), retry_s)
        except (NotReachable, EventError) as wrong:
            _log.info("%s was not told: %s", type_of(message), wrong)
            return False
        return True

    def get(self, timeout_s: float) -> Came | None:
        """The next message, None after a time without any."""
        try:
            return self._waiting.get(timeout=max(0.0, timeout_s))
        except queue.Empty:
            return None

    def _hear(self, type: str, source: str, content: Any, origin: str) -> None:
        now = time.time()
        try:
            came = Came(source, message_of(type, content), now, origin)
        except InvalidMission as wrong:
            _log.warning("%s says what can't be read: %s", source, wrong)
            return
        self.heard.append(came)
        try:
            self._waiting.put_nowait(came)
        except queue.Full:
            _log.warning("%d messages wait already: %s of %s is dropped", MOST_WAITING, type, source)
