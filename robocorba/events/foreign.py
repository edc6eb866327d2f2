"""A link with a foreign channel: another implementation of the event service, with CosEventChannelAdmin only.

This channel is an ordinary supplier and an ordinary consumer of the foreign channel. A plain event, which is an `any`
without a header, stays plain in both directions. A foreign channel delivers all events to all its consumers, so it
returns the events that this channel pushed (echoes). They are recognised: events with a header by origin and number,
plain events by their content.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from queue import Empty, SimpleQueue
from typing import Protocol

from robocorba.errors.events import InternalFault
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account, LinkEnd
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.clients import ConsumerPort
from robocorba.events.event import EventBatch
from robocorba.events.policies import DeliveryPolicy, LinkPolicy
from robocorba.events.proxy import Proxy
from robocorba.events.proxy_push_supplier import ProxyPushSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import ALL, EVERYTHING
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


class Echoes:
    """Recently pushed contents, and which of them still await their echo.

    echo_s: an echo is expected for at least this time [s]; a later one may be published as a new event. max_echoes:
    maximum number of pushed events that are remembered."""

    def __init__(self, echo_s: float = 30.0, max_echoes: int = 10_000) -> None:
        self._echo_s, self._max_echoes = echo_s, max_echoes
        self._lock = threading.Lock()
        self._count = 0
        #: Time, number and content of each push, oldest first.
        self._pushed: deque[tuple[float, int, Hashable]] = deque()
        #: Numbers of the pushes of each content whose echo has not arrived yet, oldest first.
        self._awaited: dict[Hashable, deque[int]] = {}
        #: When the foreign channel last pushed to us, and when the first push to it after that began, None before
        #: [s, time.monotonic].
        self._returned_at = time.monotonic()
        self._silent_since: float | None = None

    def note_push(self, began: float) -> None:
        """The foreign channel has accepted an event whose push began at this time [s, time.monotonic]."""
        with self._lock:
            if self._silent_since is None and began > self._returned_at:  # else the echo has arrived already
                self._silent_since = began

    def note_return(self) -> None:
        """The foreign channel has pushed an event to us."""
        with self._lock:
            self._returned_at, self._silent_since = time.monotonic(), None

    def silent_s(self) -> float:
        """How long the foreign channel has returned nothing although events were pushed to it [s]; 0 if it has."""
        with self._lock:
            return 0.0 if self._silent_since is None else time.monotonic() - self._silent_since

    def reset_silence(self) -> None:
        """A new connection: what was pushed by an earlier one returns no more."""
        with self._lock:
            self._silent_since = None

    def expect(self, content: Hashable) -> None:
        """Expect the echo of a content that is about to be pushed."""
        now = time.monotonic()
        with self._lock:
            self._count += 1
            self._pushed.append((now, self._count, content))
            self._awaited.setdefault(content, deque()).append(self._count)
            while self._pushed and (len(self._pushed) > self._max_echoes or self._pushed[0][0] < now - self._echo_s):
                _, number, old = self._pushed.popleft()
                if self._awaited.get(old, (0,))[0] == number:
                    self._end_wait(old)

    def recognise(self, content: Hashable) -> bool:
        """Whether a received content is an echo; each push has at most one echo."""
        with self._lock:
            if content not in self._awaited:
                return False
            self._end_wait(content)
            return True

    def _end_wait(self, content: Hashable) -> None:
        numbers = self._awaited[content]
        numbers.popleft()
        if not numbers:
            del self._awaited[content]


class ForeignPort(Protocol):
    """Both connections with a foreign channel; the CORBA layer implements it."""

    #: The proxy of the foreign channel to push to.
    consumer: ConsumerPort
    #: HOST:PORT at which the foreign channel calls our consumer.
    address: str

    def is_alive(self) -> bool:
        """Whether both connections work. Raises nothing."""

    def disconnect(self) -> None:
        """End both connections. Raises nothing."""


#: Connects with the foreign channel. Each event that it pushes is passed to the first function: a batch of one, and the
#: content that identifies an echo, None if the event has an origin. The second one is called when the foreign channel
#: disconnects our consumer. Raises NotReachable.
Attach = Callable[[Echoes, Callable[[EventBatch, Hashable], None], Callable[[], None]], ForeignPort]


class ForeignLink:
    """Maintains the link of `channel` with the foreign channel `peer`."""

    def __init__(self, peer: Peer, channel: Channel, attach: Attach, policy: LinkPolicy) -> None:
        self.peer, self.name = peer, peer.name
        #: Why the link is down, empty while it is up.
        self.problem = "not connected yet"
        #: Number of connections so far.
        self.connections = 0
        #: Latency of the last event, from its creation to its arrival [s].
        self.lag_s = 0.0
        #: Serves the foreign channel as a consumer.
        self.proxy = ProxyPushSupplier(
            channel.lock,
            f"foreign {self.name}",
            ALL,
            QueuePolicy(policy.max_queued),
            DeliveryPolicy(),
            self._consumer_lost,
            self.name,
        )
        self._channel, self._attach, self._policy = channel, attach, policy
        self._echoes = Echoes()
        self._account = Account()
        self._port: ForeignPort | None = None
        self._ended = threading.Event()
        #: Why the current connection has ended; the first reason counts. Another connection has another queue.
        self._losses = SimpleQueue[str]()
        #: Whether it returned nothing of what was pushed to it, and has not pushed since.
        self._is_silent = False
        self._thread = Background(f"foreign {self.name}", self._maintain_link, self._set_problem)

    def start(self) -> None:
        with self._channel.lock:
            self._channel.proxy_suppliers[self.proxy.id] = self.proxy
            self._channel.update_routes()
        self._thread.start()

    def end(self) -> None:
        """Disconnect from the foreign channel; queued events count as discarded."""
        self._ended.set()
        self._losses.put("the link was removed")
        with self._channel.lock:
            self._channel.proxy_suppliers.pop(self.proxy.id, None)
            self.proxy.end()
            self._channel.update_routes()
        if self._port:
            self._port.disconnect()

    def snapshot(self) -> tuple[LinkEnd, LinkEnd]:
        """Both directions: to the foreign channel, and from there. It neither numbers packets nor has an interest."""
        with self._channel.lock:
            sent, received, oldest_s = self.proxy.totals(), self._account.snapshot(), self.proxy.oldest_s()
        problem, interest = self.problem, (EVERYTHING,)
        return (
            LinkEnd(problem or self.proxy.problem, self.connections, sent, interest, oldest_s),
            LinkEnd(problem, self.connections, received, interest, self.lag_s),
        )

    def receive(self, batch: EventBatch, content: Hashable) -> None:
        """Publish an event from the foreign channel, unless it is an echo or a duplicate."""
        self._echoes.note_return()
        if self._is_silent:
            self._is_silent = False
            self._set_problem("")
        batch.via = self.proxy.id
        if batch.header.origin:
            refused = self._account.refused
            claims = self._channel.forward([batch], self._account)
            if self._account.refused > refused:
                _log.warning("refused an event from %s: it may have come before", self.name)
            self._channel.deliver(claims)
        elif content is not None and self._echoes.recognise(content):
            with self._channel.lock:
                self._account.repeated += 1
        else:
            self._channel.publish(batch, self._account)
        self.lag_s = max(0.0, time.time() - batch.times[-1])

    def _consumer_lost(self, proxy: Proxy, reason: str) -> None:
        """The foreign proxy is gone: connect again."""
        with self._channel.lock:
            self.proxy.leave()
        self._losses.put(reason)

    def _maintain_link(self) -> None:
        policy, failures = self._policy, 0
        while not self._ended.is_set():
            losses = self._losses = SimpleQueue[str]()
            began = time.monotonic()
            try:
                on_disconnected = functools.partial(losses.put, "it has disconnected our consumer")
                reason = self._use(self._attach(self._echoes, self.receive, on_disconnected), losses)
            except NotReachable as error:
                reason = str(error)
            except Exception as error:  # a defect must not end the link permanently
                _log.exception("foreign channel %s", self.name)
                reason = str(InternalFault(error))
            if self._ended.is_set():
                return
            self._set_problem(reason)
            failures = failures + 1 if time.monotonic() - began < policy.check_interval_s else 1
            self._ended.wait(policy.foreign_backoff.pause_s(failures))

    def _use(self, port: ForeignPort, losses: SimpleQueue[str]) -> str:
        """Deliver to the foreign channel until the connection ends; why it has."""
        self._port = port
        self._echoes.reset_silence()
        limit_s = self._policy.return_s
        try:
            with self._channel.lock:
                self.proxy.connect(port.consumer)
            self.connections += 1
            if not self._is_silent:  # else its next event shows that it can call us again
                self._set_problem("")
            while not self._ended.is_set():
                with contextlib.suppress(Empty):
                    return losses.get(timeout=self._policy.check_interval_s)
                if not port.is_alive():
                    return "it does not answer"
                if self._echoes.silent_s() > limit_s:
                    self._is_silent = True
                    return f"it has returned no event for {limit_s:g} s: can it call {port.address}?"
            return "the link was removed"
        finally:
            with self._channel.lock:
                if self.proxy.client is port.consumer:
                    self.proxy.leave()
            port.disconnect()

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            _log.info("foreign channel %s: %s", self.name, problem or "connected")
        self.problem = problem
