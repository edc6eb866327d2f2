"""What the console takes from a robot's report, and what it does with robots that fail or leave."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest

from robocorba.console import system_state
from robocorba.console.defects import DEFECT
from robocorba.console.system_state import SystemState
from robocorba.corba.remote.system_state import agent_is_driving, path_by_floor
from robocorba.errors.services import NotReachable
from robocorba.names import ROBOTS
from robocorba.testing.processes import eventually


class Point(NamedTuple):
    floor: str
    x: float
    y: float


def test_a_path_is_split_at_each_change_of_floor() -> None:
    points = [Point("L1", 1.004, 2.0), Point("L1", 3.0, 2.0), Point("L2", 3.0, 2.0), Point("L1", 9.0, 9.0)]
    assert path_by_floor(points) == [
        {"floor": "L1", "points": [[1.0, 2.0], [3.0, 2.0]]},
        {"floor": "L2", "points": [[3.0, 2.0]]},
        {"floor": "L1", "points": [[9.0, 9.0]]},
    ]
    assert path_by_floor([]) == []


@pytest.mark.parametrize(
    ("condition", "speed", "is_driving"),
    [("IDLE", 0.0, False), ("IDLE", 0.2, True), ("RUNNING", 0.0, True), ("PAUSED", 0.0, True), ("STOPPED", 0.0, False)],
)
def test_paths_are_asked_of_robots_that_may_drive_only(condition: str, speed: float, is_driving: bool) -> None:
    state: dict[str, Any] = {"condition": condition, "actor": {"moving": {"ahead": speed, "left": 0.0, "turn": 0.0}}}
    assert agent_is_driving(state) == is_driving


class FakeOrb:
    """A naming service with robots."""

    def __init__(self) -> None:
        self.robots: list[str] = []

    def names(self, path: str) -> list[str]:
        return list(self.robots) if path == ROBOTS else []


@contextlib.contextmanager
def running(monkeypatch: pytest.MonkeyPatch, answer: Callable[[str], Any]) -> Iterator[tuple[FakeOrb, SystemState]]:
    """The state of a system whose robots answer so while they run."""
    orb: Any = FakeOrb()

    def ask(name: str) -> Any:
        if name not in orb.robots:
            raise NotReachable(name)
        return answer(name)

    monkeypatch.setattr(system_state, "INTERVAL_S", 0.01)
    monkeypatch.setattr(system_state, "server_state", lambda _: dict)
    monkeypatch.setattr(system_state, "robot_state", lambda _, name: lambda: ask(name))
    with contextlib.closing(SystemState(orb)) as state:
        state.start()
        yield orb, state


def test_a_defect_in_a_request_is_said_and_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(name: str) -> None:
        raise KeyError("a defect")

    with running(monkeypatch, fail) as (orb, state):
        orb.robots = ["R1"]
        row = eventually(lambda: (row := state.rows()["robots"].get("R1")) and row["problem"] and row)
    assert (row["state"], row["age"], row["problem"]) == (None, None, DEFECT)
    assert "a defect" in caplog.text


def test_robots_that_left_are_forgotten_beyond_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system_state, "MAX_GONE", 2)
    with running(monkeypatch, lambda name: {"name": name}) as (orb, state):

        def row(name: str) -> Any:
            return state.rows()["robots"].get(name, {"state": None, "problem": "", "bound": True})

        for name in ("R0", "R1", "R2", "R3"):
            orb.robots = ["R", name]
            eventually(lambda name=name: row(name)["state"])  # type: ignore[misc]
            orb.robots = ["R"]
            eventually(lambda name=name: row(name)["problem"] and not row(name)["bound"])  # type: ignore[misc]
        assert list(state.rows()["robots"]) == ["R", "R2", "R3"]
