"""The processor cores that threads run on.

One thread at a time executes Python. Where each of hundreds of connections has a thread, most calls find the
interpreter in use, and another thread wakes them when it is free. To wake a thread on another core takes longer than a
call: the threads of a server that does thousands of calls a second then do little but hand the interpreter over. On one
core they don't wait for each other's wake-up."""

from __future__ import annotations

import os

import psutil


def share_one() -> None:
    """Keep this thread, and all threads that it and they will start, on the core on which this process runs."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {psutil.Process().cpu_num()} & cores or cores)
