"""Operations of the pages: hostile requests are answered in JSON and in words, and the console goes on."""

from __future__ import annotations

import asyncio
import contextlib
import copy
import json
import math
import re
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import create_autospec

import numpy as np
import pytest
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from robocorba.clients.cooperative_planners import planner_of
from robocorba.console import arguments
from robocorba.console.arguments import InvalidArguments, NotPossible
from robocorba.console.calls import MAX_BODY, STOPS, Calls
from robocorba.console.films import Films
from robocorba.console.history import History
from robocorba.console.leaving import in_thread
from robocorba.console.mission_operations import MissionOperations
from robocorba.console.monitor_operations import MonitorOperations
from robocorba.console.monitor_state import MonitorState
from robocorba.console.operations import Operations
from robocorba.console.program_operations import MAX_ARGUMENTS, ProgramOperations
from robocorba.console.recordings import Recordings
from robocorba.console.system_operations import SystemOperations
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.files import WorkEnded
from robocorba.errors.robots import IllegalOrder, InvalidProgram, Unreachable
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownRobot
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.floor_update import MOTION, WHOLE, FloorUpdate, FloorView
from robocorba.missions.cooperative_planner import MakePlanner
from robocorba.missions.world import StandingRobot
from robocorba.robot.agent_state import AgentCondition, AgentState, IconBegun, ProgramReport, ProgramResult, RunReport
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.display import Display, DisplayKind
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import Side
from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.programs import program as programs
from robocorba.robot.programs.icons import Icon
from robocorba.robot.programs.report import CheckReport
from robocorba.simulation.registry import Pose
from robocorba.system.decoding import Work
from robocorba.system.settings import InvalidSetting
from testkit.buildings import two_floors, two_storeys
from tests.console.asgi import answer, ask
from tests.missions.places import MapWorld
from tests.waits import until, work_for

NOBODY: Any = None


class Part:
    """Operations of a page."""

    def add_up(self, a: int, b: int = 1) -> int:
        return a + b

    def drive(self, speed: float) -> float:
        return speed

    def refuse(self) -> None:
        raise UnknownRobot("<script>")

    def break_down(self) -> None:
        raise KeyError("a secret of the console")

    def not_json(self) -> object:
        return object()

    def not_a_number(self) -> float:
        return float("nan")

    def _hidden(self) -> str:
        return "hidden"

    @property
    def also_hidden(self) -> str:
        raise AssertionError("it was read")


def served(calls: Calls, name: str) -> ASGIApp:
    """Answers all requests as calls of an operation."""

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await (await calls.answer(name, Request(scope, receive)))(scope, receive, send)

    return app


def call(name: str, body: bytes = b"{}", content_type: str = "application/json") -> dict[str, Any]:
    operations = Operations(NOBODY)
    operations.add(Part())
    pieces = [body[at : at + 65536] for at in range(0, len(body), 65536)]
    with contextlib.closing(Calls(operations)) as calls:
        given = ask(served(calls, name), f"/call/{name}", "POST", pieces, content_type=content_type)
    assert given.status == 200 and given.headers["content-type"] == "application/json"
    assert b"Traceback" not in given.body and b"secret" not in given.body
    decoded: dict[str, Any] = json.loads(given.body)
    return decoded


def test_answers_and_what_is_no_operation() -> None:
    assert call("add_up", b'{"a": 2}') == {"answer": 3}
    assert call("add_up", b'{"a": 2, "b": 5}', "application/json; charset=utf-8") == {"answer": 7}
    assert call("refuse") == {"error": "no robot called <script> is logged on"}
    for body in (b"", b"no", b"[]", b"null", b"1", b"\xff\xfe", b'{"a":', b"[" * 100_000):
        assert "the request is not" in call("add_up", body)["error"], body[:9]
    assert "not a JSON object" in call("add_up", b'{"a": 1}', "text/plain")["error"]
    assert "longer than" in call("add_up", b'{"a": "' + b"x" * MAX_BODY + b'"}')["error"]
    for name in ("nothing", "_hidden", "also_hidden", "add", "call", "__init__", "x" * 5000, "../stop"):
        error = call(name)["error"]
        assert error.startswith("there is no operation") and len(error) < 200
    for name in ("break_down", "not_json", "not_a_number"):
        assert call(name) == {"error": "the console failed; its log says why"}


