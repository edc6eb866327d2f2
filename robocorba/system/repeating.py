"""A task that a thread repeats until it is closed."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable

from robocorba.system.background import Background, end_process

_log = logging.getLogger(__name__)


class Repeating:
    """Calls `task` again and again, every_s [s] after the end of the previous call, or when it is woken. A call that
    raises is logged, and made again after the same pause: what the task keeps up to date gets old meanwhile.

    every_s: a number, or a function that is asked after each call; infinite: only when woken."""

    def __init__(self, name: str, task: Callable[[], None], every_s: float | Callable[[], float]) -> None:
        self._name, self._task, self._every_s = name, task, every_s
        self._closing = False
        self._woken = threading.Event()
        self._thread = Background(name, self._run, end_process)

    def start(self) -> Repeating:
        self._thread.start()
        return self

    def wake(self) -> None:
        """Make the next call as soon as possible. Any thread may call this; it does not block."""
        self._woken.set()

    def close(self) -> None:
        """Wait for the call in progress; make no further calls."""
        self._closing = True
        self._woken.set()
        self._thread.wait_for_end()

    def _run(self) -> None:
        while not self._closing:
            self._woken.clear()
            try:
                self._task()
            except Exception:  # a failed call must not end the repetition
                _log.exception("%s failed", self._name)
            if not self._closing:
                pause_s = self._every_s() if callable(self._every_s) else self._every_s
                self._woken.wait(None if math.isinf(pause_s) else pause_s)
