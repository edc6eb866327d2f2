"""The thread in which simulated time passes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from robocorba.errors.simulation import InvalidChoice, SimulationBusy
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.simulation_loop import MAX_LAG_S, SimulationLoop
from testkit.processes import eventually


class Counter:
    """Counts steps and runs of the housekeeping."""

    def __init__(self) -> None:
        self.steps = self.between = 0
        self.loop = SimulationLoop(self._step, self._housekeeping)

    def wait_for_cycles(self) -> None:
        """Until the loop has gone round a few times."""
        before = self.between
        eventually(lambda: self.between > before + 3, what="cycles of the loop")

    def _step(self) -> None:
        self.steps += 1

    def _housekeeping(self) -> None:
        self.between += 1


@pytest.fixture
def counter() -> Iterator[Counter]:
    counter = Counter()
    with contextlib.closing(counter.loop):
        yield counter


class Pace:
    """The pace of a loop from now on, which is never above the requested one, whatever the machine does."""

    def __init__(self, counter: Counter, requested: float) -> None:
        self._counter, self._requested, self._began = counter, requested, time.monotonic()
        self._first, self._marked, self._marked_at = counter.steps, 0, self._began

    def was_reached(self) -> bool:
        """Whether the last window of half a second or more was not slower than requested, as on a busy machine."""
        steps, now = self._counter.steps - self._first, time.monotonic()
        assert steps * STEP_S <= self._requested * (now - self._began + MAX_LAG_S) + STEP_S
        if now - self._marked_at < 0.5:
            return False
        pace = (steps - self._marked) * STEP_S / (now - self._marked_at)
        self._marked, self._marked_at = steps, now
        return pace > 0.7 * self._requested


def test_time_passes_at_the_requested_pace_and_at_once_at_a_new_one(counter: Counter) -> None:
    counter.loop.configure(0.001, False)
    counter.loop.start()
    counter.wait_for_cycles()
    for requested in (10.0, 1.0):
        counter.loop.configure(requested, False)
        eventually(lambda: counter.steps > 3, 15.0, "a step at the first pace takes 20 s")
        eventually(Pace(counter, requested).was_reached, 60.0, "the pace")


def test_calls_are_executed_at_full_pace(counter: Counter) -> None:
    counter.loop.configure(0.0, False)
    began = time.monotonic()
    counter.loop.start()
    eventually(lambda: counter.steps * STEP_S > 2.0 * (time.monotonic() - began), 60.0, "more than real time")
    before = counter.between
    assert [counter.loop.do(lambda: threading.current_thread().name) for _ in range(3)] == ["simulation"] * 3
    assert counter.between > before


def test_paused_time_can_be_stepped(counter: Counter) -> None:
    counter.loop.configure(1.0, True)
    counter.loop.start()
    with pytest.raises(InvalidChoice):
        counter.loop.step(0)
    with ThreadPoolExecutor() as threads:
        list(threads.map(counter.loop.step, (70, 30)))
    assert counter.steps == 100
    counter.wait_for_cycles()
    assert counter.steps == 100
    counter.loop.configure(1.0, False)
    with pytest.raises(InvalidChoice):
        counter.loop.step(1)


def test_errors_of_calls_and_steps_stop_nothing(counter: Counter) -> None:
    for pace in (-1.0, float("nan"), 1001.0):
        with pytest.raises(InvalidChoice):
            counter.loop.configure(pace, False)
    steps = []

    def step() -> None:
        steps.append(1)
        raise ValueError("a fault")

    loop = SimulationLoop(step, lambda: None)
    with contextlib.closing(loop):
        loop.start()
        with pytest.raises(ZeroDivisionError):
            loop.do(lambda: 1 // 0)
        eventually(lambda: len(steps) >= 3)
        assert loop.do(lambda: 7) == 7


def test_a_pending_call_ends_when_the_loop_closes(counter: Counter) -> None:
    counter.loop.start()
    began, holding = threading.Event(), threading.Event()
    with ThreadPoolExecutor() as threads:
        threads.submit(counter.loop.do, lambda: began.set() or holding.wait(60.0))
        assert began.wait(60.0)
        waiting = [threads.submit(counter.loop.do, lambda: 1) for _ in range(3)]
        closing = threads.submit(counter.loop.close)
        eventually(lambda: waiting[0].running() and closing.running(), what="the calls")
        holding.set()
        closing.result(60.0)
        for call in waiting:
            assert isinstance(call.exception(60.0), SimulationBusy | None)
