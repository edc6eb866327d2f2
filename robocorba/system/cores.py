"""The processor cores that threads run on.

One thread at a time executes Python. Where each of hundreds of connections has a thread, most calls find the
interpreter in use, and another thread wakes them when it is free. To wake a thread on another core takes longer than a
call: the threads of a server that does thousands of calls a second then do little but hand the interpreter over. On one
core they don't wait for each other's wake-up. Work that runs without the interpreter leaves that core."""

from __future__ import annotations

import contextlib
import os

import psutil

#: The cores of this process before its threads shared one; None if they do not.
_cores: set[int] | None = None


def usable() -> set[int]:
    """The cores that this process may use, whether or not this thread shares one."""
    return _cores or os.sched_getaffinity(0)


def share_one() -> None:
    """Keep this thread, and all threads that it and they will start, on the core on which this process runs."""
    global _cores
    _cores = usable()
    os.sched_setaffinity(0, {psutil.Process().cpu_num()} & _cores or _cores)


def use_all() -> None:
    """Let this thread run on every core, and all threads that it will start."""
    with contextlib.suppress(OSError):  # the process may have been bound to others meanwhile
        os.sched_setaffinity(0, usable())
