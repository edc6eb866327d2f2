"""Queries take turns: bounded in number, the short ones first, each within its time limit."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest

from robocorba.errors.paths import PlannerBusy, PlanningTimeout
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_graph import TangentGraph
from robocorba.planning.turns import ALONE, SLICE_S, Turn, Turns
from testkit.processes import eventually
from tests.planning.scenes import random_room
from tests.waits import work_for

#: Time limit of what must not wait for long [s].
LIMIT_S = 120.0


def later(limit_s: float = LIMIT_S) -> float:
    return time.monotonic() + limit_s


def compute_until(turn: Turn, has_ended: Callable[[], bool]) -> None:
    """As a long search does, which pauses after each slice."""
    while not has_ended():
        turn.began -= SLICE_S  # as if a slice had passed
        turn.pause("L1")


def has_room(turns: Turns, places: int = 1) -> bool:
    """Whether so many places are free."""
    with ExitStack() as taken:
        return bool([taken.enter_context(turns.take(later(0.0), "L1")) for _ in range(places)])


def test_a_short_query_goes_on_beside_a_long_one() -> None:
    turns, has_begun, short_has_ended = Turns(1), threading.Event(), threading.Event()

    def long() -> None:
        with turns.take(later(), "L1") as turn:
            has_begun.set()
            compute_until(turn, short_has_ended.is_set)

    def short() -> None:
        with turns.take(later(), "L1"):
            short_has_ended.set()

    with ThreadPoolExecutor(2) as pool:
        running = pool.submit(long)
        assert has_begun.wait(LIMIT_S)
        pool.submit(short).result(LIMIT_S)
        running.result(LIMIT_S)


def test_queries_that_are_expected_to_be_short_go_first() -> None:
    turns, order = Turns(1), []

    def query(expected_s: float) -> None:
        with turns.take(later(), "L1", expected_s):
            order.append(expected_s)

    with ThreadPoolExecutor(8) as pool:
        with turns.take(later(), "L1"):
            expected = [0.6, 0.001, 0.03, 0.001, 0.6]
            waiting = [pool.submit(query, each) for each in expected]
            eventually(lambda: len(turns._waiting) == len(expected), what="all queries wait")
        for each in waiting:
            each.result(LIMIT_S)
    assert order == sorted(expected)


def test_no_more_compute_at_once_than_permitted_and_all_get_on() -> None:
    turns, computing, most = Turns(2), [], []

    def query(slices: int) -> None:
        with turns.take(later(), "L1") as turn:
            for _ in range(slices):
                computing.append(slices)
                most.append(len(computing))
                work_for(0.0005)
                computing.pop()
                turn.began -= SLICE_S
                turn.pause("L1")

    with ThreadPoolExecutor(16) as pool:
        for done in [pool.submit(query, 1 + number % 7) for number in range(64)]:
            done.result(LIMIT_S)
    assert max(most) == 2
    assert has_room(turns, 2)


def test_a_query_that_waits_in_vain_or_fails_takes_no_place() -> None:
    turns = Turns(1)
    with turns.take(later(), "L1") as turn:
        with pytest.raises(PlanningTimeout, match="floor L2"), turns.take(later(0.02), "L2"):
            pytest.fail("there was a place")
        turn.began -= SLICE_S
        turn.pause("L1")  # nobody waits any more
    with pytest.raises(ZeroDivisionError), turns.take(later(), "L1"):  # nor one that fails
        _ = 1 // 0
    assert has_room(turns)


def test_a_long_query_that_is_not_continued_in_time_takes_no_place() -> None:
    turns, has_begun, is_over = Turns(1), threading.Event(), threading.Event()

    def short() -> None:
        with turns.take(later(), "L1"):
            assert is_over.wait(LIMIT_S)

    def long() -> None:
        with turns.take(later(0.3), "L1") as turn:
            has_begun.set()
            compute_until(turn, lambda: False)

    with ThreadPoolExecutor(2) as pool:
        running = pool.submit(long)
        assert has_begun.wait(LIMIT_S)
        waiting = pool.submit(short)
        assert isinstance(running.exception(LIMIT_S), PlanningTimeout)
        is_over.set()
        waiting.result(LIMIT_S)
    assert has_room(turns)


def test_queries_beyond_a_number_do_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robocorba.planning.turns.MAX_WAITING", 0)
    turns = Turns(1)
    with turns.take(later(), "L1"), pytest.raises(PlannerBusy, match="0 queries wait"), turns.take(later(), "L1"):
        pytest.fail("there was a place")


def test_a_search_pauses_and_a_turn_ends_at_its_deadline() -> None:
    ALONE.pause("L1")
    with pytest.raises(PlanningTimeout):
        Turn(later(-0.01)).pause("L1")
    paused = []

    class Noted(Turn):
        def pause(self, floor: str) -> None:
            paused.append(floor)

    graph = TangentGraph(FloorSpace(random_room(1, 8), "L1"), 0.4)
    graph.legs((1.0, 1.0), [(11.0, 8.0)], turn=Noted())
    assert paused and set(paused) == {"L1"}
