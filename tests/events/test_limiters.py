"""How many threads call clients at a time, and how long consumers may hold up the suppliers of a channel."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from robocorba.events import call_limiter
from robocorba.events.blocking_budget import BUDGET_S, RETURNS_IN_S, BlockingBudget
from robocorba.events.call_limiter import CallLimiter
from testkit.processes import eventually
from tests.clock import Clock
from tests.waits import work_for


def test_no_more_slots_are_taken_than_allowed() -> None:
    limiter, running, most = CallLimiter(3, 5.0), list[None](), list[int]()

    def work() -> None:
        for _ in range(20):
            with contextlib.suppress(ValueError), limiter.slot():
                running.append(None)
                most.append(len(running))
                work_for(0.0005)
                running.pop()
                raise ValueError  # an error frees the slot, too

    with ThreadPoolExecutor(12) as callers:
        for call in [callers.submit(work) for _ in range(12)]:
            call.result(60.0)
    assert max(most) == 3
    assert not limiter._running


def test_calls_that_hang_delay_others_no_longer_than_the_limit() -> None:
    limiter, released = CallLimiter(2, 0.05), threading.Event()

    def hang() -> None:
        with limiter.slot():
            released.wait(60.0)

    with ThreadPoolExecutor(2) as callers:
        hanging = [callers.submit(hang) for _ in range(2)]
        eventually(lambda: len(limiter._running) == 2)
        for _ in range(100):  # 5 s, if each of them waited
            with limiter.slot():
                pass
        assert not any(call.done() for call in hanging)
        assert len(limiter._running) < 2
        released.set()
    with limiter.slot(), limiter.slot():  # late ones have not taken a slot
        assert len(limiter._running) == 2


def test_a_hundred_threads_that_wait_do_not_wake_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """All calls hang, so that each thread gets the slot of the one before after the limit. One that waits looks at the
    clock whenever it wakes."""
    looks, running = list[int](), list[int]()
    clock = SimpleNamespace(monotonic=lambda: (looks.append(1), time.monotonic())[1])
    monkeypatch.setattr(call_limiter, "time", clock)
    limiter, released = CallLimiter(1, 0.01), threading.Event()

    def hang() -> None:
        with limiter.slot():
            running.append(1)
            released.wait(60.0)

    with ThreadPoolExecutor(100) as callers:
        for _ in range(100):
            callers.submit(hang)
        eventually(lambda: len(running) == 100, what="a slot for each")
        released.set()
    assert len(looks) < 500


def test_time_is_used_up_and_returns(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    budget = BlockingBudget(clock)
    assert budget.left_s() == BUDGET_S
    with caplog.at_level(logging.WARNING):
        budget.spend(BUDGET_S - 1.0, "logger")
        assert budget.left_s() == pytest.approx(1.0)
        assert not caplog.records
        budget.spend(2.0, "logger")
        budget.spend(0.5, "logger")
    assert budget.left_s() == pytest.approx(-1.5)
    (record,) = caplog.records
    assert "consumer logger" in record.getMessage()
    clock.now += RETURNS_IN_S / 2
    assert budget.left_s() == pytest.approx(BUDGET_S / 2 - 1.5)
    budget.spend(BUDGET_S, "logger")
    assert len(caplog.records) == 1
    clock.now += 10 * RETURNS_IN_S
    assert budget.left_s() == BUDGET_S
    budget.spend(BUDGET_S, "logger")  # it is reported again when all had returned
    assert len(caplog.records) == 2
