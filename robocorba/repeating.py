"""A task that a thread repeats until it is closed."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

_log = logging.getLogger(__name__)


class Repeating:
    """Calls `task` again and again, every_s [s] after the end of the previous call; logs exceptions and continues."""

    def __init__(self, name: str, task: Callable[[], None], every_s: float) -> None:
        self._name, self._task, self._every_s = name, task, every_s
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> Repeating:
        self._thread.start()
        return self

    def close(self) -> None:
        """Wait for the call in progress; make no further calls."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._task()
            except Exception:  # a failed call must not end the repetition
                _log.exception("%s failed", self._name)
            self._closing.wait(self._every_s)
