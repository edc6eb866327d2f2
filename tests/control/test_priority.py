"""A thread that asks for priority has it, or goes on without."""

from __future__ import annotations

import os
import threading

from robocorba.control.priority import PRIORITY, be_punctual


def test_priority_is_had_or_not() -> None:
    found: list[tuple[bool, int, int]] = []

    def run() -> None:
        is_allowed, number = be_punctual(), threading.get_native_id()
        found.append((is_allowed, os.sched_getscheduler(number), os.sched_getparam(number).sched_priority))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found[0] in ((True, os.SCHED_FIFO, PRIORITY), (False, os.SCHED_OTHER, 0))
    assert os.sched_getscheduler(threading.get_native_id()) == os.SCHED_OTHER
