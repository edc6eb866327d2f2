"""Calls whose clients have gone, from another process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocorba.corba.call_limit import CallLimit
from robocorba.corba.callers import present_caller
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.testing.processes import eventually
from tests.corba.held_planner import HeldPlanner, held_planner

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
def callers() -> list[Callable[[], bool]]:
    """Of all calls, whether each has gone."""
    return []


@pytest.fixture
def planner(callers: list[Callable[[], bool]]) -> Iterator[HeldPlanner]:
    with held_planner(lambda: callers.append(present_caller())) as planner:
        yield planner


@pytest.fixture
def orb(planner: HeldPlanner) -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb
        planner.go_on.set()


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


def test_a_client_whose_call_timed_out_has_gone(
    planner: HeldPlanner, callers: list[Callable[[], bool]], call: Any
) -> None:
    impatient, patient = call(0.2), call(60.0)
    eventually(lambda: len(callers) == 2, what="both calls")
    assert impatient.stdout.readline() == "timeout\n"  # and goes on
    eventually(lambda: sorted(has_gone() for has_gone in callers) == [False, True])
    planner.go_on.set()
    assert patient.communicate(timeout=60.0)[0] == "7\n"
    eventually(lambda: all(has_gone() for has_gone in callers))


def test_a_limited_call_is_not_executed_for_a_client_that_went_while_it_waited(
    planner: HeldPlanner, callers: list[Callable[[], bool]], call: Any
) -> None:
    limit = CallLimit(1, limit_s=60.0)
    limit.apply(planner, "_get_mapVersion")
    first = call(60.0)
    eventually(lambda: len(callers) == 1)
    assert call(0.2).stdout.readline() == "timeout\n"
    planner.go_on.set()
    assert first.communicate(timeout=60.0)[0] == "7\n"
    assert call(60.0).communicate(timeout=60.0)[0] == "7\n"
    assert len(callers) == 2
