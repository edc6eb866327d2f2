"""Federations whose links come and go, fail and are slow, whose channels end and restart with wrong clocks or without
their state: each consumer gets each event once and in order, and no event is lost but what a channel held that was
killed, or what had no way left.

There are no threads: links carry packets in any order of the links; what a channel learns of links that are down
spreads step by step; the rest is known everywhere at once."""

from __future__ import annotations

import itertools
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import networkx as nx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robocorba.events import seen_events
from robocorba.events.account import Account
from robocorba.events.arrival_clock import ArrivalClock
from robocorba.events.channel import Channel
from robocorba.events.event import EventBatch
from robocorba.events.event_numbers import first_number_of, next_life
from robocorba.events.federation import Advertisement, Federation
from robocorba.events.feed import Feed
from robocorba.events.policies import ChannelPolicy, LinkPolicy
from robocorba.events.seen_events import SeenEvents
from tests.events.samples import is_balanced, pull_supplier_of, pulled, supplied, wanting

NAMES = "ABCD"
EXPIRY_S = 3600.0
JUMPS_S = (0.0, 1.0, -1.0, 7200.0, -7200.0, 1e9, -1e9)

names = st.sampled_from(NAMES)


class Wire(Feed):
    """A feed that the test carries packets of."""

    def __init__(self, lock: threading.Lock, peer: str, is_up: bool) -> None:
        super().__init__(lock, peer, LinkPolicy(packet_events=2))
        self.works = is_up

    @property
    def problem(self) -> str:
        return "" if self.works else "cut"

    def accept(self, batch: EventBatch) -> bool:
        self.store(batch)
        return False

    @property
    def is_loaded(self) -> bool:
        return self._sent < len(self._unacknowledged) or self._queue.length > 0

    def send(self) -> list[EventBatch]:
        """The events of the next packet, which is in flight now."""
        if self._sent == len(self._unacknowledged):
            self._pack()
        packet = self._unacknowledged[self._sent]
        self._sent += 1
        return [batch.toward(dict(batch.targets or {})) for batch in packet.batches]

    def acknowledge_all(self) -> None:
        position = self._unacknowledged[self._sent - 1].position if self._sent else 0
        self.acknowledge(self.session, position + 1)

    def begin_session(self) -> None:
        self._sent = 0  # what is in flight is sent again
        self.works = True

    def held(self) -> Iterator[tuple[str, set[str]]]:
        """The payloads that it holds, and for whom."""
        batches = [batch for packet in self._unacknowledged for batch in packet.batches]
        for batch in [*batches, *self._queue.items()]:
            assert isinstance(batch, EventBatch)
            for payload in batch.payloads:
                yield payload.decode(), set(batch.targets or ())


class Node:
    """A channel with a consumer of some types."""

    def __init__(
        self,
        name: str,
        folder: Path,
        life: int = 1,
        known: Sequence[Advertisement] = (),
        ahead_s: float = 0.0,
        types: Iterable[str] = "t",
    ) -> None:
        self.life, self.ahead_s = life, ahead_s
        self.seen = SeenEvents(folder / f"{name}.seen")
        clock = ArrivalClock(lambda: time.time() + self.ahead_s)
        policy = ChannelPolicy(max_held_s=1e9)
        self.channel = Channel(Federation(name, known, life), self.seen, first_number_of(life), clock, policy)
        self.proxy = pull_supplier_of(self.channel, wanting(*types), 10**6)
        #: Of the events by peer, and how many came.
        self.arrivals: dict[str, Account] = defaultdict(Account)
        self.came: Counter[str] = Counter()

    @property
    def wires(self) -> dict[str, Wire]:
        return self.channel.feeds  # type: ignore[return-value]

    def link(self, *peers: str, is_up: bool = True) -> None:
        for peer in peers:
            self.channel.feeds[peer] = Wire(self.channel.lock, peer, is_up)

    def publish(self, type: str, *payloads: str) -> None:
        encoded = (payload.encode() for payload in payloads)
        self.channel.publish(supplied(type, *encoded, source=self.channel.name, expiry=EXPIRY_S), Account())

    def got(self) -> list[tuple[str, int, str]]:
        """Origin, number and payload of what its consumer gets."""
        return [(batch.header.origin, batch.first, batch.payloads[0].decode()) for batch in pulled(self.proxy)]


class FederationMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(seen_events, "MAX_LIVES", 64)  # smaller files
        self.nodes: dict[str, Node] = {}
        self.dead: set[str] = set()
        self.links: nx.Graph = nx.Graph()
        self.cut: set[frozenset[str]] = set()
        self.count = itertools.count()
        #: Who must still get each event.
        self.due: dict[str, set[str]] = {}
        #: What each consumer got since its channel lost its state: how often, and the last number of each stream.
        self.got: dict[str, Counter[str]] = defaultdict(Counter)
        self.last: dict[str, dict[tuple[str, int], int]] = defaultdict(dict)
        #: Of whom each channel knows, since it lost its state.
        self.known = {name: {name} for name in NAMES}
        #: What has arrived at each channel.
        self.arrived: dict[str, set[str]] = defaultdict(set)

    @initialize(shape=st.sampled_from([("AB", "BC", "CD"), ("AB", "BC", "CA", "CD"), ("AB", "AC", "BD", "CD")]))
    def start(self, shape: tuple[str, ...]) -> None:
        for name in NAMES:
            self.nodes[name] = Node(name, Path(self.folder.name), next_life(0))
        self.links.add_nodes_from(NAMES)
        for here, there in shape:
            self._link(here, there)

    # ---- what happens ----

    @rule(name=names, count=st.integers(1, 3))
    def publish(self, name: str, count: int) -> None:
        if name not in self.dead:
            payloads = [str(next(self.count)) for _ in range(count)]
            for payload in payloads:
                self.due[payload] = nx.node_connected_component(self.links, name) & self.known[name]
            self.nodes[name].publish("t", *payloads)

    @rule(data=st.data(), steps=st.integers(1, 8))
    def publish_everywhere(self, data: st.DataObject, steps: int) -> None:
        for name in NAMES:
            self.publish(name, 1)
        self.carry(data, steps)

    @rule(data=st.data(), steps=st.integers(1, 5))
    def carry(self, data: st.DataObject, steps: int) -> None:
        """The links that are not chosen are slow ones."""
        for _ in range(steps):
            if loaded := self._loaded():
                self._carry_one(*data.draw(st.sampled_from(loaded)))

    @rule(data=st.data())
    def acknowledge(self, data: st.DataObject) -> None:
        if pairs := [pair for pair in self._pairs() if self._works(*pair)]:
            name, peer = data.draw(st.sampled_from(pairs))
            with self.nodes[name].channel.lock:
                self.nodes[name].wires[peer].acknowledge_all()

    @rule(here=names, there=names)
    def add_link(self, here: str, there: str) -> None:
        if here != there and not self.links.has_edge(here, there) and self._reaches_all(self.links, (here, there)):
            self._link(here, there)

    @rule(data=st.data())
    def remove_link(self, data: st.DataObject) -> None:
        left = {link: nx.restricted_view(self.links, [], [link]) for link in self._links()}
        if links := [link for link in left if self._reaches_all(left[link])]:
            here, there = data.draw(st.sampled_from(links))
            held = [
                held for name, peer in ((here, there), (there, here)) for held in self.nodes[name].wires[peer].held()
            ]
            self.links.remove_edge(here, there)
            self.cut.discard(frozenset((here, there)))
            for name, peer in ((here, there), (there, here)):
                with self.nodes[name].channel.lock:
                    self.nodes[name].channel.remove_feed(peer)
            self._update()
            for name, peer in self._pairs():
                for payload, targets in self.nodes[name].wires[peer].held():
                    self.due[payload] -= targets - nx.node_connected_component(self.links, name)
            for payload, targets in held:
                for end in (here, there):
                    self.due[payload] -= targets - nx.node_connected_component(self.links, end)

    @rule(data=st.data(), losses=st.lists(st.booleans(), min_size=2, max_size=2))
    def cut_a_link(self, data: st.DataObject, losses: list[bool]) -> None:
        """What is in flight may be lost."""
        if links := [link for link in self._links() if self._works(*link)]:
            here, there = data.draw(st.sampled_from(links))
            self.cut.add(frozenset((here, there)))
            for (name, peer), is_lost in zip(((here, there), (there, here)), losses, strict=True):
                wire = self.nodes[name].wires[peer]
                if is_lost and wire.is_loaded:
                    wire.send()
                wire.works = False

    @precondition(lambda self: self.cut)
    @rule(data=st.data())
    def restore_a_link(self, data: st.DataObject) -> None:
        self._restore(data.draw(st.sampled_from(sorted(self.cut, key=sorted))))

    @rule(name=names)
    def notice(self, name: str) -> None:
        """A channel notices which of its links are down."""
        if name not in self.dead:
            self._find_routes(name)

    @rule(data=st.data())
    def spread(self, data: st.DataObject) -> None:
        """A channel learns what a peer knows."""
        if pairs := [pair for pair in self._pairs() if self._works(*pair)]:
            self._learn(*data.draw(st.sampled_from(pairs)))

    @rule(name=names)
    def kill(self, name: str) -> None:
        """What waits in its queues is lost."""
        if name in self.dead:
            return
        self._read()
        self.dead.add(name)
        for peer, wire in self.nodes[name].wires.items():
            for payload, targets in wire.held():
                self.due[payload] -= targets
            self.nodes[peer].wires[name].works = False
        for payload in self.arrived[name]:
            self.due[payload].discard(name)
        self.nodes[name].seen.__exit__(None, None, None)

    @precondition(lambda self: self.dead)
    @rule(data=st.data(), keeps_state=st.booleans(), ahead_s=st.sampled_from(JUMPS_S))
    def restart(self, data: st.DataObject, keeps_state: bool, ahead_s: float) -> None:
        self._restart(data.draw(st.sampled_from(sorted(self.dead))), keeps_state, ahead_s)

    @rule(name=names, ahead_s=st.sampled_from(JUMPS_S))
    def set_clock(self, name: str, ahead_s: float) -> None:
        self.nodes[name].ahead_s = ahead_s

    # ---- what must hold ----

    @invariant()
    def each_event_comes_once_and_in_order(self) -> None:
        self._read()
        assert all(count == 1 for counts in self.got.values() for count in counts.values())

    @invariant()
    def nobody_takes_restarts_for_a_conflict(self) -> None:
        assert all(not node.channel.federation.conflicts() for node in self.nodes.values())

    @invariant()
    def accounts_are_exact(self) -> None:
        for name, node in self.nodes.items():
            if name not in self.dead:
                assert all(is_balanced(wire.snapshot().totals) for wire in node.wires.values())
                for peer, account in node.arrivals.items():
                    assert is_balanced(account)
                    assert account.received + account.repeated == node.came[peer]

    def teardown(self) -> None:
        """In the end everything works again."""
        for name in sorted(self.dead):
            self._restart(name, keeps_state=True, ahead_s=0.0)
        for link in sorted(self.cut, key=sorted):
            self._restore(link)
        self._update()
        self._carry_all()
        for node in self.nodes.values():
            node.channel.release_overdue(is_over=True)
        self.each_event_comes_once_and_in_order()
        self.accounts_are_exact()
        assert {payload: due for payload, due in self.due.items() if due} == {}
        for node in self.nodes.values():
            node.seen.__exit__(None, None, None)
        self.patch.undo()
        self.folder.cleanup()

    # ---- inside ----

    def _links(self) -> list[tuple[str, str]]:
        return sorted((min(link), max(link)) for link in self.links.edges)

    def _pairs(self) -> list[tuple[str, str]]:
        """Of the channels that are alive, with their peers."""
        return [(name, peer) for name in NAMES if name not in self.dead for peer in sorted(self.links[name])]

    def _works(self, here: str, there: str) -> bool:
        return frozenset((here, there)) not in self.cut and not self.dead & {here, there}

    def _reaches_all(self, links: nx.Graph, *added: tuple[str, str]) -> bool:
        """Whether all that are linked would learn that these are the links now."""
        working = nx.Graph([*(link for link in links.edges if self._works(*link)), *added])
        working.add_nodes_from(NAMES)
        linked = nx.Graph([*links.edges, *added])
        linked.add_nodes_from(NAMES)
        return not self.dead and nx.number_connected_components(working) == nx.number_connected_components(linked)

    def _link(self, here: str, there: str) -> None:
        self.links.add_edge(here, there)
        for name, peer in ((here, there), (there, here)):
            self.nodes[name].link(peer)
        self._update()

    def _restore(self, link: frozenset[str]) -> None:
        self.cut.discard(link)
        here, there = sorted(link)
        if self._works(here, there):
            for name, peer in ((here, there), (there, here)):
                self.nodes[name].wires[peer].begin_session()

    def _restart(self, name: str, keeps_state: bool, ahead_s: float) -> None:
        before = self.nodes[name]
        self.dead.discard(name)
        if not keeps_state:
            (Path(self.folder.name) / f"{name}.seen").unlink()
            self.got[name].clear()
            self.last[name].clear()
            self.known[name] = {name}
        known = before.channel.federation.advertisements if keeps_state else []
        life = next_life(before.life if keeps_state else 0)
        node = self.nodes[name] = Node(name, Path(self.folder.name), life, known, ahead_s)
        for peer in self.links[name]:
            works = self._works(name, peer)
            node.link(peer, is_up=works)
            if works:
                self.nodes[peer].wires[name].begin_session()
        self._update()

    def _update(self) -> None:
        """Spread all advertisements until all know the same."""
        for name in NAMES:
            if name in self.nodes and name not in self.dead:
                self._find_routes(name)
        while any(self._learn(*pair) for pair in self._pairs() if self._works(*pair)):
            pass

    def _learn(self, here: str, there: str) -> bool:
        channel = self.nodes[there].channel
        self.known[there] |= self.known[here] & nx.node_connected_component(self.links, here)
        is_new = channel.federation.learn(self.nodes[here].channel.federation.advertisements)
        if is_new:
            self._find_routes(there)
        return is_new

    def _find_routes(self, name: str) -> None:
        with self.nodes[name].channel.lock:
            self.nodes[name].channel.update_routes()

    def _loaded(self) -> list[tuple[str, str]]:
        return [pair for pair in self._pairs() if self._works(*pair) and self.nodes[pair[0]].wires[pair[1]].is_loaded]

    def _carry_one(self, name: str, peer: str) -> None:
        there = self.nodes[peer]
        batches = self.nodes[name].wires[peer].send()
        there.came[name] += sum(map(len, batches))
        self.arrived[peer].update(payload.decode() for batch in batches for payload in batch.payloads)
        assert there.channel.forward(batches, there.arrivals[name]) == []

    def _carry_all(self) -> None:
        for _ in range(100_000):
            if not (loaded := self._loaded()):
                return
            self._carry_one(*loaded[0])
        raise AssertionError("events go round")

    def _read(self) -> None:
        for name, node in self.nodes.items():
            for origin, number, payload in node.got():
                self.got[name][payload] += 1
                self.due[payload].discard(name)
                stream = origin, number >> 32
                assert number > self.last[name].get(stream, 0), f"{name} gets {number} of {origin} too late"
                self.last[name][stream] = number


