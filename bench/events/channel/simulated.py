"""A federation in one process, on a virtual clock: the channels and routes of the product, and links that take time.

Only the two ends of a link and the memory of what was seen are replaced: a copy arrives at the peer's channel a hop
later."""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Iterable, Sequence
from typing import Any

from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.federation import Federation
from robocorba.events.feed import Feed
from robocorba.events.policies import LinkPolicy
from robocorba.events.proxy_supplier import ProxySupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import SubscriptionMatch, checked

POLICY = LinkPolicy()


class _Seen:
    """What a channel has seen, in memory: the product's needs a file of 8 MB for each channel."""

    def __init__(self) -> None:
        self._numbers: set[tuple[str, int]] = set()

    def has_seen(self, origin: str, number: int) -> bool:
        return (origin, number) in self._numbers

    def add(self, origin: str, first: int, last: int) -> tuple[list[tuple[int, int]], int]:
        new = [number for number in range(first, last + 1) if not self.has_seen(origin, number)]
        self._numbers.update((origin, number) for number in new)
        return [(number, number) for number in new], 0


class _Wire(Feed):
    """Sends each copy at once."""

    is_up = True  # type: ignore[assignment]

    def __init__(self, simulation: Simulation, peer: str) -> None:
        super().__init__(threading.Lock(), peer, POLICY)
        self._simulation = simulation

    def accept(self, batch: EventBatch) -> bool:
        self._simulation.forward(self.peer, batch.toward(dict(batch.targets or {})))
        return False


class _Arrivals(ProxySupplier):
    """A consumer that gets everything at once."""

    is_selecting = True  # type: ignore[assignment]

    def __init__(self, simulation: Simulation, name: str) -> None:
        super().__init__(threading.Lock(), name, checked([([(f"to.{name}", "*")], 0.0)]), QueuePolicy())
        self._simulation = simulation

    def accept(self, batch: EventBatch, match: SubscriptionMatch, now: float) -> bool:
        self._simulation.latencies_s.append(self._simulation.now_s - float(batch.payloads[0]))
        return False


class Simulation:
    """Channels with these links; each wants the events for itself. hop_s: duration of a hop [s]. service_s: the part of
    it in which the receiving channel can do nothing else [s]."""

    def __init__(self, names: Sequence[str], links: Sequence[tuple[str, str]], hop_s: float, service_s: float) -> None:
        self.latencies_s: list[float] = []
        self.now_s, self.messages = 0.0, 0
        self._hop_s, self._service_s = hop_s, service_s
        self._free_s = dict.fromkeys(names, 0.0)
        self._due: list[tuple[float, int, str, EventBatch]] = []
        self._order, self._account = itertools.count(), Account()
        self.channels: dict[str, Channel] = {}
        peers: dict[str, list[str]] = {name: [] for name in names}
        for a, b in links:
            peers[a].append(b)
            peers[b].append(a)
        for name in names:
            seen: Any = _Seen()
            channel = self.channels[name] = Channel(Federation(name, max_channels=len(names)), seen, 1)
            channel.feeds = {peer: _Wire(self, peer) for peer in peers[name]}
            channel.proxy_suppliers = {name: _Arrivals(self, name)}
            channel.update_routes()
        every = [channel.federation.own for channel in self.channels.values()]
        for channel in self.channels.values():
            channel.federation.learn(every)
            channel.update_routes()

    def run(self, events: Sequence[tuple[float, str, str]], base_s: float) -> list[float]:
        """Publish events: time [s], origin and target; returns all latencies [s]. base_s: that of a local event."""
        for at_s, origin, target in events:
            batch = EventBatch(EventHeader(f"to.{target}", "", ""), [at_s], [str(at_s)])
            heapq.heappush(self._due, (at_s, next(self._order), origin, batch))
        while self._due:
            self.now_s, _, name, batch = heapq.heappop(self._due)
            if batch.targets is None:
                self.channels[name].publish(batch, self._account)
            else:
                Channel.deliver(self.channels[name].forward([batch], self._account))
        return [base_s + latency_s for latency_s in self.latencies_s]

    def forward(self, peer: str, batch: EventBatch) -> None:
        """Let a copy arrive at a peer, when that has done what came before."""
        self.messages += 1
        arrives_s = max(self.now_s + self._hop_s - self._service_s, self._free_s[peer]) + self._service_s
        self._free_s[peer] = arrives_s
        heapq.heappush(self._due, (arrives_s, next(self._order), peer, batch))


def renewals_per_s(peers: Iterable[int]) -> float:
    """The calls by which the gateways of channels with so many peers renew their sessions [1/s]."""
    return sum(count / POLICY.renewal_pause_s(count) for count in peers)
