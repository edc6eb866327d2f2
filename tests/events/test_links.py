"""Links that are made, removed and made again; gateways whose peers do not answer, refuse, or come back."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robocorba.errors.events import InvalidPeer, SessionOver, UnknownPeer
from robocorba.errors.services import NotReachable
from robocorba.events import seen_events
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.federation import Advertisement, Federation
from robocorba.events.gateway import MAX_EARLY, FeedPort, Gateway
from robocorba.events.links import LinkSnapshot
from robocorba.events.peer_clock import Exchange
from robocorba.events.policies import LinkPolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.testing.processes import eventually
from tests.events.network import DEFAULTS, GatewayWire, Network, Node
from tests.events.samples import is_balanced
from tests.waits import stays


def link(node: Node) -> LinkSnapshot:
    (state,) = node.links.snapshots()
    return state


def is_up(*nodes: Node) -> bool:
    return all(state.feed.is_up and state.gateway.is_up for node in nodes for state in node.links.snapshots())


# ---- links ----


def test_a_link_that_one_end_adds_exists_at_both_ends() -> None:
    with Network("A", "B") as network:
        network.link("AB")
        eventually(lambda: len(network["B"].links.snapshots()) == 1 and is_up(*network.nodes.values()), what="the link")
        assert network["B"].store.records["A"].reference == "A"


def test_a_removed_link_ends_at_both_ends_and_can_be_added_again() -> None:
    with Network("A", "B") as network:
        a, b = network["A"], network["B"]
        network.link("AB")
        consumer = b.consume("t")
        eventually(lambda: a.knows("B") == ("t",) and is_up(a, b) and b.links.snapshots(), what="the link")
        a.links.remove("B")
        assert a.links.snapshots() == b.links.snapshots() == []
        a.publish("nobody")
        with pytest.raises(InvalidPeer, match="A has removed B; add it there again"):
            a.links.join("B", "B", GatewayWire(network, "A", "B"))

        a = network.restart("A")
        b = network.restart("B")
        consumer = b.consume("t")
        assert a.links.snapshots() == b.links.snapshots() == []

        network.link("AB")
        eventually(lambda: a.knows("B") == ("t",) and is_up(a, b) and b.links.snapshots(), what="the link again")
        a.publish("again")
        eventually(lambda: consumer.read() == ["again"], what="the event")


def test_a_peer_that_was_removed_while_unreachable_learns_why_it_is_refused() -> None:
    with Network("A", "B") as network:
        a, b = network["A"], network["B"]
        network.link("AB")
        eventually(lambda: is_up(a, b) and b.links.snapshots(), what="the link")
        network.cut.add(frozenset("AB"))
        a.links.remove("B")
        network.cut.clear()
        eventually(lambda: "A has removed B; add it there again" in link(b).gateway.problem, what="the reason")
        assert not link(b).feed.is_up or a.links.snapshots() == []
        a.links.add(Peer("B"))
        eventually(lambda: is_up(a, b) and a.links.snapshots(), what="the link again")


def test_a_second_channel_of_the_same_name_takes_nothing_from_the_first() -> None:
    with Network("A", "B") as network:
        a, b = network["A"], network["B"]
        network.link("AB")
        consumer = b.consume("t")
        eventually(lambda: a.knows("B") == ("t",) and is_up(a, b) and b.links.snapshots(), what="the link")
        joins = link(a).feed.joins
        with pytest.raises(InvalidPeer, match="another B is linked with A"):
            a.links.join("B", "a copy of B", GatewayWire(network, "A", "B"))
        a.publish("event")
        eventually(lambda: consumer.read() == ["event"], what="the event")
        assert (link(a).feed.joins, a.store.records["B"].reference) == (joins, "B")


def test_the_queue_of_a_removed_peer_is_discarded() -> None:
    with Network("A", "B") as network:
        a = network["A"]
        network.link("AB")
        network["B"].consume("t")
        eventually(lambda: a.knows("B") == ("t",), what="the interest")
        network.cut.add(frozenset("AB"))
        a.publish("1", "2", "3")
        feed = a.channel.feeds["B"]
        a.links.remove("B")
        assert feed.account.discarded == 3


@pytest.mark.parametrize(("name", "field"), [("A", "name"), ("", "name"), ("a/b", "name"), ("x" * 61, "name")])
def test_invalid_names_of_peers(name: str, field: str) -> None:
    with Network("A") as network:
        with pytest.raises(InvalidPeer) as refused:
            network["A"].links.add(Peer(name))
        assert refused.value.field == field
        assert network["A"].store.records == {}
        with pytest.raises(UnknownPeer):
            network["A"].links.remove("B")


def test_the_reference_of_a_peer_that_moved_is_saved() -> None:
    with Network("A", "B") as network:
        network.link("AB")
        eventually(lambda: is_up(*network.nodes.values()), what="the link")
        network.cut.add(frozenset("AB"))
        eventually(lambda: not link(network["A"]).feed.is_up, what="the end of the lease")
        network["A"].links.join("B", "where B is now", GatewayWire(network, "A", "B"))
        assert network["A"].store.records["B"].reference == "where B is now"


def test_a_renewal_overtaken_by_a_join_does_not_count_as_received() -> None:
    """Its answer never came: in the next session all advertisements are sent again."""
    with Network("A") as network:
        links = network["A"].links
        wire = GatewayWire(network, "A", "B")
        first, _ = links.join("B", "B", wire)
        sessions = []
        learn = links.learn

        def overtaken(news: list[Advertisement]) -> None:
            sessions.append(links.join("B", "B", wire)[0])
            learn(news)

        links.learn = overtaken  # type: ignore[method-assign]
        with pytest.raises(SessionOver):
            links.renew(first, 1, 0, [Advertisement("B", 1, ("A", "C"), ())])
        links.learn = learn  # type: ignore[method-assign]
        with pytest.raises(SessionOver):
            links.renew(first, 1, 0, [])
        assert [advertisement.name for advertisement in links.renew(sessions[0], 1, 0, [])] == ["A", "B"]
        assert links.renew(sessions[0], 1, 0, []) == []


def test_a_channel_that_ends_does_not_remove_itself_from_its_peers() -> None:
    """Also where it was about to join one of them."""
    with Network("A", "B") as network:
        a, b = network["A"], network["B"]
        held, let_go = threading.Event(), threading.Event()
        join = b.links.join

        def slow(*arguments: object) -> tuple[str, int]:
            held.set()
            assert let_go.wait(60.0)
            return join(*arguments)  # type: ignore[arg-type]

        b.links.join = slow  # type: ignore[method-assign]
        network.link("AB")
        assert held.wait(60.0)
        a.links.close()
        let_go.set()
        eventually(lambda: b.links.snapshots(), what="the join")
        stays(lambda: [(record.name, record.removed) for record in b.store.peers()] == [("A", False)])


# ---- what an idle federation costs ----


def observe_renewals(node: Node) -> list[float]:
    """When the sessions with the feeds of a node are renewed from here on [s, time.monotonic]."""
    renewed: list[float] = []
    renew = node.links.renew

    def observed(*arguments: Any) -> list[Advertisement]:
        renewed.append(time.monotonic())
        return renew(*arguments)

    node.links.renew = observed  # type: ignore[method-assign]
    return renewed


def test_renewals_show_that_a_link_works_without_empty_packets() -> None:
    policy = LinkPolicy(renew_interval_s=0.01, probe_interval_s=0.1, silence_s=0.3)
    with Network("A", "B", policy=policy) as network:
        a, b = network["A"], network["B"]
        packets = []
        forward = b.links.forward

        def observed(session: str, position: int, batches: list[EventBatch]) -> None:
            packets.append(position)
            forward(session, position, batches)

        b.links.forward = observed  # type: ignore[assignment]
        network.link("AB")
        eventually(lambda: is_up(a, b) and b.links.snapshots(), what="the link")
        packets.clear()
        renewed = observe_renewals(b)
        eventually(lambda: len(renewed) > 2 and renewed[-1] - renewed[0] > 4 * policy.silence_s, what="renewals")
        assert is_up(a, b)
        pauses = [after - before for before, after in itertools.pairwise(renewed)]  # of a busy machine
        assert len(packets) <= sum(pause > policy.probe_interval_s / 2 for pause in pauses)


def test_a_change_is_passed_on_at_once_only_to_those_who_do_not_get_it_from_its_channel() -> None:
    policy = LinkPolicy(renew_interval_s=600.0, lease_s=math.inf, silence_s=math.inf, probe_interval_s=600.0)
    with Network("A", "B", "C", "D", policy=policy) as network:
        network.link("AB", "AC", "BC", "CD")
        renewed = [observe_renewals(node) for node in network.nodes.values()]

        def is_quiet() -> bool:
            return max((times[-1] for times in renewed if times), default=0.0) < time.monotonic() - 0.5

        def all_know_that_links_are_up() -> bool:
            for node in network.nodes.values():
                node.links.send_advertisements()  # as a renewal does twice a second
            known = [entry for node in network.nodes.values() for entry in node.channel.federation.advertisements]
            return is_up(*network.nodes.values()) and not any(entry.down for entry in known)

        eventually(all_know_that_links_are_up, what="the links")
        eventually(is_quiet, what="no more calls")
        before = [len(times) for times in renewed]
        network["A"].consume("t")
        eventually(lambda: all(node.knows("A") == ("t",) for node in network.nodes.values()), what="the interest")
        eventually(is_quiet, what="no more calls")
        calls = [len(times) - earlier for times, earlier in zip(renewed, before, strict=True)]
        assert calls == [0, 1, 1, 1], "B and C were called by A, D by C"


@pytest.mark.parametrize(("peers", "pause_s"), [(1, 0.5), (10, 0.5), (16, 0.8), (29, 1.25), (255, 1.25)])
def test_sessions_are_renewed_less_often_with_many_peers(peers: int, pause_s: float) -> None:
    policy = LinkPolicy()
    assert policy.renewal_pause_s(peers) == pytest.approx(pause_s)
    assert 2 * policy.renewal_pause_s(peers) < policy.lease_s


# ---- a gateway alone ----


class Feed:
    """A peer's feed, which answers as the test wants."""

    def __init__(self) -> None:
        self.session, self.position = "s1", 1
        #: Called with each renewal.
        self.on_renewal: Callable[[], None] = lambda: None
        self.attempts: list[float] = []
        self.acknowledged: list[int] = []
        self.problem: Exception | None = None
        self.refused = 0
        self.joining = Exchange(0.0, 0.0, 0.0)

    def join(self) -> FeedPort:
        self.attempts.append(time.monotonic())
        if self.problem:
            raise self.problem
        return self

    def renew(self, position: int, refused: int, news: list[Advertisement]) -> tuple[list[Advertisement], Exchange]:
        if self.problem:
            raise self.problem
        self.on_renewal()
        self.refused = refused
        return [], self.joining

    def acknowledge(self, position: int) -> None:
        self.acknowledged.append(position)

    def leave(self) -> None:
        pass


