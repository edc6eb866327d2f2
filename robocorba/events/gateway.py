"""The consuming end of a link: a gateway, collocated with the channel that it supplies.

It joins its peer's feed, and keeps the link: tells news, acknowledges what came, and joins again, with
growing pauses, whenever the peer does not answer.
"""

from __future__ import annotations

import logging
import random
import threading
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

from robocorba.errors.events import InvalidPeer, SessionOver
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account, Totals
from robocorba.events.channel import Channel
from robocorba.events.event import Run
from robocorba.events.federation import Notice
from robocorba.events.subscription import Pattern

#: How often a gateway tells its peer that it is there.
RENEW_S = 0.5
#: Batches that came before an earlier one, which is still on its way.
MAX_EARLY = 64
#: Acknowledge after so many batches, or so much time.
ACKNOWLEDGE_BATCHES, ACKNOWLEDGE_S = 4, 0.02
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 0.5
#: Longest pause where the peer answers, but refuses.
REFUSED_PAUSE_S = 5.0

_log = logging.getLogger(__name__)


class FeedPort(Protocol):
    """A session with the peer's feed, as a translator presents it."""

    session: str
    position: int

    def renew(self, position: int, news: list[Notice]) -> list[Notice]:
        """Raises SessionOver, NotReachable."""

    def acknowledge(self, position: int) -> None:
        """Without waiting for an answer; raises nothing."""

    def leave(self) -> None:
        """Raises nothing: the peer may be dead."""


class GatewayState(NamedTuple):
    """A gateway at one moment; lag_s: of the last event, from when it was made to when it came."""

    is_up: bool
    problem: str
    joins: int
    lag_s: float
    batches: int
    bytes: int
    repeated: int
    totals: Totals


class Gateway:
    """Supplies `channel` with what `peer` forwards.

    join: begins a session with the peer's feed; raises NotReachable, InvalidPeer. on_news: is told, without a lock,
    what the peer knows."""

    def __init__(
        self,
        peer: str,
        channel: Channel,
        join: Callable[[], FeedPort],
        on_news: Callable[[list[Notice]], None],
    ) -> None:
        self.peer = peer
        self._channel = channel
        self._join = join
        self._on_news = on_news
        self._lock = threading.Lock()
        self._woken = threading.Event()
        self._is_ended = self._leaves = False
        self._port: FeedPort | None = None
        self.session = ""
        self._expected = 1
        self._early: dict[int, list[Run]] = {}
        self._told: dict[str, int] = {}
        self._in_force: tuple[Pattern, ...] = ()
        self._acknowledged, self._acknowledged_at = 1, 0.0
        self._problem = "not joined yet"
        self._account = Account()
        self._joins = self._batches = self._bytes = self._repeated = 0
        self._lag_s = 0.0
        self._thread = threading.Thread(target=self._keep, name=f"gateway of {peer}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self, leave: bool = False) -> None:
        """Stop; `leave` tells the peer that it is for good."""
        with self._lock:
            self._is_ended, self._leaves = True, leave
            port = self._port
        self._woken.set()
        if leave and port:
            port.leave()

    def wake(self) -> None:
        """There is news to tell, or the peer is known to be back."""
        self._woken.set()

    @property
    def in_force(self) -> tuple[Pattern, ...]:
        """The interest of this channel that the peer knows of."""
        return self._in_force if not self._problem else ()

    def forward(self, session: str, position: int, runs: list[Run]) -> None:
        """A batch from the peer. Those that came too early wait for the ones before them; others are ignored."""
        with self._lock:
            if session != self.session or self._is_ended:
                return
            self._early.setdefault(position, runs)
            claimed: list = []
            while (batch := self._early.pop(self._expected, None)) is not None:
                self._expected += 1
                claimed += self._take(batch)
            for late in [early for early in self._early if early < self._expected]:
                del self._early[late]
            while len(self._early) > MAX_EARLY:  # it will be sent again
                del self._early[max(self._early)]
            position, port = self._expected, self._port
            now = time.monotonic()
            due = (
                position - self._acknowledged >= ACKNOWLEDGE_BATCHES or now - self._acknowledged_at > ACKNOWLEDGE_S
            ) and position > self._acknowledged
            if due:
                self._acknowledged, self._acknowledged_at = position, now
        self._channel.deliver(claimed)
        if due and port:
            port.acknowledge(position)

    def _take(self, batch: list[Run]) -> list:
        for run in batch:
            run.via = self.peer
        claimed, repeated = self._channel.forward(batch)
        count = sum(map(len, batch))
        taken = sum(len(run) for run, _ in claimed)
        self._batches += 1
        self._bytes += sum(run.size for run in batch)
        self._repeated += repeated
        self._account.received += count - repeated
        self._account.delivered += taken
        self._account.expired += count - repeated - taken
        if claimed:
            self._lag_s = max(0.0, time.time() - claimed[-1][0].times[-1])
        return claimed

    def state(self) -> GatewayState:
        return GatewayState(
            not self._problem,
            self._problem,
            self._joins,
            self._lag_s,
            self._batches,
            self._bytes,
            self._repeated,
            self._account.totals(0),
        )

    # ---- keeping the link ----

    def _keep(self) -> None:
        pause = FIRST_PAUSE_S
        while not self._is_ended:
            longest = LONGEST_PAUSE_S
            try:
                self._begin(self._join())
                pause = FIRST_PAUSE_S
                while not self._is_ended:
                    self._renew()
                    self._woken.wait(RENEW_S)
                    self._woken.clear()
            except SessionOver as wrong:
                self._set_problem(str(wrong))
            except NotReachable as wrong:
                self._set_problem(str(wrong))
            except InvalidPeer as wrong:
                self._set_problem(f"refused: {wrong}")
                longest = REFUSED_PAUSE_S
            except Exception:  # a fault of ours must not end the link for good
                _log.exception("gateway of %s", self.peer)
                self._set_problem("internal fault, see the log")
            if self._is_ended:
                return
            is_called = self._woken.wait(pause * random.uniform(0.5, 1.0))
            self._woken.clear()
            pause = FIRST_PAUSE_S if is_called else min(2 * pause, longest)

    def _begin(self, port: FeedPort) -> None:
        with self._lock:
            self._port, self.session = port, port.session
            self._expected = self._acknowledged = port.position
            self._early.clear()
            self._told.clear()
            self._joins += 1
            is_too_late = self._leaves
        if is_too_late:
            port.leave()

    def _renew(self) -> None:
        port = self._port
        assert port is not None
        with self._channel.lock:
            news = [n for n in self._channel.federation.notices if self._told.get(n.name) != n.version]
            interest = self._channel.federation.own.interest
        with self._lock:
            position = self._acknowledged = self._expected
        answer = port.renew(position, news)
        self._told.update((notice.name, notice.version) for notice in (*news, *answer))
        self._in_force = interest
        if self._problem:
            _log.info("the link from %s is up", self.peer)
            self._problem = ""
        if answer:
            self._on_news(answer)

    def _set_problem(self, problem: str) -> None:
        if problem != self._problem:
            _log.info("the link from %s is down (%s)", self.peer, problem)
        self._problem = problem
