"""Real channels under traffic: where a link is cut events go by the other way, each once and in order. And one of
another release, which is refused."""

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

    def wait_flow(self, *routes: str) -> None:
        """Wait until events that are published from now on arrive ("AB": at B, from A)."""
        for origin, name in routes:
            accepted, got = self.suppliers[origin].accepted, self.consumers[name].payloads
            count = len(accepted) + 20
            eventually(lambda a=accepted, c=count: len(a) > c, LIMIT_S, f"new events of {origin}")
            last = [*accepted][count]
            eventually(lambda g=got, o=origin, e=last: e in g(o), LIMIT_S, f"event {last} of {origin} at {name}")

    def check(self) -> None:
        """Each event has come exactly once, in order."""

        def all_came() -> bool:
            for origin, name in itertools.permutations(self.names, 2):
                got = self.consumers[name].payloads(origin)
                assert got == sorted(set(got)), f"{name} gets events of {origin} twice or too late"
                if not self.suppliers[origin].accepted.keys() <= set(got):
                    return False
            return True

        eventually(all_came, LIMIT_S, "all events")
        stays(all_came, 0.2)  # copies would come now

    def check_accounts(self) -> None:
        for name in self.names:
            state = self.at.channel(name).state()
            assert all(Counts.of(part.events).is_exact for part in (*state.links, *state.proxies))


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
    traffic.check()
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
