"""Repeated tasks: on time, when woken, and until they are closed."""

from __future__ import annotations

import itertools
import math
import queue

import pytest

from robocorba.repeating import Repeating

#: Whatever it runs on: a call is waited for at most this long [s].
LIMIT_S = 30.0


def test_it_is_called_when_woken_however_long_the_interval() -> None:
    calls: queue.Queue[int] = queue.Queue()
    repeating = Repeating("test", lambda: calls.put(1), math.inf)
    repeating.wake()  # before the start has no effect: the first call comes at once anyway
    repeating.start()
    calls.get(timeout=LIMIT_S)
    for _ in range(3):
        repeating.wake()
        calls.get(timeout=LIMIT_S)
    repeating.close()
    assert calls.empty()
    repeating.wake()
    repeating.close()


def test_a_wake_during_a_call_makes_another_one() -> None:
    calls: queue.Queue[int] = queue.Queue()
    numbers = itertools.count()

    def call() -> None:
        number = next(numbers)
        if number == 0:
            repeating.wake()
        calls.put(number)

    repeating = Repeating("test", call, math.inf)
    repeating.start()
    assert [calls.get(timeout=LIMIT_S) for _ in range(2)] == [0, 1]
    repeating.close()
    assert calls.empty()  # no other one


def test_the_interval_may_change(caplog: pytest.LogCaptureFixture) -> None:
    calls: queue.Queue[int] = queue.Queue()
    intervals = iter([0.0, 0.001, 0.0])

    def call() -> None:
        calls.put(1)
        raise ValueError("fails")

    repeating = Repeating("test", call, lambda: next(intervals, math.inf)).start()
    for _ in range(4):
        calls.get(timeout=LIMIT_S)
    repeating.close()
    assert calls.empty()
    assert "test failed" in caplog.text
