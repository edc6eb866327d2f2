"""Assignment of robots to virtual sensor servers."""

from __future__ import annotations

from collections import Counter

import pytest

from robocorba.simulation.load_balance import SENSOR_LEASE_S, Load, LoadBalance
from tests.clock import Clock


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def balance(clock: Clock) -> LoadBalance:
    return LoadBalance(clock)


def busy(share: float) -> Load:
    return Load(share, 0.01, 10.0, 0)


def handed(balance: LoadBalance, *robots: str) -> list[str]:
    return [server.name if (server := balance.assign(robot)) else "" for robot in robots]


def test_robots_are_assigned_to_the_least_busy_server(balance: LoadBalance) -> None:
    assert handed(balance, "early") == [""]
    for name in ("S1", "S2"):
        balance.report(name, f"reference {name}", busy(0.0))
    assert Counter(handed(balance, *(f"R{number}" for number in range(20)))) == {"S1": 10, "S2": 10}
    balance.report("S1", "", busy(0.18))
    balance.report("S2", "", busy(0.05))  # as many robots, but they ask less
    assert set(handed(balance, *(f"Q{number}" for number in range(5)))) == {"S2"}


def test_a_robot_keeps_its_server(balance: LoadBalance) -> None:
    balance.report("S1", "", busy(0.1))
    assert handed(balance, "A") == ["S1"]
    balance.report("S2", "", busy(0.0))
    assert handed(balance, "A") == ["S1"]
    assert balance.name_for("A") == "S1"
    balance.release("A")
    assert balance.name_for("A") == ""
    assert handed(balance, "A") == ["S2"]


@pytest.mark.parametrize("is_told", [True, False])
def test_robots_of_a_dead_server_are_reassigned(balance: LoadBalance, clock: Clock, is_told: bool) -> None:
    for name in ("S1", "S2", "S3"):
        balance.report(name, "", busy(0.1))
    robots = [f"R{number}" for number in range(30)]
    before = dict(zip(robots, handed(balance, *robots), strict=True))
    if is_told:
        balance.remove("S2")
    else:
        for _ in range(2):
            clock.now += 0.6 * SENSOR_LEASE_S
            for name in ("S1", "S3"):
                balance.report(name, "", busy(0.1))
    after = dict(zip(robots, handed(balance, *robots), strict=True))
    assert set(after.values()) == {"S1", "S3"}
    assert all(after[robot] == name for robot, name in before.items() if name != "S2")
    assert abs(Counter(after.values())["S1"] - 15) <= 1
    assert [server.name for server in balance.servers] == ["S1", "S3"]


def test_robots_move_to_a_less_busy_server(balance: LoadBalance) -> None:
    balance.report("S1", "one", busy(0.8))
    robots = [f"R{number}" for number in range(10)]
    handed(balance, *robots)
    balance.report("S1", "one", busy(0.8))
    moving = balance.report("S2", "two", busy(0.0))
    assert len(moving) == 5
    assert {reference for _, reference in moving} == {"one"}
    assert Counter(handed(balance, *robots)) == {"S1": 5, "S2": 5}
    assert balance.report("S1", "one", busy(0.4)) == []
    assert balance.report("S2", "two", busy(0.4)) == []


def test_the_only_robot_of_a_busy_server_is_not_moved(balance: LoadBalance) -> None:
    balance.report("S1", "one", busy(0.0))
    handed(balance, "A")
    balance.report("S1", "one", busy(0.9))
    assert balance.report("S2", "two", busy(0.0)) == []
