"""The threads in which omniORB executes calls must end before Python does: one that still releases what it has of
Python would abort the process."""

from __future__ import annotations

import threading
import time
from collections import deque
from pathlib import Path

from omniORB import WTHREAD_CREATED, WorkerThread, addWThreadHook

#: Time limit for their end, once the ORB has ended [s].
END_LIMIT_S = 5.0
#: Number of threads that are remembered: more than there may be connections.
MAX_THREADS = 8192
#: Interval between looks [s].
INTERVAL_S = 0.001
#: Where the kernel lists the threads of this process; other systems than Linux are not waited for.
_LISTING = Path("/proc/self/task")

#: The kernel's ids of those that have begun.
_begun: deque[int] = deque(maxlen=MAX_THREADS)


def _note(change: object, thread: WorkerThread) -> None:
    if change == WTHREAD_CREATED:
        _begun.append(threading.get_native_id())


addWThreadHook(_note)


def wait_for_end(limit_s: float = END_LIMIT_S) -> None:
    """Wait until they have ended, at most for `limit_s`."""
    latest = time.monotonic() + limit_s
    while _begun and time.monotonic() < latest and _LISTING.is_dir():
        living = {path.name for path in _LISTING.iterdir()}
        while _begun and str(_begun[-1]) not in living:
            _begun.pop()
        if _begun:
            time.sleep(INTERVAL_S)
