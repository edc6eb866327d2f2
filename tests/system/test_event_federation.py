"""Four channels: who gets what, how often, and what the links say of it."""

from __future__ import annotations

import operator
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from robocorba.stubs import RoboCorba
from testkit.federation import LIMIT_S, Channels, Consumer, Counts, channels
from testkit.processes import eventually
from tests.waits import outlast, stays

pytestmark = pytest.mark.system

#: The others are tested without processes.
SHAPES = {"mesh": ("AB", "AC", "AD", "BC", "BD", "CD"), "diamond": ("AB", "AC", "BD", "CD")}


@pytest.fixture(scope="module")
def federation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Channels]:
    with channels(tmp_path_factory.mktemp("federation"), *"ABCD") as started:
        yield started


@pytest.fixture
def at(federation: Channels) -> Iterator[Channels]:
    """The federation, without any consumer before and after."""
    yield federation
    for client in federation.clients.values():
        client.close()


def linked(at: Channels, *types: str) -> Consumer:
    """Link A and B; a consumer at B, whose subscription is in force at A."""
    at.shape("AB")
    consumer = Consumer(at.clients["B"], types or ("t",))
    assert consumer.subscription.wait_in_force("A")
    return consumer


def check_got(consumers: dict[str, Consumer], said: dict[str, list[int]]) -> None:
    """Each consumer gets exactly one copy of everything, in order."""

    def got() -> list[list[int]]:
        return [consumer.payloads(origin) for consumer in consumers.values() for origin in said]

    expected = [numbers for _ in consumers for numbers in said.values()]
    counts = [len(numbers) for numbers in expected]
    eventually(lambda: all(map(operator.ge, map(len, got()), counts)), LIMIT_S, "all that was said")
    stays(lambda: got() == expected, 0.2)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_each_consumer_gets_exactly_one_copy(at: Channels, shape: tuple[str, ...]) -> None:
    at.shape(*shape)
    consumers = {name: Consumer(client, ()) for name, client in at.clients.items()}
    at.wait_reaches(consumers, "ABCD")

    def talk(name: str) -> None:
        for number in range(100):
            at.clients[name].push("t", number)

    with ThreadPoolExecutor() as speakers:
        list(speakers.map(talk, "ABCD"))
    check_got(consumers, {name: list(range(100)) for name in "ABCD"})
    at.check_links(*shape)


def test_an_uninterested_channel_receives_nothing(at: Channels) -> None:
    at.shape("AB", "BC")
    wanting = Consumer(at.clients["B"], ("wanted",))
    assert wanting.subscription.wait_in_force("A")
    at.clients["A"].push_many("unwanted", range(500))
    at.clients["A"].push_many("wanted", range(10))
    eventually(lambda: len(wanting.payloads("A", "wanted")) == 10, LIMIT_S, "what is wanted")

    out, came = at.outgoing("A", "B"), at.incoming("B", "A")
    assert (out.unseen, out.events.received) == (500, 10)
    assert (came.events.received, came.repeated) == (10, 0)
    for name, peer in ("BC", "CB"):  # nobody there asked for anything
        link = at.outgoing(name, peer)
        assert (link.batches, link.bytes, Counts.of(link.events)) == (0, 0, Counts(0, 0, 0, 0, 0, 0))
    link = at.incoming("C", "B")
    assert (link.batches, link.bytes, link.events.received) == (0, 0, 0)
    assert at.outgoing("B", "C").unseen == 10


