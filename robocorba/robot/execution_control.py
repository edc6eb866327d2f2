"""Control of a running program: other threads pause, step and end it, or interrupt it by a sensor."""

from __future__ import annotations

import contextlib
import itertools
import random
import threading
import time
from collections.abc import Callable, Iterator

from robocorba.errors.robots import RobotError
from robocorba.robot.agent_state import Question

#: Interval at which waiting threads check their conditions and interruptions [s].
CHECK_INTERVAL_S = 0.02


class Aborted(RobotError):
    """An operator or a leader ended the program."""


class PartEnded(Aborted):
    """A robot's part in a mission ends early. A program of this robot that leads the mission goes on."""


class SensorStop(RobotError):
    """A sensor saw an obstacle closer than `icon` allows."""

    def __init__(self, icon: object, reason: str) -> None:
        self.icon = icon
        super().__init__(reason)


class ExecutionControl:
    """end_motion: ends the running motion with an error. hold: pauses the robot (True) or lets it continue.

    One thread runs the program; any thread may control it."""

    #: Numbers of questions of all robots of a process. They begin at random, so that an answer which comes late never
    #: belongs to a question of the process's next life.
    _numbers = itertools.count(random.randrange(1, 2**31))

    def __init__(self, end_motion: Callable[[RobotError], None], hold: Callable[[bool], None]) -> None:
        self._end_motion, self._hold = end_motion, hold
        #: Interval at which waiting threads check their conditions and interruptions [s].
        self.check_interval_s = CHECK_INTERVAL_S
        self._lock = threading.Lock()
        self._interruptions: list[RobotError] = []
        #: Each says what the program waits for; what began last is the last one.
        self._waits: list[Callable[[], str]] = []
        #: What the program asks a person, until it is answered; and the answer.
        self.question = Question()
        self._answer: bool | None = None
        self._is_released = threading.Event()
        self._is_released.set()
        self.is_stepping = False

    def reset(self, is_stepping: bool) -> None:
        """Prepare for a new program."""
        with self._lock:
            self._interruptions = []
        self.is_stepping = is_stepping
        self._release()

    # ---- for controlling threads ----

    @property
    def is_paused(self) -> bool:
        return not self._is_released.is_set()

    def pause(self) -> None:
        self._is_released.clear()
        self._hold(True)

    def resume(self) -> None:
        """Continue to the end."""
        self.is_stepping = False
        self._release()

    def step(self) -> None:
        """Continue to the next icon."""
        self.is_stepping = True
        self._release()

    def abort(self, reason: str = "it was aborted") -> None:
        """End the program."""
        self._end(Aborted(reason))

    def end_part(self, reason: str) -> None:
        """End the robot's part in a mission."""
        self._end(PartEnded(reason))

    def _end(self, why: Aborted) -> None:
        self.interrupt(why)
        self._release()

    def interrupt(self, why: RobotError) -> None:
        """Raise an error in the program's thread, at each check until `settle` drops it."""
        with self._lock:
            self._interruptions.append(why)
        self._end_motion(why)

    def answer(self, number: int, is_yes: bool) -> bool:
        """Answer a question; returns False if that is not asked, or not any more."""
        with self._lock:
            if number != self.question.number or not number:
                return False
            self.question, self._answer = Question(), is_yes
            return True

    def settle(self, is_settled: Callable[[RobotError], bool]) -> None:
        """Drop the interruptions that `is_settled` accepts, because they were handled."""
        with self._lock:
            self._interruptions = [why for why in self._interruptions if not is_settled(why)]

    def _release(self) -> None:
        self._hold(False)
        self._is_released.set()

    @property
    def interruption(self) -> RobotError | None:
        """The error that the next check raises."""
        with self._lock:
            return self._interruptions[0] if self._interruptions else None

    @property
    def awaited(self) -> str:
        """What the program waits for, the innermost of several; empty if it does not wait."""
        with self._lock:
            waits = self._waits[::-1]
        return next((text for wait in waits if (text := wait())), "")

    # ---- for the program's thread ----

    @contextlib.contextmanager
    def awaiting(self, wait: Callable[[], str]) -> Iterator[None]:
        """Inside of it the program waits for what `wait` says, such as `B and C`; empty while it does not wait. Any
        thread may call it then."""
        with self._lock:
            self._waits.append(wait)
        try:
            yield
        finally:
            with self._lock:
                self._waits.remove(wait)

    @contextlib.contextmanager
    def asking(self, text: str) -> Iterator[Callable[[], bool | None]]:
        """Inside of it the program asks a person; what it yields returns the answer, None until there is one."""
        with self._lock:
            self.question, self._answer = Question(next(self._numbers), text), None
        try:
            with self.awaiting(lambda: f"an answer: {text}" if self.question.number else ""):
                yield lambda: self._answer
        finally:
            with self._lock:
                self.question = Question()

    def check(self) -> None:
        """Wait while the program is paused; raise its interruption."""
        while True:
            with self._lock:
                if self._interruptions:
                    raise self._interruptions[0]
            if self._is_released.is_set():
                return
            self._is_released.wait(self.check_interval_s)  # an abort sets it, too

    def before_icon(self) -> None:
        """Pause in stepping mode, and check."""
        if self.is_stepping:
            self.pause()
        self.check()

    def wait_for(self, is_met: Callable[[], bool], limit_s: float, clock: Callable[[], float]) -> bool:
        """Wait until a condition is met, at most `limit_s` by the clock without pauses; returns whether it is."""
        waited_s, before = 0.0, clock()
        while True:
            is_held = self.is_paused
            self.check()
            now = clock()
            if not is_held:
                waited_s += now - before
            before = now
            if is_met():
                return True
            if waited_s >= limit_s:
                return False
            time.sleep(self.check_interval_s)
