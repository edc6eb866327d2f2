"""States of robots as diagnostics of ROS, for tools such as rqt_robot_monitor."""

from __future__ import annotations

from typing import Any

from robocorba.bridges.ros2.messages import Messages
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramResult

#: Levels of diagnostic_msgs/msg/DiagnosticStatus.
OK, WARN, ERROR, STALE = b"\x00", b"\x01", b"\x02", b"\x03"


def robot_status(messages: Messages, state: AgentState) -> Any:
    """A robot's condition, and the progress of its program."""
    level, text = _condition(state)
    program = state.program
    values = {
        "condition": state.condition.name.lower(),
        "adaptor": state.adaptor,
        "floor": state.at.floor,
        "program": program.name,
        "icon": program.icon,
        "icons done": str(program.icons_done),
        "result": program.result.name.lower(),
        "reason": program.reason,
        "speed cap [m/s]": f"{state.speed_cap:g}",
        "tick jitter [s]": f"{state.jitter_s:.4f}",
    }
    return messages.status(level, state.name, text, values)


def lost_status(messages: Messages, robot: str, reason: str) -> Any:
    """Of a robot whose agent does not answer, or that has none."""
    return messages.status(STALE, robot, reason, {})


def system_status(messages: Messages, problem: str) -> Any:
    """Of the system itself. problem: empty if there is none."""
    return messages.status(ERROR if problem else OK, "robocorba", problem or "connected", {})


def _condition(state: AgentState) -> tuple[bytes, str]:
    if state.condition is AgentCondition.STOPPED:
        return ERROR, f"stopped: {state.reason}"
    program = state.program
    if state.condition is AgentCondition.IDLE:
        if program.result is ProgramResult.FAILED:
            return WARN, f"program {program.name} failed: {program.reason}"
        return OK, "idle"
    return OK, f"{state.condition.name.lower()}: {program.name}"
