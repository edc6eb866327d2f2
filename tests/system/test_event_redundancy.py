"""Real channels under traffic: where a link is cut, events go by the other way, each once and in order. A channel of an
earlier release is refused, and both ends say why."""

from __future__ import annotations

import itertools
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


class Traffic:
    """A supplier and a consumer of all events at each channel."""

    def __init__(self, at: Channels, names: str) -> None:
        self.at, self.names = at, names
        self.consumers = {name: Consumer(at.clients[name], ("t", "probe")) for name in names}
        at.wait_reaches(self.consumers, names)
        self.suppliers = {name: Supplier(at, name, 0) for name in names}

    def __enter__(self) -> Traffic:
        for supplier in self.suppliers.values():
            supplier.start()
        return self

    def __exit__(self, *_: object) -> None:
        for supplier in self.suppliers.values():
            supplier.end()

    def accepted(self, origin: str) -> list[int]:
        return [*self.suppliers[origin].accepted]

    def wait_flow(self, *routes: str) -> None:
        """Wait until events that are published from now on arrive ("AB": at B, from A)."""
        for origin, name in routes:
            count = len(self.accepted(origin)) + 20
            eventually(lambda count=count, origin=origin: len(self.accepted(origin)) > count, LIMIT_S, "new events")
            self.wait_for(self.accepted(origin)[count], origin, name)

    def wait_for(self, event: int, origin: str, name: str) -> None:
        what = f"event {event} of {origin} at {name}"
        eventually(lambda: event in self.consumers[name].payloads(origin), LIMIT_S, what)

    def lost(self, origin: str, name: str) -> set[int]:
        """What has not come; what has come was in order, each once."""
        got = self.consumers[name].payloads(origin)
        assert got == sorted(set(got)), f"{name} gets events of {origin} twice or too late"
        return set(self.accepted(origin)) - set(got)

    def check(self, *routes: str) -> None:
        """Each event has come exactly once, in order."""
        for origin, name in routes:
            self.wait_for(self.accepted(origin)[-1], origin, name)
        stays(lambda: not any(self.lost(*route) for route in routes), 0.2)  # copies would come now

    def check_accounts(self) -> None:
        for name in self.names:
            state = self.at.channel(name).state()
            assert all(Counts.of(part.events).is_exact for part in (*state.links, *state.proxies))


def routes(names: str) -> list[str]:
    return list(map("".join, itertools.permutations(names, 2)))


def is_down(at: Channels, link: str, reason: str = "") -> bool:
    """Whether both ends of a link are down in both directions, with this reason, or any."""
    ends = [end(a, b) for a, b in (link, link[::-1]) for end in (at.outgoing, at.incoming)]
    return all(end.condition == RoboCorba.DOWN and end.problem and reason in end.problem for end in ends)


def agree(at: Channels, a: str, b: str) -> bool:
    """Whether both ends of a link have counted the same events. Those whose acknowledgement was lost came twice."""
    sent, came = at.outgoing(a, b).events, at.incoming(b, a)
    received = came.events.received
    return not sent.queued and received <= sent.delivered <= received + came.repeated


def test_where_a_link_is_cut_events_go_the_other_way_round(at: Channels) -> None:
    shape, names = ("AB", "BC", "CD", "AD"), "ABCD"
    at.shape(*shape)
    with Traffic(at, names) as traffic:
        traffic.wait_flow("AB")
        at.cut("AB")
        eventually(lambda: is_down(at, "AB"), LIMIT_S, "the link to be down at both ends, with the reason")
        traffic.wait_flow("AB", "BA")
        traffic.check_accounts()
        uncertain = at.outgoing("A", "B").events.queued
        traffic.wait_flow("AB")
        assert at.outgoing("A", "B").events.queued == uncertain, "only what may have arrived waits for the link"
        at.restore("AB")
        eventually(lambda: at.is_up(*shape), LIMIT_S, "the link again")
        for a, b in ("AB", "BA"):
            before = at.outgoing(a, b).events.delivered
            eventually(
                lambda a=a, b=b, before=before: at.outgoing(a, b).events.delivered > before, LIMIT_S, "direct events"
            )
        traffic.wait_flow("AB", "BA")
    traffic.check(*routes(names))
    traffic.check_accounts()
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
