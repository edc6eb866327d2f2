"""Orders to many robots: how many at a time, and what comes of each."""

from __future__ import annotations

import threading
from typing import Any

from robocorba.corba.remote import control_agent
from robocorba.corba.remote.control_agent import CALM, OrderLimits, RemoteAgent, order_all
from robocorba.errors.services import NotReachable

NAMES = [f"R{number}" for number in range(200)]


class Crowd:
    """Robots behind a naming service that finds none while more than `room` are looked for at a time."""

    def __init__(self, room: int) -> None:
        self._room, self._lock = room, threading.Lock()
        self._looking = 0
        self.stopped = set(NAMES)
        self.asked: list[str] = []

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> str:
        with self._lock:
            self._looking += 1
            self.asked.append(name)
        is_crowded = threading.Event().wait(0.002) or self._looking > self._room
        with self._lock:
            self._looking -= 1
        if is_crowded:
            raise NotReachable(f"{name} is not reachable")
        return name

    def reference(self, uri: str, interface: Any, timeout_s: float) -> str:
        return uri

    def uri(self, reference: str) -> str:
        return reference


def restart(crowd: Crowd) -> Any:
    return lambda agent: crowd.stopped.discard(agent.name)


def test_a_restart_of_a_crowd_leaves_nobody_stopped() -> None:
    """`stop --all --reset` left 13 of 200 stopped: all were called at once, within a second each."""
    crowd = Crowd(CALM.at_once)
    assert list(order_all(crowd, NAMES, restart(crowd), CALM)) == [(name, "") for name in NAMES]  # type: ignore[arg-type]
    assert crowd.stopped == set()


def test_robots_that_hang_cost_the_others_nothing_but_their_place() -> None:
    crowd, end = Crowd(len(NAMES)), threading.Event()

    def order(agent: RemoteAgent) -> None:
        if agent.name in ("R0", "R7"):
            end.wait(60.0)
        crowd.stopped.discard(agent.name)

    found = dict(order_all(crowd, NAMES, order, OrderLimits(4, 1.0, 3.0)))  # type: ignore[arg-type]
    end.set()
    assert {name for name, problem in found.items() if problem} == {"R0", "R7"}
    assert found["R0"] == "did not answer within 3 s"


def test_after_the_limit_nobody_else_is_called() -> None:
    crowd, end = Crowd(len(NAMES)), threading.Event()
    found = dict(order_all(crowd, NAMES, lambda agent: end.wait(60.0) and None, OrderLimits(2, 1.0, 0.1)))  # type: ignore[arg-type,func-returns-value]
    end.set()
    assert all(found.values())
    assert len(crowd.asked) == 2


def test_the_reason_of_each_is_given() -> None:
    def refuse(agent: RemoteAgent) -> None:
        raise NotReachable(f"robot {agent.name} is away")

    crowd = Crowd(2)
    assert list(order_all(crowd, ["R1"], refuse)) == [("R1", "robot R1 is away")]  # type: ignore[arg-type]
    assert list(order_all(crowd, [], refuse)) == []  # type: ignore[arg-type]
    assert control_agent.URGENT.at_once > len(NAMES)
