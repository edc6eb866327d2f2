"""The servant of a control agent: how checks, programs, paths and missions look over CORBA."""

from __future__ import annotations

from typing import Any

import pytest

from robocorba.corba.servants.control_agent import RobotAgentServant
from robocorba.errors.robots import IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownMission
from robocorba.maps.element_rules import MAX_NAME
from robocorba.planning.request import PathPoint, PointKind
from robocorba.programs import program
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import Program
from robocorba.programs.report import CheckReport
from robocorba.stubs import RoboCorba

WAITING = ProgramBuilder("waiting").wait(1.0).program()
CARRY = '{"icon": "move_table", "table": "t", "to": {"floor": "L1", "x": 1, "y": 2}}'


class Agent:
    """The part of a ControlAgent that the servant uses here."""

    name = "A"

    def __init__(self) -> None:
        self.program: Program | None = None
        self.path: list[PathPoint] = []
        self.report = CheckReport()
        self.checked: list[Program] = []
        self.missions: list[tuple[str, Program]] = []
        self.aborted = 0
        self.is_planner_away = False

    def check(self, program: Program) -> CheckReport:
        if self.is_planner_away:
            raise NotReachable("PathPlanner does not answer")
        self.checked.append(program)
        return self.report

    def abort(self) -> None:
        self.aborted += 1


class Missions:
    mission = "carry-1"
    aborted = ""

    def __init__(self) -> None:
        self.led: list[tuple[str, Program, int]] = []

    def lead_mission(self, mission: str, program: Program, term: int = 0) -> None:
        if self.led:
            raise IllegalOrder("run a program", "runs a program")
        self.led.append((mission, program, term))

    def abort_mission(self, mission: str) -> None:
        if mission != self.mission:
            raise UnknownMission(mission)
        self.aborted = mission


@pytest.fixture
def agent() -> Agent:
    return Agent()


@pytest.fixture
def missions() -> Missions:
    return Missions()


@pytest.fixture
def servant(agent: Agent, missions: Missions) -> RobotAgentServant:
    return RobotAgentServant(agent, None, "a", missions)  # type: ignore[arg-type]


def findings(check: Any) -> list[tuple[str, str, str, str]]:
    return [(found.kind._n, found.icon, found.parameter, found.reason) for found in check.findings]


def test_a_check_has_errors_and_notes(servant: RobotAgentServant, agent: Agent) -> None:
    agent.report.add_note("icons[0]", "is not checked")
    agent.report.add_finding("icons[0]", "seconds", "is wrong")
    check = servant.checkProgram(program.dumps(WAITING))
    assert findings(check) == [
        ("PROGRAM_ERROR", "icons[0]", "seconds", "is wrong"),
        ("PROGRAM_NOTE", "icons[0]", "", "is not checked"),
    ]
    assert not check.isExecutable
    assert agent.checked == [WAITING]


def test_notes_alone_forbid_nothing(servant: RobotAgentServant, agent: Agent) -> None:
    agent.report.add_note("", "no map")
    assert servant.checkProgram(program.dumps(WAITING)).isExecutable


def test_what_is_no_program_is_a_finding(servant: RobotAgentServant, agent: Agent) -> None:
    check = servant.checkProgram('{"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}')
    assert not check.isExecutable
    ((kind, icon, parameter, _),) = findings(check)
    assert (kind, icon, parameter) == ("PROGRAM_ERROR", "icons[0]", "seconds")
    assert findings(servant.checkProgram("{"))[0][3].startswith("not JSON")
    assert agent.checked == []


def test_without_a_planner_the_check_says_why(servant: RobotAgentServant, agent: Agent) -> None:
    agent.is_planner_away = True
    check = servant.checkProgram(program.dumps(WAITING))
    assert not check.isExecutable
    ((_, icon, _, reason),) = findings(check)
    assert (icon, "PathPlanner" in reason) == ("", True)


def test_the_loaded_program_is_readable(servant: RobotAgentServant, agent: Agent) -> None:
    assert servant._get_program() == ""
    agent.program = WAITING
    assert program.loads(servant._get_program()) == WAITING


def test_the_path_that_is_driven(servant: RobotAgentServant, agent: Agent) -> None:
    assert servant._get_path() == []
    agent.path = [PathPoint(PointKind.START, "", "L1", 1.0, 2.0, 0.5, 0.0, 0.0, "")]
    (point,) = servant._get_path()
    assert (point.kind, point.position.floor, point.position.x, point.position.y) == (RoboCorba.START, "L1", 1.0, 2.0)


def test_channel_and_mission(servant: RobotAgentServant) -> None:
    assert (servant._get_channel(), servant._get_mission()) == ("a", "carry-1")


@pytest.mark.parametrize("term", [0, 7])
def test_a_mission_is_started_from_the_json_of_an_icon(
    servant: RobotAgentServant, missions: Missions, term: int
) -> None:
    if term:
        servant.leadMission("carry-1", CARRY, term)
    else:
        servant.startMission("carry-1", CARRY)
    ((name, started, found),) = missions.led
    assert (name, len(started.icons), found) == ("carry-1", 1, term)
    with pytest.raises(RoboCorba.IllegalOrder):
        servant.startMission("carry-2", CARRY)


@pytest.mark.parametrize("name", ["", "x" * (MAX_NAME + 1), " carry", "a\nb"])
def test_a_mission_has_a_name(servant: RobotAgentServant, missions: Missions, name: str) -> None:
    with pytest.raises(RoboCorba.InvalidProgram, match="its name"):
        servant.startMission(name, CARRY)
    assert missions.led == []


@pytest.mark.parametrize("icon", ["", "{", f"{CARRY}, {CARRY}", '{"icon": "move_table"}'])
def test_a_mission_is_one_readable_icon(servant: RobotAgentServant, missions: Missions, icon: str) -> None:
    with pytest.raises(RoboCorba.InvalidProgram):
        servant.startMission("carry-1", icon)
    assert missions.led == []


def test_a_mission_is_aborted_by_its_name(servant: RobotAgentServant, agent: Agent, missions: Missions) -> None:
    with pytest.raises(RoboCorba.UnknownMission, match="carry-2"):
        servant.abortMission("carry-2")
    assert missions.aborted == ""
    servant.abortMission("carry-1")
    assert (missions.aborted, agent.aborted) == ("carry-1", 0)
