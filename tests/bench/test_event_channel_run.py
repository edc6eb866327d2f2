"""The processes of the benches, with this project's own channel: what they say of a delivery that went well."""

from __future__ import annotations

from collections.abc import Iterator

import psutil
import pytest

from bench.events.channel.stage import Stage, collect, ready, send, trio
from robocorba.testing.json_process import ProcessFailed
from robocorba.testing.peers import PEERS, installed
from robocorba.testing.peers.base import Peer
from robocorba.testing.peers.corba import BOUNDED, CLIENT, HEADER, PLAIN, PLAIN_TO_BATCHES

pytestmark = [pytest.mark.system, pytest.mark.full]

COUNT = 300


@pytest.fixture
def stage() -> Iterator[Stage]:
    """What is started on it has ended after the test, and its folder is gone."""
    before = {child.pid for child in psutil.Process().children(recursive=True)}
    with Stage() as stage:
        yield stage
        folder = stage.folder
    assert not folder.exists()
    assert {child.pid for child in psutil.Process().children(recursive=True)} <= before


@pytest.mark.parametrize("peer", [PLAIN, PLAIN_TO_BATCHES, CLIENT], ids=lambda peer: peer.name)
def test_paced_and_flooded_events_arrive(stage: Stage, peer: Peer) -> None:
    supplier, consumer = trio(stage, peer.name)

    assert send(supplier, "pace", 60.0, first=0, count=COUNT, rate=2000.0)["sent"] == [COUNT]
    (got,) = collect(consumer, [range(COUNT)], 60.0, latencies_from=100)
    assert _faultless(got, COUNT)
    assert len(got["latencies"]) == COUNT - 100
    assert all(value > 0 for value in got["latencies"])

    answer = send(supplier, "flood", 90.0, first=1000, seconds=60.0, most=COUNT, threads=2)
    assert answer["sent"] == [COUNT // 2] * 2
    assert answer["failed"] == 0
    (got,) = collect(consumer, [range(1000, 1000 + COUNT // 2)] * 2, 60.0)
    assert _faultless(got, COUNT)
    assert answer["began"] < got["first"] <= got["last"]


def test_runs_arrive(stage: Stage) -> None:
    supplier, consumer = trio(stage, CLIENT.name)
    assert send(supplier, "runs", 90.0, first=0, seconds=60.0, most=10_000, size=100)["sent"] == [10_000]
    (got,) = collect(consumer, [range(10_000)], 60.0)
    assert _faultless(got, 10_000)


def test_several_consumers_in_a_process(stage: Stage) -> None:
    broker = stage.broker(BOUNDED.name)
    consumers = stage.consumer(BOUNDED.name, broker, 3)
    ready(consumers)
    supplier = stage.supplier(BOUNDED.name, broker)
    ready(supplier)
    send(supplier, "pace", 60.0, first=0, count=50, rate=1000.0)
    assert [_faultless(got, 50) for got in collect(consumers, [range(50)], 60.0)] == [True] * 3


def test_missing_events_are_counted(stage: Stage) -> None:
    supplier, consumer = trio(stage, HEADER.name)
    send(supplier, "pace", 60.0, first=0, count=20, rate=1000.0)
    (got,) = collect(consumer, [range(30)], 60.0)
    assert (got["count"], got["lost"], got["gaps"]) == (20, 10, [[20, 30]])


def test_the_failure_of_a_role_names_its_reason(stage: Stage) -> None:
    broker = stage.broker(HEADER.name)
    supplier = stage.supplier("nobody knows it", broker)
    with pytest.raises(ProcessFailed, match="nobody knows it"):
        ready(supplier)


def test_a_role_that_does_not_answer_fails() -> None:
    with Stage() as stage:
        supplier, _ = trio(stage, HEADER.name)
        with pytest.raises(ProcessFailed, match="did not answer within"):
            supplier.receive(0.05)


@pytest.mark.parametrize("name", sorted(set(PEERS) - {peer.name for peer in (PLAIN, PLAIN_TO_BATCHES, HEADER, CLIENT)}))
def test_the_other_peers_deliver_as_well(stage: Stage, name: str) -> None:
    if name not in installed():
        pytest.skip(f"{PEERS[name].missing()} is not installed")
    supplier, consumer = trio(stage, name)
    assert send(supplier, "pace", 60.0, first=0, count=COUNT, rate=1000.0)["failed"] == 0
    (got,) = collect(consumer, [range(COUNT)], 60.0)
    assert _faultless(got, COUNT)


def _faultless(got: dict[str, int], count: int) -> bool:
    return (got["count"], got["lost"], got["repeated"], got["misordered"]) == (count, 0, 0, 0)
