"""Servants of a robot: its agent, its session and its adaptor."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest

from robocorba.control.adaptor import RobotAdaptor
from robocorba.corba.remote.adaptor import RemoteAdaptor
from robocorba.corba.servants.adaptor import RobotAdaptorServant
from robocorba.corba.servants.control_agent import RobotAgentServant
from robocorba.corba.servants.simulation_server import RobotSessionServant
from robocorba.errors.robots import AdaptorFailed, IllegalOrder
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import CannotGrip, UnknownMission
from robocorba.maps.element_rules import MAX_NAME
from robocorba.planning.request import PathPoint, PointKind
from robocorba.programs import program
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import Program
from robocorba.programs.report import CheckReport
from robocorba.simulation.registry import RobotClient
from robocorba.stubs import RoboCorba
from tests.simulation.places import robot

WAITING = ProgramBuilder("waiting").wait(1.0).program()
CARRY = '{"icon": "move_table", "table": "t", "to": {"floor": "L1", "x": 1, "y": 2}}'


class Agent:
    """The parts of a ControlAgent and of its missions that the servant uses here."""

    name, mission = "A", "carry-1"

    def __init__(self) -> None:
        self.program: Program | None = None
        self.path: list[PathPoint] = []
        self.report = CheckReport()
        self.checked: list[Program] = []
        self.led: list[tuple[str, Program, int]] = []
        self.aborted, self.is_planner_away = "", False

    def check(self, program: Program) -> CheckReport:
        if self.is_planner_away:
            raise NotReachable("PathPlanner does not answer")
        self.checked.append(program)
        return self.report

    def abort(self) -> None:
        self.aborted = "its program"

    def lead_mission(self, mission: str, program: Program, term: int = 0) -> None:
        if self.led:
            raise IllegalOrder("run a program", "runs a program")
        self.led.append((mission, program, term))

    def abort_mission(self, mission: str) -> None:
        if mission != self.mission:
            raise UnknownMission(mission)
        self.aborted = mission


@pytest.fixture
def agent() -> Any:
    return Agent()


@pytest.fixture
def servant(agent: Any) -> RobotAgentServant:
    return RobotAgentServant(agent, None, "a", agent)  # type: ignore[arg-type]


def findings(check: Any) -> list[tuple[str, str, str, str]]:
    return [(found.kind._n, found.icon, found.parameter, found.reason) for found in check.findings]


def test_checks_of_programs(servant: RobotAgentServant, agent: Agent) -> None:
    check = servant.checkProgram('{"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}')
    assert not check.isExecutable
    ((*found, _),) = findings(check)
    assert found == ["PROGRAM_ERROR", "icons[0]", "seconds"]
    assert findings(servant.checkProgram("{"))[0][3].startswith("not JSON")
    assert agent.checked == []
    agent.report.add_note("icons[0]", "is not checked")
    assert servant.checkProgram(program.dumps(WAITING)).isExecutable
    agent.report.add_finding("icons[0]", "seconds", "is wrong")
    check = servant.checkProgram(program.dumps(WAITING))
    assert findings(check) == [
        ("PROGRAM_ERROR", "icons[0]", "seconds", "is wrong"),
        ("PROGRAM_NOTE", "icons[0]", "", "is not checked"),
    ]
    assert not check.isExecutable
    assert agent.checked == [WAITING] * 2
    agent.is_planner_away = True
    check = servant.checkProgram(program.dumps(WAITING))
    ((_, icon, _, reason),) = findings(check)
    assert (check.isExecutable, icon, "PathPlanner" in reason) == (False, "", True)


def test_what_is_readable_of_an_agent(servant: RobotAgentServant, agent: Agent) -> None:
    assert (servant._get_program(), servant._get_path()) == ("", [])
    assert (servant._get_channel(), servant._get_mission()) == ("a", "carry-1")
    agent.program = WAITING
    assert program.loads(servant._get_program()) == WAITING
    agent.path = [PathPoint(PointKind.START, "", "L1", 1.0, 2.0, 0.5, 0.0, 0.0, "")]
    (point,) = servant._get_path()
    assert (point.kind, point.position.floor, point.position.x, point.position.y) == (RoboCorba.START, "L1", 1.0, 2.0)


def test_a_mission_is_started_from_an_icon_and_aborted_by_its_name(servant: RobotAgentServant, agent: Any) -> None:
    for name in ("", "x" * (MAX_NAME + 1), " carry", "a\nb"):
        with pytest.raises(RoboCorba.InvalidProgram, match="its name"):
            servant.startMission(name, CARRY)
    for icon in ("", "{", f"{CARRY}, {CARRY}", '{"icon": "move_table"}'):
        with pytest.raises(RoboCorba.InvalidProgram):
            servant.startMission("carry-1", icon)
    assert agent.led == []
    for start, term in ((servant.startMission, 0), (servant.leadMission, 7)):
        start("carry-1", CARRY, *[term] * bool(term))
        ((name, started, found),) = agent.led
        assert (name, len(started.icons), found) == ("carry-1", 1, term)
        with pytest.raises(RoboCorba.IllegalOrder):
            servant.startMission("carry-2", CARRY)
        agent.led.clear()
    with pytest.raises(RoboCorba.UnknownMission, match="carry-2"):
        servant.abortMission("carry-2")
    assert agent.aborted == ""
    servant.abortMission("carry-1")
    assert agent.aborted == "carry-1"


class Faulty(RobotAdaptor):
    """Raises whatever the test says."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def _fail(self, *arguments: object) -> bool:
        raise self._error

    start = stop = read = write = _fail


def test_every_error_of_a_driver_reaches_the_agent_with_its_cause() -> None:
    for error, cause in (
        (AdaptorFailed("battery empty"), "battery empty"),
        (OSError(5, "no serial port"), "OSError: [Errno 5] no serial port"),
    ):
        servant = RobotAdaptorServant(Faulty(error))
        for call in (lambda servant=servant: servant.start([]), servant.stop, servant.read):
            with pytest.raises(RoboCorba.AdaptorFailed) as raised:
                call()
            assert raised.value.cause == cause
    nobody: Any = None
    with pytest.raises(AdaptorFailed, match="--uri"):
        RemoteAdaptor(nobody, "A").start(["--uri"])


def test_a_long_call_keeps_the_lease() -> None:
    client, calling = RobotClient(robot("A"), "key", 0.0, time.monotonic), []

    def grip(what: str, at: tuple[float, float]) -> None:
        calling.append(client.is_calling)
        client.last_call_at -= 3600.0  # after an hour of waiting
        raise CannotGrip(what, "it is too far away")

    unused: Any = None
    session: Any = SimpleNamespace(client=client, grip=grip)
    servant = RobotSessionServant(session, 2.0, sensor=unused, stops=unused, uri=unused)
    with pytest.raises(RoboCorba.CannotGrip):
        servant.grip("T1", RoboCorba.XY(1.0, 2.0))
    assert [*calling, client.is_calling] == [True, False]
    assert client.silent_s < 1800.0
