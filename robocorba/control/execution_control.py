"""The course of a program: it can be paused, stepped and ended from outside, and stopped by what a sensor sees."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.robots import RobotError

#: Whoever waits looks around so often, s.
LOOK_S = 0.02


class Aborted(RobotError):
    """Somebody ended the program."""


class SensorStop(RobotError):
    """A sensor saw something closer than it may be. `stop` is the icon that asked for it."""

    def __init__(self, stop: object, reason: str) -> None:
        self.stop = stop
        super().__init__(reason)


class ExecutionControl:
    """interrupt: ends what the robot is doing with an error. hold: lets it stand, or go on.

    One thread follows the course, any thread steers it."""

    def __init__(self, interrupt: Callable[[RobotError], None], hold: Callable[[bool], None]) -> None:
        self._interrupt, self._hold = interrupt, hold
        self._lock = threading.Lock()
        self._interruptions: list[RobotError] = []
        self._go = threading.Event()
        self._go.set()
        self.is_stepping = False

    def reset(self, is_stepping: bool) -> None:
        """Before it begins."""
        with self._lock:
            self._interruptions = []
        self.is_stepping = is_stepping
        self._release()

    # ---- who steers ----

    @property
    def is_paused(self) -> bool:
        return not self._go.is_set()

    def pause(self) -> None:
        self._go.clear()
        self._hold(True)

    def resume(self) -> None:
        """Go on to the end."""
        self.is_stepping = False
        self._release()

    def step(self) -> None:
        """Go on to the next icon."""
        self.is_stepping = True
        self._release()

    def abort(self, reason: str = "somebody ended it") -> None:
        """End the program."""
        self.interrupt(Aborted(reason))
        self._release()

    def interrupt(self, why: RobotError) -> None:
        """Let whoever follows the course meet this error, now and until it is settled."""
        with self._lock:
            self._interruptions.append(why)
        self._interrupt(why)

    def settle(self, is_settled: Callable[[RobotError], bool]) -> None:
        """These have been dealt with."""
        with self._lock:
            self._interruptions = [why for why in self._interruptions if not is_settled(why)]

    def _release(self) -> None:
        self._hold(False)
        self._go.set()

    @property
    def interruption(self) -> RobotError | None:
        """What whoever follows the course will meet."""
        with self._lock:
            return self._interruptions[0] if self._interruptions else None

    # ---- who follows ----

    def check(self) -> None:
        """Wait while the course is paused; raise what interrupts it."""
        while True:
            with self._lock:
                if self._interruptions:
                    raise self._interruptions[0]
            if self._go.wait(LOOK_S):
                return

    def at_icon(self) -> None:
        """The next icon begins."""
        if self.is_stepping:
            self.pause()
        self.check()

    def wait_for(self, is_so: Callable[[], bool], limit_s: float, clock: Callable[[], float] = time.monotonic) -> bool:
        """Wait until something is so, at most so long by a clock, without pauses; whether it is."""
        waited_s, before = 0.0, clock()
        while True:
            is_held = self.is_paused
            self.check()
            now = clock()
            if not is_held:
                waited_s += now - before
            before = now
            if is_so():
                return True
            if waited_s >= limit_s:
                return False
            time.sleep(LOOK_S)
