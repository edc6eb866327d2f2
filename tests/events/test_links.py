"""Links that are made and removed, on wires that fail; gateways whose peers do not answer, refuse, or come back."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.events import InvalidPeer, SessionOver, UnknownPeer
from robocorba.errors.services import NotReachable
from robocorba.events import seen_events
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.federation import MAX_CHANNELS, Advertisement, Federation
from robocorba.events.gateway import FeedPort, Gateway
from robocorba.events.links import LinkSnapshot
from robocorba.events.peer_clock import MAX_EXCHANGES, STEADY_S, Exchange, PeerClock
from robocorba.events.policies import LinkPolicy
from robocorba.events.seen_events import SeenEvents
from robocorba.system.backoff import Backoff
from testkit.processes import eventually
from tests.events.network import DEFAULTS, Consumer, GatewayWire, Network, Node, Weather
from tests.events.samples import arrive, is_balanced
from tests.waits import pause, stays


def link(node: Node) -> LinkSnapshot:
    (state,) = node.links.snapshots()
    return state


def is_up(*nodes: Node) -> bool:
    return all(state.feed.is_up and state.gateway.is_up for node in nodes for state in node.links.snapshots())


def test_a_channel_too_many_or_of_a_wrong_name_is_refused_and_named() -> None:
    names = ["A", *(f"c{number}" for number in range(1, MAX_CHANNELS))]
    chain = [
        Advertisement(name, 1, tuple(names[max(0, at - 1) : at] + names[at + 1 : at + 2]), ())
        for at, name in enumerate(names)
    ]
    with Network("A") as network:
        links = network["A"].links
        for name in ("A", "a/b"):
            with pytest.raises(InvalidPeer) as refused:
                links.add(Peer(name))
            assert refused.value.field == "name"
        with pytest.raises(UnknownPeer):
            links.remove("B")
        assert network["A"].store.peers() == []
        links.add(Peer("c1"))
        links.learn(chain[1:])
        links.add(Peer(names[-1]))  # it is in the federation
        for call in (lambda: links.add(Peer("new")), lambda: links.join("new", "new", lambda *_: [])):
            with pytest.raises(InvalidPeer, match="the federation of A has 256 channels, the maximum"):
                call()
        links.learn([chain[-1]._replace(version=2, peers=(names[-2], "far")), Advertisement("far", 1, names[-1:], ())])
        assert links.snapshots()[0].gateway.warning == "without far: the maximum is 256 channels"


def record(node: Node, peer: str) -> Peer:
    """What a node has stored of a peer."""
    return next(each for each in node.store.peers() if each.name == peer)


def await_link(network: Network) -> None:
    a, b = network["A"], network["B"]
    eventually(lambda: a.knows("B") == ("t",) and is_up(a, b) and b.links.snapshots(), what="the link")


@pytest.fixture
def pair() -> Iterator[Network]:
    """A, which has added its link with B, and B with a consumer of events t."""
    with Network("A", "B") as network:
        network.link("AB")
        network["B"].consume("t")
        await_link(network)
        yield network


def test_a_removed_link_ends_at_both_ends_and_can_be_added_again(pair: Network) -> None:
    a, b = pair["A"], pair["B"]
    assert record(b, "A").reference == "A"  # one end has added it, both have it
    a.links.remove("B")
    assert a.links.snapshots() == b.links.snapshots() == []
    a.publish("nobody")
    a, b, before = pair.restart("A"), pair.restart("B"), a
    for node in (before, a):
        with pytest.raises(InvalidPeer, match="A has removed B; add it there again"):
            node.links.join("B", "B", GatewayWire(pair, "A", "B").forward)
    consumer = b.consume("t")
    assert a.links.snapshots() == b.links.snapshots() == []

    pair.link("AB")
    await_link(pair)
    a.publish("again")
    eventually(lambda: consumer.read() == ["again"], what="the event")


def test_a_peer_that_was_removed_while_unreachable_learns_why_it_is_refused(pair: Network) -> None:
    a, b = pair["A"], pair["B"]
    pair.cut.add(frozenset("AB"))
    a.publish("1", "2", "3")
    account = a.channel.feeds["B"].account
    a.links.remove("B")
    assert account.discarded == 3
    pair.cut.clear()
    eventually(lambda: "A has removed B; add it there again" in link(b).gateway.problem, what="the reason")
    assert not link(b).feed.is_up or a.links.snapshots() == []
    a.links.add(Peer("B"))
    eventually(lambda: is_up(a, b) and a.links.snapshots(), what="the link again")


def test_a_second_channel_of_the_same_name_takes_nothing_from_the_first_unless_it_has_moved(pair: Network) -> None:
    a, joins, wire = pair["A"], link(pair["A"]).feed.joins, GatewayWire(pair, "A", "B").forward
    with pytest.raises(InvalidPeer, match="another B is linked with A"):
        a.links.join("B", "a copy of B", wire)
    a.publish("event")
    eventually(lambda: pair["B"].consumers[0].read() == ["event"], what="the event")
    assert (link(a).feed.joins, record(a, "B").reference) == (joins, "B")
    pair.cut.add(frozenset("AB"))
    eventually(lambda: not link(a).feed.is_up, what="the end of the lease")
    a.links.join("B", "where B is now", wire)
    assert record(a, "B").reference == "where B is now"


def test_a_renewal_overtaken_by_a_join_does_not_count_as_received() -> None:
    """Its answer never came: in the next session all advertisements are sent again."""
    with Network("A") as network:
        links = network["A"].links
        wire = GatewayWire(network, "A", "B").forward
        first, _ = links.join("B", "B", wire)
        assert [advertisement.name for advertisement in links.renew(first, 1, 0, [])] == ["A"]
        sessions = []
        with pytest.MonkeyPatch.context() as patch:
            learn = links.learn
            patch.setattr(links, "learn", lambda news: (sessions.append(links.join("B", "B", wire)[0]), learn(news)))
            with pytest.raises(SessionOver):
                links.renew(first, 1, 0, [Advertisement("B", 1, ("A", "C"), ())])
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


def test_nothing_waits_for_peers_that_are_gone(pair: Network) -> None:
    """What waits for earlier events is delivered when the last link is removed."""
    consumer = pair["A"].consume("t")
    late = EventBatch(EventHeader("t", "s", "B"), [1.0], [b"late"], 5)
    arrive(pair["A"].channel, late, before=4)
    assert consumer.read() == []
    pair["A"].links.remove("B")
    eventually(lambda: consumer.read() == ["late"], what="the event that has waited")


#: Shorter intervals than the defaults.
QUICK = LinkPolicy(
    renew_interval_s=0.02, retransmit_s=0.02, recheck_s=0.02, probe_interval_s=0.05, backoff=Backoff(0.05, 0.05)
)


def stormy(seed: int) -> Weather:
    return Weather(seed, lost=0.1, twice=0.1, late=0.1, fails=0.05)


def states(network: Network) -> list[LinkSnapshot]:
    return [state for node in network.nodes.values() for state in node.links.snapshots()]


def link_all(network: Network, *shape: str, consuming: str) -> dict[str, Consumer]:
    """Link nodes, and wait until all know all links and what the consumers want, one at each of these nodes."""
    network.link(*shape)
    consumers = {name: network[name].consume("t") for name in consuming}
    wanted = {frozenset(pair) for pair in shape}

    def is_known() -> bool:
        for node in network.nodes.values():
            with node.channel.lock:
                known = {entry.name: entry.peers for entry in node.channel.federation.advertisements}
            links = {frozenset((a, b)) for a, peers in known.items() for b in peers if a in known.get(b, ())}
            if links != wanted or any(node.knows(name) != ("t",) for name in consuming):
                return False
        return True

    eventually(is_known, what="all links and the interest everywhere")
    return consumers


def check(network: Network, consumers: dict[str, Consumer], supplied: dict[str, list[str]]) -> None:
    """Each consumer gets what each node has supplied, in order, and nothing else."""
    total = sum(map(len, supplied.values()))
    for consumer in consumers.values():
        eventually(lambda consumer=consumer: len(consumer.read()) >= total, what="all events")
    stays(lambda: all(len(consumer.read()) == total for consumer in consumers.values()))
    for consumer in consumers.values():
        for origin, payloads in supplied.items():
            assert [text for text in consumer.got if text.startswith(origin)] == payloads
    for state in states(network):
        assert is_balanced(state.feed.totals) and is_balanced(state.gateway.totals)


@pytest.mark.parametrize(
    ("shape", "seed"),
    [
        *((("AB", "BC"), seed) for seed in range(4)),
        (("AB", "BC", "CA"), 7),
        (("AB", "AC", "BD", "CD"), 7),
        (("AB", "AC", "AD", "BC", "BD", "CD"), 7),
    ],
)
def test_each_event_comes_once_and_in_order(shape: tuple[str, ...], seed: int) -> None:
    """Also by several paths, and while a consumer changes what else it wants."""
    weather, names = stormy(seed), sorted(set("".join(shape)))
    supplied = {name: [f"{name}{number}" for number in range(100)] for name in names}
    with Network(*names, weather=weather, policy=QUICK) as network:
        consumers = link_all(network, *shape, consuming="".join(names))

        def talk(name: str) -> None:
            for number, payload in enumerate(supplied[name]):
                network[name].publish(payload, source=name)
                if number % 10 == 0:
                    consumers[name].change("t", f"x{number}")
                pause(0.001)

        with ThreadPoolExecutor(len(names)) as speakers:
            list(speakers.map(talk, names, timeout=60.0))
        weather.clear_up()
        check(network, consumers, supplied)
        eventually(lambda: not any(state.feed.totals.queued for state in states(network)), what="all acknowledged")
        if shape == ("AB", "BC"):
            assert link(network["A"]).feed.totals.received == 100


def test_the_supplying_end_restarts_and_its_events_are_new() -> None:
    with Network("A", "B", policy=QUICK) as network:
        consumer = link_all(network, "AB", consuming="B")["B"]
        eventually(lambda: network["B"].links.is_in_force(consumer.proxy, "A"), what="the interest at A, on its disk")
        network["A"].publish("before")
        eventually(lambda: consumer.read() == ["before"], what="the first event")
        network.cut.add(frozenset("AB"))
        network.restart("A").publish("after")  # no peer can send the interest of B: it is in the store
        network.cut.clear()
        eventually(lambda: consumer.read() == ["before", "after"], what="the second event")


def test_both_ends_agree_that_a_link_is_down_where_one_of_them_cannot_be_called() -> None:
    """As behind a firewall: B can call A, and A can't call B."""
    with Network("A", "B", policy=replace(QUICK, lease_s=0.2, silence_s=0.2)) as network:
        consumer = link_all(network, "AB", consuming="B")["B"]

        def conditions() -> list[bool]:
            return [end.is_up for state in states(network) for end in (state.feed, state.gateway)]

        eventually(lambda: conditions() == [True] * 4, what="the link")
        network.refused.add(("A", "B"))
        network["A"].publish("1")
        eventually(lambda: conditions() == [False] * 4, what="the link to be down at both ends")
        stays(lambda: not any(conditions()), 0.4)  # while B renews its session with A again and again
        at_a, at_b = states(network)
        assert (at_a.feed.problem, at_a.gateway.problem) == ("B is away", "B is away")
        assert "nothing that it sends has arrived" in at_b.gateway.problem
        assert "has not called" in at_b.feed.problem
        assert not network["B"].links.is_in_force(consumer.proxy, "A")
        network.refused.clear()
        eventually(lambda: conditions() == [True] * 4, what="the link again")
        eventually(lambda: consumer.read() == ["1"], what="what waited")


