"""A thread that has to be on time asks the system to run it before all others."""

from __future__ import annotations

import logging
import os
import threading

#: Above everything without such a priority, below the kernel's own threads.
PRIORITY = 10

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
