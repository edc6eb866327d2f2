"""How commands that go on wait: for Ctrl-C, for a server that is away, with a bar that shows how far it is."""

from __future__ import annotations

import contextlib
import queue
import signal
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from robocorba.errors.services import NotReachable

#: For a server to be found at first, and once more in each attempt after it was lost.
FIND_S, FIND_AGAIN_S = 3.0, 0.5
#: A server that is away is waited for so long.
AWAY_LIMIT_S = 10.0


class Stop:
    """Ctrl-C and SIGTERM, which from now on interrupt nothing but `wait`."""

    def __init__(self) -> None:
        self.is_asked = False
        # Unlike an Event, its put() is safe in a signal handler that interrupts its get().
        self._asked: queue.SimpleQueue[None] = queue.SimpleQueue()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._asked.put(None))

    def wait(self, seconds: float) -> bool:
        """Sleep so long, or until somebody asks to stop; whether somebody has."""
        if not self.is_asked:
            with contextlib.suppress(queue.Empty):
                self._asked.get(timeout=max(0.0, seconds))
                self.is_asked = True
        return self.is_asked

    def ticks(self, every_s: float, limit_s: float = 0.0) -> Iterator[float]:
        """The seconds since the first of them, which comes at once, until the stop or a limit (0: none).

        Whoever takes longer than `every_s` misses some."""
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


class Absence:
    """How long a server has been away: at most `limit_s`."""

    def __init__(self, limit_s: float = AWAY_LIMIT_S) -> None:
        self._limit_s = limit_s
        self._since: float | None = None

    @property
    def is_on(self) -> bool:
        return self._since is not None

    def go_on(self, wrong: NotReachable) -> str:
        """It does not answer; a sentence about it. Raises what is `wrong` after the limit."""
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        if now - self._since > self._limit_s:
            raise wrong
        return f"away for {now - self._since:.0f} s: {wrong}"

    def end(self) -> None:
        """It answers."""
        self._since = None


@contextlib.contextmanager
def progress(total: float) -> Iterator[Callable[[float, str], None]]:
    """A bar on the terminal, up to a total (0: nobody knows it); call what you get with how far it is, and a note."""
    columns = (BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, disable=not Console().is_terminal, transient=True) as bar:
        task = bar.add_task("", total=total or None)
        yield lambda done, note: bar.update(task, completed=done, description=note)
