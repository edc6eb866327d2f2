"""The time of leases: what passes while the server is held up does not count."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.simulation.attended_time import LONGEST_PAUSE_S, AttendedTime
from tests.clock import Clock


def test_it_is_the_time_while_the_server_works() -> None:
    clock = Clock()
    attended, began = AttendedTime(clock), clock.now
    for _ in range(100):
        clock.now += LONGEST_PAUSE_S / 2
        attended.attend()
    assert attended() == pytest.approx(began + 50 * LONGEST_PAUSE_S)


def test_it_stands_still_while_the_server_is_held_up() -> None:
    clock = Clock()
    attended, began = AttendedTime(clock), clock.now
    clock.now += 3600.0
    assert attended() == pytest.approx(began + LONGEST_PAUSE_S)  # a thread that runs before the one that attends
    attended.attend()
    assert attended() == pytest.approx(began + LONGEST_PAUSE_S)
    clock.now += 0.1
    assert attended() == pytest.approx(began + LONGEST_PAUSE_S + 0.1)


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.booleans())))
def test_it_never_goes_back_nor_ahead(pauses: list[tuple[float, bool]]) -> None:
    clock = Clock()
    attended, before = AttendedTime(clock), clock.now
    for pause_s, works in pauses:
        clock.now += pause_s
        if works:
            attended.attend()
        assert before - 1e-9 <= attended() <= clock.now
        before = attended()
