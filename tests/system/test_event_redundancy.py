"""Rings and meshes of real channels under traffic: where a link is cut or a channel is killed, events go by the other
way, each once and in order."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.stubs import RoboCorba
from robocorba.testing.federation import LIMIT_S, Channels, Consumer, Counts, channels
from robocorba.testing.federation_chaos import Supplier
from robocorba.testing.processes import eventually
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
            last = self.accepted(origin)[count]
            eventually(
                lambda origin=origin, name=name, last=last: last in self.consumers[name].payloads(origin),
                LIMIT_S,
                f"new events of {origin} at {name}",
            )

    def wait_last(self, origin: str, name: str) -> None:
        last = self.accepted(origin)[-1]
        what = f"the last event of {origin} at {name}"
        eventually(lambda: last in self.consumers[name].payloads(origin), LIMIT_S, what)

    def check(self, *routes: str) -> None:
        """Each event has come exactly once, in order."""
        for origin, name in routes:
            self.wait_last(origin, name)

        def came_once() -> bool:
            for origin, name in routes:
                got = self.consumers[name].payloads(origin)
                assert got == sorted(set(got)), f"{name} gets events of {origin} twice or too late"
                assert set(self.accepted(origin)) <= set(got), f"{name} misses events of {origin}"
            return True

        stays(came_once, 0.2)  # copies would come now

    def check_accounts(self) -> None:
        for name in self.names:
            state = self.at.channel(name).state()
            assert all(Counts.of(part.events).is_exact for part in (*state.links, *state.proxies))


def routes(names: str) -> list[str]:
    return [origin + name for origin in names for name in names if origin != name]


def is_down(at: Channels, *links: str) -> bool:
    ends = [
        end for a, b in links for end in (at.outgoing(a, b), at.incoming(a, b), at.outgoing(b, a), at.incoming(b, a))
    ]
    return all(end.condition == RoboCorba.DOWN and end.problem for end in ends)


def reverse(link: str) -> str:
    return link[::-1]


def agree(at: Channels, a: str, b: str) -> bool:
    """Whether both ends of a link have counted the same events. Those whose acknowledgement was lost came twice."""
    sent, came = at.outgoing(a, b).events, at.incoming(b, a)
    received = came.events.received
    return not sent.queued and received <= sent.delivered <= received + came.repeated


@pytest.mark.parametrize("shape", [("AB", "BC", "AC"), ("AB", "BC", "CD", "AD")], ids=["ring of three", "ring of four"])
def test_where_a_link_is_cut_events_go_the_other_way_round(at: Channels, shape: tuple[str, ...]) -> None:
    names = "".join(sorted(set("".join(shape))))
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
    eventually(lambda: all(agree(at, a, b) for a, b in (*shape, *map(reverse, shape))), LIMIT_S, "the same counts")


def test_while_a_channel_is_dead_the_others_miss_nothing(at: Channels) -> None:
    """In a mesh no events between them are in the killed process. What is meant for it waits."""
    shape = ("AB", "AC", "AD", "BC", "BD", "CD")
    at.shape(*shape)
    with Traffic(at, "ABCD") as traffic:
        traffic.wait_flow(*routes("ABCD"))
        traffic.suppliers["D"].end()
        at.cut("AB")
        traffic.wait_flow("AB", "BA")
        at.kill("D")
        killed = {name: len(traffic.accepted(name)) for name in "ABC"}
        eventually(lambda: at.outgoing("C", "D").condition == RoboCorba.DOWN, LIMIT_S, "the link with D to be down")
        traffic.wait_flow(*routes("ABC"))
        at.spawn("D")
        at.wait_ready("D")
        at.restore("AB")
        eventually(lambda: at.is_up(*shape), LIMIT_S, "all links")
        traffic.wait_flow("AD", "BD", "CD")
    traffic.check(*routes("ABC"))
    traffic.check_accounts()
    for origin in "ABC":
        got = traffic.consumers["D"].payloads(origin)
        assert got == sorted(set(got))
        lost = set(traffic.accepted(origin)) - set(got)
        assert not lost & set(traffic.accepted(origin)[killed[origin] + 1 :]), "what was published since has waited"


def test_where_a_channel_on_the_way_is_killed_events_take_the_other_way(at: Channels) -> None:
    """Only what it held is lost. The other way holds up nothing for longer than the events that were lost."""
    shape = ("AB", "BC", "CD", "AD")
    at.shape(*shape)
    with Traffic(at, "AC") as traffic:
        traffic.wait_flow("AC", "CA")
        at.kill("B")
        killed = {name: len(traffic.accepted(name)) for name in "AC"}
        try:
            traffic.wait_flow("AC", "CA")
        finally:
            at.spawn("B")
            at.wait_ready("B")
        eventually(lambda: at.is_up(*shape), LIMIT_S, "all links")
        traffic.wait_flow("AC", "CA")
    for origin, name in ("AC", "CA"):
        traffic.wait_last(origin, name)
        got, accepted = traffic.consumers[name].payloads(origin), traffic.accepted(origin)
        assert got == sorted(set(got))
        assert not set(accepted[killed[origin] + 1 :]) - set(got)
    traffic.check_accounts()
