"""The simulation thread: it advances simulated time, and executes calls of other threads between steps."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from robocorba.errors.simulation import InvalidChoice, SimulationBusy
from robocorba.simulation.physics import STEP_S
from robocorba.system.background import Background, end_process

T = TypeVar("T")

#: Timeout of a call that waits for execution [s].
CALL_LIMIT_S = 5.0
#: Maximum pace, in simulated seconds per second.
MAX_PACE = 1000.0
#: Maximum number of steps in one request.
MAX_STEPS = 10_000
#: Maximum lag behind real time that the loop catches up on [s]; it skips what exceeds it.
MAX_LAG_S = 0.25
#: Maximum interval between two runs of the housekeeping [s].
IDLE_INTERVAL_S = 0.02
#: Maximum number of steps before pending calls are executed.
MAX_CONSECUTIVE_STEPS = 50

_log = logging.getLogger(__name__)


class SimulationLoop:
    """The simulation thread.

    step: advances simulated time by STEP_S. housekeeping: called after steps and calls, at least every
    IDLE_INTERVAL_S. pace: simulated seconds per second, 0 for as fast as possible."""

    def __init__(self, step: Callable[[], None], housekeeping: Callable[[], None]) -> None:
        self._step, self._housekeeping = step, housekeeping
        self.pace, self.is_paused = 1.0, False
        #: Achieved pace over the last 2 s.
        self.achieved = 0.0
        self._calls: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        #: Requests of paused time: the number of the last step, and the result.
        self._step_requests: list[tuple[int, Future[None]]] = []
        self._steps = self._counted = 0
        self._counted_at = 0.0
        self._closing = False
        self._thread = Background("simulation", self._run, end_process)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Stop the thread; pending calls fail with SimulationBusy."""
        self._closing = True
        self._thread.wait_for_end()
        with contextlib.suppress(Empty):
            while True:
                self._calls.get_nowait()[1].set_exception(SimulationBusy("the simulation is shutting down"))
        for _, done in self._step_requests:
            done.set_exception(SimulationBusy("the simulation is shutting down"))

    def do(self, call: Callable[[], T]) -> T:
        """Execute a call between two steps and return its result; raises what it raises, and SimulationBusy.

        Without a running thread, or within it, the call is executed immediately."""
        if not self._thread.is_alive() or threading.current_thread() is self._thread:
            return call()
        done: Future[T] = Future()
        self._calls.put((call, done))
        try:
            return done.result(CALL_LIMIT_S)
        except FutureTimeoutError:
            if done.cancel():
                raise SimulationBusy(
                    f"the simulation did not execute the call within {CALL_LIMIT_S:g} s; try again"
                ) from None
        return done.result(CALL_LIMIT_S)  # it is executing now

    def configure(self, pace: float, is_paused: bool) -> None:
        """Set pace and pause. Raises InvalidChoice."""
        check_pace(pace)
        self.pace, self.is_paused = pace, is_paused

    def step(self, steps: int) -> None:
        """While time is paused: execute `steps` steps and wait for them. Raises InvalidChoice, SimulationBusy."""
        if not 1 <= steps <= MAX_STEPS:
            raise InvalidChoice("steps", f"{steps} is not 1 to {MAX_STEPS}")
        if not self.is_paused:
            raise InvalidChoice("steps", "time is not paused; pause it first")
        done: Future[None] = Future()

        def request() -> None:
            self._step_requests.append(
                ((self._step_requests[-1][0] if self._step_requests else self._steps) + steps, done)
            )

        self.do(request)
        limit_s = CALL_LIMIT_S + steps * 0.05  # a step usually takes far less
        try:
            done.result(limit_s)
        except FutureTimeoutError:
            raise SimulationBusy(f"{steps} steps took longer than {limit_s:g} s") from None

    def _run(self) -> None:
        due = self._counted_at = time.monotonic()
        while not self._closing:
            due = self._advance(due)
            self._count()
            self._make_calls(due)
            self._guard(self._housekeeping)

    def _advance(self, due: float) -> float:
        """Execute the steps that are due; return the time at which the next one is due."""
        now = time.monotonic()
        if self._step_requests:
            self._run_steps_while(lambda: bool(self._step_requests))
            return now
        if self.is_paused:
            return now + IDLE_INTERVAL_S
        if self.pace == 0.0:
            self._run_steps_while(lambda: time.monotonic() < now + IDLE_INTERVAL_S and self._calls.empty())
            return now
        interval_s = STEP_S / self.pace
        due = min(max(due, now - MAX_LAG_S), now + interval_s)  # the pace may have changed meanwhile
        for _ in range(MAX_CONSECUTIVE_STEPS):
            if due > now:
                break
            self._run_step()
            due += interval_s
        return due

    def _run_steps_while(self, is_wanted: Callable[[], bool]) -> None:
        for _ in range(MAX_CONSECUTIVE_STEPS):
            if not is_wanted():
                break
            self._run_step()

    def _run_step(self) -> None:
        self._guard(self._step)
        self._steps += 1
        while self._step_requests and self._step_requests[0][0] <= self._steps:
            self._step_requests.pop(0)[1].set_result(None)

    def _count(self) -> None:
        now = time.monotonic()
        if now - self._counted_at >= 2.0:  # window of the measurement [s]
            self.achieved = (self._steps - self._counted) * STEP_S / (now - self._counted_at)
            self._counted, self._counted_at = self._steps, now

    def _make_calls(self, due: float) -> None:
        """Execute pending calls, and those that arrive until the next step is due."""
        until = min(due, time.monotonic() + IDLE_INTERVAL_S)
        while not self._closing:
            left = until - time.monotonic()
            try:
                call, done = self._calls.get(timeout=left) if left > 0 else self._calls.get_nowait()
            except Empty:
                return
            if done.set_running_or_notify_cancel():
                try:
                    done.set_result(call())
                except Exception as error:  # reported to the caller
                    done.set_exception(error)
            self._guard(self._housekeeping)

    @staticmethod
    def _guard(work: Callable[[], None]) -> None:
        """Log a fault and continue."""
        try:
            work()
        except Exception:  # a defect must not end simulated time for all robots
            _log.exception("a step of the simulation failed")


def check_pace(pace: float) -> None:
    """Check a pace. Raises InvalidChoice."""
    if not 0.0 <= pace <= MAX_PACE:  # also refuses NaN
        raise InvalidChoice("pace", f"{pace} is not 0 to {MAX_PACE:g} simulated seconds per second")
