"""A path planning agent whose answer waits for the test."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

from robocorba.stubs import RoboCorba__POA


class HeldPlanner(RoboCorba__POA.PathPlanner):
    """Its map version is known once `go_on` is set. called: has a permit for each call. note: called by each call."""

    def __init__(self, note: Callable[[], object] = lambda: None) -> None:
        self.called, self.go_on, self._note = threading.Semaphore(0), threading.Event(), note

    def _get_mapVersion(self) -> int:
        self._note()
        self.called.release()
        assert self.go_on.wait(60.0)
        return 7


@contextlib.contextmanager
def held_planner(note: Callable[[], object] = lambda: None) -> Iterator[HeldPlanner]:
    """One whose calls end with the `with` at the latest."""
    planner = HeldPlanner(note)
    try:
        yield planner
    finally:
        planner.go_on.set()
