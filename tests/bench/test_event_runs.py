"""Benches of events for a moment, with real processes: this project's channel, and both kinds of network."""

from __future__ import annotations

import itertools
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from bench.events.channel.processes import Stage
from bench.events.network.experiment import DELAYS, FEDERATED, SET_UPS, Case, Plan, conduct, split_cores
from bench.events.network.mission import SCANS
from bench.events.network.networks import ADDRESS_OF, Link, Network
from bench.events.network.robot import LEADERS
from testkit.peers import PEERS, installed
from testkit.peers.corba import CLIENT, HEADER, PLAIN, PLAIN_TO_BATCHES
from testkit.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.slow(120), pytest.mark.full]

COUNT = 300
#: Peers that are tested with floods, too.
OURS = {peer.name for peer in (PLAIN, PLAIN_TO_BATCHES, CLIENT)}


@pytest.fixture(autouse=True)
def _nothing_is_left() -> Iterator[None]:
    before = set(psutil.Process().children(recursive=True))
    yield
    eventually(lambda: set(psutil.Process().children(recursive=True)) <= before, what="all processes ended")


@pytest.mark.parametrize("name", sorted(set(PEERS) - {HEADER.name}))
def test_paced_and_flooded_events_arrive(name: str) -> None:
    if name not in installed():
        pytest.skip(f"{PEERS[name].missing()} is not installed")
    with Stage(name) as stage:
        sent, (got,) = stage.send("pace", 60.0, 100, first=0, count=COUNT, rate=1000.0)
        assert (sent["sent"], sent["failed"]) == ([[0, COUNT]], 0)
        assert _faultless(got, COUNT)
        assert len(got["latencies"]) == COUNT - 100 and min(got["latencies"]) > 0
        if name in OURS:
            sent, (got,) = stage.send("flood", 90.0, first=1000, seconds=60.0, most=COUNT, threads=2)
            assert (sent["sent"], sent["failed"]) == ([[1000, 1000 + COUNT // 2], [1000 + COUNT // 2, 1000 + COUNT]], 0)
            assert _faultless(got, COUNT) and sent["began"] < got["last"]
        if name == CLIENT.name:
            sent, (got,) = stage.send("flood", 90.0, first=10_000, seconds=60.0, most=10_000, size=100)
            assert sent["sent"] == [[10_000, 20_000]] and _faultless(got, 10_000)
    assert not stage.folder.exists()


def _faultless(got: dict[str, int], count: int) -> bool:
    return (got["count"], got["lost"], got["repeated"], got["misordered"]) == (count, 0, 0, 0)


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    descriptors = psutil.Process().num_fds()
    try:
        network = Network(tmp_path, split_cores()[1])
    except OSError:
        pytest.skip("network namespaces are not allowed here")
    with network:
        yield network
    assert psutil.Process().num_fds() <= descriptors


def test_a_link_delays_limits_and_counts(network: Network) -> None:
    def end(host: str) -> socket.socket:
        found = network.hosts[host].inside(lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        found.bind((ADDRESS_OF[host], 0))
        found.settimeout(60.0)
        return found

    def took_ms(source: socket.socket, target: socket.socket, count: int) -> float:
        began = time.monotonic()
        for _ in range(count):
            source.sendto(bytes(1000), target.getsockname())
        for _ in range(count):
            target.recv(2000)
        return 1e3 * (time.monotonic() - began)

    with end("A") as a, end("B") as b, end("C") as c:
        network.change(Link("", delay_us=2000))
        before = network.counts()
        assert took_ms(a, c, 1) > 2.0
        network.change(Link("", mbit_s=1.0))
        assert took_ms(a, b, 10) > 10 * 8.2  # on one segment
        assert network.counts().since(before) == (1, 1028, 0)
        assert took_ms(a, c, 10) > 11 * 8.2  # the first packet is stored between two segments


@pytest.mark.parametrize("leader", LEADERS)
def test_all_set_ups_carry_the_mission(network: Network, leader: str) -> None:
    cases = [Case(leader, DELAYS[1], scans, 0.6) for scans in SCANS]
    outcomes = list(conduct(network, split_cores()[0], Plan(cases, 1, 0.5)))
    assert sorted((one.case.scans, one.set_up) for one in outcomes) == sorted(itertools.product(SCANS, SET_UPS))
    for one in outcomes:
        assert one.lost == one.dropped == 0 < one.packets
        assert one.latencies_us("remote").min() > 200
        assert one.latencies_us("local").min() > (400 if one.set_up in ("II", "servers") else 0)  # two links or none
        assert one.forwarded == (one.wanted_across if one.set_up == FEDERATED else 0)
