"""Limits of concurrent calls, with a real ORB."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from omniORB import CORBA

from robocorba.corba.call_limit import CallLimit
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.testing.processes import eventually


class Planner(RoboCorba__POA.PathPlanner):
    """Its map version is known when the test says so."""

    def __init__(self) -> None:
        self.called, self.go_on = threading.Semaphore(0), threading.Event()

    def _get_mapVersion(self) -> int:
        self.called.release()
        assert self.go_on.wait(10.0)
        return 7


@pytest.fixture
def planner() -> Iterator[Planner]:
    planner = Planner()
    yield planner
    planner.go_on.set()


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(8) as pool:
        yield pool


def reference_of(planner: Planner, orb: Orb) -> RoboCorba.PathPlanner:
    return orb.activate(planner)._narrow(RoboCorba.PathPlanner)


@pytest.fixture
def orb() -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb


def refused(call: Future[int]) -> bool:
    return isinstance(call.exception(10.0), CORBA.TRANSIENT)


def test_calls_beyond_the_limit_wait_and_further_ones_are_refused(
    planner: Planner, pool: ThreadPoolExecutor, orb: Orb
) -> None:
    CallLimit(at_once=2, waiting=1).apply(planner, "_get_mapVersion")
    reference = reference_of(planner, orb)
    calls = [pool.submit(reference._get_mapVersion) for _ in range(4)]
    eventually(lambda: sum(call.done() for call in calls) == 1, what="the refusal")
    assert [refused(call) for call in calls if call.done()] == [True]
    assert planner.called.acquire(timeout=10.0) and planner.called.acquire(timeout=10.0)
    assert not planner.called.acquire(blocking=False)  # the third one waits
    planner.go_on.set()
    assert sorted(call.result(10.0) for call in calls if not call.exception(10.0)) == [7, 7, 7]
    assert reference._get_mapVersion() == 7


def test_a_call_does_not_wait_for_good(planner: Planner, pool: ThreadPoolExecutor, orb: Orb) -> None:
    CallLimit(at_once=1, limit_s=0.01).apply(planner, "_get_mapVersion")
    reference = reference_of(planner, orb)
    first = pool.submit(reference._get_mapVersion)
    assert planner.called.acquire(timeout=10.0)
    assert refused(pool.submit(reference._get_mapVersion))
    planner.go_on.set()
    assert first.result(10.0) == 7
    assert reference._get_mapVersion() == 7


def test_a_call_that_fails_leaves_its_place() -> None:
    def fail() -> None:
        raise CORBA.NO_IMPLEMENT

    call = CallLimit(at_once=1, waiting=0).limited(fail)
    for _ in range(3):
        with pytest.raises(CORBA.NO_IMPLEMENT):
            call()
