"""Links with foreign channels: what they return is recognised, and a link is up only while it works both ways."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.events import NotDelivered
from robocorba.errors.services import NotReachable
from robocorba.events.account import Account
from robocorba.events.channel import Channel
from robocorba.events.channel_store import Peer
from robocorba.events.event import Encoding, EventBatch, EventHeader
from robocorba.events.foreign import Echoes, ForeignLink
from robocorba.events.policies import LinkPolicy
from robocorba.events.queue import QueueItem
from testkit.processes import eventually
from tests.events.samples import Consumer, publish, totals
from tests.waits import stays


class ForeignChannel:
    """A foreign channel that gives back what it is given; each connection is a port of its own."""

    def __init__(self) -> None:
        self.connections: list[Port] = []
        self.problem: Exception | None = None
        #: How it answers a push.
        self.answer: Callable[[Sequence[QueueItem]], None] = lambda items: None
        self.returns = True

    def attach(self, *connection: Any) -> Port:
        if self.problem:
            raise self.problem
        self.connections.append(Port(self, *connection))
        return self.connections[-1]

    def push(self, text: str) -> None:
        """An event of one of its own suppliers."""
        self.connections[-1].receive(EventBatch(EventHeader("t", "", ""), [0.0], [text.encode()]), text)


class Port:
    """One connection with it."""

    def __init__(
        self,
        channel: ForeignChannel,
        echoes: Echoes,
        receive: Callable[[EventBatch, object], None],
        on_disconnected: Callable[[], None],
    ) -> None:
        self.receive, self.on_disconnected, self.address = receive, on_disconnected, "here:1"
        self._channel, self._echoes = channel, echoes
        self.consumer = Consumer(takes_batches=False, answer=self._take)
        self.is_ended = False

    def _take(self, items: Sequence[QueueItem]) -> None:
        began = time.monotonic()
        self._channel.answer(items)
        self._echoes.note_push(began)
        if self._channel.returns:
            (batch,) = items
            assert isinstance(batch, EventBatch)
            header = batch.header._replace(encoding=Encoding.MSGPACK)
            self.receive(EventBatch(header, list(batch.times), list(batch.payloads), batch.first), None)

    def is_alive(self) -> bool:
        return True

    def disconnect(self) -> None:
        self.is_ended = True


@pytest.fixture
def peer() -> ForeignChannel:
    return ForeignChannel()


@pytest.fixture
def link(channel: Channel, peer: ForeignChannel) -> Iterator[ForeignLink]:
    link = ForeignLink(
        Peer("old", foreign=True), channel, peer.attach, LinkPolicy(check_interval_s=0.01, return_s=0.05)
    )
    link.start()
    eventually(lambda: link.connections == 1 and not link.problem, what="the connection")
    yield link
    link.end()


def test_why_a_connection_ended_is_shown(link: ForeignLink, peer: ForeignChannel) -> None:
    peer.problem = NotReachable("it is away")
    peer.connections[0].on_disconnected()
    eventually(lambda: link.problem == "it is away", what="the problem")
    assert link.snapshot()[0].problem == "it is away"
    peer.problem = ValueError("a fault")
    eventually(lambda: "internal fault (ValueError: a fault)" in link.problem, what="the defect")
    peer.problem = None
    eventually(lambda: not link.problem, what="the next connection")


def test_a_channel_that_returns_nothing_is_down(link: ForeignLink, channel: Channel, peer: ForeignChannel) -> None:
    """Such as behind a firewall: it accepts connections, and cannot connect to us."""
    peer.returns = False
    publish(channel, 1)
    eventually(lambda: "has returned no event" in link.problem and "here:1" in link.problem, what="the problem")
    eventually(lambda: link.connections >= 2, what="another connection")
    stays(lambda: link.problem)  # a connection alone shows nothing
    peer.push("an event")
    eventually(lambda: not link.problem, what="the link")
    assert totals(link.proxy).received == 1, "it does not get its own event back"
    connections = link.connections
    peer.connections[-1].on_disconnected()
    eventually(lambda: link.connections > connections and not link.problem, what="the next connection")


@pytest.mark.parametrize(
    ("error", "account"),
    [(NotDelivered("no way there"), Account(2, 2)), (AttributeError("a fault"), Account(2, 1, discarded=1))],
)
def test_failed_deliveries_are_shown_until_one_arrives(
    link: ForeignLink, channel: Channel, peer: ForeignChannel, error: Exception, account: Account
) -> None:
    """A fault costs its event only, and a channel that returns our events stays up."""

    def fail(items: Sequence[QueueItem]) -> None:
        raise error

    sound, peer.answer = peer.answer, fail
    publish(channel, 1)
    eventually(lambda: str(error) in link.snapshot()[0].problem, what="the problem")
    assert link.problem == ""
    peer.answer = sound
    publish(channel, 2)
    eventually(lambda: link.snapshot()[0].problem == "" and totals(link.proxy) == account, what="the delivery")
    stays(lambda: (link.problem, link.connections) == ("", 1), 0.2)


@given(st.lists(st.tuples(st.booleans(), st.sampled_from("abc")), max_size=60))
def test_each_push_is_recognised_once(steps: list[tuple[bool, str]]) -> None:
    echoes, open_pushes = Echoes(), Counter[str]()
    for is_push, content in steps:
        if is_push:
            echoes.expect(content)
            open_pushes[content] += 1
        else:
            assert echoes.recognise(content) == (open_pushes[content] > 0)
            open_pushes[content] = max(0, open_pushes[content] - 1)


def test_expected_echoes_are_forgotten_after_their_time_and_beyond_their_number() -> None:
    late, few = Echoes(echo_s=-1.0), Echoes(max_echoes=10)
    late.expect("a")
    assert not late.recognise("a")
    for number in range(30):
        few.expect(number)
    assert [number for number in range(30) if few.recognise(number)] == list(range(20, 30))
    for _ in range(30):
        few.expect("alive")
        assert few.recognise("alive")
        assert not few.recognise("alive")
