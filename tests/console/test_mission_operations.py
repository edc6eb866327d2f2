"""Who can lead a mission, by what the robots last reported."""

from __future__ import annotations

from typing import Any

import pytest

from robocorba.console.mission_operations import MissionOperations
from robocorba.errors.services import NotReachable

NOBODY: Any = None
IDLE = {"condition": "IDLE", "reason": "", "mission": "", "channel": "a"}


def leaders(robots: dict[str, Any], naming: str = "") -> list[dict[str, Any]]:
    return MissionOperations(NOBODY, lambda: {"naming": naming, "robots": robots}).leaders()


def row(**state: str) -> dict[str, Any]:
    return {"state": {**IDLE, **state}, "age": 0.1, "problem": "", "bound": True}


def test_an_idle_robot_is_free() -> None:
    assert leaders({"R1": row()}) == [{"robot": "R1", "channel": "a", "free": True, "why": ""}]


@pytest.mark.parametrize(
    ("state", "why"),
    [
        ({"condition": "STOPPED", "reason": "emergency stop"}, "is stopped: emergency stop"),
        ({"mission": "M1"}, "is in mission M1"),
        ({"condition": "RUNNING"}, "runs a program"),
        ({"condition": "PAUSED"}, "runs a program"),
        ({"channel": ""}, "has no event channel"),
    ],
)
def test_why_a_robot_is_not_free(state: dict[str, str], why: str) -> None:
    [found] = leaders({"R1": row(**state)})
    assert (found["free"], found["why"]) == (False, why)


def test_robots_that_do_not_answer_are_not_free() -> None:
    silent = [{**row(), "problem": "hangs"}, {**row(), "state": None}]
    assert [found["why"] for each in silent for found in leaders({"R1": each})] == ["does not answer"] * 2


def test_a_robot_of_an_earlier_release_has_no_channel() -> None:
    old = {**row(), "state": {"condition": "IDLE", "reason": ""}}
    assert leaders({"R1": old})[0]["why"] == "has no event channel"


def test_robots_that_have_left_are_no_leaders() -> None:
    assert [found["robot"] for found in leaders({"R2": row(), "R1": row(), "R3": {**row(), "bound": False}})] == [
        "R1",
        "R2",
    ]


def test_without_the_naming_service_nobody_knows() -> None:
    with pytest.raises(NotReachable, match="connecting"):
        leaders({}, "connecting")
    assert leaders({"R1": row()}, "does not answer")[0]["free"]