class Alone:
    """A gateway of channel lab for its peer hall."""

    def __init__(self, folder: Path, policy: LinkPolicy = DEFAULTS) -> None:
        self.feed = Feed()
        self.channel = Channel(Federation("lab"), SeenEvents(folder / "seen"), 1)
        self.gateway = Gateway("hall", self.channel, self.feed.join, lambda news: None, policy)
        self.feed.on_renewal = self.probe

    def __enter__(self) -> Alone:
        self.gateway.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.gateway.end()
        self.gateway._thread.join(60.0)
        assert not self.gateway._thread.is_alive()
        assert is_balanced(self.gateway.snapshot().totals)

    def probe(self) -> None:
        """A packet arrives that holds no events, and that the gateway has had."""
        self.gateway.forward("s1", 0, [])

    def forward(self, position: int, *numbers: int, session: str = "s1") -> None:
        batches = [EventBatch(EventHeader("t", "s", "hall"), [1.0], [b"x"], number) for number in numbers]
        self.accept(position, *batches, session=session)

    def accept(self, position: int, *batches: EventBatch, session: str = "s1") -> None:
        for batch in batches:
            batch.targets = {"lab": 0}
        self.gateway.forward(session, position, [*batches])

    def received(self) -> tuple[int, int]:
        state = self.gateway.snapshot()
        return state.totals.received, state.duplicates


