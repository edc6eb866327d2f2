"""What a robot's touch panel shows, and with it every viewer of the robot: working, waiting or exceptional, as in the
paper, and one sentence about it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from robocorba.robot.agent_state import AgentCondition, ProgramReport, ProgramResult


class DisplayKind(Enum):
    """The robot works on its task; waits for an order, or for something in its task; or is stopped or lost, or its last
    task failed."""

    WORKING = 0
    WAITING = 1
    EXCEPTIONAL = 2


class Display(NamedTuple):
    """text: for a person, without a full stop. seconds: how long it has been shown [s]."""

    kind: DisplayKind
    text: str
    seconds: float = 0.0


def display_of(
    condition: AgentCondition, reason: str, report: ProgramReport, awaited: str = "", is_lost: bool = False
) -> Display:
    """reason: why the robot is stopped, or lost. report: of the present or last task. awaited: what the task waits for,
    such as `elevator E1, 2 ahead`; empty if it does not wait."""
    if condition is AgentCondition.STOPPED:
        return Display(DisplayKind.EXCEPTIONAL, f"{'lost' if is_lost else 'stopped'}: {reason}")
    # At the end of a task its thread may still run.
    if condition is AgentCondition.IDLE or report.result is not ProgramResult.NO_RESULT:
        if report.result is ProgramResult.FAILED:
            return Display(DisplayKind.EXCEPTIONAL, f"{report.name or 'its program'} failed: {report.reason}")
        return Display(DisplayKind.WAITING, "waiting for an order")
    task = report.name or "its program"
    doing = f"{report.kind.replace('_', ' ')} ({task})" if report.kind else task
    if condition is AgentCondition.PAUSED:
        return Display(DisplayKind.WAITING, f"paused, waiting for {awaited}" if awaited else f"paused: {doing}")
    if awaited:
        return Display(DisplayKind.WAITING, f"waiting for {awaited}")
    return Display(DisplayKind.WORKING, doing)
