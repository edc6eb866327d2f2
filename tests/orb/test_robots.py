"""Robots: servants of their agents, sessions and adaptors, and clients that go on while something does not answer."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omniORB import CORBA

from robocorba.errors.robots import AdaptorFailed, IllegalOrder, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import CannotGrip, PlaceTaken, UnknownMission
from robocorba.map_editor.element_rules import MAX_NAME
from robocorba.map_editor.spatial.pose import Pose
from robocorba.planning.request import PathPoint, PointKind
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport, ProgramResult
from robocorba.robot.corba import emergency_stop
from robocorba.robot.corba import remote_agent as control_agent
from robocorba.robot.corba import remote_session as module
from robocorba.robot.corba.adaptor_servant import RobotAdaptorServant
from robocorba.robot.corba.control_agent_servant import RobotAgentServant
from robocorba.robot.corba.emergency_stop import OTHERS, StopAddresses, Verdict, reset_robots, stop_robots
from robocorba.robot.corba.remote_adaptor import RemoteAdaptor
from robocorba.robot.corba.remote_agent import CALM, OrderLimits, RemoteAgent, order_all
from robocorba.robot.corba.remote_session import RemoteSession
from robocorba.robot.corba.robot_orders import GOAL, RobotOrders
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs import program
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.uploads import CheckedPrograms
from robocorba.simulation.corba.simulation_server_servant import RobotSessionServant
from robocorba.simulation.emergency_stops import StopAnswer, StopRecord
from robocorba.simulation.registry import Description, RobotClient
from robocorba.simulation.sensing.scan import LASER, Mount, ScanSpec
from robocorba.stubs import RoboCorba
from robocorba.system.roles import Role
from robocorba.system.settings import RoleNaming
from testkit.processes import eventually
from tests.simulation.places import robot

WAITING = ProgramBuilder("waiting").wait(1.0).program()
CARRY = '{"icon": "move_table", "table": "t", "to": {"floor": "L1", "x": 1, "y": 2}}'


class ServedAgent:
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
    return ServedAgent()


@pytest.fixture
def servant(agent: Any) -> RobotAgentServant:
    return RobotAgentServant(agent, None, None, "a", agent, CheckedPrograms(agent, lambda: ("b", 1)))


def findings(check: Any) -> list[tuple[str, str, str, str]]:
    return [(found.kind._n, found.icon, found.parameter, found.reason) for found in check.findings]


def test_a_role_finds_by_its_name_the_robot_at_an_address() -> None:
    def found(where: str, *_: object) -> Any:
        return SimpleNamespace(_get_name=lambda: "A", _get_mission=lambda: where)

    naming = RoleNaming("a", 1, "key", Role.OPERATOR, Path("file"))
    orb: Any = SimpleNamespace(
        naming=naming, reference=found, resolve=found, uri_at="at {}".format, uri=lambda agent: ""
    )
    assert RemoteAgent(orb, "a:2").mission() == "Robots/A"


def test_checks_of_programs_and_what_is_readable_of_an_agent(servant: RobotAgentServant, agent: ServedAgent) -> None:
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
    error, note = (
        ("PROGRAM_ERROR", "icons[0]", "seconds", "is wrong"),
        ("PROGRAM_NOTE", "icons[0]", "", "is not checked"),
    )
    assert (findings(check), check.isExecutable) == ([error, note], False)
    assert agent.checked == [WAITING] * 2
    agent.is_planner_away = True
    check = servant.checkProgram(program.dumps(WAITING))
    ((_, icon, _, reason),) = findings(check)
    assert (check.isExecutable, icon, "PathPlanner" in reason) == (False, "", True)
    assert (servant._get_program(), servant._get_path()) == ("", [])
    assert (servant._get_channel(), servant._get_mission()) == ("a", "carry-1")
    agent.program, agent.path = WAITING, [PathPoint(PointKind.START, "", "L1", 1.0, 2.0, 0.5, 0.0, 0.0, "")]
    assert program.loads(servant._get_program()) == WAITING
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


class Server:
    """A simulation server, its ORB and its only session."""

    def __init__(self) -> None:
        self.registered, self.has_sensor, self.heartbeats = 0, True, 0
        #: Floors without a free place, and those on which robots logged on.
        self.full, self.started_on = set[str](), list[str]()
        self.riding, self.collisions = RoboCorba.Ride(RoboCorba.NO_RIDE, "", "", "", 0), 0
        #: Calls that fail because the server is away, how, and all calls by their names.
        self.failing, self.failure, self.calls = 0, CORBA.COMM_FAILURE, list[str]()
        for operation in CALLS:
            setattr(self, operation, functools.partial(self._answer, operation))

    def resolve(self, *arguments: Any) -> Server:
        return self

    def uri(self, reference: Any) -> str:
        return "session"

    def reference(self, uri: str, interface: Any, call_timeout_s: float) -> Server:
        return self

    def registerRobot(self, about: Any) -> Server:
        if about.start.floor in self.full:
            raise RoboCorba.PlaceTaken(RoboCorba.Point(about.start.floor, about.start.x, about.start.y), "a cabin")
        self.started_on.append(about.start.floor)
        self.registered += 1
        self.collisions = 0  # the server counts those of each session
        return self

    def _get_sensor(self) -> Server:
        if not self.has_sensor:
            raise CORBA.TRANSIENT()
        return self

    def deregister(self) -> None:
        self.registered -= 1

    def heartbeat(self) -> None:
        self.heartbeats += 1
        if not self.registered:
            raise CORBA.OBJECT_NOT_EXIST()

    def state(self) -> Any:
        at, still = RoboCorba.Pose("L1", 1.0, 2.0, 0.0), RoboCorba.Velocity(0.0, 0.0, 0.0)
        return RoboCorba.RobotState(1.0, at, still, "", self.riding, self.collisions, "")

    def _answer(self, operation: str, *arguments: Any) -> None:
        self.calls.append(operation)
        if self.failing:
            self.failing -= 1
            raise self.failure(0, CORBA.COMPLETED_MAYBE)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    monkeypatch.setattr(module, "set_call_timeout", lambda reference, timeout_s: None)
    return Server()


@pytest.fixture
def session(server: Any) -> RemoteSession:
    return RemoteSession(server, Description("A", Pose("L1", 1.0, 2.0, 0.0), 0.4))


def test_a_robot_is_registered_until_it_logs_off(session: RemoteSession, server: Server) -> None:
    for _ in range(2):
        session.log_on()
    assert server.registered == 1
    server.registered = 0
    with pytest.raises(RobotLost, match="has logged the robot off"):
        session.heartbeat()
    session.log_on()
    session.heartbeat()
    for _ in range(2):
        session.log_off()
    assert server.registered == 0
    with pytest.raises(RobotLost, match="A is not logged on"):
        session.heartbeat()
    server.has_sensor = False  # the session is given back
    with pytest.raises(RobotLost):
        session.log_on()
    assert server.registered == 0


@given(st.lists(st.sampled_from(["touch", "read", "lose", "log off"]), max_size=20))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_collisions_count_through_all_sessions_of_a_robot(server: Any, what_happens: list[str]) -> None:
    """None that the robot read of is forgotten with its session, and none counts twice."""
    session = RemoteSession(server, Description("A", Pose("L1", 1.0, 2.0, 0.0), 0.4))
    server.registered = known = unread = 0
    session.log_on()
    for what in [*what_happens, "read"]:
        if what == "touch":
            server.collisions += 1
            unread += 1
        elif what == "read":
            known, unread = known + unread, 0
            assert session.state().collisions == known
        else:
            if what == "log off":
                session.log_off()
            server.registered = unread = 0
            session.log_on()


@pytest.mark.parametrize(
    ("phase", "names", "full", "floors"),
    [
        ("NO_RIDE", {"L1": "ground", "L2": "L1"}, set(), ["L1", "ground"]),  # its floor has another name now
        ("RIDING", {"L1": "L1", "L2": "top"}, {"L1"}, ["L1", "top"]),
        ("WAITING_FOR_CABIN", {"L1": "L1", "L2": "top"}, {"L1"}, ["L1"]),
    ],
)
def test_a_robot_that_was_logged_off_logs_on_where_it_is_now(
    session: RemoteSession, server: Server, phase: str, names: dict[str, str], full: set[str], floors: list[str]
) -> None:
    server.riding = RoboCorba.Ride(getattr(RoboCorba, phase), "E1", "L1", "L2", 0)
    session.log_on()
    session.state()
    session.floors_since = lambda floor: names
    server.registered, server.full = 0, full
    with contextlib.suppress(PlaceTaken):
        session.log_on()
    assert server.started_on == floors


@pytest.mark.parametrize(
    ("operation", "failing", "failure", "calls", "refusal"),
    [
        *(("brake", 3, failure, 4, "") for failure in (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT)),
        # An emergency stop may have come meanwhile:
        *(("command", 1, failure, 1, "") for failure in (CORBA.COMM_FAILURE, CORBA.TIMEOUT)),
        # What could be done twice:
        ("callElevator", 1, CORBA.COMM_FAILURE, 1, "does not answer"),
        ("scan", 1, CORBA.TIMEOUT, 1, "the virtual sensor server does not answer"),
        ("scan", 1, CORBA.OBJECT_NOT_EXIST, 1, "the virtual sensor server does not answer"),
    ],
)
def test_what_is_repeated_while_a_server_restarts_or_is_held_up(
    session: RemoteSession, server: Server, operation: str, failing: int, failure: Any, calls: int, refusal: str
) -> None:
    session.log_on()
    server.failing, server.failure = failing, failure
    with pytest.raises(RobotLost, match=refusal) if refusal else contextlib.nullcontext():
        CALLS[operation](session)
    assert server.calls == [operation] * calls
    assert server.heartbeats == (operation == "command")


#: By their operations.
CALLS: dict[str, Callable[[RemoteSession], object]] = {
    "brake": RemoteSession.brake,
    "command": lambda session: session.command((0.3, 0.0, 0.0), 0.1),
    "callElevator": lambda session: session.call_elevator("E1", "L2"),
    "scan": lambda session: session.scan(Pose("L1", 1.0, 2.0, 0.0), Mount(0.0, 0.0, 0.0), ScanSpec(LASER)),
}


def test_how_long_robots_wait(session: RemoteSession, server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """A brake for the timeout of a call, if that is shorter."""
    session.log_on()
    server.failing = 1000
    for call_timeout_s, attempts in ((0.1, range(1, 4)), (60.0, range(4, 60))):
        monkeypatch.setattr(module, "CALL_TIMEOUT_S", call_timeout_s)
        monkeypatch.setattr(module, "PATIENCE_S", 1.0)
        server.calls.clear()
        with pytest.raises(RobotLost, match="does not answer"):
            session.brake()
        assert len(server.calls) in attempts


PATIENCE_S = 30.0
ROUND, OTHER = (program.dumps(ProgramBuilder(name).mbase_path("L1", 1.0, 2.0).program()) for name in ("round", "other"))


class Agent:
    """A robot's agent; drives end at once. ran: names of the programs that have run. report: of the last one."""

    def __init__(self) -> None:
        self.loaded, self.ran, self.report = "", list[str](), ProgramReport()

    def state(self) -> AgentState:
        here = Pose("L1", 0.0, 0.0, 0.0)
        return AgentState("A", "simulated", AgentCondition.IDLE, "", here, RobotState(), 1.0, 0.0, self.report)

    def display(self) -> Display:
        return Display(DisplayKind.WAITING, "an order")

    def program(self) -> str:
        return self.loaded

    def load(self, json: str) -> None:
        self.loaded = json

    def run(self) -> None:
        if not self.loaded:
            raise IllegalOrder("run", "has no program")
        self.ran.append(program.loads(self.loaded).name)