def test_early_packets_wait_and_duplicates_are_dropped(tmp_path: Path) -> None:
    with Alone(tmp_path) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        alone.forward(2, 12, 13)
        alone.forward(3, 14)
        assert alone.received() == (0, 0)
        alone.forward(1, 11, session="s0")
        assert alone.received() == (0, 0)
        alone.forward(1, 11)
        assert alone.received() == (4, 0)
        alone.forward(1, 11)  # the same packet again
        alone.forward(4, 14, 15)  # another packet that holds a copy
        assert alone.received() == (5, 1)


def test_early_packets_are_bounded(tmp_path: Path) -> None:
    with Alone(tmp_path) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        last = 2 * MAX_EARLY
        for position in range(last, 1, -1):
            alone.forward(position, position)
        alone.forward(1, 1)
        assert alone.received() == (MAX_EARLY + 1, 0)
        for position in range(MAX_EARLY + 2, last + 1):
            alone.forward(position, position)
        assert alone.received() == (last, 0)


def test_a_wake_while_the_peer_is_away_costs_one_attempt(tmp_path: Path) -> None:
    alone = Alone(tmp_path)
    alone.feed.problem = NotReachable("it is away")
    with alone:
        eventually(lambda: len(alone.feed.attempts) >= 3, what="attempts")
        alone.gateway.wake()
        stays(lambda: len(alone.feed.attempts) < 25, 0.5)
        assert alone.gateway.snapshot().problem == "it is away"
        alone.feed.problem = None
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")


