"""States of robots as diagnostics of ROS, for tools such as rqt_robot_monitor."""

from __future__ import annotations

from typing import Any

from robocorba.bridges.ros2.messages import Messages
from robocorba.robot.agent_state import AgentState
from robocorba.robot.display import Display, DisplayKind

#: Levels of diagnostic_msgs/msg/DiagnosticStatus.
OK, ERROR, STALE = b"\x00", b"\x02", b"\x03"


def robot_status(messages: Messages, state: AgentState, shown: Display) -> Any:
    """What a robot's touch panel shows, its condition, and the progress of its program."""
    level = ERROR if shown.kind is DisplayKind.EXCEPTIONAL else OK
    program = state.program
    values = {
        "display": shown.kind.name.lower(),
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
    return messages.status(level, state.name, shown.text, values)


def lost_status(messages: Messages, robot: str, reason: str) -> Any:
    """Of a robot whose agent does not answer, or that has none."""
    return messages.status(STALE, robot, reason, {})


def system_status(messages: Messages, problem: str) -> Any:
    """Of the system itself. problem: empty if there is none."""
    return messages.status(ERROR if problem else OK, "robocorba", problem or "connected", {})
