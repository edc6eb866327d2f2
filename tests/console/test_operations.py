"""Calls of operations: hostile requests are answered in JSON and in words, and the console goes on."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from robocorba.console import arguments
from robocorba.console.arguments import InvalidArguments
from robocorba.console.calls import MAX_BODY, STOPS, Calls
from robocorba.console.operations import Operations
from robocorba.console.process_operations import ProcessOperations
from robocorba.console.simulation_operations import SimulationOperations
from robocorba.errors.simulation import UnknownRobot
from tests.console.asgi import answer, ask

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


def test_forms_of_other_sites_are_refused() -> None:
    assert "not a JSON object" in call("add_up", b'{"a": 1}', "text/plain")["error"]


def test_a_request_that_is_too_long_is_refused() -> None:
    assert "longer than" in call("add_up", b'{"a": "' + b"x" * MAX_BODY + b'"}')["error"]


@pytest.mark.parametrize("body", [b"{}", b'{"a": 1, "c": 2}', b'{"": 1}', b'{"a": 1, "self": 2}'])
def test_wrong_arguments_are_named(body: bytes) -> None:
    assert call("add_up", body)["error"].startswith("add_up: ")


@pytest.mark.parametrize("value", ["1", None, 1.5, True, [], {}, -1, 2**53 + 1, 10**400])
def test_arguments_of_another_type_are_named(value: object) -> None:
    assert call("add_up", json.dumps({"a": value}).encode())["error"] == "a is not a whole number"


@pytest.mark.parametrize("value", ["1", None, True, [], float("nan"), float("inf"), 10**400])
def test_numbers_that_are_none_are_refused(value: object) -> None:
    assert call("drive", json.dumps({"speed": value}).encode())["error"] == "speed is not a number"


@pytest.mark.parametrize("value", [1, None, [], "\0", "\ud800"])
def test_texts_that_can_not_be_sent_are_refused(value: object) -> None:
    assert call("stop", json.dumps({"robot": value}).encode())["error"] == "robot is not a text that can be sent"


@pytest.mark.parametrize(
    "name", ["nothing", "_hidden", "also_hidden", "add", "call", "__init__", "x" * 5000, "../stop"]
)
def test_only_operations_can_be_called(name: str) -> None:
    assert call(name)["error"].startswith("there is no operation")
    assert len(call(name)["error"]) < 200


@pytest.mark.parametrize("name", ["break_down", "not_json", "not_a_number"])
def test_defects_show_nothing_of_the_console(name: str) -> None:
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


def test_without_rights_the_simulation_is_left_alone(tmp_path: Any) -> None:
    operations = Operations(NOBODY)
    operations.add(SimulationOperations(NOBODY, None, tmp_path / "supervisor.ior"))
    assert operations.call("rights", {}) == {"administrator": False, "supervisor": False}
    for name, given in (("pause_simulation", {}), ("evict", {"robot": "A"})):
        with pytest.raises(Exception, match="--administrator FILE"):
            operations.call(name, given)


def test_without_a_supervisor_it_says_where_it_looked(tmp_path: Any) -> None:
    operations = Operations(NOBODY)
    operations.add(ProcessOperations(NOBODY, tmp_path / "supervisor.ior"))
    with pytest.raises(Exception, match=r"the supervisor is not reachable: .*supervisor.ior"):
        operations.call("processes", {})


@pytest.mark.parametrize(
    "given",
    [
        {"name": 3},
        {"name": "A\0"},
        {"name": "\ud800"},
        {"name": "A" * 5000},
        {"name": "A", "x": 1.0},
        {"name": "A", "x": "1", "y": 2},
        {"name": "A", "x": float("nan"), "y": 2},
        {"name": "A", "x": True, "y": 2},
        {"name": "A", "adaptor_arguments": "-x"},
        {"name": "A", "adaptor_arguments": [1]},
        {"name": "A", "channel": None},
    ],
)
def test_orders_of_the_wrong_types_are_refused(given: dict[str, Any], tmp_path: Any) -> None:
    with pytest.raises(InvalidArguments):
        ProcessOperations(NOBODY, tmp_path / "supervisor.ior").start_robot(**given)


@pytest.mark.parametrize("value", [0, 501, 1.0, "1", True, None])
def test_counts(value: Any) -> None:
    with pytest.raises(InvalidArguments, match="lines is not a whole number from 1 to 500"):
        arguments.count("lines", value, 500)
