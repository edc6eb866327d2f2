"""Channels on machines whose clocks are wrong, or are set: all events arrive, and expire by the time that passes."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import pytest

from testkit.federation import LIMIT_S, Channels, Consumer, Counts, channels
from testkit.processes import eventually
from tests.system.wrong_clocks import HOUR_S, JUMPS_S, YEAR_S, Clocks, wrong_clocks

pytestmark = [pytest.mark.system, pytest.mark.full]

LINK = "AB"

_payloads = itertools.count()


@pytest.fixture(scope="module")
def clocks(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Clocks]:
    with wrong_clocks(tmp_path_factory.mktemp("clocks")) as clocks:
        yield clocks


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory, clocks: Clocks) -> Iterator[Channels]:
    """Channels A and B, linked."""
    with channels(tmp_path_factory.mktemp("federation"), *LINK) as started:
        started.shape(LINK)
        yield started


def restart(at: Channels, clocks: Clocks, name: str, ahead_s: float, keeps_state: bool = True) -> None:
    """Restart a channel on a machine whose clock is ahead; the other one keeps its own."""
    at.kill(name)
    if not keeps_state:
        at.forget(name)
    clocks.set_others(ahead_s)
    at.spawn(name)
    clocks.set(at.processes[name].pid, ahead_s)
    clocks.set_others(0.0)
    at.wait_ready(name)
    if not keeps_state:  # its proxies are forgotten as well
        at.clients[name] = type(at.clients[name])(at.orb, name, name)
    eventually(lambda: at.is_up(LINK), LIMIT_S, "the link")


def check_both_ways(at: Channels, expiry_s: float = 60.0) -> None:
    """Events arrive at the other end, and by the accounts of both ends none was discarded or has expired."""
    consumers = {name: Consumer(at.clients[name], ("t", "probe")) for name in LINK}
    at.wait_reaches(consumers, LINK)
    for origin, there in (LINK, LINK[::-1]):
        sent, arrived = [next(_payloads) for _ in range(5)], consumers[there].payloads
        for payload in sent:
            at.clients[origin].push("t", payload, expiry_s=expiry_s)
        eventually(lambda a=arrived, o=origin: len(a(o)) >= 5, LIMIT_S, f"events of {origin} at {there}")
        assert arrived(origin) == sent
    for consumer in consumers.values():
        consumer.subscription.end()
    for here, there in (LINK, LINK[::-1]):
        # What is not acknowledged is sent again to a channel that forgets that it has come.
        eventually(lambda a=here, b=there: at.outgoing(a, b).events.queued == 0, LIMIT_S, "acknowledgements")
        for state in (at.outgoing(here, there), at.incoming(here, there)):
            counts = Counts.of(state.events)
            assert (counts.discarded, counts.expired) == (0, 0)


@pytest.mark.parametrize("keeps_state", [True, False])
@pytest.mark.parametrize("ahead_s", [HOUR_S, -HOUR_S, 1.0, YEAR_S])
def test_a_channel_that_was_once_started_with_a_wrong_clock(
    at: Channels, clocks: Clocks, ahead_s: float, keeps_state: bool
) -> None:
    restart(at, clocks, "A", ahead_s)
    check_both_ways(at)
    restart(at, clocks, "A", 0.0, keeps_state)
    check_both_ways(at)


def test_a_computer_without_a_clock_starts_at_the_same_time_again(at: Channels, clocks: Clocks) -> None:
    for _ in range(3):
        restart(at, clocks, "A", -50 * YEAR_S, keeps_state=False)
        check_both_ways(at)


@pytest.mark.parametrize("name", LINK)
def test_the_clock_of_a_running_channel_is_set(at: Channels, clocks: Clocks, name: str) -> None:
    restart(at, clocks, name, 0.0)
    consumer = Consumer(at.clients[LINK.replace(name, "")], ("t",))
    for ahead_s in JUMPS_S:
        clocks.set(at.processes[name].pid, ahead_s)
        check_both_ways(at)
        event = [event for event in consumer.events if event.origin == name][-1]
        assert abs(event.time - time.time() - ahead_s) < 60.0  # it is really another clock
    consumer.subscription.end()
    restart(at, clocks, name, 0.0)