@pytest.mark.parametrize(
    ("operation", "argument", "values", "problem"),
    [
        ("add_up", "a", ["1", None, 1.5, True, [], {}, -1, 2**53 + 1, 10**400], "a is not a whole number"),
        ("drive", "speed", ["1", None, True, [], math.nan, math.inf, 10**400], "speed is not a number"),
        ("stop", "robot", [1, None, [], "\0", "\ud800"], "robot is not a text that can be sent"),
    ],
)
def test_wrong_arguments_are_named(operation: str, argument: str, values: list[Any], problem: str) -> None:
    for value in values:
        assert call(operation, json.dumps({argument: value}).encode())["error"] == problem, value
    for body in (b"{}", b'{"a": 1, "c": 2}', b'{"": 1}', b'{"a": 1, "self": 2}'):
        assert call("add_up", body)["error"].startswith("add_up: ")


class Stoppable(Operations):
    """Operations of robots that stop at once, and one that hangs until it is released."""

    def __init__(self) -> None:
        super().__init__(NOBODY)
        self.has_begun, self.release = threading.Event(), threading.Event()

    def hang(self) -> None:
        self.has_begun.set()
        assert self.release.wait(60.0)

    def stop_all(self) -> dict[str, str]:
        return {}

    def stop(self, robot: str) -> None:
        return None

    panel_stop = stop


def test_emergency_stops_do_not_wait_for_other_operations() -> None:
    operations = Stoppable()

    async def stop_while_others_hang(calls: Calls) -> dict[str, Any]:
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        hanging = loop.create_task(ask_for(calls, "hang", {}))
        try:
            await until(operations.has_begun.is_set)
            orders = {"stop_all": {}, "stop": {"robot": "R1"}, "panel_stop": {"robot": "R1"}}
            return {name: await asyncio.wait_for(ask_for(calls, name, given), 20.0) for name, given in orders.items()}
        finally:
            operations.release.set()
            await hanging

    async def ask_for(calls: Calls, name: str, given: dict[str, Any]) -> Any:
        body = [json.dumps(given).encode()]
        return json.loads((await answer(served(calls, name), "/", "POST", body, content_type="application/json")).body)

    with contextlib.closing(Calls(operations)) as calls:
        answers = asyncio.run(stop_while_others_hang(calls))
    assert answers == {"stop_all": {"answer": {}}, "stop": {"answer": None}, "panel_stop": {"answer": None}}
    assert answers.keys() == STOPS


def test_operations_need_rights_and_orders_the_right_types(tmp_path: Path) -> None:
    operations = Operations(NOBODY)
    operations.add(Part())
    with pytest.raises(ValueError, match="add_up"):
        operations.add(Part())
    operations, supervisor = Operations(NOBODY), tmp_path / "supervisor.ior"
    system = SystemOperations(NOBODY, None, supervisor)
    operations.add(system)
    assert operations.call("rights", {}) == {"administrator": False, "supervisor": False}
    for name, given in (("pause_simulation", {}), ("evict", {"robot": "A"})):
        with pytest.raises(NotPossible, match="rights of an administrator"):
            operations.call(name, given)
    with pytest.raises(Exception, match=r"the supervisor is not reachable: .*supervisor.ior"):
        operations.call("processes", {})
    wrong: list[dict[str, Any]] = [{"name": name} for name in (3, "A\0", "\ud800")]
    wrong += [{"name": "A", "x": 1.0}, *({"name": "A", "x": x, "y": 2} for x in ("1", math.nan, True))]
    for given in (*wrong, {"name": "A", "channel": None}):
        with pytest.raises(InvalidArguments):
            operations.call("start_robot", given)
    for value in (0, 501, 1.0, "1", True, None):
        with pytest.raises(InvalidArguments, match="lines is not a whole number from 1 to 500"):
            arguments.count("lines", value, 500)


