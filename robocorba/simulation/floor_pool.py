"""Threads that step the floors of a building side by side. Chipmunk and kernels run without the interpreter's lock.

Floors share nothing within a step, and results are merged in the order of the floors: they do not depend on the number
of threads, nor on their timing.
"""

from __future__ import annotations

import logging
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import count
from typing import Protocol

from robocorba.simulation.physics import StepResult
from robocorba.system import cores
from robocorba.system.background import Background, end_process

#: Steps after which the pool decides again whether threads share the next ones.
WINDOW_STEPS = 8
#: Windows until the slower way is tried again. A trial costs at most a few windows in a hundred.
TRIAL_WINDOWS = 24
#: Windows whose median time stands for a way.
KEPT_WINDOWS = 5
#: Share of the time that steps take from which sharing them is tried. Below, nobody waits for a step.
MIN_BUSY_SHARE = 0.25
#: Bodies on all moving floors but the largest from which sharing is tried: 25 us of work; a hand-over takes 10.
MIN_SHARED_BODIES = 100
#: Time without work after which a thread ends [s]; the next shared step starts another one.
IDLE_LIMIT_S = 5.0
#: Interval between warnings while a floor's step does not end [s].
WARNING_INTERVAL_S = 10.0

_log = logging.getLogger(__name__)


class Floor(Protocol):
    """What the pool needs of FloorPhysics."""

    @property
    def name(self) -> str: ...
    @property
    def size(self) -> int: ...
    @property
    def is_still(self) -> bool: ...
    def step(self) -> StepResult: ...


class FloorPool:
    """Steps floors, in the caller's thread and in threads of its own, which start when they are first needed.

    threads: with the caller's; 1 never shares, a larger number always does. None: at most one for each core that this
    process may use, and only while measured times of both ways say that it pays. clock: returns the time [s].

    One thread at a time may call its methods."""

    def __init__(self, threads: int | None = None, clock: Callable[[], float] = time.perf_counter) -> None:
        self._threads = threads
        self._clock = clock
        self._helpers: list[_Helper] = []
        self._choice = SharingChoice()
        self._cores = 0

    def step(self, floors: Sequence[Floor]) -> list[StepResult]:
        """Step all floors; return their results in the order of `floors`.

        Raises the first error of a floor in this order, after all other floors have made their step."""
        began = self._clock()
        shared, threads = self._shared_of(floors)
        turn = _Turn(floors, shared)
        if shared:
            self._share(turn, threads)
        else:
            turn.work_rest()
        if self._threads is None:
            self._choice.record(bool(shared), began, self._clock())
        return turn.results()

    def close(self) -> None:
        """End the threads. A later step may start them again."""
        helpers, self._helpers = self._helpers, []
        for helper in helpers:
            helper.close()

    def _shared_of(self, floors: Sequence[Floor]) -> tuple[list[int], int]:
        """The floors that threads share, the largest one first, and the number of threads; none for the caller's."""
        if self._threads == 1 or not (self._threads or self._choice.shares):
            return [], 1
        shared = [at for at, floor in enumerate(floors) if floor.size and not floor.is_still]
        shared.sort(key=lambda at: -floors[at].size)
        if self._threads is None and sum(floors[at].size for at in shared[1:]) < MIN_SHARED_BODIES:
            return [], 1
        self._cores = self._cores or len(cores.usable())
        threads = min(self._threads or self._cores, len(shared))
        return (shared, threads) if threads > 1 else ([], 1)

    def _share(self, turn: _Turn, threads: int) -> None:
        while len(self._helpers) < threads - 1:
            self._helpers.append(_Helper())
        is_done = False
        try:
            for helper in self._helpers[: threads - 1]:
                helper.help(turn)
            turn.work()
            turn.work_rest()
            turn.wait()
            is_done = True
        finally:
            if not is_done:  # interrupted: nobody may touch a floor while a thread steps it
                turn.stop()
                self.close()


