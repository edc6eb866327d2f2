"""Federations whose links come and go and are slow, whose channels restart with wrong clocks or without their state:
each consumer gets each event once, in order while the links stay, and no event is lost but what waited in a queue that
was discarded.

There are no threads: links are queues that are carried in any order, advertisements are known everywhere at once."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections import Counter, defaultdict, deque
from pathlib import Path

import networkx as nx
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from robocorba.events import seen_events
from robocorba.events.account import Account
from robocorba.events.arrival_clock import ArrivalClock
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import first_number_of, life_of, next_life
from robocorba.events.federation import Advertisement, Federation
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import SubscriptionMatch, checked
from tests.events.network import batch_of

NAMES = "ABCD"
EXPIRY_S = 3600.0
JUMPS_S = (0.0, 1.0, -1.0, 7200.0, -7200.0, 1e9, -1e9)

names = st.sampled_from(NAMES)


class Wire:
    """Stands in for the feed of `peer`: what waits, in order."""

    def __init__(self, peer: str) -> None:
        self.peer, self.unseen = peer, 0
        self.batches: deque[EventBatch] = deque()

    def accept(self, batch: EventBatch, fit: SubscriptionMatch, now: float) -> bool:
        if batch.via != self.peer:
            self.batches.append(batch)
        return False

    def waiting(self) -> list[EventBatch]:
        return list(self.batches)

    def take_over(self, batch: EventBatch) -> None:
        self.accept(batch, SubscriptionMatch(True, ()), 0.0)


class Node:
    """A channel with a consumer of all events."""

    def __init__(self, name: str, folder: Path, life: int, known: list[Advertisement], ahead_s: float) -> None:
        self.life, self.ahead_s = life, ahead_s
        self.seen = SeenEvents(folder / f"{name}.seen")
        clock = ArrivalClock(lambda: time.time() + self.ahead_s)
        self.channel = Channel(Federation(name, known, life), self.seen, first_number_of(life), clock)
        self.proxy = ProxyPullSupplier(self.channel.lock, "1", checked([([("t", "")], 0)]), QueuePolicy(10**6))
        self.proxy.connect(None)
        self.channel.proxy_suppliers["1"] = self.proxy
        self.channel.update_routes()

    @property
    def wires(self) -> dict[str, Wire]:
        return self.channel.feeds  # type: ignore[return-value]

    def got(self) -> list[str]:
        result: list[str] = []
        while batch := self.proxy.pull(0.0):
            result += [payload.decode() for payload in batch.payloads]
        return result


class FederationMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.patch = pytest.MonkeyPatch()  # smaller files
        self.patch.setattr(seen_events, "MAX_LIVES", 64)
        self.nodes: dict[str, Node] = {}
        self.links: nx.Graph = nx.Graph()
        self.count = itertools.count()
        #: Number of changes of links and processes; when each event was published, and where.
        self.era = 0
        self.published: dict[str, tuple[int, str]] = {}
        #: Who must still get each event.
        self.due: dict[str, set[str]] = {}
        #: What each consumer got since its channel lost its state, and in the present era.
        self.got: dict[str, Counter[str]] = defaultdict(Counter)
        self.in_order: dict[tuple[str, str], list[str]] = defaultdict(list)

    @initialize(shape=st.sampled_from([("AB", "BC", "CD"), ("AB", "BC", "CA", "CD"), ("AB", "AC", "BD", "CD")]))
    def start(self, shape: tuple[str, ...]) -> None:
        for name in NAMES:
            self.nodes[name] = Node(name, Path(self.folder.name), next_life(0), [], 0.0)
        self.links.add_nodes_from(NAMES)
        for here, there in shape:
            self._link(here, there)

    # ---- what happens ----

    @rule(name=names, count=st.integers(1, 3))
    def publish(self, name: str, count: int) -> None:
        payloads = [str(next(self.count)) for _ in range(count)]
        for payload in payloads:
            self.published[payload] = (self.era, name)
            self.due[payload] = set(nx.node_connected_component(self.links, name))
        self.nodes[name].channel.publish(batch_of(*payloads, source=name, expiry=EXPIRY_S), Account())

    @rule(data=st.data(), steps=st.integers(1, 5))
    def carry(self, data: st.DataObject, steps: int) -> None:
        """The links that are not chosen are slow ones."""
        for _ in range(steps):
            loaded = self._loaded()
            if not loaded:
                return
            self._carry_one(*data.draw(st.sampled_from(loaded)))

    def carry_all(self) -> None:
        while loaded := self._loaded():
            self._carry_one(*loaded[0])
        self._read()
        assert {payload: due for payload, due in self.due.items() if due} == {}

    @rule(here=names, there=names)
    def add_link(self, here: str, there: str) -> None:
        if here != there and not self.links.has_edge(here, there):
            self._link(here, there)

    @rule(data=st.data())
    def remove_link(self, data: st.DataObject) -> None:
        """What waits for it is discarded."""
        if self.links.edges:
            here, there = data.draw(st.sampled_from(sorted(map(tuple, map(sorted, self.links.edges)))))
            self._begin_era()
            self.links.remove_edge(here, there)
            for name, peer in ((here, there), (there, here)):
                self._lose(self.nodes[name].wires.pop(peer))
            for payload, due in self.due.items():
                due &= nx.node_connected_component(self.links, self.published[payload][1])
            self._update(here, there)

    @rule(name=names, keeps_state=st.booleans(), ahead_s=st.sampled_from(JUMPS_S))
    def restart(self, name: str, keeps_state: bool, ahead_s: float) -> None:
        """By a kill: what waits in its queues is lost."""
        self._begin_era()
        before = self.nodes[name]
        known = before.channel.federation.advertisements if keeps_state else []
        before.seen.__exit__(None, None, None)
        if not keeps_state:
            (Path(self.folder.name) / f"{name}.seen").unlink()
            self.got[name].clear()
        life = next_life(before.life if keeps_state else 0)
        node = self.nodes[name] = Node(name, Path(self.folder.name), life, known, ahead_s)
        for peer, wire in before.wires.items():
            self._lose(wire)
            node.channel.feeds[peer] = Wire(peer)  # type: ignore[assignment]
        self._update(name)

    @rule(name=names, ahead_s=st.sampled_from(JUMPS_S))
    def set_clock(self, name: str, ahead_s: float) -> None:
        self.nodes[name].ahead_s = ahead_s

    # ---- what must hold ----

    @invariant()
    def each_event_comes_once(self) -> None:
        self._read()
        assert all(count == 1 for counts in self.got.values() for count in counts.values())

    @invariant()
    def nobody_takes_restarts_for_a_conflict(self) -> None:
        assert all(not node.channel.federation.conflicts() for node in self.nodes.values())

    @invariant()
    def events_come_in_order_while_the_links_stay(self) -> None:
        for payloads in self.in_order.values():
            assert payloads == sorted(payloads, key=int)

    def teardown(self) -> None:
        if self.nodes:
            self.carry_all()
            self.each_event_comes_once()
        for node in self.nodes.values():
            node.seen.__exit__(None, None, None)
        self.patch.undo()
        self.folder.cleanup()

    # ---- inside ----

    def _link(self, here: str, there: str) -> None:
        self._begin_era()
        self.links.add_edge(here, there)
        for name, peer in ((here, there), (there, here)):
            self.nodes[name].channel.feeds[peer] = Wire(peer)  # type: ignore[assignment]
        self._update(here, there)

    def _update(self, *changed: str) -> None:
        """Spread the advertisements until all know the same."""
        for name in changed:
            self.nodes[name].channel.update_routes()
        is_new = True
        while is_new:
            is_new = False
            for here, there in [(a, b) for pair in self.links.edges for a, b in (pair, pair[::-1])]:
                channel = self.nodes[there].channel
                if channel.federation.learn(self.nodes[here].channel.federation.advertisements):
                    channel.update_routes()
                    is_new = True

    def _begin_era(self) -> None:
        self._read()
        self.era += 1
        self.in_order.clear()

    def _loaded(self) -> list[tuple[str, str]]:
        return [(name, peer) for name in NAMES for peer, wire in self.nodes[name].wires.items() if wire.batches]

    def _carry_one(self, name: str, peer: str) -> None:
        batch = self.nodes[name].wires[peer].batches.popleft()
        sent = EventBatch(batch.header, batch.times, batch.payloads, batch.first, name, batch.epoch)
        claims, duplicates, refused = self.nodes[peer].channel.forward([sent])
        if batch.header.origin == peer and life_of(batch.first) != self.nodes[peer].life:
            assert (claims, refused) == ([], len(batch))  # of an earlier process
        else:
            assert sum(len(claim) for claim, _ in claims) + duplicates == len(batch)
            assert refused == 0

    def _read(self) -> None:
        for name, node in self.nodes.items():
            for payload in node.got():
                self.got[name][payload] += 1
                self.due[payload].discard(name)
                era, origin = self.published[payload]
                if era == self.era:
                    self.in_order[name, origin].append(payload)

    def _lose(self, wire: Wire) -> None:
        for batch in wire.batches:
            for payload in batch.payloads:
                self.due[payload.decode()].clear()


TestFederation = FederationMachine.TestCase
TestFederation.settings = settings(max_examples=120, stateful_step_count=40, deadline=None)