def test_what_waits_for_a_link_that_is_down_goes_by_the_other_way() -> None:
    """And by the shorter way again when it is up."""
    with Network("A", "B", "C", policy=replace(QUICK, lease_s=0.2, silence_s=0.5)) as network:
        consumers = link_all(network, "AB", "BC", "CA", consuming="ABC")
        eventually(lambda: all(state.feed.is_up for state in states(network)), what="all links")
        published: dict[str, list[str]] = {name: [] for name in "ABC"}

        def publish(count: int) -> None:
            for _ in range(count):
                for name in "ABC":
                    published[name].append(f"{name}{len(published[name])}")
                    network[name].publish(published[name][-1])
                pause(0.001)

        for _ in range(2):
            publish(100)
            network.cut.add(frozenset("AB"))
            publish(100)
            check(network, consumers, published)  # all by way of C
            network.cut.clear()
        eventually(lambda: all(state.feed.is_up for state in states(network)), what="all links again")
        publish(1)
        check(network, consumers, published)
        assert network["C"].channel.feeds["B"].account.delivered >= 400 + 200, "those of C, and those of A meanwhile"
        eventually(lambda: all(not state.feed.totals.queued for state in states(network)), what="all acknowledged")


def observe(node: Node, operation: str) -> list[float]:
    """When an operation of a node's links is called from here on [s, time.monotonic]."""
    called: list[float] = []
    original = getattr(node.links, operation)
    setattr(node.links, operation, lambda *arguments: (called.append(time.monotonic()), original(*arguments))[1])
    return called


