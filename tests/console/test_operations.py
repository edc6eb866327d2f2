"""Operations of the pages: hostile requests are answered in JSON and in words, and the console goes on."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from robocorba.console import arguments
from robocorba.console.arguments import InvalidArguments
from robocorba.console.calls import MAX_BODY, STOPS, Calls
from robocorba.console.films import Films, InvalidFilm
from robocorba.console.history import History
from robocorba.console.kinematics_operations import InvalidPosture, KinematicsOperations
from robocorba.console.leaving import in_thread
from robocorba.console.mission_operations import MissionOperations
from robocorba.console.monitor_operations import MonitorOperations
from robocorba.console.monitor_state import MonitorState
from robocorba.console.operations import Operations
from robocorba.console.process_operations import ProcessOperations
from robocorba.console.recordings import Recordings, UnknownRecording
from robocorba.console.simulation_operations import SimulationOperations
from robocorba.decoding import Work
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.files import WorkEnded
from robocorba.errors.robots import Unreachable
from robocorba.errors.services import NotReachable
from robocorba.errors.simulation import UnknownRobot
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.smartpal import Side
from robocorba.kinematics.tasks import POSTURES
from robocorba.maps.model import Building
from robocorba.spatial.floor_update import MOTION, WHOLE, FloorUpdate, FloorView
from robocorba.testing.buildings import two_floors
from tests.console.asgi import answer, ask
from tests.waits import work_for

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


def test_answers() -> None:
    assert call("add_up", b'{"a": 2}') == {"answer": 3}
    assert call("add_up", b'{"a": 2, "b": 5}', "application/json; charset=utf-8") == {"answer": 7}
    assert call("refuse") == {"error": "no robot called <script> is logged on"}


@pytest.mark.parametrize("body", [b"", b"no", b"[]", b"null", b"1", b"\xff\xfe", b'{"a":', b"[" * 100_000])
def test_what_is_no_json_object_is_refused(body: bytes) -> None:
    assert "the request is not" in call("add_up", body)["error"]


def test_forms_of_other_sites_and_requests_that_are_too_long_are_refused() -> None:
    assert "not a JSON object" in call("add_up", b'{"a": 1}', "text/plain")["error"]
    assert "longer than" in call("add_up", b'{"a": "' + b"x" * MAX_BODY + b'"}')["error"]


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


def test_only_operations_can_be_called_and_their_defects_show_nothing_of_the_console() -> None:
    for name in ("nothing", "_hidden", "also_hidden", "add", "call", "__init__", "x" * 5000, "../stop"):
        error = call(name)["error"]
        assert error.startswith("there is no operation") and len(error) < 200
    for name in ("break_down", "not_json", "not_a_number"):
        assert call(name) == {"error": "the console failed; its log says why"}


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


def test_emergency_stops_do_not_wait_for_other_operations() -> None:
    operations = Stoppable()

    async def stop_while_others_hang(calls: Calls) -> dict[str, Any]:
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        hanging = loop.create_task(ask_for(calls, "hang", {}))
        try:
            while not operations.has_begun.is_set():
                await asyncio.sleep(0.001)
            orders = {"stop_all": {}, "stop": {"robot": "R1"}}
            return {name: await asyncio.wait_for(ask_for(calls, name, given), 20.0) for name, given in orders.items()}
        finally:
            operations.release.set()
            await hanging

    async def ask_for(calls: Calls, name: str, given: dict[str, Any]) -> Any:
        body = [json.dumps(given).encode()]
        return json.loads((await answer(served(calls, name), "/", "POST", body, content_type="application/json")).body)

    with contextlib.closing(Calls(operations)) as calls:
        answers = asyncio.run(stop_while_others_hang(calls))
    assert answers == {"stop_all": {"answer": {}}, "stop": {"answer": None}}
    assert answers.keys() == STOPS


def test_two_parts_can_not_have_the_same_operation() -> None:
    operations = Operations(NOBODY)
    operations.add(Part())
    with pytest.raises(ValueError, match="add_up"):
        operations.add(Part())


def test_without_rights_the_simulation_is_left_alone_and_without_a_supervisor_its_place_named(
    tmp_path: Path,
) -> None:
    operations, supervisor = Operations(NOBODY), tmp_path / "supervisor.ior"
    operations.add(SimulationOperations(NOBODY, None, supervisor))
    assert operations.call("rights", {}) == {"administrator": False, "supervisor": False}
    for name, given in (("pause_simulation", {}), ("evict", {"robot": "A"})):
        with pytest.raises(Exception, match="--administrator FILE"):
            operations.call(name, given)
    operations.add(ProcessOperations(NOBODY, supervisor))
    with pytest.raises(Exception, match=r"the supervisor is not reachable: .*supervisor.ior"):
        operations.call("processes", {})


def test_orders_of_the_wrong_types_are_refused(tmp_path: Path) -> None:
    operations = ProcessOperations(NOBODY, tmp_path / "supervisor.ior")
    wrong: list[dict[str, Any]] = [{"name": name} for name in (3, "A\0", "\ud800", "A" * 5000)]
    wrong += [{"name": "A", "x": 1.0}, *({"name": "A", "x": x, "y": 2} for x in ("1", math.nan, True))]
    wrong += [{"name": "A", **others} for others in ({"adaptor_arguments": "-x"}, {"adaptor_arguments": [1]})]
    for given in (*wrong, {"name": "A", "channel": None}):
        with pytest.raises(InvalidArguments):
            operations.start_robot(**given)
    for value in (0, 501, 1.0, "1", True, None):
        with pytest.raises(InvalidArguments, match="lines is not a whole number from 1 to 500"):
            arguments.count("lines", value, 500)


NOBODY: Any = None
Make = Callable[[Building], MonitorOperations]


class NoState:
    """A system without anything."""

    def start(self) -> None: ...
    def close(self) -> None: ...
    def forget(self, robot: str) -> None: ...

    def rows(self) -> dict[str, Any]:
        server = {"state": None, "age": None, "problem": "gone"}
        return {"naming": "", "server": server, "robots": {}, "channels": {}}


@pytest.fixture
def make() -> Iterator[Make]:
    history, view = History(), FloorView("L1")
    view.apply(FloorUpdate("L1", WHOLE, 1, 0.0, 1, [], [], np.empty(0, MOTION), {}))
    history.add(view, 1000.0)
    with contextlib.closing(Films()) as films:
        yield lambda building: MonitorOperations(
            MonitorState(NoState(), history), history, lambda: building, Recordings(), films
        )


@pytest.mark.parametrize(
    ("operation", "arguments", "error"),
    [
        ("start_film", {"floor": "L1", "begin": "now", "end": 2.0}, InvalidArguments),
        ("start_film", {"floor": 1, "begin": 1.0, "end": 2.0}, InvalidArguments),
        ("start_film", {"floor": "L1", "begin": 1.0, "end": float("nan")}, InvalidArguments),
        ("start_film", {"floor": "L1", "begin": 2.0, "end": 2.0}, InvalidFilm),
        ("start_film", {"floor": "cellar", "begin": 1.0, "end": 2.0}, InvalidFilm),
        ("start_film", {"floor": "L2", "begin": 1.0, "end": 2.0}, RoboCorbaError),
        ("start_film", {"floor": "L1", "begin": 1.0, "end": 2.0, "recording": "recording 9"}, UnknownRecording),
        ("film_state", {"film": "1"}, InvalidArguments),
        ("film_state", {"film": 1}, InvalidFilm),
        ("cancel_film", {"film": True}, InvalidArguments),
        ("happenings", {"after": "x"}, InvalidArguments),
        ("happenings", {"after": 10**400}, InvalidArguments),
        ("forget_robot", {"robot": None}, InvalidArguments),
    ],
)
def test_impossible_arguments(make: Make, operation: str, arguments: dict[str, Any], error: type[Exception]) -> None:
    operations = Operations(NOBODY)
    operations.add(make(two_floors()))
    with pytest.raises(error):
        operations.call(operation, arguments)


def test_no_film_before_the_map_is_known_and_nothing_in_a_system_without_anything(make: Make) -> None:
    with pytest.raises(InvalidFilm, match="map is not known"):
        make(Building("")).start_film("L1", 1.0, 2.0)
    assert make(two_floors()).recordings() == make(two_floors()).happenings() == []


@pytest.fixture(scope="module")
def poser() -> KinematicsOperations:
    return KinematicsOperations()


@pytest.fixture(scope="module")
def ready(poser: KinematicsOperations) -> list[float]:
    return [*poser.arm_postures()["ready"] * 2, 0.0, 0.0, 0.0, 0.0]


def test_a_hand_follows_its_target_and_both_mirror_each_other(poser: KinematicsOperations, ready: list[float]) -> None:
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


@pytest.mark.parametrize(
    ("joints", "side", "pose", "match"),
    [
        ([0.0] * 17, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ("0" * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([math.nan] * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([10**400] * 18, "left", {"x": 0, "y": 0, "z": 0}, "18 angles"),
        ([0.0] * 18, "<b>", {"x": 0, "y": 0, "z": 0}, "not left, right or both"),
        ([0.0] * 18, "left", {"x": 0, "y": 0}, "x, y and z"),
        ([0.0] * 18, "left", {"x": 0, "y": 0, "z": 0, "w": 1}, "x, y and z"),
        ([0.0] * 18, "left", {"x": 0, "y": 0, "z": math.inf}, "z is not a number"),
        ([0.0] * 18, "left", None, "x, y and z"),
    ],
)
def test_bad_input_is_refused(poser: KinematicsOperations, joints: Any, side: Any, pose: Any, match: str) -> None:
    with pytest.raises(InvalidPosture, match=match):
        poser.solve_hand(joints, side, pose)


NOBODY: Any = None
IDLE = {"condition": "IDLE", "reason": "", "mission": "", "channel": "a"}


def leaders(robots: dict[str, Any], naming: str = "") -> list[dict[str, Any]]:
    return MissionOperations(NOBODY, lambda: {"naming": naming, "robots": robots}).leaders()


def row(**state: str) -> dict[str, Any]:
    return {"state": {**IDLE, **state}, "age": 0.1, "problem": "", "bound": True}


def test_an_idle_robot_is_free_and_why_others_are_not() -> None:
    assert leaders({"R1": row()}) == [{"robot": "R1", "channel": "a", "free": True, "why": ""}]
    for robot, why in (
        (row(condition="STOPPED", reason="emergency stop"), "is stopped: emergency stop"),
        (row(mission="M1"), "is in mission M1"),
        *((row(condition=condition), "runs a program") for condition in ("RUNNING", "PAUSED")),
        (row(channel=""), "has no event channel"),
        ({**row(), "state": {"condition": "IDLE", "reason": ""}}, "has no event channel"),  # of an earlier release
        *(({**row(), **silent}, "does not answer") for silent in ({"problem": "hangs"}, {"state": None})),
    ):
        (found,) = leaders({"R1": robot})
        assert (found["free"], found["why"]) == (False, why)


def test_robots_that_have_left_are_no_leaders_and_without_the_naming_service_nobody_knows() -> None:
    found = leaders({"R2": row(), "R1": row(), "R3": {**row(), "bound": False}})
    assert [each["robot"] for each in found] == ["R1", "R2"]
    with pytest.raises(NotReachable, match="connecting"):
        leaders({}, "connecting")
    assert leaders({"R1": row()}, "does not answer")[0]["free"]


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


def test_work_ends_with_its_client_or_after_its_limit() -> None:
    is_gone, work = threading.Event(), Work(LIMIT_S)
    threading.Timer(0.1, is_gone.set).start()
    with pytest.raises(WorkEnded, match="nobody waits"):
        asyncio.run(in_thread(request(is_gone), work, lambda: endless(work)))
    short = Work(0.2)
    with pytest.raises(WorkEnded, match=r"after 0\.2 s, its limit"):
        asyncio.run(in_thread(request(threading.Event()), short, lambda: endless(short)))


def test_work_ends_with_its_server() -> None:
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


def test_the_result_and_errors_arrive() -> None:
    assert asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), lambda: 7)) == 7
    with pytest.raises(KeyError):
        asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), lambda: {}["x"]))
