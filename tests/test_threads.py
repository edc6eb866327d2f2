"""Threads of the background, what they share, and what is done once for all of them."""

from __future__ import annotations

import itertools
import math
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from robocorba.errors.base import RoboCorbaError
from robocorba.system import cores
from robocorba.system.background import Background, Workers
from robocorba.system.last_order import LastOrder
from robocorba.system.lazy_property import lazy_property
from robocorba.system.repeating import Repeating

#: Whatever it runs on: a thread is waited for at most this long [s].
LIMIT_S = 60.0


def fail() -> None:
    raise ValueError("a fault")


def test_failures_of_threads_are_reported() -> None:
    for call, expected in ((fail, ["internal fault in 'test' (ValueError: a fault), see the log"]), (int, [])):
        reasons: list[str] = []
        thread = Background("test", call, reasons.append)
        thread.start()
        thread.join(LIMIT_S)
        assert reasons == expected
    reasons: queue.Queue[str] = queue.Queue()
    workers = Workers("test", 1, reasons.put)
    workers.submit(fail)
    workers.submit(reasons.put, "an argument")
    assert "ValueError: a fault" in reasons.get(timeout=LIMIT_S)
    assert reasons.get(timeout=LIMIT_S) == "an argument"
    workers.close()


def test_a_thread_that_does_not_end_is_named(caplog: pytest.LogCaptureFixture) -> None:
    end = threading.Event()
    thread = Background("test", end.wait, lambda reason: None)
    thread.start()
    thread.wait_for_end(0.01)
    assert "the thread 'test' has not ended within 0.01 s" in caplog.text
    end.set()
    thread.wait_for_end(LIMIT_S)
    assert not thread.is_alive()


def test_a_process_ends_with_an_error_though_its_main_thread_waits() -> None:
    program = (
        "import threading; from robocorba.system.background import Background, end_process\n"
        "Background('worker', lambda: 1 / 0, end_process).start(); threading.Event().wait()"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=LIMIT_S)
    assert ended.returncode == 1
    assert "the process ends: internal fault in 'worker' (ZeroDivisionError" in ended.stderr


def test_a_repeated_task_is_called_when_woken_however_long_the_interval(caplog: pytest.LogCaptureFixture) -> None:
    """A wake during a call makes another one, also where it fails."""
    calls: queue.Queue[int] = queue.Queue()
    numbers = itertools.count()

    def call() -> None:
        number = next(numbers)
        if number == 1:
            repeating.wake()
        calls.put(number)
        fail()

    repeating = Repeating("test", call, math.inf)
    repeating.wake()  # before the start has no effect: the first call comes at once anyway
    repeating.start()
    assert calls.get(timeout=LIMIT_S) == 0
    for expected in ([1, 2], [3], [4]):
        repeating.wake()
        assert [calls.get(timeout=LIMIT_S) for _ in expected] == expected
    repeating.close()
    assert "test failed" in caplog.text
    intervals = iter([0.0, 0.001, 0.0])
    repeating = Repeating("test", lambda: calls.put(0), lambda: next(intervals, math.inf)).start()
    assert [calls.get(timeout=LIMIT_S) for _ in range(4)] == [0] * 4
    repeating.close()
    assert calls.empty()
    repeating.wake()
    repeating.close()


def test_closing_waits_for_the_call_in_progress_and_no_other_is_made() -> None:
    begun, go_on, calls = threading.Event(), threading.Event(), list[int]()

    def call() -> None:
        begun.set()
        go_on.wait(LIMIT_S)
        calls.append(1)

    repeating = Repeating("test", call, 0.0).start()
    assert begun.wait(LIMIT_S)
    closing = threading.Thread(target=repeating.close)
    closing.start()
    repeating.wake()
    closing.join(0.1)
    assert (closing.is_alive(), calls) == (True, [])
    go_on.set()
    closing.join(LIMIT_S)
    assert (closing.is_alive(), calls) == (False, [1])


def test_each_order_ends_with_a_report_and_the_next_one_has_its_chance() -> None:
    reports: queue.Queue[str] = queue.Queue()

    def execute(order: Exception | str) -> None:
        if isinstance(order, Exception):
            raise order

    orders = LastOrder("test", execute, reports.put)
    for order, report in (
        (RoboCorbaError("not possible"), "not possible"),
        (ValueError("a fault"), "internal fault (ValueError: a fault), see the log"),
        ("an order", ""),
    ):
        orders.give(order)
        assert reports.get(timeout=LIMIT_S) == report
    orders.close()


class Thing:
    def __init__(self, compute: Callable[[], object]) -> None:
        self._compute = compute

    @lazy_property
    def value(self) -> object:
        """What `compute` returns."""
        return self._compute()


def test_a_property_is_computed_once_for_all_threads() -> None:
    first, second = Thing(object), Thing(object)
    assert first.value is first.value
    assert first.value is not second.value
    assert Thing.value.__doc__ == "What `compute` returns."
    # As they would with functools.cached_property of Python 3.10 and 3.11.
    both_compute = threading.Barrier(2)

    def compute() -> object:
        both_compute.wait(LIMIT_S)
        return object()

    thing = Thing(compute)
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(lambda _: thing.value, range(2), timeout=LIMIT_S)
        assert first is second is thing.value
        values = list(threads.map(lambda each: each.value, [Thing(compute), Thing(compute)], timeout=LIMIT_S))
    assert values[0] is not values[1]


def test_a_thread_and_those_that_it_starts_share_a_core() -> None:
    found, every = list[set[int]](), os.sched_getaffinity(0)

    def in_a_thread(call: Callable[[], None]) -> None:
        """So that the threads of other tests keep their cores."""
        thread = threading.Thread(target=call)
        thread.start()
        thread.join()

    def share() -> None:
        cores.share_one()
        found.append(os.sched_getaffinity(0))
        in_a_thread(lambda: found.append(os.sched_getaffinity(0)))

    in_a_thread(share)
    assert [len(each) for each in found] == [1, 1]
    assert found[0] == found[1] <= every
