"""A thread that has to be on time asks the system to run it before all others, and its process to let it."""

from __future__ import annotations

import logging
import os
import sys
import threading

#: Above everything without such a priority, below the kernel's own threads.
PRIORITY = 10
#: All others of its process are a little more urgent than other processes; and no thread keeps the interpreter's lock
#: for longer when another one wants it, s: Python's own 5 ms are a quarter of a tick.
NICE, SWITCH_S = -5, 0.0005

_log = logging.getLogger(__name__)


def be_punctual() -> bool:
    """Run this thread, and those that it starts, before whatever is less urgent on this computer; whether that is
    allowed. It is to root, to whoever has CAP_SYS_NICE, or by `ulimit -r`; others go on as they are."""
    try:
        os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as refused:
        _log.info("ticks have no priority over other processes: %s", refused.strerror)
        return False
    return True


def be_prompt() -> None:
    """Let a punctual thread of this process not wait for long for one that has the interpreter's lock, and that has to
    be run to hand it on. For a process to call before it starts threads; without the right to it, they stay as they
    are."""
    sys.setswitchinterval(SWITCH_S)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except OSError as refused:
        _log.info("the process has no priority over others: %s", refused.strerror)