def test_after_a_goal_the_program_runs_that_was_loaded_last_not_the_goal_again() -> None:
    agent: Any = Agent()
    with contextlib.closing(RobotOrders("A", lambda: agent, print)) as orders:

        def drive() -> None:
            count = len(agent.ran)
            orders.drive_to(Pose("L1", 3.0, 4.0, 0.0))
            eventually(lambda: agent.ran[count:] == [GOAL], PATIENCE_S)

        with pytest.raises(IllegalOrder, match="has no program"):
            orders.run()
        drive()
        with pytest.raises(IllegalOrder, match="has loaded none, only driven to a goal"):
            orders.run()
        orders.load(ROUND)
        for order in (drive, orders.run, orders.run, drive, drive, orders.run):
            order()
        for loaded, order in ((OTHER, drive), ("", orders.run), (ROUND, orders.run)):  # by the console
            agent.loaded = loaded or agent.loaded
            order()
    assert agent.ran == [GOAL, GOAL, "round", "round", GOAL, GOAL, "round", GOAL, "other", "round"]


def test_a_goal_that_was_not_reached_is_reported_once() -> None:
    agent, said = Agent(), list[str]()
    goal = ProgramReport(GOAL)
    ends = [goal._replace(result=result, reason="a chair") for result in (ProgramResult.FAILED, ProgramResult.DONE)]
    with contextlib.closing(RobotOrders("A", lambda: cast(RemoteAgent, agent), said.append)) as orders:
        for report in (*ends, ProgramReport("round", ProgramResult.FAILED), ends[0]):
            agent.report, count = goal, len(agent.ran)
            orders.drive_to(Pose("L1", 3.0, 4.0, 0.0))
            eventually(lambda count=count: agent.ran[count:], PATIENCE_S)
            eventually(lambda: orders._driven, PATIENCE_S)
            for agent.report in (goal, report, report):
                orders.look()
    assert said == ["A: goal L1:3.00,4.00 was not reached: failed: a chair"] * 2


