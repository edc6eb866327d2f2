"""Scheduling for control loops: real-time priority of a thread, and a higher priority of its process."""

from __future__ import annotations

import logging
import os
import sys
import threading

#: Priority under SCHED_FIFO: above all threads without real-time priority, below the kernel's own.
PRIORITY = 10
#: Niceness of the process's other threads: a priority slightly above that of other processes.
NICE = -5
#: Switch interval of the interpreter's lock [s]. Python's default of 5 ms is a quarter of a control cycle.
SWITCH_S = 0.0005

_log = logging.getLogger(__name__)


def use_realtime_scheduling() -> bool:
    """Give this thread, and threads that it starts, real-time priority (SCHED_FIFO). Returns whether the system allows
    it: it does for root, with CAP_SYS_NICE, or by `ulimit -r`."""
    try:
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as refused:
        _log.info("the control loop runs without real-time priority: %s", refused.strerror)
        return False
    return True


def raise_process_priority() -> None:
    """Shorten the time for which a real-time thread of this process waits for the interpreter's lock: lower the switch
    interval, and raise the priority of the threads that may hold the lock. Call it before the process starts threads.
    Without permission the priority stays as it is."""
    sys.setswitchinterval(SWITCH_S)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except OSError as refused:
        _log.info("the process keeps its priority: %s", refused.strerror)