TestFederation = FederationMachine.TestCase
TestFederation.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)


# ---- which links carry what ----


@st.composite
def graphs(draw: st.DrawFn) -> nx.Graph:
    """Up to seven channels, all linked somehow."""
    names = "ABCDEFG"[: draw(st.integers(2, 7))]
    graph = nx.Graph((names[number], names[draw(st.integers(0, number - 1))]) for number in range(1, len(names)))
    pairs = st.tuples(st.sampled_from(names), st.sampled_from(names))
    graph.add_edges_from((a, b) for a, b in draw(st.lists(pairs, max_size=8)) if a != b)
    return graph


def linked(graph: nx.Graph, wants: Mapping[str, Iterable[str]], folder: Path) -> dict[str, Node]:
    """Channels that know all of each other."""
    nodes = {name: Node(name, folder, types=wants[name]) for name in sorted(graph)}
    for name, node in nodes.items():
        node.link(*sorted(graph[name]))
        node.channel.update_routes()
    for node in nodes.values():
        node.channel.federation.learn([other.channel.federation.own for other in nodes.values()])
        node.channel.update_routes()
    return nodes


@settings(max_examples=25, deadline=None)
@given(graphs(), st.data())
def test_one_copy_crosses_the_links_to_those_who_want_it_and_no_others(graph: nx.Graph, data: st.DataObject) -> None:
    wants = {name: data.draw(st.sets(st.sampled_from("ab"))) for name in sorted(graph)}
    supplied = data.draw(st.lists(st.tuples(st.sampled_from(sorted(graph)), st.sampled_from("ab")), max_size=12))
    carried: dict[tuple[str, str], list[str]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        nodes = linked(graph, wants, Path(folder))
        for number, (origin, type) in enumerate(supplied):
            nodes[origin].publish(type, str(number))
        while loaded := [(name, peer) for name in nodes for peer, wire in nodes[name].wires.items() if wire.is_loaded]:
            here, there = data.draw(st.sampled_from(loaded), label="link")
            batches = nodes[here].wires[there].send()
            carried[here, there] += [payload.decode() for batch in batches for payload in batch.payloads]
            nodes[there].channel.forward(batches, Account())
        got = {name: [payload for _, _, payload in node.got()] for name, node in nodes.items()}
    crossed: dict[tuple[str, str], list[str]] = defaultdict(list)
    for number, (origin, type) in enumerate(supplied):
        # Of the shortest paths to a channel, the first one by the names of the channels on it.
        wanted_by = [name for name in graph if type in wants[name]]
        paths = [min(nx.all_shortest_paths(graph, origin, name)) for name in wanted_by]
        for link in {link for path in paths for link in itertools.pairwise(path)}:
            crossed[link].append(str(number))
    assert {link: sorted(payloads, key=int) for link, payloads in carried.items()} == crossed
    for name, payloads in got.items():
        assert sorted(payloads, key=int) == [str(n) for n, (_, type) in enumerate(supplied) if type in wants[name]]


def test_events_that_nobody_needs_there_are_counted_as_unseen(tmp_path: Path) -> None:
    node = linked(nx.Graph(["AB", "AC"]), {"A": "", "B": "a", "C": ""}, tmp_path)["A"]
    for type in "abb":
        node.publish(type, "x")
    assert [(wire.unseen, len([*wire.held()])) for wire in node.wires.values()] == [(2, 1), (3, 0)]