NAMES = [f"R{number}" for number in range(200)]


class Crowd:
    """Robots behind a naming service that finds none while more than `room` are looked for at a time."""

    def __init__(self, room: int) -> None:
        self._room, self._lock, self._looking = room, threading.Lock(), 0
        self.stopped, self.asked = set(NAMES), list[str]()

    def resolve(self, name: str, interface: Any, timeout_s: float, call_timeout_s: float) -> str:
        with self._lock:
            self._looking += 1
            self.asked.append(name)
        is_crowded = threading.Event().wait(0.002) or self._looking > self._room
        with self._lock:
            self._looking -= 1
        if is_crowded:
            raise NotReachable(f"{name} is not reachable")
        return name

    def reference(self, uri: str, interface: Any, timeout_s: float) -> str:
        return uri

    def uri(self, reference: str) -> str:
        return reference


def test_a_restart_of_a_crowd_leaves_nobody_stopped() -> None:
    """`stop --all --reset` left 13 of 200 stopped: all were called at once, within a second each."""
    crowd: Any = Crowd(CALM.at_once)
    done = order_all(crowd, NAMES, lambda agent: crowd.stopped.discard(agent.name), CALM)
    assert list(done) == [(name, "") for name in NAMES]
    assert crowd.stopped == set()


def test_robots_that_hang_or_refuse_cost_the_others_nothing_and_their_reasons_are_given() -> None:
    crowd, end = Crowd(len(NAMES)), threading.Event()
    refusals = {"R1": NotReachable("is away"), "R2": ValueError("a fault")}

    def order(agent: RemoteAgent) -> None:
        if agent.name in ("R0", "R7"):
            end.wait(60.0)
        if agent.name in refusals:
            raise refusals[agent.name]
        crowd.stopped.discard(agent.name)

    found = dict(order_all(crowd, NAMES, order, OrderLimits(4, 1.0, 3.0)))  # type: ignore[arg-type]
    assert {name for name, problem in found.items() if problem} == {"R0", "R1", "R2", "R7"}
    assert (found["R0"], found["R1"]) == ("did not answer within 3 s", "is away")
    assert "ValueError: a fault" in found["R2"]
    crowd.asked.clear()  # after the limit nobody else is called
    assert all(problem for _, problem in order_all(crowd, ["R0", "R7", "R3"], order, OrderLimits(2, 1.0, 0.1)))  # type: ignore[arg-type]
    end.set()
    assert sorted(crowd.asked) == ["Robots/R0", "Robots/R7"]
    assert list(order_all(crowd, [], order)) == []  # type: ignore[arg-type]
    assert control_agent.URGENT.at_once > len(NAMES)


