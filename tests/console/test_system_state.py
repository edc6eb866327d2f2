"""What the console takes from a robot's report."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from robocorba.corba.remote.system_state import agent_is_driving, path_by_floor


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
