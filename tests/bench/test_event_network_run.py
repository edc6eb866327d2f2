"""The paper's experiment, for a moment: real processes on both kinds of network."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from bench.events.network.experiment import FEDERATED, SET_UPS, Plan, conduct, experiment, split_cores
from bench.events.network.networks import Network, counts, networks, round_trips_us
from robocorba.testing.json_process import Process, ProcessFailed
from robocorba.testing.namespaces import Namespace

pytestmark = pytest.mark.system


def namespaces_are_allowed() -> bool:
    """Whether this user may make network namespaces and TUN devices here."""
    try:
        with Namespace() as namespace:
            os.close(namespace.add_tun("192.168.8.0/24"))
    except OSError:
        return False
    return True


@pytest.fixture(params=["namespaces", "relay"])
def network(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Network]:
    """Both kinds; all processes and descriptors of it are gone afterwards."""
    if request.param == "namespaces" and not namespaces_are_allowed():
        pytest.skip("network namespaces are not allowed here")
    before, descriptors = psutil.Process().children(recursive=True), open_descriptors()
    with networks(tmp_path, split_cores()[1], relay=request.param == "relay") as found:
        yield found
    assert [child for child in psutil.Process().children(recursive=True) if child not in before] == []
    assert open_descriptors() <= descriptors


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_both_set_ups_carry_the_mission(network: Network, tmp_path: Path) -> None:
    leaders_core, cores = split_cores()
    with experiment(network, tmp_path, leaders_core, cores) as running:
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


def test_the_link_delays_and_counts(network: Network) -> None:
    before = counts(network, delay_us=2000)
    times = round_trips_us(network, 5)
    crossed = counts(network).since(before)
    assert min(times) > 4000
    assert crossed.packets >= (5, 5)
    assert min(crossed.bytes) >= 5


def test_a_process_that_ends_tells_why(tmp_path: Path) -> None:
    program = "import sys; sys.exit('no table here')"
    with (
        Process((sys.executable, "-c", program), tmp_path / "log", split_cores()[1]) as process,
        pytest.raises(ProcessFailed, match="no table here"),
    ):
        process.receive(20)