def test_a_gateway_is_up_only_while_packets_arrive(tmp_path: Path) -> None:
    """Its own calls may get through where those of the feed do not."""
    policy = LinkPolicy(renew_interval_s=0.01, silence_s=0.1)
    with Alone(tmp_path, policy) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the first packet")
        alone.feed.on_renewal = lambda: None
        eventually(lambda: "has arrived for 0.1 s" in alone.gateway.snapshot().problem, what="the link to be down")
        alone.feed.problem = SessionOver("the session has ended")
        eventually(lambda: len(alone.feed.attempts) >= 2, what="another session")
        alone.feed.problem = None
        eventually(lambda: "nothing that it sends has arrived yet" in alone.gateway.snapshot().problem, what="why")
        alone.feed.on_renewal = alone.probe
        eventually(lambda: alone.gateway.snapshot().is_up, what="the link")


def test_the_reason_of_a_refusal_is_reported(tmp_path: Path) -> None:
    alone = Alone(tmp_path)
    alone.feed.problem = InvalidPeer("address", "the channel there is 'yard', not 'hall'")
    with alone:
        eventually(lambda: alone.gateway.snapshot().problem.startswith("refused: address: the channel"), what="why")
        alone.feed.problem = None
        alone.gateway.wake()
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")


def test_a_fault_does_not_end_the_gateway(tmp_path: Path) -> None:
    alone = Alone(tmp_path)
    alone.feed.problem = ValueError("a fault")
    with alone:
        eventually(lambda: "internal fault" in alone.gateway.snapshot().problem, what="a reported problem")
        alone.feed.problem = None
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")


def test_its_own_events_are_duplicates(tmp_path: Path) -> None:
    with Alone(tmp_path) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        alone.accept(1, EventBatch(EventHeader("t", "s", "lab"), [1.0], [b"x"], 1))
        assert alone.received() == (0, 1)


def test_expired_events_are_counted_and_not_published(tmp_path: Path) -> None:
    with Alone(tmp_path) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        header = EventHeader("t", "s", "hall", expiry=1.0)
        alone.accept(1, EventBatch(header, [time.time() - 5, time.time()], [b"x", b"y"], 1))
        assert alone.gateway.snapshot().totals == (2, 1, 0, 0, 1, 0)


def test_refused_events_are_reported_to_the_peer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seen_events, "MAX_INTERVALS", 2)
    with Alone(tmp_path) as alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        alone.forward(1, 11, 13, 15, 12)
        assert alone.gateway.snapshot().totals == (4, 3, 0, 1, 0, 0)
        alone.gateway.wake()
        eventually(lambda: alone.feed.refused == 1, what="the report")


def test_the_age_of_events_does_not_depend_on_clocks_that_are_set(tmp_path: Path) -> None:
    """The peer's system is an hour behind, its machine was started 1000 s later than this one."""
    alone = Alone(tmp_path)
    now = time.monotonic()
    alone.feed.joining = Exchange(now, now - 1000.0, now)
    with alone:
        eventually(lambda: alone.gateway.snapshot().is_up, what="the session")
        header, made = EventHeader("t", "s", "hall", expiry=10.0), time.time() - 3600.0
        batch = EventBatch(header, [made - 20.0, made - 5.0], [b"x", b"y"], 1)
        batch.epoch = made - (time.monotonic() - 1000.0)
        alone.accept(1, batch)
        snapshot = alone.gateway.snapshot()
        assert snapshot.totals == (2, 1, 0, 0, 1, 0)
        assert 5.0 <= snapshot.lag_s < 10.0
