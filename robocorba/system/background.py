"""Threads of the background, and what becomes of their work when one ends by an exception that nobody expected.

Who starts a thread decides that, since a thread that ends takes its part of the state with it: `on_failure` says where
a user sees it, such as a link that is down or a robot that is stopped, with the reason. A server that is of no use
without the thread ends itself, and is started again."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NoReturn

#: Timeout for the end of a thread that was told to end [s].
END_LIMIT_S = 30.0

_log = logging.getLogger(__name__)


class Background(threading.Thread):
    """Calls `work` once it is started. on_failure: called in the thread with a sentence for users when `work` raises;
    the log has the trace."""

    def __init__(self, name: str, work: Callable[[], object], on_failure: Callable[[str], object]) -> None:
        super().__init__(name=name, daemon=True)
        self._work, self._on_failure = work, on_failure

    def run(self) -> None:
        _attempt(self.name, self._work, self._on_failure)

    def wait_for_end(self, limit_s: float = END_LIMIT_S) -> None:
        """Wait until it has ended; a warning names one that goes on after `limit_s`. It does not keep the process."""
        if self.is_alive():
            self.join(limit_s)
            if self.is_alive():
                _log.warning("the thread '%s' has not ended within %g s", self.name, limit_s)


class Workers:
    """At most `count` threads that make calls in the order of `submit`. on_failure: as of Background, of each call."""

    def __init__(self, name: str, count: int, on_failure: Callable[[str], object]) -> None:
        self._name, self._on_failure = name, on_failure
        self._threads = ThreadPoolExecutor(count, name)

    def submit(self, call: Callable[..., object], *arguments: Any) -> None:
        self._threads.submit(_attempt, self._name, lambda: call(*arguments), self._on_failure)

    def finish(self) -> None:
        """Make all calls that wait, and end."""
        self._threads.shutdown()

    def close(self, wait: bool = True) -> None:
        """Drop the calls that wait. wait: for the end of those in progress."""
        self._threads.shutdown(wait=wait, cancel_futures=True)


def end_process(reason: str) -> NoReturn:
    """End this process with exit code 1, whatever its other threads do; the state on disk is as after a kill."""
    _log.critical("the process ends: %s", reason)
    os._exit(1)


def _attempt(name: str, work: Callable[[], object], on_failure: Callable[[str], object]) -> None:
    try:
        work()
    except (Exception, SystemExit) as error:  # sys.exit in a thread ends that thread, and says nothing
        _log.exception("%s ended by a defect", name)
        on_failure(f"internal fault in '{name}' ({type(error).__name__}: {str(error)[:200]}), see the log")