def test_impossible_arguments_of_the_monitor() -> None:
    """Of a system without anything."""
    server = {"state": None, "age": None, "problem": "gone"}
    rows = {"naming": "", "server": server, "robots": {}, "channels": {}}
    nothing: Any = SimpleNamespace(start=int, close=int, forget=str, rows=lambda: copy.deepcopy(rows))
    history, view, building = History(), FloorView("L1"), [Building("")]
    view.apply(FloorUpdate("L1", WHOLE, 1, 0.0, 1, [], [], np.empty(0, MOTION), {}))
    history.add(view, 1000.0)
    film, operations = {"floor": "L1", "begin": 1.0, "end": 2.0}, Operations(NOBODY)
    with contextlib.closing(Films()) as films:
        state = MonitorState(nothing, history)
        operations.add(MonitorOperations(state, history, lambda: building[0], Recordings(), films))
        with pytest.raises(NotPossible, match="map is not known"):
            operations.call("start_film", film)
        building[0] = two_floors()
        assert operations.call("recordings", {}) == operations.call("happenings", {}) == []
        for operation, given, error in (
            ("start_film", {**film, "begin": "now"}, InvalidArguments),
            ("start_film", {**film, "floor": 1}, InvalidArguments),
            ("start_film", {**film, "end": math.nan}, InvalidArguments),
            ("start_film", {**film, "begin": 2.0}, NotPossible),
            ("start_film", {**film, "floor": "cellar"}, NotPossible),
            ("start_film", {**film, "floor": "L2"}, RoboCorbaError),
            ("start_film", {**film, "recording": "recording 9"}, NotPossible),
            ("film_state", {"film": "1"}, InvalidArguments),
            ("film_state", {"film": 1}, NotPossible),
            ("cancel_film", {"film": True}, InvalidArguments),
            *(("happenings", {"after": after}, InvalidArguments) for after in ("x", 10**400)),
            ("forget_robot", {"robot": None}, InvalidArguments),
        ):
            with pytest.raises(error):
                operations.call(operation, given)


def test_a_hand_follows_its_target_and_both_mirror_each_other() -> None:
    poser = ProgramOperations(NOBODY)
    ready = [*poser.arm_postures()["ready"] * 2, 0.0, 0.0, 0.0, 0.0]
    pose = poser.hand_poses(ready)["left"]
    wanted = {**pose, "x": pose["x"] + 0.05, "z": pose["z"] + 0.1}
    answer: dict[str, Any] = poser.solve_hand(ready, "left", wanted)
    assert answer["hands"]["left"] == pytest.approx(wanted, abs=1e-5)
    assert answer["joints"][7:] == pytest.approx(ready[7:])  # the other arm stays
    hand = SmartPalBody().hand(Side.LEFT, np.array(answer["joints"]))
    assert hand._asdict() == pytest.approx(answer["hands"]["left"])
    answer = poser.solve_hand(ready, "both", {**pose, "z": pose["z"] + 0.05})
    left, right = (answer["hands"][side] for side in ("left", "right"))
    assert right["y"] == pytest.approx(-left["y"], abs=1e-5)
    assert right["z"] == pytest.approx(left["z"], abs=1e-5)
    with pytest.raises(Unreachable, match="misses the target by"):
        poser.solve_hand(ready, "right", {"x": 2.0, "y": 0.0, "z": 1.0})
    assert poser.arm_postures().keys() == POSTURES.keys()
    zero, still = {"x": 0, "y": 0, "z": 0}, [0.0] * 18
    for joints, side, wrong, match in (
        *((joints, "left", zero, "18 angles") for joints in ([0.0] * 17, "0" * 18, [math.nan] * 18, [10**400] * 18)),
        (still, "<b>", zero, "not left, right or both"),
        *((still, "left", pose, "x, y and z") for pose in ({"x": 0, "y": 0}, {**zero, "w": 1}, None)),
        (still, "left", {**zero, "z": math.inf}, "z is not a number"),
    ):
        with pytest.raises(InvalidArguments, match=match):
            poser.solve_hand(joints, side, wrong)  # type: ignore[arg-type]


