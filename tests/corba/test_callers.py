"""Calls whose clients have gone, from another process."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from robocorba.corba.call_limit import CallLimit
from robocorba.corba.callers import present_caller
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba__POA
from robocorba.testing.processes import eventually

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


class Planner(RoboCorba__POA.PathPlanner):
    """Its map version is known when the test says so."""

    def __init__(self) -> None:
        self.callers: list[Callable[[], bool]] = []
        self.calls, self.go_on = 0, threading.Event()

    def _get_mapVersion(self) -> int:
        self.calls += 1
        self.callers.append(present_caller())
        assert self.go_on.wait(60.0)
        return 7


@pytest.fixture
def planner() -> Iterator[Planner]:
    planner = Planner()
    yield planner
    planner.go_on.set()


@pytest.fixture
def orb(planner: Planner) -> Iterator[Orb]:
    with Orb(Address("127.0.0.1", 9)) as orb:
        yield orb
        planner.go_on.set()


@pytest.fixture
def call(orb: Orb, planner: Planner) -> Iterator[Any]:
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


def test_a_client_whose_call_timed_out_has_gone(planner: Planner, call: Any) -> None:
    impatient, patient = call(0.2), call(60.0)
    eventually(lambda: len(planner.callers) == 2, what="both calls")
    assert impatient.stdout.readline() == "timeout\n"  # and goes on
    eventually(lambda: sorted(has_gone() for has_gone in planner.callers) == [False, True])
    planner.go_on.set()
    assert patient.communicate(timeout=60.0)[0] == "7\n"
    eventually(lambda: all(has_gone() for has_gone in planner.callers))


def test_a_limited_call_is_not_executed_for_a_client_that_went_while_it_waited(planner: Planner, call: Any) -> None:
    limit = CallLimit(1, limit_s=60.0)
    limit.apply(planner, "_get_mapVersion")
    first = call(60.0)
    eventually(lambda: planner.calls == 1)
    assert call(0.2).stdout.readline() == "timeout\n"
    planner.go_on.set()
    assert first.communicate(timeout=60.0)[0] == "7\n"
    assert call(60.0).communicate(timeout=60.0)[0] == "7\n"
    assert planner.calls == 2
