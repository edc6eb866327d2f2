"""Two channels of one name in a federation, which are no neighbours: nothing is lost, and all see why."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from omniORB import CORBA

from robocorba.claimed_ports import claimed_ports
from robocorba.corba.event_client import EventClient
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.testing.federation import LIMIT_S, Channels, Consumer, channels
from robocorba.testing.processes import Launcher, eventually

pytestmark = [pytest.mark.system, pytest.mark.full]

REASON = "two channels with the name X are in the federation"


@pytest.fixture
def halves(tmp_path: Path) -> Iterator[tuple[Channels, Channels]]:
    """X - M and N - X, each with a naming service of its own."""
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
    with (
        channels(tmp_path / "one", "X", "M") as one,
        claimed_ports() as port,
        Launcher(tmp_path / "two") as launch,
    ):
        two = Channels(launch, tmp_path / "two", port, one.orb)
        two.start_naming()
        for name in "NX":
            two.spawn(name)
            two.wait_ready(name)
        two.clients["N"] = EventClient(one.orb, "N", "N", channel_at=two.channel("N"))
        one.shape("XM")
        two.channel("N").addPeer(RoboCorba.PeerAddress("X", "", False))
        eventually(lambda: two.is_up("NX"), LIMIT_S, "the link of the others")
        yield one, two


def are_down_with_the_reason(states: list[Any]) -> bool:
    return all(state.condition == RoboCorba.DOWN and REASON in state.problem for state in states)


def test_two_channels_of_one_name_are_down_until_one_of_them_has_gone(halves: tuple[Channels, Channels]) -> None:
    one, two = halves
    here, there = Consumer(one.clients["M"], ("t",)), Consumer(two.clients["N"], ("t",))
    one.channel("M").addPeer(RoboCorba.PeerAddress("N", two.address("N"), False))

    def all_know() -> bool:
        ends = [(one, "X", "M"), (one, "M", "X"), (two, "X", "N"), (two, "N", "X")]
        return are_down_with_the_reason([f(name, peer) for c, name, peer in ends for f in (c.outgoing, c.incoming)])

    eventually(all_know, LIMIT_S, "the conflict at all ends")
    for number in range(200):
        one.clients["X"].push("t", number)
    waiting = one.outgoing("X", "M").events
    assert waiting.received == waiting.delivered + waiting.queued
    assert one.outgoing("M", "N").condition == RoboCorba.UP

    two.kill("X")
    eventually(lambda: one.is_up("XM"), LIMIT_S, "the link of the one that is left")
    for consumer in (here, there):
        eventually(lambda consumer=consumer: len(consumer.payloads("X")) >= 200, LIMIT_S, "all events")
        assert consumer.payloads("X") == list(range(200))


# ---- channels of another release ----


class ChannelOfRelease010(RoboCorba__POA.EventChannel):
    """What a channel of release 0.1.0 answers."""

    def _get_name(self) -> str:
        return "old"

    def joinPeer(self, *arguments: Any) -> NoReturn:
        raise CORBA.BAD_OPERATION(0, CORBA.COMPLETED_NO)


def test_a_channel_of_release_0_1_0_is_refused_with_the_reason_at_both_ends(tmp_path: Path) -> None:
    with channels(tmp_path, "A") as at:
        old = at.orb.activate(ChannelOfRelease010())
        with pytest.raises(RoboCorba.InvalidPeer) as refused:
            at.channel("A").joinGateway("old", old, None)
        reason = "old runs release 0.1.0, which takes event numbers for times; it needs a later one"
        assert refused.value.reason == reason
        at.channel("A").addPeer(RoboCorba.PeerAddress("old", at.orb.uri(old), False))
        eventually(lambda: reason in at.incoming("A", "old").problem, LIMIT_S, "the reason")
        assert at.incoming("A", "old").condition == at.outgoing("A", "old").condition == RoboCorba.DOWN
