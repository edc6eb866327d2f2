"""The routes of events: random federations, without threads. Each link is a queue whose order is kept."""

from __future__ import annotations

import itertools
import tempfile
from collections import deque
from collections.abc import Mapping
from pathlib import Path

import networkx as nx
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.events.account import Account, Arrivals
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.federation import Federation
from robocorba.events.proxy_supplier import ProxyPullSupplier
from robocorba.events.queue import QueuePolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.events.subscription import checked
from tests.events.network import batch_of

TYPES = ("a", "b")


class RecordedFeed:
    """Stands in for a feed: records the events for `peer`."""

    def __init__(self, peer: str) -> None:
        self.peer, self.unseen, self.is_up = peer, 0, True
        self.batches: deque[EventBatch] = deque()
        self.carried: list[bytes] = []

    def accept(self, batch: EventBatch) -> bool:
        self.batches.append(batch)
        self.carried += batch.payloads
        return False

    def withdraw(self, next_peers: Mapping[str, str]) -> list[EventBatch]:
        return []


class Node:
    """A channel whose consumer wants events of `types`."""

    def __init__(self, name: str, peers: list[str], types: set[str], folder: Path) -> None:
        self.channel = Channel(Federation(name), SeenEvents(folder / name), 1)
        self.feeds = {peer: RecordedFeed(peer) for peer in peers}
        self.channel.feeds.update(self.feeds)  # type: ignore[arg-type]
        self.proxy = ProxyPullSupplier(
            self.channel.lock, "1", checked([([(t, "")], 0) for t in types]), QueuePolicy(10**6)
        )
        self.proxy.connect(None)
        self.channel.proxy_suppliers["1"] = self.proxy
        self.channel.update_routes()

    def got(self) -> list[bytes]:
        result: list[bytes] = []
        while batch := self.proxy.pull(0.0):
            result += batch.payloads
        return result


@st.composite
def federations(draw: st.DrawFn) -> tuple[nx.Graph, dict[str, set[str]]]:
    """Up to seven channels, all linked somehow, and what each of them wants."""
    count = draw(st.integers(2, 7))
    names = [chr(ord("A") + number) for number in range(count)]
    graph: nx.Graph = nx.Graph()
    for number in range(1, count):
        graph.add_edge(names[number], names[draw(st.integers(0, number - 1))])
    pairs = st.tuples(st.sampled_from(names), st.sampled_from(names))
    graph.add_edges_from((a, b) for a, b in draw(st.lists(pairs, max_size=8)) if a != b)
    return graph, {name: draw(st.sets(st.sampled_from(TYPES))) for name in names}


@settings(max_examples=60, deadline=None)
@given(federations(), st.data())
def test_each_consumer_gets_one_copy_in_order_and_nobody_else_gets_any(
    federation: tuple[nx.Graph, dict[str, set[str]]], data: st.DataObject
) -> None:
    graph, wants = federation
    names = sorted(graph)
    with tempfile.TemporaryDirectory() as folder:
        nodes = {name: Node(name, sorted(graph[name]), wants[name], Path(folder)) for name in names}
        advertisements = [node.channel.federation.own for node in nodes.values()]
        for node in nodes.values():
            node.channel.federation.learn(advertisements)
            node.channel.update_routes()

        supplied: dict[tuple[str, str], list[bytes]] = {}
        events = st.lists(st.tuples(st.sampled_from(names), st.sampled_from(TYPES)), max_size=12)
        for count, (origin, type) in enumerate(data.draw(events)):
            supplied.setdefault((origin, type), []).append(b"%d" % count)
            nodes[origin].channel.publish(batch_of(str(count), type=type, source=origin), Account())
            _carry(nodes, data, at_most=2)
        _carry(nodes, data)

        for name, node in nodes.items():
            got = node.got()
            assert len(got) == len(set(got))
            for (_, type), payloads in supplied.items():
                expected = payloads if type in wants[name] else []
                assert [payload for payload in got if payload in payloads] == expected
        for (origin, type), payloads in supplied.items():
            # Of the shortest paths to a channel, the first one by the names of the channels on it.
            paths = [
                min(nx.all_shortest_paths(graph, origin, name))
                for name in names
                if type in wants[name] and name != origin
            ]
            used = {link for path in paths for link in itertools.pairwise(path)}
            for here in names:
                for feed in nodes[here].feeds.values():
                    expected = payloads if (here, feed.peer) in used else []
                    assert [payload for payload in feed.carried if payload in payloads] == expected


def _carry(nodes: dict[str, Node], data: st.DataObject, at_most: int = 10**6) -> None:
    """Move batches from one channel to the next, in any order of the links."""
    for _ in range(at_most):
        loaded = [(name, feed) for name, node in nodes.items() for feed in node.feeds.values() if feed.batches]
        if not loaded:
            return
        _, feed = data.draw(st.sampled_from(loaded), label="link")
        sent = feed.batches.popleft()
        nodes[feed.peer].channel.forward([sent.toward(dict(sent.targets or {}))], Arrivals())


def test_events_that_nobody_needs_there_are_counted_as_unseen(tmp_path: Path) -> None:
    node = Node("A", ["B", "C"], set(), tmp_path)
    other = Node("B", ["A"], {"a"}, tmp_path)
    third = Node("C", ["A"], set(), tmp_path)
    node.channel.federation.learn([other.channel.federation.own, third.channel.federation.own])
    node.channel.update_routes()
    for type in ("a", "b", "b"):
        node.channel.publish(batch_of("x", type=type), Account())
    assert [(feed.unseen, len(feed.batches)) for feed in node.feeds.values()] == [(2, 1), (3, 0)]