class World:
    """An ORB, and what answers behind it. states: of the simulation server, None while it does not answer.
    has_stop_of_all: it is no earlier release."""

    def __init__(self) -> None:
        self.states: list[Any] | None = None
        self.has_stop_of_all, self.held = True, False
        self.targets: dict[str, StopAnswer] = {}
        self.bound: dict[str, str] = {}
        self.asked: list[tuple[str, Sequence[str]]] = []

    def uri_at(self, address: str, key: str) -> str:
        return f"corbaloc:iiop:1.2@{address}/{key}"

    def reference(self, uri: str, interface: Any, timeout_s: float) -> World:
        if interface is not RoboCorba.SimulationServer:
            raise NotReachable("no channel")
        self.asked.append((uri, ()))
        return self

    def resolve(self, name: str, *arguments: Any) -> World:
        raise NotReachable(f"{name}: the naming service hangs")

    def names(self, path: str, timeout_s: float = 1.0) -> list[str]:
        raise NotReachable("the naming service hangs")

    def stopRobots(self, robots: Sequence[str], reason: str) -> list[Any]:
        if self.states is None:
            raise CORBA.TIMEOUT()
        self.held |= not robots
        return [state for state in self.states if not robots or state.robot in robots]

    def _get_stopOfAll(self) -> Any:
        if not self.has_stop_of_all:
            raise CORBA.BAD_OPERATION()
        return RoboCorba.StopHold(self.held, 7, "fire")

    def endStopOfAll(self, last: int) -> Any:
        if self.states is None:
            raise CORBA.TIMEOUT()
        self.held &= last != 7
        return self._get_stopOfAll()

    def stopStates(self, robots: Sequence[str]) -> list[Any]:
        return self.stopRobots(robots, "")


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    world = World()

    def stop_at(orb: Any, target: str, reason: str) -> StopAnswer:
        if target not in world.targets:
            raise NotReachable("gone")
        return world.targets[target]

    def order_all(orb: Any, names: Sequence[str], order: Any, limits: Any = None) -> list[tuple[str, str]]:
        return [(name, world.bound.get(name, "is not bound")) for name in names]

    for name, value in (("LIMIT_S", 0.3), ("stop_at", stop_at), ("order_all", order_all)):
        monkeypatch.setattr(emergency_stop, name, value)
    monkeypatch.setattr(emergency_stop, "robots", lambda orb: list(world.bound))
    return world


