"""Real channels under traffic: where a link is cut events go by the other way, each once and in order. And one of
another release, which is refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NoReturn

import pytest
from omniORB import CORBA

from robocorba.stubs import RoboCorba, RoboCorba__POA
from testkit.federation import LIMIT_S, Channels, Consumer, Counts, channels
from testkit.federation_chaos import Supplier
from testkit.processes import eventually
from tests.waits import stays

pytestmark = [pytest.mark.system, pytest.mark.full]


@pytest.fixture(scope="module")
def federation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Channels]:
    with channels(tmp_path_factory.mktemp("redundancy")) as at, at.behind_relays(*"ABCD"):
        yield at


@pytest.fixture
def at(federation: Channels) -> Iterator[Channels]:
    """The federation, without any consumer before and after."""
    yield federation
    for client in federation.clients.values():
        client.close()


def is_down(at: Channels, link: str) -> bool:
    """Whether both ends of a link are down in both directions, with a reason."""
    ends = [end(a, b) for a, b in (link, link[::-1]) for end in (at.outgoing, at.incoming)]
    return all(end.condition == RoboCorba.DOWN and end.problem for end in ends)


def agree(at: Channels, a: str, b: str) -> bool:
    """Whether both ends of a link have counted the same events. Those whose acknowledgement was lost came twice."""
    sent, came = at.outgoing(a, b).events, at.incoming(b, a)
    received = came.events.received
    return not sent.queued and received <= sent.delivered <= received + came.repeated


def test_where_a_link_is_cut_events_go_the_other_way_round(at: Channels) -> None:
    shape = ("AB", "BC", "CD", "AD")
    at.shape(*shape)
    consumer, supplier = Consumer(at.clients["B"], ("t", "probe")), Supplier(at, "A", 0)
    at.wait_reaches({"B": consumer}, "A")

    def wait_flow() -> None:
        """Until events that are published from now on arrive."""
        count = len(supplier.accepted) + 20
        eventually(lambda: len(supplier.accepted) > count, LIMIT_S, "new events")
        last = [*supplier.accepted][count]
        eventually(lambda: last in consumer.payloads("A"), LIMIT_S, f"event {last}")

    supplier.start()
    try:
        wait_flow()
        at.cut("AB")
        eventually(lambda: is_down(at, "AB"), LIMIT_S, "the link to be down at both ends, with the reason")
        wait_flow()
        uncertain = at.outgoing("A", "B").events.queued
        wait_flow()
        assert at.outgoing("A", "B").events.queued == uncertain, "only what may have arrived waits for the link"
        at.restore("AB")
        eventually(lambda: at.is_up(*shape), LIMIT_S, "the link again")
        before = at.outgoing("A", "B").events.delivered
        eventually(lambda: at.outgoing("A", "B").events.delivered > before, LIMIT_S, "direct events")
        wait_flow()
    finally:
        supplier.end()
    eventually(lambda: supplier.accepted.keys() <= set(consumer.payloads("A")), LIMIT_S, "all events")
    stays(lambda: (got := consumer.payloads("A")) == sorted(set(got)), 0.2)  # copies would come now
    states = [at.channel(name).state() for name in "ABCD"]
    assert all(Counts.of(part.events).is_exact for state in states for part in (*state.links, *state.proxies))
    eventually(
        lambda: all(agree(at, a, b) for link in shape for a, b in (link, link[::-1])), LIMIT_S, "the same counts"
    )


class ChannelOfRelease010(RoboCorba__POA.EventChannel):
    """What a channel of release 0.1.0 answers."""

    def _get_name(self) -> str:
        return "old"

    def joinPeer(self, *arguments: Any) -> NoReturn:
        raise CORBA.BAD_OPERATION(0, CORBA.COMPLETED_NO)


def test_a_channel_of_release_0_1_0_is_refused_with_the_reason_at_both_ends(at: Channels) -> None:
    old = at.orb.activate(ChannelOfRelease010())
    with pytest.raises(RoboCorba.InvalidPeer) as refused:
        at.channel("A").joinGateway("old", old, None)
    reason = "old runs release 0.1.0, which takes event numbers for times; it needs a later one"
    assert refused.value.reason == reason
    at.channel("A").addPeer(RoboCorba.PeerAddress("old", at.orb.uri(old), False))
    eventually(lambda: reason in at.incoming("A", "old").problem, LIMIT_S, "the reason")
    assert at.incoming("A", "old").condition == at.outgoing("A", "old").condition == RoboCorba.DOWN
    at.channel("A").removePeer("old")
