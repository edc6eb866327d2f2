"""Benches of events for a moment, with real processes: this project's channel, and both kinds of network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from bench.events.channel.stage import Stage, collect, send, trio
from bench.events.network.experiment import FEDERATED, SET_UPS, Plan, conduct, experiment, split_cores
from bench.events.network.networks import Network
from testkit.namespaces import Namespace
from testkit.peers import PEERS, installed
from testkit.peers.corba import CLIENT, HEADER, PLAIN, PLAIN_TO_BATCHES

pytestmark = [pytest.mark.system, pytest.mark.full]

COUNT = 300
#: Peers that are tested with floods, too.
OURS = {peer.name for peer in (PLAIN, PLAIN_TO_BATCHES, CLIENT)}


@pytest.fixture
def stage() -> Iterator[Stage]:
    """What is started on it has ended after the test, and its folder is gone."""
    before = {child.pid for child in psutil.Process().children(recursive=True)}
    with Stage() as stage:
        yield stage
        folder = stage.folder
    assert not folder.exists()
    assert {child.pid for child in psutil.Process().children(recursive=True)} <= before


@pytest.mark.parametrize("name", sorted(set(PEERS) - {HEADER.name}))
def test_paced_and_flooded_events_arrive(stage: Stage, name: str) -> None:
    if name not in installed():
        pytest.skip(f"{PEERS[name].missing()} is not installed")
    supplier, consumer = trio(stage, name)
    sent = send(supplier, "pace", 60.0, first=0, count=COUNT, rate=1000.0)
    assert (sent["sent"], sent["failed"]) == ([COUNT], 0)
    (got,) = collect(consumer, [range(COUNT)], 60.0, latencies_from=100)
    assert _faultless(got, COUNT)
    if name not in OURS:
        return
    assert len(got["latencies"]) == COUNT - 100
    assert all(value > 0 for value in got["latencies"])
    answer = send(supplier, "flood", 90.0, first=1000, seconds=60.0, most=COUNT, threads=2)
    assert answer["sent"] == [COUNT // 2] * 2
    assert answer["failed"] == 0
    (got,) = collect(consumer, [range(1000, 1000 + COUNT // 2)] * 2, 60.0)
    assert _faultless(got, COUNT)
    assert answer["began"] < got["first"] <= got["last"]
    if name == CLIENT.name:
        runs = send(supplier, "runs", 90.0, first=10_000, seconds=60.0, most=10_000, size=100)
        assert runs["sent"] == [10_000]
        assert _faultless(collect(consumer, [range(10_000, 20_000)], 60.0)[0], 10_000)


def _faultless(got: dict[str, int], count: int) -> bool:
    return (got["count"], got["lost"], got["repeated"], got["misordered"]) == (count, 0, 0, 0)


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    """All its processes and descriptors are gone afterwards."""
    try:
        with Namespace() as namespace:
            namespace.add_tun("192.168.8.0/24")
    except OSError:
        pytest.skip("network namespaces are not allowed here")
    before, descriptors = psutil.Process().children(recursive=True), open_descriptors()
    with Network(tmp_path, split_cores()[1]) as found:
        yield found
    assert [child for child in psutil.Process().children(recursive=True) if child not in before] == []
    assert open_descriptors() <= descriptors


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_the_link_delays_and_counts_and_both_set_ups_carry_the_mission(network: Network) -> None:
    before = network.counts(delay_us=2000)
    assert min(network.round_trips_us(5)) > 4000
    crossed = network.counts().since(before)
    assert crossed.packets >= 10 <= crossed.bytes
    with experiment(network, split_cores()[0]) as running:
        outcomes = list(conduct(running, Plan((200,), (0.2,), 1, 0.5)))
    assert sorted(one.set_up for one in outcomes) == sorted(SET_UPS)
    for one in outcomes:
        assert one.lost == 0
        assert len(one.local_us) > 0 and len(one.remote_us) > 0
        assert one.local_us.min() > 0 and one.remote_us.min() > 200  # no way leads past the router
        assert one.packets > 0
    (federated,) = (one for one in outcomes if one.set_up == FEDERATED)
    assert federated.forwarded == federated.wanted_across > 0
    assert federated.unseen == federated.sent - federated.wanted_across > 0
