"""CallLimiter: never more at once than allowed, and those that hang don't count for long."""

from __future__ import annotations

import threading
import time

import pytest

from robocorba.events import call_limiter
from robocorba.events.call_limiter import CallLimiter
from robocorba.testing.processes import eventually
from tests.waits import work_for


def test_no_more_slots_are_taken_than_allowed() -> None:
    limiter, running, most = CallLimiter(3, 5.0), 0, 0
    counting = threading.Lock()

    def work() -> None:
        nonlocal running, most
        for _ in range(20):
            with limiter.slot():
                with counting:
                    running += 1
                    most = max(most, running)
                work_for(0.0005)
                with counting:
                    running -= 1

    threads = [threading.Thread(target=work) for _ in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
        assert not thread.is_alive()
    assert most == 3


def test_calls_that_hang_delay_others_no_longer_than_the_limit() -> None:
    limiter, released = CallLimiter(2, 0.05), threading.Event()

    def hang() -> None:
        with limiter.slot():
            released.wait(60.0)

    hanging = [threading.Thread(target=hang) for _ in range(2)]
    for thread in hanging:
        thread.start()
    eventually(lambda: len(limiter._running) == 2)
    for _ in range(100):  # 5 s, if each of them waited
        with limiter.slot():
            pass
    assert all(thread.is_alive() for thread in hanging)
    assert len(limiter._running) < 2
    released.set()
    for thread in hanging:
        thread.join(60.0)
    with limiter.slot(), limiter.slot():  # late ones have not taken a slot
        assert len(limiter._running) == 2


def test_a_hundred_threads_that_wait_do_not_wake_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """All calls hang, so that each thread gets the slot of the one before after the limit. One that waits looks at the
    clock whenever it wakes."""
    looks: list[int] = []

    class Clock:
        @staticmethod
        def monotonic() -> float:
            looks.append(threading.get_ident())
            return time.monotonic()

    monkeypatch.setattr(call_limiter, "time", Clock)
    limiter, released = CallLimiter(1, 0.01), threading.Event()
    running: list[int] = []

    def hang() -> None:
        with limiter.slot():
            running.append(threading.get_ident())
            released.wait(60.0)

    threads = [threading.Thread(target=hang) for _ in range(100)]
    for thread in threads:
        thread.start()
    eventually(lambda: len(running) == len(threads), what="a slot for each")
    released.set()
    for thread in threads:
        thread.join(60.0)
    assert len(looks) < 5 * len(threads)


def test_an_error_frees_the_slot() -> None:
    limiter = CallLimiter(1, 60.0)
    for _ in range(3):
        try:
            with limiter.slot():
                raise ValueError
        except ValueError:
            pass
    assert not limiter._running
