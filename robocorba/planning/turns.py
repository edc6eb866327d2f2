"""Queries that compute take turns, so that dozens of long ones delay neither short ones nor other calls of the process.

As many compute at a time as there are cores. Those go first that are expected to be short; after each slice of time, a
query lets one go on that has computed less. So short queries need not wait for long ones, which share what is left."""

from __future__ import annotations

import heapq
import itertools
import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from robocorba.errors.paths import PlannerBusy, PlanningTimeout

#: Maximum number of queries that wait.
MAX_WAITING = 2000
#: Computing time after which a query lets others go on [s].
SLICE_S = 0.01


class Turn:
    """The turn of a query; its thread computes while it has a place. deadline: time.monotonic() [s]. A turn without
    Turns never waits."""

    def __init__(self, deadline: float = math.inf, turns: Turns | None = None, expected_s: float = 0.0) -> None:
        self.deadline, self._turns = deadline, turns
        self.has_place = False
        #: Expected computing time and that before the present slice [s], and when the slice began.
        self.computed_s, self.began = expected_s, 0.0

    @property
    def left_s(self) -> float:
        """Time until the deadline [s], as a timeout of locks; 0 after it."""
        return min(max(0.0, self.deadline - time.monotonic()), threading.TIMEOUT_MAX)

    def pause(self, floor: str) -> None:
        """Let others go on where it is their turn. Not within a lock. Raises PlanningTimeout after the deadline."""
        now = time.monotonic()
        if now > self.deadline:
            raise PlanningTimeout(floor)
        if self._turns is not None and now - self.began >= SLICE_S:
            self.computed_s += now - self.began
            self.began = now
            if not self._turns.exchange(self):
                raise PlanningTimeout(floor)


class Turns:
    """The turns of all queries of a planner."""

    def __init__(self, at_once: int = max(2, os.cpu_count() or 1)) -> None:
        self._lock = threading.Lock()
        self._free = at_once
        self._numbers = itertools.count()
        #: A heap: computing time of a turn, a number in the order of waiting, the turn, and a lock that is held until
        #: it gets a place.
        self._waiting: list[tuple[float, int, Turn, threading.Lock]] = []

    @contextmanager
    def take(self, deadline: float, floor: str, expected_s: float = 0.0) -> Iterator[Turn]:
        """A turn with a place. expected_s: how long the query may compute [s]; it counts as computed already.

        Raises PlanningTimeout if there is no place before the deadline (time.monotonic) [s], PlannerBusy if too many
        wait."""
        turn, waiting = Turn(deadline, self, expected_s), None
        with self._lock:
            if self._free:
                self._free -= 1
                turn.has_place = True
            elif len(self._waiting) < MAX_WAITING:
                waiting = self._wait(turn)
            else:
                raise PlannerBusy(f"{MAX_WAITING} queries wait already; try again")
        try:
            if waiting and not self._gets_place(turn, waiting):
                raise PlanningTimeout(floor)
            turn.began = time.monotonic()
            yield turn
        finally:
            with self._lock:
                if turn.has_place:
                    self._hand_on(turn)

    def exchange(self, turn: Turn) -> bool:
        """Hand the place on to the turn that has computed least, if that is less than this one, and wait for another
        place. False if there is none in time."""
        with self._lock:
            if not self._waiting or self._waiting[0][0] >= turn.computed_s:
                return True
            waiting = self._wait(turn)
            self._hand_on(turn)
        is_served = self._gets_place(turn, waiting)
        turn.began = time.monotonic()
        return is_served

    def _wait(self, turn: Turn) -> threading.Lock:
        """Begin to wait. Requires the lock."""
        waiting = threading.Lock()
        waiting.acquire()
        heapq.heappush(self._waiting, (turn.computed_s, next(self._numbers), turn, waiting))
        return waiting

    def _hand_on(self, turn: Turn) -> None:
        """Give the place of a turn to the next one, or free it. Requires the lock."""
        turn.has_place = False
        if not self._waiting:
            self._free += 1
            return
        _, _, following, waiting = heapq.heappop(self._waiting)
        following.has_place = True
        waiting.release()

    def _gets_place(self, turn: Turn, waiting: threading.Lock) -> bool:
        """Wait outside of the interpreter."""
        if not waiting.acquire(timeout=turn.left_s):
            with self._lock:
                if not turn.has_place:
                    self._waiting = [each for each in self._waiting if each[2] is not turn]
                    heapq.heapify(self._waiting)
        return turn.has_place


#: The turn of a query that shares its process with no others.
ALONE = Turn()
