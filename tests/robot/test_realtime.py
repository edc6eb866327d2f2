"""A thread that asks for priority has it, or goes on without."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

from robocorba.robot.realtime import NICE, PRIORITY, SWITCH_S, use_realtime_scheduling


def test_priority_is_had_or_not() -> None:
    def ask() -> tuple[bool, int, int]:
        is_allowed, number = use_realtime_scheduling(), threading.get_native_id()
        return is_allowed, os.sched_getscheduler(number), os.sched_getparam(number).sched_priority

    with ThreadPoolExecutor() as threads:
        found = threads.submit(ask).result()
    assert found in ((True, os.SCHED_FIFO, PRIORITY), (False, os.SCHED_OTHER, 0))
    assert os.sched_getscheduler(threading.get_native_id()) == os.SCHED_OTHER


def test_a_prompt_process_hands_on_its_lock_and_is_preferred_or_goes_on_without() -> None:
    asks = (
        "from robocorba.robot import realtime; import os, sys, threading; realtime.raise_process_priority();"
        "seen = []; one = threading.Thread(target=lambda: seen.append(os.getpriority(os.PRIO_PROCESS, 0)));"
        "one.start(); one.join(); print(sys.getswitchinterval(), *seen)"
    )
    said = subprocess.check_output((sys.executable, "-c", asks), text=True, timeout=60.0).split()
    assert float(said[0]) == SWITCH_S
    assert int(said[1]) in (NICE, os.getpriority(os.PRIO_PROCESS, 0))
