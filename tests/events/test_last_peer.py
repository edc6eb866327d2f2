"""What waits for earlier events when the last link is removed."""

from __future__ import annotations

from testkit.processes import eventually
from tests.events.network import Network
from tests.events.samples import arrive, events


def test_nothing_waits_for_peers_that_are_gone() -> None:
    with Network("A", "B") as network:
        network.link("AB")
        a = network["A"]
        consumer = a.consume("t")
        eventually(lambda: a.links.snapshots() and network["B"].links.snapshots(), what="the link")
        late = events(5)
        late.payloads[:] = [b"late"]
        arrive(a.channel, late, before=4)
        assert consumer.read() == []
        a.links.remove("B")
        eventually(lambda: consumer.read() == ["late"], what="the event that has waited")