ARMS = {"joints": [0.0] * 18}
IDLE = {"condition": "IDLE", "mission": "", "channel": "a", "display": {"text": "waiting for B"}, "actor": ARMS}


def leaders(robots: dict[str, Any], naming: str = "") -> list[dict[str, Any]]:
    return MissionOperations(NOBODY, lambda: {"naming": naming, "robots": robots}, planner_of).leaders()


def row(**state: Any) -> dict[str, Any]:
    return {"state": {**IDLE, **state}, "age": 0.1, "problem": "", "bound": True}


def test_who_can_lead_a_mission() -> None:
    assert leaders({"R1": row()}) == [{"robot": "R1", "channel": "a", "free": True, "why": ""}]
    for robot, why in (
        *((row(condition=condition), "waiting for B") for condition in ("STOPPED", "RUNNING", "PAUSED")),
        (row(mission="M1"), "is in a mission"),
        (row(channel=""), "has no event channel"),
        (row(actor={"joints": []}), "does not have SmartPal's arms"),
        (row(actor={"joints": []}, condition="STOPPED"), "waiting for B"),  # it may not have been read yet
        ({**row(), "state": {"condition": "IDLE", "actor": ARMS}}, "has no event channel"),  # of an earlier release
        *(({**row(), **silent}, "does not answer") for silent in ({"problem": "hangs"}, {"state": None})),
    ):
        (found,) = leaders({"R1": robot})
        assert (found["free"], found["why"]) == (False, why)
    found = leaders({"R2": row(), "R1": row(), "R3": {**row(), "bound": False}})
    assert [each["robot"] for each in found] == ["R1", "R2"]
    with pytest.raises(NotReachable, match="connecting"):
        leaders({}, "connecting")
    assert leaders({"R1": row()}, "does not answer")[0]["free"]


def test_who_would_carry_what_is_known_before_a_mission_and_its_program_begin() -> None:
    at = {"R1": (9.0, 5.5), "R2": (9.0, 1.5)}
    rows = {name: row(at={"floor": "L1", "x": x, "y": y}) for name, (x, y) in at.items()}
    state, standing = {"naming": "", "robots": rows}, [StandingRobot("D", "L1", 3.0, 3.5, 0.3)]
    worlds = (MapWorld(two_storeys(), kg, standing) for kg in (40.0, 2.0))
    places = []

    def make(icon: Icon) -> MakePlanner:
        places.append(missions.object_place("box"))  # others may ask for it meanwhile
        return planner_of(icon)

    heavy, missions = (MissionOperations(NOBODY, lambda: state, make, world) for world in worlds)
    carry = {"icon": "move_table", "table": "box", "to": {"floor": "L1", "x": 3.0, "y": 3.5, "heading": 0.0}}
    assert missions.mission_party("R2", carry) == {"robots": ["R2", "R1"], "aside": ["D"]}
    for change, reason in (
        ({"to": {**carry["to"], "x": 0.0}}, "goal .* is not free"),  # type: ignore[dict-item]
        ({"carriers": 3}, "3 robots are needed; free are R1, R2"),
        ({"table": "chair"}, "there is no object 'chair'"),
    ):
        assert re.search(reason, missions.mission_party("R1", {**carry, **change})["reason"])
    rows["R2"]["state"]["mission"] = "M1"
    assert missions.mission_party("R2", carry) == {"reason": "R2 is not free"}
    assert missions.mission_party("R1", carry, with_busy=True)["robots"] == ["R1", "R2"]
    assert heavy.mission_party("R1", carry) == {"reason": "10 robots would be needed; at most 6 carry together"}
    assert places[0] == {"floor": "L1", "x": 5.4, "y": 3.5}


LIMIT_S = 60.0


