"""Limits of concurrent calls, with a real ORB."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from omniORB import CORBA

from robocorba.corba.call_limit import CallLimit
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from tests.corba.held_planner import HeldPlanner, held_planner
from tests.waits import work_for


@pytest.fixture
def planner() -> Iterator[HeldPlanner]:
    with held_planner() as planner:
        yield planner


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(8) as pool:
        yield pool


def reference_of(planner: HeldPlanner, orb: Orb) -> RoboCorba.PathPlanner:
    return orb.activate(planner)._narrow(RoboCorba.PathPlanner)


@pytest.fixture
def orb() -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb


def refused(call: Future[int]) -> bool:
    return isinstance(call.exception(60.0), CORBA.TRANSIENT)


def test_calls_beyond_the_limit_wait_and_further_ones_are_refused(
    planner: HeldPlanner, pool: ThreadPoolExecutor, orb: Orb
) -> None:
    CallLimit(at_once=2, waiting=1).apply(planner, "_get_mapVersion")
    reference = reference_of(planner, orb)
    calls = [pool.submit(reference._get_mapVersion) for _ in range(4)]
    eventually(lambda: sum(call.done() for call in calls) == 1, what="the refusal")
    assert [refused(call) for call in calls if call.done()] == [True]
    assert planner.called.acquire(timeout=60.0) and planner.called.acquire(timeout=60.0)
    assert not planner.called.acquire(blocking=False)  # the third one waits
    planner.go_on.set()
    assert sorted(call.result(60.0) for call in calls if not call.exception(60.0)) == [7, 7, 7]
    assert reference._get_mapVersion() == 7


def test_a_call_does_not_wait_for_good(planner: HeldPlanner, pool: ThreadPoolExecutor, orb: Orb) -> None:
    CallLimit(at_once=1, limit_s=0.01).apply(planner, "_get_mapVersion")
    reference = reference_of(planner, orb)
    first = pool.submit(reference._get_mapVersion)
    assert planner.called.acquire(timeout=60.0)
    assert refused(pool.submit(reference._get_mapVersion))
    planner.go_on.set()
    assert first.result(60.0) == 7
    assert reference._get_mapVersion() == 7


def test_a_call_that_fails_leaves_its_place() -> None:
    def fail() -> None:
        raise CORBA.NO_IMPLEMENT

    call = CallLimit(at_once=1, waiting=0).limited(fail)
    for _ in range(3):
        with pytest.raises(CORBA.NO_IMPLEMENT):
            call()


@pytest.mark.parametrize("limit_s", [10.0, 0.0005])
def test_no_place_is_lost_and_none_is_taken_twice(limit_s: float) -> None:
    """Beside many callers, also those whose time ends while they get their place."""
    running: list[None] = []
    most = [0]

    def work() -> None:
        running.append(None)
        most[0] = max(most[0], len(running))
        work_for(0.0002)
        running.pop()

    call = CallLimit(at_once=3, limit_s=limit_s).limited(work)

    def repeat(times: int) -> int:
        done = 0
        for _ in range(times):
            with contextlib.suppress(CORBA.TRANSIENT):
                call()
                done += 1
        return done

    with ThreadPoolExecutor(24) as pool:
        done = sum(pool.map(repeat, [50] * 24))
    assert most[0] <= 3
    assert 50 <= done <= 24 * 50
    assert limit_s < 1.0 or done == 24 * 50
    for _ in range(10):
        call()  # all places are free again


def test_who_has_waited_longest_goes_first() -> None:
    order: list[int] = []
    go_on, call_first = threading.Event(), threading.Event()

    def work(number: int) -> None:
        order.append(number)
        call_first.set()
        go_on.wait(60.0)

    limit = CallLimit(at_once=1)
    call = limit.limited(work)
    with ThreadPoolExecutor(8) as pool:
        for number in range(6):
            pool.submit(call, number)
            assert call_first.wait(60.0)
            eventually(lambda waiting=number: len(limit._places._waiting) == waiting)
        go_on.set()
    assert order == list(range(6))