def test_a_channel_that_was_suspended_gets_all_it_missed_once_but_the_expired(at: Channels) -> None:
    """Longer than a session lasts without a sign. What has waited comes in large batches."""
    consumer = linked(at)
    with at.stopped("B"):
        for number in range(1000):
            if number < 200:
                at.clients["A"].push("t", -1 - number, expiry_s=0.2)
            at.clients["A"].push("t", number)
        eventually(lambda: at.outgoing("A", "B").condition == RoboCorba.DOWN, LIMIT_S, "the end of the link")
        assert at.outgoing("A", "B").problem
        eventually(lambda: at.incoming("A", "B").condition == RoboCorba.DOWN, LIMIT_S, "the end at the gateway")
        assert at.outgoing("A", "B").events.queued > 0
        outlast(0.2)
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link")
    check_got({"B": consumer}, {"A": list(range(1000))})
    assert at.outgoing("A", "B").batches < 250

    # At the link of A, at the gateway of B, or, on a busy machine, already at the proxy of their supplier.
    states = [at.channel(name).state() for name in "AB"]
    accounts = [Counts.of(part.events) for state in states for part in (*state.proxies, *state.links)]
    assert all(account.is_exact for account in accounts)
    assert sum(account.expired for account in accounts) >= 200


@pytest.mark.parametrize("victim", ["A", "B"])
def test_a_killed_end_comes_back_without_duplicates(at: Channels, victim: str) -> None:
    """A supplies B; what is said before and after the kill arrives once, and numbers rise."""
    consumer = linked(at)
    at.clients["A"].push_many("t", range(50))
    eventually(lambda: len(consumer.payloads("A")) == 50, LIMIT_S, "the first events")
    at.restart(victim)
    at.clients["A"].push_many("t", range(50, 100))  # nothing is waited for: they wait for the link
    check_got({"B": consumer}, {"A": list(range(100))})
    numbers = [event.number for event in consumer.events]
    assert numbers == sorted(set(numbers))
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link")


def test_a_link_comes_back_without_the_naming_service(at: Channels) -> None:
    """Peers remember where they were; the names are bound again when it is there."""
    at.shape("AB")
    at.kill_naming()
    at.restart("B")
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link")
    at.start_naming()
    at.orb.resolve("EventChannels/B", RoboCorba.EventChannel, timeout_s=LIMIT_S)


def test_a_channel_ends_in_order_while_its_peer_hangs(at: Channels) -> None:
    """And is still a peer of it: both find each other again."""
    at.shape("AB")
    with at.stopped("B"):
        eventually(lambda: at.incoming("A", "B").condition == RoboCorba.DOWN, LIMIT_S, "calls that hang")
        at.processes["A"].terminate()
        assert at.processes["A"].wait(LIMIT_S) == 0
    at.spawn("A")
    at.wait_ready("A")
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link")


def test_a_link_is_down_at_both_ends_while_one_of_them_cannot_be_called(at: Channels) -> None:
    """B stands behind a firewall: its calls to A get through, those of A to B do not."""
    at.shape("AB")
    at.restart("B", **at.relayed("B"))
    with at.relay("B") as firewall:
        eventually(lambda: at.is_up("AB"), LIMIT_S, "the link by way of the firewall")
        consumer = Consumer(at.clients["B"], ("t",))
        assert consumer.subscription.wait_in_force("A")
        at.clients["A"].push("t", 1)
        eventually(lambda: consumer.payloads("A") == [1], LIMIT_S, "the first event")
        firewall.close()
        at.clients["A"].push("t", 2)

        def is_down() -> bool:
            ends = [link for name in "AB" for link in at.links(name).values()]
            return all(end.condition == RoboCorba.DOWN and end.problem for end in ends)

        eventually(is_down, LIMIT_S, "the link to be down at both ends, in both directions")
        joins = at.outgoing("A", "B").reconnects
        stays(is_down, 3.0)  # B goes on to call A, twice a second
        assert at.outgoing("A", "B").reconnects == joins
        assert "can't be called" in at.outgoing("A", "B").problem
        assert "nothing that it sends has arrived" in at.incoming("B", "A").problem
        assert at.outgoing("A", "B").events.queued == 1
        firewall.open()
        eventually(lambda: at.is_up("AB"), LIMIT_S, "the link again")
        eventually(lambda: consumer.payloads("A") == [1, 2], LIMIT_S, "what waited")
    at.restart("B")
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link")