def request(is_gone: threading.Event) -> Request:
    async def receive() -> dict[str, Any]:
        while not is_gone.is_set():
            await asyncio.sleep(0.01)
        return {"type": "http.disconnect"}

    return Request({"type": "http"}, receive)


def endless(work: Work) -> None:
    while True:
        work.check()
        work_for(0.001)


def test_work_ends_with_its_client_its_server_or_its_limit() -> None:
    is_gone, work = threading.Event(), Work(LIMIT_S)
    threading.Timer(0.1, is_gone.set).start()
    with pytest.raises(WorkEnded, match="waits no longer"):
        asyncio.run(in_thread(request(is_gone), work, lambda: endless(work)))
    short = Work(0.2)
    with pytest.raises(WorkEnded, match=r"after 0\.2 s, its limit"):
        asyncio.run(in_thread(request(threading.Event()), short, lambda: endless(short)))
    work = Work(LIMIT_S)

    async def serve() -> None:
        serving = asyncio.create_task(in_thread(request(threading.Event()), work, lambda: endless(work)))
        await asyncio.sleep(0.05)
        serving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await serving

    asyncio.run(serve())  # waits for the thread
    with pytest.raises(WorkEnded):
        work.check()
    assert asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), lambda: 7)) == 7
    with pytest.raises(KeyError):
        asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), lambda: {}["x"]))


WAITS = json.dumps({"name": "waits", "icons": [{"icon": "wait", "seconds": number} for number in (1, 2, 3)]})


@pytest.fixture
def agent() -> Any:
    """A robot's agent."""
    agent: Any = create_autospec(RemoteAgent, instance=True)
    progress = ProgramReport("waits", ProgramResult.NO_RESULT, "icons[1]", "wait", "", 1, 1.5)
    place = Pose("L1", 1.0, 2.0, 0.0)
    running = AgentCondition.RUNNING
    agent.name = "robot on 10.0.0.2"
    agent.state.return_value = AgentState(
        "A", "simulated", running, "no reason", place, RobotState(), 1.0, 0.0, progress
    )
    icons = [IconBegun(number, f"icons[{number}]", "wait", float(number)) for number in range(3)]
    agent.begun.side_effect = lambda first: icons[first:]
    agent.check.return_value = CheckReport()
    agent.adaptors.return_value, agent.sensors.return_value = ["simulated", "smartpal"], ["laser"]
    agent.display.return_value = Display(DisplayKind.WAITING, "waiting for an order")
    agent.reports.return_value = [RunReport(number, 1, 5.0, progress) for number in (1, 2)], "2"
    agent.fingerprint.side_effect = "of {}".format
    agent.upload.return_value = 7
    return agent


@pytest.fixture
def operations(agent: Any) -> ProgramOperations:
    def found(name: str) -> RemoteAgent:
        if name not in ("A", "10.0.0.2:2831"):
            raise NotReachable(f"robot {name} does not answer")
        return agent  # type: ignore[no-any-return]

    return ProgramOperations(None, found)  # type: ignore[arg-type]


def findings(answer: dict[str, Any]) -> list[tuple[str, ...]]:
    return [tuple(finding.values()) for finding in answer["findings"]]


def test_examples_are_programs_and_a_check_has_notes_and_python(operations: ProgramOperations, agent: Any) -> None:
    answer = operations.program_schema()
    assert answer["schema"] == programs.schema()
    assert {"home", "tuck"} <= set(answer["postures"])
    examples = operations.example_programs()
    assert "fetch" in examples
    assert all(programs.loads(text).icons for text in examples.values())
    answer = operations.check_program("A", '{"name": "x", "icons": [{"icon": "wait"}]}')  # no program
    assert findings(answer)[0][:3] == ("error", "icons[0]", "seconds")
    assert (answer["python"], agent.method_calls) == ("", [])
    answer = operations.check_program("", WAITS)
    assert findings(answer) == [("note", "", "", "no robot is chosen: drives and arms are not checked")]
    with pytest.raises(NotReachable, match="robot B"):
        operations.check_program("B", WAITS)
    agent.check.return_value.add_note("icons[1]", "is not checked")
    agent.check.return_value.add_finding("icons[2]", "seconds", "is too long")
    answer = operations.check_program("A", WAITS)
    expected = [("error", "icons[2]", "seconds", "is too long"), ("note", "icons[1]", "", "is not checked")]
    assert findings(answer) == expected
    assert "program.wait(2.0)" in answer["python"]