class SharingChoice:
    """Whether threads share the next steps: while steps take much of the time, the way whose steps are faster."""

    def __init__(self) -> None:
        self.shares = False
        self._times: dict[bool, deque[float]] = {way: deque(maxlen=KEPT_WINDOWS) for way in (False, True)}
        self._steps = self._windows = self._shared = 0
        self._busy_s = self._began = 0.0

    def record(self, shared: bool, began: float, ended: float) -> None:
        """Count a step with its times [s]; decide at the end of a window."""
        if not self._steps:
            self._began = began
        self._steps += 1
        self._shared += shared
        self._busy_s += ended - began
        if self._steps == WINDOW_STEPS:
            self._decide(ended - self._began)

    def _decide(self, passed_s: float) -> None:
        busy_s, shared = self._busy_s, self._shared
        self._busy_s, self._steps, self._shared = 0.0, 0, 0
        if busy_s < MIN_BUSY_SHARE * passed_s:
            self.shares = False
            return
        if shared in (0, WINDOW_STEPS):  # the rest had too few bodies now and then
            self._times[shared > 0].append(busy_s)
        self._windows += 1
        alone, together = self._times[False], self._times[True]
        if len(alone) < KEPT_WINDOWS or len(together) < KEPT_WINDOWS:
            self.shares = len(together) < len(alone)
            return
        self.shares = statistics.median(together) < statistics.median(alone)
        if self._windows % TRIAL_WINDOWS == 0:
            self.shares = not self.shares


class _Turn:
    """One step of all floors. Each thread that is free takes the next one of `shared`."""

    def __init__(self, floors: Sequence[Floor], shared: Sequence[int]) -> None:
        self._floors, self._shared = floors, shared
        self._results: list[StepResult | Exception | None] = [None] * len(floors)
        # `next` is atomic, also of `count`.
        self._next, self._finished = iter(shared), count(1)
        self._all_done = threading.Lock()
        self._all_done.acquire()

    def work(self) -> None:
        """Step shared floors that nobody has taken, until there is none."""
        for at in self._next:
            self._step(at)
            if next(self._finished) == len(self._shared):
                self._all_done.release()

    def work_rest(self) -> None:
        """Step the floors that are not shared."""
        for at in range(len(self._floors)):
            if at not in self._shared:
                self._step(at)

    def stop(self) -> None:
        """Let nobody take another floor."""
        deque(self._next, maxlen=0)

    def wait(self) -> None:
        """Wait for the floors that others have taken. As alone, an endless step of one floor holds up all."""
        while not self._all_done.acquire(timeout=WARNING_INTERVAL_S):
            missing = [self._floors[at].name for at in sorted(self._shared) if self._results[at] is None]
            _log.warning("the step of %s takes longer than %g s", ", ".join(missing), WARNING_INTERVAL_S)

    def results(self) -> list[StepResult]:
        """The results in the order of the floors; raises the first error."""
        results = []
        for result in self._results:
            if isinstance(result, Exception):
                raise result
            assert result is not None
            results.append(result)
        return results

    def _step(self, at: int) -> None:
        try:
            self._results[at] = self._floors[at].step()
        except Exception as error:  # raised by `results`
            self._results[at] = error


class _Helper:
    """A thread that works on turns; it ends when it had none for IDLE_LIMIT_S."""

    def __init__(self) -> None:
        self._turn: _Turn | None = None
        self._wake_up = threading.Lock()
        self._wake_up.acquire()
        #: Guards the end of an idle thread.
        self._lock = threading.Lock()
        self._thread: Background | None = None
        self._closing = False

    def help(self, turn: _Turn) -> None:
        """Let the thread work on a turn; a thread that is late comes to the next one."""
        with self._lock:
            self._turn = turn
            if self._thread is None:
                self._thread = Background("floors", self._run, end_process)
                self._thread.start()
            if self._wake_up.locked():
                self._wake_up.release()

    def close(self) -> None:
        """End the thread after the floor that it steps, if any."""
        with self._lock:
            self._closing, thread = True, self._thread
            if self._wake_up.locked():
                self._wake_up.release()
        while thread and thread.is_alive():
            thread.join(WARNING_INTERVAL_S)

    def _run(self) -> None:
        cores.use_all()
        while not self._closing:
            if not self._wake_up.acquire(timeout=IDLE_LIMIT_S):
                with self._lock:
                    if not self._wake_up.acquire(blocking=False):
                        self._thread = None
                        return
            turn, self._turn = self._turn, None
            if turn:
                turn.work()
            del turn  # an idle thread keeps no floors