def test_renewals_show_that_a_link_works_without_empty_packets() -> None:
    policy = LinkPolicy(renew_interval_s=0.01, probe_interval_s=0.1, silence_s=0.3)
    with Network("A", "B", policy=policy) as network:
        a, b = network["A"], network["B"]
        network.link("AB")
        eventually(lambda: is_up(a, b) and b.links.snapshots(), what="the link")
        packets, renewed = observe(b, "forward"), observe(b, "renew")
        eventually(lambda: len(renewed) > 2 and renewed[-1] - renewed[0] > 4 * policy.silence_s, what="renewals")
        assert is_up(a, b)
        pauses = [after - before for before, after in itertools.pairwise(renewed)]  # of a busy machine
        assert len(packets) <= sum(pause > policy.probe_interval_s / 2 for pause in pauses)


def test_a_change_is_passed_on_at_once_only_to_those_who_do_not_get_it_from_its_channel() -> None:
    policy = LinkPolicy(renew_interval_s=600.0, lease_s=math.inf, silence_s=math.inf, probe_interval_s=600.0)
    with Network("A", "B", "C", "D", policy=policy) as network:
        network.link("AB", "AC", "BC", "CD")
        renewed = [observe(node, "renew") for node in network.nodes.values()]

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


class Feed:
    """A peer's feed, which answers as the test wants. problem: raised by its calls."""

    def __init__(self, problem: Exception | None, joining: Exchange) -> None:
        self.session, self.position, self.joining = "s1", 1, joining
        #: Called with each renewal.
        self.on_renewal: Callable[[], None] = lambda: None
        self.attempts: list[float] = []
        self.problem = problem
        self.refused = 0

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

    def acknowledge(self, position: int = 0) -> None:
        pass

    leave = acknowledge