def test_a_program_is_loaded_and_run_unless_it_is_refused(operations: ProgramOperations, agent: Any) -> None:
    for first in (3, 4, -1):
        with pytest.raises(InvalidArguments, match=f"no icon {first}; it has 3"):
            operations.run_program("A", WAITS, first=first)
    agent.load.side_effect = IllegalOrder("load a program", "runs a program")
    with pytest.raises(IllegalOrder):
        operations.run_program("A", WAITS)
    assert not agent.run.called
    agent.load.side_effect = None
    operations.run_program("A", WAITS, step=True)
    operations.run_program("A", WAITS, first=2)
    whole, rest = (programs.loads(each.args[0]) for each in agent.load.call_args_list[-2:])
    assert (whole, rest.icons) == (programs.loads(WAITS), programs.loads(WAITS).icons[2:])
    assert agent.run.call_args_list == [((True,),), ((False,),)]
    agent.program.return_value = WAITS
    assert operations.loaded_program("A") == WAITS
    for order in ("pause", "resume", "step", "abort"):
        getattr(operations, f"{order}_program")("A")
        getattr(agent, order).assert_called_once_with()


def test_a_robots_own_computer_is_found_and_gets_programs(operations: ProgramOperations, agent: Any) -> None:
    found = operations.reach_computer("10.0.0.2", 2831)
    assert [found[name] for name in ("name", "adaptor", "display")] == [agent.name, "simulated", "waiting for an order"]
    assert found["sensors"] == ["laser"] and [each["number"] for each in found["reports"]] == [1, 2]
    json.dumps(found)
    for robot, runs in (("", False), ("A", True)):
        assert not agent.run.called
        answer = operations.upload_program("10.0.0.2", 2831, WAITS, robot, runs)
        assert answer == {"name": agent.name, "number": 7}
        agent.upload.assert_called_with(WAITS, f"of {WAITS}")
    agent.run.assert_called_once_with()
    agent.check.return_value.add_finding("icons[0]", "seconds", "is too long")
    with pytest.raises(InvalidProgram):
        operations.upload_program("10.0.0.2", 2831, WAITS)
    for host, port in (("-x", 2831), ("10.0.0.2", 0), ("", 1), (5, 1), ("10.0.0.2", "1")):
        with pytest.raises((InvalidSetting, InvalidArguments)):
            operations.reach_computer(host, port)  # type: ignore[arg-type]
    with pytest.raises(NotReachable):
        operations.reach_computer("10.0.0.3", 2831)


def test_progress_has_what_is_new_and_the_adaptor_can_be_switched(operations: ProgramOperations, agent: Any) -> None:
    progress = operations.program_progress("A", 2)
    assert progress["begun"] == [{"number": 2, "icon": "icons[2]", "kind": "wait"}]
    assert (progress["report"]["result"], progress["report"]["icon"]) == ("no_result", "icons[1]")
    assert (progress["condition"], progress["adaptor"]) == ("running", "simulated")
    assert len(operations.program_progress("A", 0)["begun"]) == 3
    json.dumps(progress)
    assert operations.adaptors("A") == ["simulated", "smartpal"]
    arguments = ["--naming", "localhost:2809"]
    operations.switch_adaptor("A", "smartpal", arguments)
    agent.switch.assert_called_once_with("smartpal", arguments)
    table = Operations(NOBODY)
    table.add(operations)
    for words in (["x" * MAX_ARGUMENTS, "x"], [1], ["\0"], "-x", 5):
        with pytest.raises(InvalidArguments, match="arguments"):
            table.call("switch_adaptor", {"robot": "A", "adaptor": "smartpal", "arguments": words})
