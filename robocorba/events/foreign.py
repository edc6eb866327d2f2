"""A link with a foreign channel: one that supports CosEventChannelAdmin only, without headers and gateways.

This channel is an ordinary supplier and an ordinary consumer of the foreign channel. Plain events stay plain in both
directions. A foreign channel delivers all events to all its consumers, so it returns the events that this channel
pushed (echoes). They are recognised: events with a header by origin and number, plain events by their content.
"""

from __future__ import annotations

import logging
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from typing import Protocol

from robocorba.errors.services import NotReachable
from robocorba.events.account import Account, Totals
from robocorba.events.channel import Channel
from robocorba.events.clients import ConsumerPort
from robocorba.events.event import EventRun
from robocorba.events.outlet import Outlet
from robocorba.events.push_outlet import PushOutlet
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, SubscriptionMatch

#: An echo is expected for at least this time [s]; a later one may be published as a new event.
ECHO_S = 30.0
#: Maximum number of pushed events that are remembered.
MAX_ECHOES = 10_000
#: Maximum number of events that wait for the foreign channel.
STORE_EVENTS = 100_000
#: Interval between checks that the foreign channel answers [s].
CHECK_S = 1.0
#: Backoff between connection attempts: first, longest [s].
FIRST_PAUSE_S, MAX_PAUSE_S = 0.05, 1.0

_log = logging.getLogger(__name__)


class Echoes:
    """Recently pushed contents, and which of them still await their echo."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        #: Time, number and content of each push, oldest first.
        self._pushed: deque[tuple[float, int, Hashable]] = deque()
        #: Numbers of the pushes of each content whose echo has not arrived yet, oldest first.
        self._open: dict[Hashable, deque[int]] = {}

    def expect(self, content: Hashable) -> None:
        """Expect the echo of a content that is about to be pushed."""
        now = time.monotonic()
        with self._lock:
            self._count += 1
            self._pushed.append((now, self._count, content))
            self._open.setdefault(content, deque()).append(self._count)
            while self._pushed and (len(self._pushed) > MAX_ECHOES or self._pushed[0][0] < now - ECHO_S):
                _, number, old = self._pushed.popleft()
                if self._open.get(old, (0,))[0] == number:
                    self._close(old)

    def recognise(self, content: Hashable) -> bool:
        """Whether a received content is an echo; each push has at most one echo."""
        with self._lock:
            if content not in self._open:
                return False
            self._close(content)
            return True

    def _close(self, content: Hashable) -> None:
        numbers = self._open[content]
        numbers.popleft()
        if not numbers:
            del self._open[content]


class ForeignOutlet(PushOutlet):
    """Delivers all events to the foreign channel `name`, except those that it pushed."""

    def offer(self, run: EventRun, match: SubscriptionMatch, now: float) -> bool:
        return run.via != self.name and super().offer(run, match, now)


class ForeignPort(Protocol):
    """Both connections with a foreign channel; the CORBA layer implements it."""

    #: The proxy of the foreign channel to push to.
    consumer: ConsumerPort

    def is_there(self) -> bool:
        """Whether both connections work. Raises nothing."""

    def leave(self) -> None:
        """End both connections. Raises nothing."""


#: Connects with the foreign channel, which then calls the function for each event, with a run of one and the content
#: that identifies an echo (None for an event with an origin). Raises NotReachable.
Attach = Callable[[Echoes, Callable[[EventRun, Hashable], None]], ForeignPort]


class ForeignLink:
    """Maintains the link of `channel` with the foreign channel `name`."""

    def __init__(self, name: str, channel: Channel, attach: Attach) -> None:
        self.name = name
        self.problem = "not connected yet"
        self.connects = 0
        self.repeated = 0
        self.lag_s = 0.0
        self.outlet = ForeignOutlet(
            channel.lock, f"foreign {name}", ALL, QueuePolicy(STORE_EVENTS), self._consumer_lost, name
        )
        self._channel, self._attach = channel, attach
        self._echoes = Echoes()
        self._account = Account()
        self._port: ForeignPort | None = None
        self._ended = threading.Event()
        self._lost = threading.Event()
        self._thread = threading.Thread(target=self._maintain_link, name=f"foreign {name}", daemon=True)

    def start(self) -> None:
        with self._channel.lock:
            self._channel.outlets[self.outlet.id] = self.outlet
            self._channel.changed()
        self._thread.start()

    def end(self) -> None:
        """Disconnect from the foreign channel; queued events count as discarded."""
        self._ended.set()
        self._lost.set()
        with self._channel.lock:
            self._channel.outlets.pop(self.outlet.id, None)
            self.outlet.end()
            self._channel.changed()
        if self._port:
            self._port.leave()

    def totals_in(self) -> Totals:
        """The account of the events from the foreign channel."""
        return self._account.totals(0)

    def receive(self, run: EventRun, content: Hashable) -> None:
        """Publish an event from the foreign channel, unless it is an echo or a duplicate."""
        run.via = self.name
        if run.header.origin:
            claimed, repeated = self._channel.forward([run])
            self.repeated += repeated
            with self._channel.lock:
                self._account.received += 1 - repeated
                self._account.delivered += len(claimed)
                self._account.expired += 1 - repeated - len(claimed)
            self._channel.deliver(claimed)
        elif content is not None and self._echoes.recognise(content):
            self.repeated += 1
        else:
            self._channel.publish(run, self._account)
        self.lag_s = max(0.0, time.time() - run.times[-1])

    def _consumer_lost(self, outlet: Outlet, reason: str) -> None:
        """The foreign proxy is gone: connect again."""
        with self._channel.lock:
            self.outlet.leave()
        self._lost.set()

    def _maintain_link(self) -> None:
        pause = FIRST_PAUSE_S
        while not self._ended.is_set():
            try:
                self._lost.clear()
                self._port = port = self._attach(self._echoes, self.receive)
            except NotReachable as error:
                self._set_problem(str(error))
                self._ended.wait(pause * random.uniform(0.5, 1.0))
                pause = min(2 * pause, MAX_PAUSE_S)
                continue
            pause = FIRST_PAUSE_S
            with self._channel.lock:
                self.outlet.connect(port.consumer)
            self.connects += 1
            self._set_problem("")
            while not self._lost.wait(CHECK_S) and port.is_there():
                pass
            port.leave()
            if not self._ended.is_set():
                self._set_problem("it does not answer")

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            _log.info("foreign channel %s: %s", self.name, problem or "connected")
        self.problem = problem
