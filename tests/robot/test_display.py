"""What a robot's touch panel shows: for each combination of what the agent knows, and what a program waits for."""

from __future__ import annotations

import contextlib
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from omniORB import CORBA

from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport, ProgramResult
from robocorba.robot.corba import robot_states
from robocorba.robot.corba.remote_agent import shown_by
from robocorba.robot.display import Display, DisplayKind, display_of
from robocorba.robot.execution_control import ExecutionControl
from robocorba.robot.motion.robot_state import RobotState

#: Condition, result of the task, whether it waits for B, whether the robot is lost (? any of them); what is shown.
TABLE = """
STOPPED ?         ? no  | EXCEPTIONAL stopped: the reason
STOPPED ?         ? yes | EXCEPTIONAL lost: the reason
IDLE    NO_RESULT ? ?   | WAITING waiting for an order
?       DONE      ? ?   | WAITING waiting for an order
?       ABORTED   ? ?   | WAITING waiting for an order
?       FAILED    ? ?   | EXCEPTIONAL fetch failed: a wall
PAUSED  NO_RESULT no  ? | WAITING paused: mbase path (fetch)
PAUSED  NO_RESULT yes ? | WAITING paused, waiting for B
RUNNING NO_RESULT no  ? | WORKING mbase path (fetch)
RUNNING NO_RESULT yes ? | WAITING waiting for B
"""


def by_table(*facts: str) -> tuple[str, str]:
    """Kind and text of the first row that fits."""
    for row in TABLE.strip().splitlines():
        pattern, _, shown = row.partition("|")
        if all(wanted in ("?", fact) for wanted, fact in zip(pattern.split(), facts, strict=True)):
            kind, _, text = shown.strip().partition(" ")
            return kind, text
    raise AssertionError(facts)


@pytest.mark.parametrize("condition", AgentCondition)
@pytest.mark.parametrize("result", ProgramResult)
def test_every_combination_shows_what_the_table_says(condition: AgentCondition, result: ProgramResult) -> None:
    report = ProgramReport("fetch", result, "icons[0]", "mbase_path", "a wall")
    for waits, is_lost in product(("yes", "no"), repeat=2):
        shown = display_of(condition, "the reason", report, "B" if waits == "yes" else "", is_lost == "yes")
        assert (shown.kind.name, shown.text) == by_table(condition.name, result.name, waits, is_lost)


class Released:
    """A robot of 0.1.0."""

    def _get_display(self) -> Any:
        raise CORBA.BAD_OPERATION

    def _get_state(self) -> Any:
        report = ProgramReport("fetch", ProgramResult.NO_RESULT, "icons[0]", "mbase_path")
        at = Pose("L1", 0.0, 0.0, 0.0)
        state = AgentState("A", "simulated", AgentCondition.RUNNING, "", at, RobotState(), 1.0, 0.0, report)
        return robot_states.agent_state(state)


def test_what_has_no_name_is_said_and_what_a_robot_of_0_1_0_shows_follows_from_its_state() -> None:
    running, idle = AgentCondition.RUNNING, AgentCondition.IDLE
    assert display_of(running, "", ProgramReport("teleoperation")).text == "teleoperation"
    assert display_of(running, "", ProgramReport()).text == "its program"
    assert display_of(idle, "", ProgramReport(result=ProgramResult.FAILED, reason="x")).text == "its program failed: x"
    assert shown_by(Released()) == Display(DisplayKind.WORKING, "mbase path (fetch)")


@given(st.lists(st.one_of(st.just(None), st.sampled_from(["", "B", "elevator E1", "areas"]))))
def test_a_program_waits_for_what_it_has_begun_to_wait_for_last(steps: list[str | None]) -> None:
    """Waits begin with a text, which is empty while they are none, and end with None, the last one first."""
    execution = ExecutionControl(lambda error: None, lambda is_held: None)
    assert not execution.answer(0, True)  # nothing is asked
    waits: list[tuple[contextlib.ExitStack, str]] = []
    for step in steps:
        if step is None:
            if waits:
                waits.pop()[0].close()
        else:
            stack = contextlib.ExitStack()
            stack.enter_context(execution.awaiting(lambda text=step: text))  # type: ignore[misc]
            waits.append((stack, step))
        assert execution.awaited == next((text for _, text in reversed(waits) if text), "")
