"""Channels on machines whose clocks are wrong, or are set: all events arrive, and expire by the time that passes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

from robocorba.testing.federation import LIMIT_S, Channels, Consumer, Counts, channels
from robocorba.testing.processes import eventually

pytestmark = [pytest.mark.system, pytest.mark.full]

HOUR_S, YEAR_S = 3600.0, 365 * 86400.0
LINK = "AB"

_payloads = itertools.count()


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Channels]:
    """Channels A and B, linked."""
    with channels(tmp_path_factory.mktemp("federation"), *LINK) as started:
        started.shape(LINK)
        yield started


def set_clock(at: Channels, name: str, ahead_s: float) -> None:
    """Set the clock of a channel that runs or is to be started ahead of the true time."""
    new = at.folder / "new clock"
    new.write_text(str(ahead_s))
    new.replace(at.folder / f"clock of {name}")


def restart(at: Channels, name: str, ahead_s: float, keeps_state: bool = True) -> None:
    """Restart a channel on a machine whose clock is ahead."""
    set_clock(at, name, ahead_s)
    at.kill(name)
    if not keeps_state:
        at.forget(name)
    at.spawn(name, module="wrong_clock_channel", CLOCK=str(at.folder / f"clock of {name}"))
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
        for state in (at.outgoing(here, there), at.incoming(here, there)):
            counts = Counts.of(state.events)
            assert (counts.discarded, counts.expired) == (0, 0)


@pytest.mark.parametrize("keeps_state", [True, False])
@pytest.mark.parametrize("ahead_s", [HOUR_S, -HOUR_S, 1.0, YEAR_S])
def test_a_channel_that_was_once_started_with_a_wrong_clock(at: Channels, ahead_s: float, keeps_state: bool) -> None:
    restart(at, "A", ahead_s)
    check_both_ways(at)
    restart(at, "A", 0.0, keeps_state)
    check_both_ways(at)


def test_a_computer_without_a_clock_starts_at_the_same_time_again(at: Channels) -> None:
    for _ in range(3):
        restart(at, "A", -50 * YEAR_S, keeps_state=False)
        check_both_ways(at)


@pytest.mark.parametrize("name", LINK)
def test_the_clock_of_a_running_channel_is_set(at: Channels, name: str) -> None:
    restart(at, name, 0.0)
    for ahead_s in (HOUR_S, 0.0, -HOUR_S, -1.0, YEAR_S, -YEAR_S):
        set_clock(at, name, ahead_s)
        check_both_ways(at)
    restart(at, name, 0.0)
