"""Four channels in every shape: who gets what, how often, and what the links say of it."""

from __future__ import annotations

import contextlib
import math
import operator
import threading
from collections.abc import Iterator, Sequence

import pytest

from robocorba.events.corba.event_client import Event
from robocorba.stubs import RoboCorba
from testkit.federation import LIMIT_S, Channels, Consumer, Counts, channels
from testkit.processes import eventually
from tests.waits import stays

pytestmark = pytest.mark.system

SHAPES = {"mesh": ("AB", "AC", "AD", "BC", "BD", "CD"), "ring": ("AB", "BC", "CD", "AD")}


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


@contextlib.contextmanager
def talking(federation: Channels, *names: str, count: float = math.inf) -> Iterator[list[int]]:
    """Numbers that are pushed one by one, at all of these channels at the same time, until the `with` ends. count: how
    many at each. What is yielded has those of the first channel."""
    said: dict[str, list[int]] = {name: [] for name in names}
    stop = threading.Event()

    def talk(name: str) -> None:
        while len(said[name]) < count and not stop.wait(0.002 if count == math.inf else 0.0):
            federation.clients[name].push("t", len(said[name]))
            said[name].append(len(said[name]))

    speakers = [threading.Thread(target=talk, args=(name,)) for name in names]
    for speaker in speakers:
        speaker.start()
    try:
        yield said[names[0]]
    finally:
        if count == math.inf:
            stop.set()
        for speaker in speakers:
            speaker.join(LIMIT_S)
            assert not speaker.is_alive()


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
    with talking(at, *"ABCD", count=100):
        pass
    check_got(consumers, {name: list(range(100)) for name in "ABCD"})
    at.check_links(*shape)


def test_an_uninterested_channel_receives_nothing(at: Channels) -> None:
    at.shape("AB", "BC")
    wanting = Consumer(at.clients["B"], ("wanted",))
    assert wanting.subscription.wait_in_force("A")
    at.clients["A"].push_many("unwanted", range(500))
    at.clients["A"].push_many("wanted", range(10))
    eventually(lambda: len(wanting.payloads("A", "wanted")) == 10, LIMIT_S, "what is wanted")

    def unseen() -> tuple[int, int]:
        return at.outgoing("A", "B").unseen, at.outgoing("B", "C").unseen

    eventually(lambda: unseen() == (500, 10), LIMIT_S, "the counts of what links leave out")
    out, came = at.outgoing("A", "B"), at.incoming("B", "A")
    assert out.events.received == 10
    assert (came.events.received, came.repeated) == (10, 0)
    for name, peer in ("BC", "CB"):  # nobody there asked for anything
        link = at.outgoing(name, peer)
        assert (link.batches, link.bytes, Counts.of(link.events)) == (0, 0, Counts(0, 0, 0, 0, 0, 0))
    link = at.incoming("C", "B")
    assert (link.batches, link.bytes, link.events.received) == (0, 0, 0)


def test_a_conjunction_of_a_local_and_a_remote_event_comes_true_once_for_each_pair(at: Channels) -> None:
    at.shape("AB")
    at.channel("B").addPeer(RoboCorba.PeerAddress("A", "", False))  # told to both ends it is still one link
    found: list[Sequence[Event]] = []
    pairs = at.clients["B"].subscribe_together(found.append, "local", "remote")
    assert pairs.wait_in_force("A")
    for number in range(20):
        at.clients["A"].push("remote", number)
        at.clients["B"].push("local", number)
    eventually(lambda: len(found) >= 20, LIMIT_S, "all pairs")
    stays(lambda: len(found) == 20, 0.2)
    assert [[(event.type, event.origin, event.payload) for event in pair] for pair in found] == [
        [("local", "B", number), ("remote", "A", number)] for number in range(20)
    ]
    assert [link.peer for link in at.channel("B").state().links] == ["A", "A"]
    at.check_links("AB")


def test_wrong_addresses_are_told_in_the_state_of_the_link(at: Channels) -> None:
    at.shape("AB")
    naming = f"127.0.0.1:{at.port}"
    wrong = {
        "nowhere": ("127.0.0.1:1", "ConnectFailed"),
        "another": (at.address("B"), "there is no channel 'another' at this address"),
        "misnamed": (f"corbaloc::{at.address('B')}/EventChannels/B", "the channel there is 'B', not 'misnamed'"),
        "itself": (f"corbaloc::{at.address('A')}/EventChannels/A", "the channel there is 'A', not 'itself'"),
        "naming": (f"corbaloc::{naming}/NameService", "what is at this address is no event channel"),
        "garbage": ("no uri", "leads to no object"),
        "unbound": ("", f"the naming service at {naming} does not know it"),
    }
    for name, (address, _) in wrong.items():
        at.channel("A").addPeer(RoboCorba.PeerAddress(name, address, False))
    problems: dict[str, str] = {}

    def all_told() -> bool:
        problems.update({name: at.incoming("A", name).problem for name in wrong})
        return all(expected in problems[name] for name, (_, expected) in wrong.items())

    eventually(all_told, LIMIT_S, "all problems")
    assert at.is_up("AB")
    for name in wrong:
        at.channel("A").removePeer(name)
    assert [peer.name for peer in at.channel("A").peers()] == ["B"]

    # A peer at a new address is found there.
    at.channel("A").addPeer(RoboCorba.PeerAddress("B", "127.0.0.1:1", False))
    eventually(lambda: "ConnectFailed" in at.incoming("A", "B").problem, LIMIT_S, "the wrong address")
    at.channel("A").addPeer(RoboCorba.PeerAddress("B", at.address("B"), False))
    eventually(lambda: at.is_up("AB"), LIMIT_S, "the link again")


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