class Alone:
    """A gateway of channel lab for its peer hall."""

    def __init__(
        self,
        folder: Path,
        policy: LinkPolicy = DEFAULTS,
        problem: Exception | None = None,
        joining: Exchange = Exchange(0.0, 0.0, 0.0),  # noqa: B008
    ) -> None:
        self.feed = Feed(problem, joining)
        self.channel = Channel(Federation("lab"), SeenEvents(folder / "seen"), 1)
        self.gateway = Gateway("hall", self.channel, self.feed.join, lambda news: None, policy)
        self.feed.on_renewal = self.probe

    def __enter__(self) -> Alone:
        self.gateway.start()
        if not self.feed.problem:
            self.await_link()
        return self

    def __exit__(self, *_: object) -> None:
        self.gateway.end()
        self.gateway._thread.join(60.0)
        assert not self.gateway._thread.is_alive()
        assert is_balanced(self.gateway.snapshot().totals)

    def await_link(self) -> None:
        eventually(lambda: self.gateway.snapshot().is_up, what="the session")

    def await_problem(self, problem: str) -> None:
        eventually(lambda: problem in self.gateway.snapshot().problem, what=problem)

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
        return state.totals.received, state.totals.repeated


@pytest.fixture
def alone(tmp_path: Path) -> Iterator[Alone]:
    with Alone(tmp_path) as alone:
        yield alone


def test_early_packets_wait_up_to_a_limit_and_duplicates_are_dropped(alone: Alone) -> None:
    alone.forward(2, 12, 13)
    alone.forward(3, 14)
    alone.forward(1, 11, session="s0")
    assert alone.received() == (0, 0)
    alone.forward(1, 11)
    assert alone.received() == (4, 0)
    alone.forward(1, 11)  # the same packet again
    alone.forward(4, 14, 15)  # another packet that holds a copy
    assert alone.received() == (5, 1)
    alone.accept(5, EventBatch(EventHeader("t", "s", "lab"), [1.0], [b"x"], 1))  # its own
    assert alone.received() == (5, 2)
    last = 6 + 2 * DEFAULTS.max_early
    for position in range(last, 5, -1):
        alone.forward(position, 100 + position)
    assert alone.received() == (5 + 1 + DEFAULTS.max_early, 2)


@pytest.mark.parametrize(
    ("problem", "shown"),
    [
        (NotReachable("it is away"), "it is away"),
        (InvalidPeer("address", "the channel there is 'yard', not 'hall'"), "refused: address: the channel"),
        (ValueError("a fault"), "internal fault"),
    ],
)
def test_why_a_peer_is_not_joined_is_shown_until_it_is(tmp_path: Path, problem: Exception, shown: str) -> None:
    with Alone(tmp_path, problem=problem) as alone:
        alone.await_problem(shown)
        alone.feed.problem = None
        alone.gateway.wake()
        alone.await_link()


