"""The paper's experiment, for a moment: real processes on both kinds of network."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from bench.events.network.experiment import FEDERATED, SET_UPS, Plan, conduct, experiment, split_cores
from bench.events.network.networks import Network
from robocorba.testing.json_process import Process, ProcessFailed
from robocorba.testing.namespaces import Namespace

pytestmark = [pytest.mark.system, pytest.mark.full]


def namespaces_are_allowed() -> bool:
    """Whether this user may make network namespaces and TUN devices here."""
    try:
        with Namespace() as namespace:
            namespace.add_tun("192.168.8.0/24")
    except OSError:
        return False
    return True


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    """All its processes and descriptors are gone afterwards."""
    if not namespaces_are_allowed():
        pytest.skip("network namespaces are not allowed here")
    before, descriptors = psutil.Process().children(recursive=True), open_descriptors()
    with Network(tmp_path, split_cores()[1]) as found:
        yield found
    assert [child for child in psutil.Process().children(recursive=True) if child not in before] == []
    assert open_descriptors() <= descriptors


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_both_set_ups_carry_the_mission(network: Network) -> None:
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


def test_the_link_delays_and_counts(network: Network) -> None:
    before = network.counts(delay_us=2000)
    times = network.round_trips_us(5)
    crossed = network.counts().since(before)
    assert min(times) > 4000
    assert crossed.packets >= 10
    assert crossed.bytes >= 10


def test_a_process_that_ends_reports_why(tmp_path: Path) -> None:
    program = "import sys; sys.exit('no table here')"
    with (
        Process((sys.executable, "-c", program), tmp_path / "log", split_cores()[1]) as process,
        pytest.raises(ProcessFailed, match="no table here"),
    ):
        process.receive(20)
