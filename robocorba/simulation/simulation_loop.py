"""The thread in which simulated time passes. Between two steps it does what others ask for, one after another."""

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

T = TypeVar("T")

#: How long a call waits for its turn, s.
CALL_LIMIT_S = 5.0
MOST_PACE, MOST_STEPS = 1000.0, 10_000
#: A step takes at most so long, s; far less as a rule.
LONGEST_STEP_S = 0.05
#: Simulated time that can't be caught up with is lost, beyond so much of real time, s.
MOST_LAG_S = 0.25
#: What is done in between is done so often at least, s.
IDLE_INTERVAL_S = 0.02
#: Steps in a row before calls have their turn again.
MOST_CONSECUTIVE_STEPS = 50
#: `achieved` is that of so many seconds.
RATE_WINDOW_S = 2.0

_log = logging.getLogger(__name__)


class SimulationLoop:
    """step: lets STEP_S of simulated time pass. between: is called after steps and calls, and at least each IDLE_INTERVAL_S.

    pace: simulated seconds in a second, 0 for as many as possible."""

    def __init__(self, step: Callable[[], None], housekeeping: Callable[[], None]) -> None:
        self._step, self._housekeeping = step, housekeeping
        self.pace, self.is_paused = 1.0, False
        #: Simulated seconds in a second, in the last seconds.
        self.achieved = 0.0
        self._calls: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        self._step_requests: list[tuple[int, Future[None]]] = []
        self._steps = self._counted = 0
        self._counted_at = 0.0
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Let time end. Calls that wait are refused."""
        self._closing = True
        if self._thread.is_alive():
            self._thread.join()
        with contextlib.suppress(Empty):
            while True:
                self._calls.get_nowait()[1].set_exception(SimulationBusy("the simulation ends"))
        for _, done in self._step_requests:
            done.set_exception(SimulationBusy("the simulation ends"))

    def do(self, call: Callable[[], T]) -> T:
        """Make a call between two steps; what it returns or raises. Raises SimulationBusy.

        It is made at once where the thread is not started, or is the one that asks."""
        if not self._thread.is_alive() or threading.current_thread() is self._thread:
            return call()
        done: Future[T] = Future()
        self._calls.put((call, done))
        try:
            return done.result(CALL_LIMIT_S)
        except FutureTimeoutError:
            if done.cancel():
                raise SimulationBusy(f"the simulation had no time within {CALL_LIMIT_S:g} s") from None
        return done.result(CALL_LIMIT_S)  # it has its turn now

    def configure(self, pace: float, is_paused: bool) -> None:
        """Raises InvalidChoice."""
        check_pace(pace)
        self.pace, self.is_paused = pace, is_paused

    def step(self, steps: int) -> None:
        """While time is paused: let so many steps pass, and wait for it. Raises InvalidChoice, SimulationBusy."""
        if not 1 <= steps <= MOST_STEPS:
            raise InvalidChoice("steps", f"{steps} is not 1 to {MOST_STEPS}")
        if not self.is_paused:
            raise InvalidChoice("steps", "time is not paused")
        done: Future[None] = Future()

        def ask() -> None:
            self._step_requests.append(
                ((self._step_requests[-1][0] if self._step_requests else self._steps) + steps, done)
            )

        self.do(ask)
        try:
            done.result(CALL_LIMIT_S + steps * LONGEST_STEP_S)
        except FutureTimeoutError:
            raise SimulationBusy(f"{steps} steps were not over in time") from None

    def _run(self) -> None:
        due = self._counted_at = time.monotonic()
        while not self._closing:
            due = self._advance(due)
            self._count()
            self._make_calls(due)
            self._guard(self._housekeeping)

    def _advance(self, due: float) -> float:
        """Let time pass as far as it should by now; when it should go on."""
        now = time.monotonic()
        if self._step_requests:
            self._run_steps_while(lambda: bool(self._step_requests))
            return now
        if self.is_paused:
            return now + IDLE_INTERVAL_S
        if self.pace == 0.0:
            self._run_steps_while(lambda: time.monotonic() < now + IDLE_INTERVAL_S and self._calls.empty())
            return now
        length = STEP_S / self.pace
        due = min(max(due, now - MOST_LAG_S), now + length)  # the pace may have been another when it was set
        for _ in range(MOST_CONSECUTIVE_STEPS):
            if due > now:
                break
            self._run_step()
            due += length
        return due

    def _run_steps_while(self, is_wanted: Callable[[], bool]) -> None:
        for _ in range(MOST_CONSECUTIVE_STEPS):
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
        if now - self._counted_at >= RATE_WINDOW_S:
            self.achieved = (self._steps - self._counted) * STEP_S / (now - self._counted_at)
            self._counted, self._counted_at = self._steps, now

    def _make_calls(self, due: float) -> None:
        """Those that wait, and those that come until the next step is due."""
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
                except Exception as wrong:  # whoever asked is told
                    done.set_exception(wrong)
            self._guard(self._housekeeping)

    @staticmethod
    def _guard(work: Callable[[], None]) -> None:
        """A fault is logged; time goes on."""
        try:
            work()
        except Exception:
            _log.exception("a step of the simulation failed")


def check_pace(pace: float) -> None:
    """Raises InvalidChoice."""
    if not 0.0 <= pace <= MOST_PACE:  # also refuses NaN
        raise InvalidChoice("pace", f"{pace} is not 0 to {MOST_PACE:g}")
