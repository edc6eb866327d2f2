"""Calls: how many at the same time, whose clients have gone, and which wait for which."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, cast

import pytest
from omniORB import CORBA

from robocorba.corba.call_limit import CallLimit
from robocorba.corba.callers import present_caller
from robocorba.corba.orb import Orb
from robocorba.corba.servants.mission_control import MissionControlServant
from robocorba.corba.servants.omni_database import OmniDatabaseServant
from robocorba.corba.servants.simulation_server import SimulationServerServant
from robocorba.errors.paths import UnknownFloor
from robocorba.servers.simulation import FOLLOWING, limit_calls
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.testing.processes import eventually
from tests.waits import work_for


class HeldPlanner(RoboCorba__POA.PathPlanner):
    """A path planning agent whose map version is known once `go_on` is set.

    called: has a permit for each call. callers: of all calls, whether each has gone."""

    def __init__(self) -> None:
        self.called, self.go_on = threading.Semaphore(0), threading.Event()
        self.callers: list[Callable[[], bool]] = []

    def _get_mapVersion(self) -> int:
        self.callers.append(present_caller())
        self.called.release()
        assert self.go_on.wait(60.0)
        return 7


@pytest.fixture
def planner() -> Iterator[HeldPlanner]:
    """One whose calls end with the test at the latest."""
    planner = HeldPlanner()
    yield planner
    planner.go_on.set()


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(8) as pool:
        yield pool


def reference_of(planner: HeldPlanner, orb: Orb) -> RoboCorba.PathPlanner:
    return orb.activate(planner)._narrow(RoboCorba.PathPlanner)


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
    assert (first.result(60.0), reference._get_mapVersion()) == (7, 7)


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


#: Calls an object once, and prints the result.
CLIENT = """
import sys
from omniORB import CORBA
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
with Orb(Address("127.0.0.1", 9), call_timeout_s=float(sys.argv[2])) as orb:
    try:
        print(orb.reference(sys.argv[1], RoboCorba.PathPlanner)._get_mapVersion())
    except CORBA.TIMEOUT:
        print("timeout", flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def call(orb: Orb, planner: HeldPlanner) -> Iterator[Any]:
    """Starts a client with a call timeout."""
    started: list[subprocess.Popen[str]] = []
    uri = orb.uri(orb.activate(planner))

    def start(timeout_s: float) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", CLIENT, uri, str(timeout_s)]
        started.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_a_client_whose_call_timed_out_has_gone(planner: HeldPlanner, call: Any) -> None:
    impatient, patient = call(0.2), call(60.0)
    eventually(lambda: len(planner.callers) == 2, what="both calls")
    assert impatient.stdout.readline() == "timeout\n"  # and goes on
    eventually(lambda: sorted(has_gone() for has_gone in planner.callers) == [False, True])
    planner.go_on.set()
    assert patient.communicate(timeout=60.0)[0] == "7\n"
    eventually(lambda: all(has_gone() for has_gone in planner.callers))


def test_a_limited_call_is_not_executed_for_a_client_that_went_while_it_waited(planner: HeldPlanner, call: Any) -> None:
    CallLimit(1, limit_s=60.0).apply(planner, "_get_mapVersion")
    first = call(60.0)
    eventually(lambda: len(planner.callers) == 1)
    assert call(0.2).stdout.readline() == "timeout\n"
    planner.go_on.set()
    assert first.communicate(timeout=60.0)[0] == "7\n"
    assert call(60.0).communicate(timeout=60.0)[0] == "7\n"
    assert len(planner.callers) == 2


class Database:
    """Its floors are known, and what changed on them once `go_on` is set."""

    def __init__(self) -> None:
        self.called, self.go_on = threading.Semaphore(0), threading.Event()
        self.floors = ["L1"]

    def changes(self, name: str, since: int) -> None:
        self.called.release()
        assert self.go_on.wait(60.0)
        raise UnknownFloor("name", name, self.floors)


def test_readers_do_not_wait_for_robots_that_follow_a_floor() -> None:
    database, nobody = Database(), cast(Any, None)
    servant = OmniDatabaseServant(cast(Any, database), nobody, nobody)
    server = SimulationServerServant(nobody, nobody, nobody, nobody, nobody)
    limit_calls(server, servant, MissionControlServant(nobody))
    with ThreadPoolExecutor(FOLLOWING + 1) as robots:
        calls = ("floorChanges", "typedFloorChanges")
        following = [robots.submit(getattr(servant, calls[i % 2]), "L9", 0) for i in range(FOLLOWING)]
        for _ in range(FOLLOWING):
            assert database.called.acquire(timeout=60.0)
        assert robots.submit(servant.floors).result(60.0) == ["L1"]
        database.go_on.set()
    for call in following:
        with pytest.raises(RoboCorba.UnknownFloor):
            call.result(60.0)
