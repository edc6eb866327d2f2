"""A peer's monotonic clock, measured by calls that take their time in either direction."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocorba.events.peer_clock import STEADY_S, Exchange, PeerClock

delays = st.floats(0.0, 5.0)


def test_the_shortest_round_trip_counts() -> None:
    clock = PeerClock()
    assert clock.behind_s == 0.0
    clock.measure(Exchange(100.0, 31.0, 104.0))  # a slow answer: 1 s there, 3 s back
    assert clock.behind_s == 71.0
    clock.measure(Exchange(200.0, 130.01, 200.02))
    assert clock.behind_s == 70.0
    clock.measure(Exchange(300.0, 231.0, 304.0))
    assert clock.behind_s == 70.0


@given(st.floats(-1e6, 1e6), st.lists(st.tuples(delays, delays), min_size=1, max_size=300))
def test_the_error_is_at_most_half_of_the_shortest_recent_round_trip(
    behind_s: float, calls: list[tuple[float, float]]
) -> None:
    clock, now = PeerClock(), 1000.0
    for there_s, back_s in calls:
        clock.measure(Exchange(now, now + there_s - behind_s, now + there_s + back_s))
        now += 5.0
    shortest = min(there_s + back_s for there_s, back_s in calls[-120:])
    assert abs(clock.behind_s - behind_s) <= shortest / 2.0 + STEADY_S + 1e-6


def test_another_process_of_the_peer_has_another_clock() -> None:
    clock = PeerClock()
    clock.measure(Exchange(100.0, 30.0, 100.0))
    clock.reset()
    clock.measure(Exchange(200.0, 1.0, 202.0))
    assert clock.behind_s == 200.0