def stop(world: World, *names: str, targets: Sequence[str] = ()) -> list[Verdict]:
    known = {name: StopRecord("r", name) for name in targets}
    return stop_robots(world, names, StopAddresses("h:1", {}, known))  # type: ignore[arg-type]


def state(robot: str, waits_for: str = "", is_confirmed: bool = True) -> Any:
    return RoboCorba.StopState(robot, True, not waits_for, 0.0, is_confirmed, waits_for)


def test_the_simulation_server_shows_it_and_what_is_bound_or_still_moves_proves_nothing(world: World) -> None:
    world.states = [state("A"), state("B", is_confirmed=False)]
    *robots, others = stop(world)
    assert robots == [Verdict("A", True, "the robot confirms it"), Verdict("B", True, "its body stands")]
    assert others == (OTHERS, True, "robots that log on are stopped, too, until: robocorba stop --all --reset", True)
    assert world.asked[0][0] == "corbaloc:iiop:1.2@h:1/SimulationServer"
    world.states, world.bound = None, {"A": ""}
    (verdict,) = stop(world, "A")
    assert not verdict.stands and "proves nothing; the simulation server does not answer" in verdict.text
    world.states = []
    verdict, _ = stop(world)
    assert (verdict.stands, verdict.is_known) == (False, False)
    assert verdict.text.endswith("proves nothing; it is not logged on")
    world.states, world.targets = [state("A", "it brakes")], {"A": StopAnswer(True, True)}
    assert stop(world, "A", targets="A") == [Verdict("A", False, "is not shown to stand: it brakes")]


def test_without_the_server_others_are_doubtful_and_a_reset_of_all_ends_the_stop_of_all(world: World) -> None:
    assert [(verdict.robot, verdict.stands) for verdict in stop(world)] == [(OTHERS, False)]
    world.targets = {"A": StopAnswer(True, True), "B": StopAnswer(True, False)}
    found = {verdict.robot: verdict.stands for verdict in stop(world, targets="ABC")}
    assert found == {"A": True, "B": False, "C": False, OTHERS: False}
    assert [verdict.stands for verdict in stop(world, "A", targets="ABC")] == [True]

    def reset(*names: str) -> dict[str, str]:
        return dict(reset_robots(world, names, StopAddresses("h:1")))  # type: ignore[arg-type]

    world.states, world.has_stop_of_all = [], False  # an earlier release holds no robot that logs on
    (others,) = stop(world)
    assert (others.robot, others.stands, others.is_known) == (OTHERS, False, False)
    assert reset() == {OTHERS: ""}
    world.has_stop_of_all, world.held = True, False
    world.states, world.bound = [state("A"), state("B")], {"A": "", "B": "is not bound"}
    stop(world)
    assert reset("A") == {"A": ""} and world.held
    assert reset() == {OTHERS: "", "A": "", "B": "is not bound"}
    assert not world.held
    world.states = None
    assert reset()[OTHERS].startswith("robots that log on stay stopped: the simulation server does not answer")
