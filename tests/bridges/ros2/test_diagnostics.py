"""The diagnostics of a robot: what its touch panel shows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from robocorba.bridges.ros2.diagnostics import ERROR, OK, robot_status
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.motion.robot_state import RobotState


@pytest.mark.parametrize("kind", DisplayKind)
def test_a_robot_has_an_error_if_it_is_exceptional(kind: DisplayKind) -> None:
    at = Pose("L1", 0.0, 0.0, 0.0)
    state = AgentState("A", "simulated", AgentCondition.IDLE, "", at, RobotState(), 1.0, 0.0, ProgramReport("fetch"))
    messages: Any = SimpleNamespace(status=lambda *members: members)
    level, name, text, values = robot_status(messages, state, Display(kind, "waiting for B"))
    assert (name, text, values["display"]) == ("A", "waiting for B", kind.name.lower())
    assert level == (ERROR if kind is DisplayKind.EXCEPTIONAL else OK)
