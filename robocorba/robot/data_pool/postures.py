"""Postures of the robots on a pool's floor, read when somebody asks for them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.posture import Posture

#: Time for which answers of the source serve all readers, and pause after one that failed [s].
KEPT_S, RETRY_S = 0.05, 1.0
#: Supplies the postures on a floor after a simulated time [s]. Raises UnknownFloor, NotReachable.
PostureSource = Callable[[str, float], list[Posture]]


class PoolPostures:
    """Thread-safe. floor: returns the floor that the pool's robot is on. clock: returns the time [s].

    One reader at a time waits for the source; the others, and all while it does not answer, get the last postures."""

    def __init__(
        self, source: PostureSource, floor: Callable[[], str], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._source, self._floor, self._clock = source, floor, clock
        self._reading = threading.Lock()
        self._next_s = 0.0
        #: The floor and its postures, replaced together.
        self._last: tuple[str, list[Posture]] = "", []

    def since(self, time_s: float) -> list[Posture]:
        """Postures on the floor that were reported after a simulated time [s]."""
        floor = self._floor()
        if (floor != self._last[0] or self._clock() >= self._next_s) and self._reading.acquire(blocking=False):
            try:
                self._read(floor)
            finally:
                self._reading.release()
        known, postures = self._last
        return [posture for posture in postures if posture.time > time_s] if known == floor else []

    def _read(self, floor: str) -> None:
        try:
            self._last = floor, self._source(floor, -1.0)
        except UnknownFloor:
            self._last = floor, []
        except NotReachable:
            if floor != self._last[0]:
                self._last = floor, []
            self._next_s = self._clock() + RETRY_S
            return
        self._next_s = self._clock() + KEPT_S
