"""Threads of the product that run one after the other, each when a test gives it a turn, by a clock of the test."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from types import ModuleType, SimpleNamespace

import pytest

from robocorba.system.background import Background
from tests.clock import Clock


class TurnTaking(Background):
    """Takes the place of Background: it runs in its turns, each of which ends where it waits or has ended."""

    def __init__(
        self, threads: list[TurnTaking], name: str, work: Callable[[], object], on_failure: Callable[[str], object]
    ) -> None:
        super().__init__(name, work, on_failure)
        self._begins, self._ends = threading.Semaphore(0), threading.Semaphore(0)
        self.is_over = False
        threads.append(self)

    def run(self) -> None:
        self._begins.acquire()
        super().run()
        self.is_over = True
        self._ends.release()

    def turn(self) -> None:
        if not self.is_over:
            self._begins.release()
            assert self._ends.acquire(timeout=60.0), f"{self.name} hangs"
        if self.is_over:
            super().join()

    def end_turn(self) -> None:
        """Called by this thread."""
        self._ends.release()
        self._begins.acquire()

    def join(self, timeout: float | None = None) -> None:
        """It gets turns until it has ended."""
        for _ in range(1000):
            self.turn()
            if self.is_over:
                return
        raise AssertionError(f"{self.name} does not end")


def end_turn(seconds: float = 0.0) -> None:
    """Takes the place of time.sleep."""
    thread = threading.current_thread()
    if isinstance(thread, TurnTaking):
        thread.end_turn()


class TurnEvent(threading.Event):
    """Whoever waits for it ends a turn; a thread of the test does not wait."""

    def wait(self, timeout: float | None = None) -> bool:
        if not self.is_set():
            end_turn()
        return self.is_set()


def take_turns(patch: pytest.MonkeyPatch, clock: Clock, *modules: ModuleType) -> list[TurnTaking]:
    """Let the threads of modules take turns, and let them tell the time by a clock; returns those that were made."""
    threads: list[TurnTaking] = []
    for module in modules:
        patch.setattr(module, "Background", functools.partial(TurnTaking, threads), raising=False)
        patch.setattr(module, "threading", SimpleNamespace(**vars(threading) | {"Event": TurnEvent}))
        patch.setattr(module, "time", SimpleNamespace(monotonic=clock, sleep=end_turn), raising=False)
    return threads
