"""The clocks of missions: orders don't move when the system's clock is set."""

from __future__ import annotations

import time

import pytest

from robocorba.missions.clock import LeaderClock, SteadyClock

HOUR_S = 3600.0


@pytest.mark.parametrize("jump_s", [-HOUR_S, HOUR_S, -50 * 365 * 24 * HOUR_S])
def test_time_passes_steadily_while_the_clock_is_set(monkeypatch: pytest.MonkeyPatch, jump_s: float) -> None:
    own, leaders = SteadyClock(), LeaderClock()
    before, ordered, wall = own.now(), leaders.now(), time.time
    monkeypatch.setattr(time, "time", lambda: wall() + jump_s)
    assert 0.0 <= own.now() - before < HOUR_S / 2
    assert 0.0 <= leaders.now() - ordered < HOUR_S / 2
    own.synchronize()
    assert abs(own.now() - before - jump_s) < HOUR_S / 2
