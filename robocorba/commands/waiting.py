"""Waiting in long-running commands: for Ctrl-C, for a server that does not answer, with a progress bar."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from robocorba.errors.services import NotReachable
from robocorba.system.printing import Console
from robocorba.system.stop_request import StopRequest

#: Timeout to resolve a server at the start, and in each retry after it was lost [s].
RESOLVE_TIMEOUT_S, RETRY_TIMEOUT_S = 3.0, 0.5
#: Time for which a command retries while a server does not answer [s].
OUTAGE_LIMIT_S = 10.0


class StopSignal(StopRequest):
    """Ctrl-C and SIGTERM: from its construction on, they end `wait` instead of the process."""

    def __init__(self) -> None:
        super().__init__()
        self.catch_signals()

    def ticks(self, every_s: float, limit_s: float = 0.0) -> Iterator[float]:
        """Yield every `every_s` the time since the first tick [s], until a stop signal or `limit_s` (0: no limit).

        The first tick comes immediately; ticks that the caller is too slow for are skipped."""
        began = time.monotonic()
        due_s = now_s = 0.0
        while True:
            yield now_s
            due_s = max(due_s + every_s, time.monotonic() - began)
            if limit_s and due_s > limit_s - every_s / 2:
                self.wait(began + limit_s - time.monotonic())
                return
            if self.wait(began + due_s - time.monotonic()):
                return
            now_s = time.monotonic() - began


class Outage:
    """How long a server has not answered; `note_failure` raises after `limit_s`."""

    def __init__(self, limit_s: float = OUTAGE_LIMIT_S) -> None:
        self._limit_s = limit_s
        self._since: float | None = None

    @property
    def is_active(self) -> bool:
        """Whether the last call failed."""
        return self._since is not None

    def note_failure(self, error: NotReachable) -> str:
        """Note that the server does not answer; returns a message. Raises `error` after the limit."""
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        if now - self._since > self._limit_s:
            raise error
        return f"not reachable for {now - self._since:.0f} s: {error}"

    def note_answer(self) -> None:
        self._since = None


@contextlib.contextmanager
def progress(total: float) -> Iterator[Callable[[float, str], None]]:
    """A progress bar on the terminal up to `total` (0: unknown); yields a function that sets progress and note."""
    columns = (BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, disable=not Console().is_terminal, transient=True) as bar:
        task = bar.add_task("", total=total or None)
        yield lambda done, note: bar.update(task, completed=done, description=note)
