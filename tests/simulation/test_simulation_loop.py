"""The thread in which simulated time passes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import pytest

from robocorba.errors.simulation import InvalidChoice, SimulationBusy
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.simulation_loop import SimulationLoop
from robocorba.testing.processes import eventually


class Counter:
    """Counts steps and runs of the housekeeping."""

    def __init__(self) -> None:
        self.steps = self.between = 0
        self.loop = SimulationLoop(self._step, self._housekeeping)

    def _step(self) -> None:
        self.steps += 1

    def _housekeeping(self) -> None:
        self.between += 1


@pytest.fixture
def counter() -> Iterator[Counter]:
    counter = Counter()
    with contextlib.closing(counter.loop):
        yield counter


def passed(counter: Counter, seconds: float) -> float:
    """Simulated seconds per second, measured over real seconds."""
    before, began = counter.steps, time.monotonic()
    time.sleep(seconds)
    return (counter.steps - before) * STEP_S / (time.monotonic() - began)


@pytest.mark.parametrize("pace", [1.0, 10.0])
def test_time_passes_at_the_requested_pace(counter: Counter, pace: float) -> None:
    counter.loop.configure(pace, False)
    counter.loop.start()
    eventually(lambda: passed(counter, 0.6) == pytest.approx(pace, rel=0.3), 60.0, "the pace")


def test_calls_are_executed_at_full_pace(counter: Counter) -> None:
    counter.loop.configure(0.0, False)
    counter.loop.start()
    eventually(lambda: passed(counter, 0.2) > 20.0, 60.0, "full pace")
    before = counter.between
    assert [counter.loop.do(lambda: threading.current_thread().name) for _ in range(3)] == ["simulation"] * 3
    assert counter.between > before


def test_a_new_pace_applies_immediately(counter: Counter) -> None:
    counter.loop.configure(0.001, False)
    counter.loop.start()
    time.sleep(0.1)
    counter.loop.configure(10.0, False)
    eventually(lambda: passed(counter, 0.4) > 5.0, 10.0, "the new pace, before a step of the old one is due")


def test_paused_time_can_be_stepped(counter: Counter) -> None:
    counter.loop.configure(1.0, True)
    counter.loop.start()
    with pytest.raises(InvalidChoice):
        counter.loop.step(0)
    threads = [threading.Thread(target=counter.loop.step, args=(steps,)) for steps in (70, 30)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert counter.steps == 100
    time.sleep(0.1)
    assert counter.steps == 100
    counter.loop.configure(1.0, False)
    with pytest.raises(InvalidChoice):
        counter.loop.step(1)


def test_the_error_of_a_call_reaches_its_caller(counter: Counter) -> None:
    counter.loop.start()
    with pytest.raises(ZeroDivisionError):
        counter.loop.do(lambda: 1 // 0)
    assert counter.loop.do(lambda: 7) == 7


def test_a_fault_in_a_step_does_not_stop_time() -> None:
    steps = []

    def step() -> None:
        steps.append(1)
        raise ValueError("a fault")

    pace = SimulationLoop(step, lambda: None)
    with contextlib.closing(pace):
        pace.start()
        eventually(lambda: len(steps) >= 3)


def test_a_pending_call_ends_when_the_loop_closes(counter: Counter) -> None:
    counter.loop.start()
    holding, results = threading.Event(), []
    first = threading.Thread(target=lambda: counter.loop.do(lambda: holding.wait(2.0)))
    first.start()

    def second() -> None:
        try:
            results.append(counter.loop.do(lambda: 1))
        except SimulationBusy as busy:
            results.append(busy)

    waiting = threading.Thread(target=second)
    waiting.start()
    time.sleep(0.1)
    counter.loop._closing = True
    holding.set()
    counter.loop.close()
    waiting.join(60.0)
    assert len(results) == 1


@pytest.mark.parametrize("pace", [-1.0, float("nan"), 1001.0])
def test_an_invalid_pace_is_refused(counter: Counter, pace: float) -> None:
    with pytest.raises(InvalidChoice):
        counter.loop.configure(pace, False)