def test_a_wake_while_the_peer_is_away_costs_one_attempt_and_news_none(tmp_path: Path) -> None:
    """It sends all advertisements when it joins; in a mesh under load each change would cost attempts."""
    policy = LinkPolicy(backoff=Backoff(60.0, 60.0))
    with Alone(tmp_path, policy, problem=NotReachable("it is away")) as alone:
        alone.await_problem("it is away")
        alone.gateway.send_news()
        stays(lambda: len(alone.feed.attempts) == 1)
        alone.gateway.wake()
        eventually(lambda: len(alone.feed.attempts) == 2, what="another attempt")
        stays(lambda: len(alone.feed.attempts) == 2)


@pytest.mark.parametrize(("peers", "pause_s"), [(10, 0.0), (20, 0.2)])
def test_news_is_sent_at_once_to_a_few_peers_and_together_to_many(tmp_path: Path, peers: int, pause_s: float) -> None:
    """Without news there would be no renewal for minutes, or after two such pauses."""
    policy = LinkPolicy(renew_interval_s=2 * pause_s or 600.0, max_renew_interval_s=2 * pause_s)
    with Alone(tmp_path, policy) as alone:
        alone.channel.feeds.update((str(number), alone.channel) for number in range(peers))  # type: ignore[misc]
        renewals: list[float] = []
        alone.feed.on_renewal = lambda: (renewals.append(time.monotonic()), alone.probe())
        for _ in range(10):
            known = len(renewals)
            alone.gateway.send_news()
            eventually(lambda known=known: len(renewals) > known, what="a renewal")
        assert min(later - earlier for earlier, later in itertools.pairwise(renewals)) >= 0.99 * pause_s


def test_a_gateway_is_up_only_while_packets_arrive(tmp_path: Path) -> None:
    """Its own calls may get through where those of the feed do not."""
    with Alone(tmp_path, LinkPolicy(renew_interval_s=0.01, silence_s=0.1)) as alone:
        alone.feed.on_renewal = lambda: None
        alone.await_problem("has arrived for 0.1 s")
        alone.feed.problem = SessionOver("the session has ended")
        eventually(lambda: len(alone.feed.attempts) >= 2, what="another session")
        alone.feed.problem = None
        alone.await_problem("nothing that it sends has arrived yet")
        alone.feed.on_renewal = alone.probe
        alone.await_link()


def test_refused_events_are_reported_to_the_peer(alone: Alone, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seen_events, "MAX_INTERVALS", 2)
    alone.forward(1, 11, 13, 15, 12)
    assert alone.gateway.snapshot().totals == Account(4, 3, discarded=1, refused=1)
    alone.gateway.forward("s1", 2, [], invalid=2)  # which could not be read
    assert alone.gateway.snapshot().totals == Account(6, 3, discarded=3, refused=3)
    alone.gateway.wake()
    eventually(lambda: alone.feed.refused == 3, what="the report")


def test_the_age_of_events_does_not_depend_on_clocks_that_are_set(tmp_path: Path) -> None:
    """The peer's system is an hour behind, its machine was started 1000 s later than this one."""
    now = time.monotonic()
    with Alone(tmp_path, joining=Exchange(now, now - 1000.0, now)) as alone:
        header, made = EventHeader("t", "s", "hall", expiry=10.0), time.time() - 3600.0
        epoch = made - (time.monotonic() - 1000.0)
        alone.accept(1, EventBatch(header, [made - 20.0, made - 5.0], [b"x", b"y"], 1, epoch=epoch))
        snapshot = alone.gateway.snapshot()
        assert snapshot.totals == Account(2, 1, expired=1)
        assert 5.0 <= snapshot.lag_s < 10.0


delays = st.floats(0.0, 5.0)


@given(st.floats(-1e6, 1e6), st.lists(st.tuples(delays, delays), min_size=1, max_size=300))
def test_the_error_of_a_clock_is_at_most_half_of_the_shortest_recent_round_trip(
    behind_s: float, calls: list[tuple[float, float]]
) -> None:
    clock, now = PeerClock(), 1000.0
    for there_s, back_s in calls:
        clock.measure(Exchange(now, now + there_s - behind_s, now + there_s + back_s))
        now += 5.0
    shortest = min(there_s + back_s for there_s, back_s in calls[-MAX_EXCHANGES:])
    assert abs(clock.behind_s - behind_s) <= shortest / 2.0 + STEADY_S + 1e-6
    clock.reset()  # another process of the peer has another clock
    clock.measure(Exchange(200.0, 1.0, 202.0))
    assert clock.behind_s == 200.0
