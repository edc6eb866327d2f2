"""A process that runs but does not answer is as good as ended."""

from __future__ import annotations

import asyncio
import logging
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

import psutil

from robocorba.errors.base import RoboCorbaError
from robocorba.system.supervision.starter import Child

#: Calls within the limit. All must fail: a pause of this process itself, or of the whole machine, is no hang.
CALLS = 5

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class HangLimit:
    """When a process that does not answer is killed, to be started again.

    limit_s: time without an answer [s]; 0: never. spares_held: not while a debugger or SIGSTOP holds it."""

    limit_s: float = 10.0
    spares_held: bool = False


async def watch_for_hang(process: Child, is_alive: Callable[[], None] | None, limit: HangLimit) -> str:
    """Call `is_alive` in a thread again and again; kill the process when it hangs, and return the reason. Runs until
    then, or until cancelled; returns "" if there is nothing to watch."""
    if is_alive is None or not limit.limit_s:
        return ""
    answered = called = time.monotonic()
    failures = 0
    while True:
        await asyncio.sleep(max(0.0, called + limit.limit_s / CALLS - time.monotonic()))
        called = time.monotonic()
        try:
            await asyncio.to_thread(is_alive)
        except RoboCorbaError as error:
            failures += 1
            silent_s = time.monotonic() - answered
            if failures >= CALLS and silent_s >= limit.limit_s and not (limit.spares_held and _is_held(process.pid)):
                process.send_signal(signal.SIGKILL)
                return f"was killed: no answer for {silent_s:.0f} s ({error})"
        except Exception:  # a defect of the check says nothing of the process, and must not end the watch
            _log.exception("a check whether process %d hangs failed", process.pid)
        else:
            answered, failures = time.monotonic(), 0


def _is_held(pid: int) -> bool:
    """Whether a debugger or SIGSTOP holds a process."""
    try:
        return psutil.Process(pid).status() in (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP)
    except psutil.Error:
        return False
