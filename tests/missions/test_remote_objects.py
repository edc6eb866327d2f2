"""What clients send of programs, missions and scans arrives at the objects of servants as it was sent."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from robocorba.errors.robots import InvalidProgram
from robocorba.errors.simulation import StaleMission
from robocorba.missions.corba.mission_control_servant import MissionControlServant
from robocorba.missions.corba.remote_mission_control import RemoteMissionControl
from robocorba.robot.corba.control_agent_servant import RobotAgentServant
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.simulation.corba import scans
from robocorba.simulation.corba.omni_database_servant import OmniDatabaseServant
from robocorba.simulation.corba.remote_database import RemoteDatabase
from robocorba.simulation.mission_record import (
    LeaderRecord,
    MemberRecord,
    MissionContent,
    MissionResult,
    MissionState,
    PhaseRecord,
)
from robocorba.simulation.sensing.scan import Mount
from robocorba.simulation.store import Mission
from robocorba.stubs import RoboCorba


def orb_with(servant: object) -> Any:
    """An ORB whose references lead to a servant of this process."""
    return SimpleNamespace(resolve=lambda *where: servant, reference=lambda *where: servant, uri=lambda reference: "")


def test_an_operator_loads_a_program_and_limits_the_speed() -> None:
    agent, program = Mock(), ProgramBuilder("waiting").wait(1.0).program()
    servant = RobotAgentServant(agent, Mock(), Mock(), "lab", Mock(), Mock())
    remote = RemoteAgent(orb_with(servant), "A")
    remote.load(dumps(program))
    agent.load.assert_called_once_with(program)
    with pytest.raises(InvalidProgram):
        remote.load("{")
    servant.setSpeedCap(0.5)
    agent.cap_speed.assert_called_once_with(0.5)


def test_a_leader_stores_its_mission() -> None:
    missions, mission = Mock(), Mission("m", 6, b"document")
    missions.put_mission.return_value = 7
    missions.stored.return_value = mission
    remote = RemoteDatabase(orb_with(OmniDatabaseServant(Mock(), missions, Mock())), 1.0)
    assert remote.put_mission(mission) == 7
    missions.put_mission.assert_called_once_with(mission)
    assert remote.mission("m") == mission
    missions.put_mission.side_effect = StaleMission("m", 6, 8)
    with pytest.raises(StaleMission) as refused:
        remote.put_mission(mission)
    assert refused.value.current == 8


def test_a_sensor_is_mounted_where_the_robot_says() -> None:
    assert scans.mount_of(RoboCorba.Mount(0.1, -0.2, 0.3)) == Mount(0.1, -0.2, 0.3)


def test_a_mission_is_shown_as_it_is_recorded() -> None:
    content = MissionContent(
        **{"kind": "move_table", "about": "desk", "leader": "B", "term": 2, "begun": 1.0, "ended": 9.0},
        members=(MemberRecord("B", "leader"), MemberRecord("C", "helper")),
        phases=(PhaseRecord("asking", 1.0, 2.0, "B"), PhaseRecord("gathering", 2.0)),
        phases_in_all=3,
        result=MissionResult.FAILED,
        reason="C is silent",
    )
    state, control = MissionState("m", 7, content), Mock()
    control.missions.since.return_value, control.missions.mission.return_value = [state], state
    remote = RemoteMissionControl(orb_with(MissionControlServant(control)))
    assert remote.missions_since(5) == [state]
    assert (remote.mission("m"), remote.leaders("m")) == (state, [LeaderRecord("B", 2, 1.0)])
