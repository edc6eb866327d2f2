"""Operations of the program page, on an agent that records its calls."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from typing import Any

import pytest

from robocorba.console.operations import InvalidArguments, Operations
from robocorba.console.program_operations import MAX_ARGUMENTS, ProgramOperations
from robocorba.control.agent_state import AgentCondition, AgentState, IconBegun, ProgramReport, ProgramResult
from robocorba.errors.robots import IllegalOrder, InvalidProgram
from robocorba.errors.services import NotReachable
from robocorba.motion.robot_state import RobotState
from robocorba.programs import program as programs
from robocorba.programs.program import Program
from robocorba.programs.report import CheckReport
from robocorba.simulation.registry import Pose

WAITS = json.dumps({"name": "waits", "icons": [{"icon": "wait", "seconds": number} for number in (1, 2, 3)]})


class Agent:
    """A robot's agent. calls: names of the orders that it got."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.loaded: Program | None = None
        self.is_stepping = False
        self.report = CheckReport()
        self.progress = ProgramReport("waits", ProgramResult.NO_RESULT, "icons[1]", "wait", "", 1, 1.5)
        self.icons = [IconBegun(number, f"icons[{number}]", "wait", float(number)) for number in range(3)]
        self.switched: tuple[str, Sequence[str]] = ("", ())
        self.is_running = False
        for order in ("pause", "resume", "step", "abort"):
            setattr(self, order, functools.partial(self.calls.append, order))

    def state(self) -> AgentState:
        at, moving = Pose("L1", 1.0, 2.0, 0.0), AgentCondition.RUNNING
        return AgentState("A", "simulated", moving, "no reason", at, RobotState(), 1.0, 0.0, self.progress)

    def program(self) -> str:
        return programs.dumps(self.loaded) if self.loaded else ""

    def check(self, json: str) -> CheckReport:
        self.calls.append("check")
        return self.report

    def load(self, json: str) -> None:
        if self.is_running:
            raise IllegalOrder("load a program", "runs a program")
        self.loaded = programs.loads(json)

    def run(self, is_stepping: bool = False) -> None:
        self.calls.append("run")
        self.is_stepping = is_stepping

    def begun(self, first: int) -> list[IconBegun]:
        return self.icons[first:]

    def adaptors(self) -> list[str]:
        return ["simulated", "smartpal"]

    def switch(self, adaptor: str, argv: Sequence[str]) -> None:
        self.switched = adaptor, argv


@pytest.fixture
def agent() -> Agent:
    return Agent()


@pytest.fixture
def operations(agent: Agent) -> ProgramOperations:
    def found(name: str) -> Agent:
        if name != "A":
            raise NotReachable(f"robot {name} does not answer")
        return agent

    return ProgramOperations(None, found)  # type: ignore[arg-type]


def findings(answer: dict[str, Any]) -> list[tuple[str, ...]]:
    return [tuple(finding.values()) for finding in answer["findings"]]


def test_the_schema_is_that_of_program_files_and_examples_are_programs(operations: ProgramOperations) -> None:
    answer = operations.program_schema()
    assert answer["schema"] == programs.schema()
    assert {"home", "tuck"} <= set(answer["postures"])
    examples = operations.example_programs()
    assert "fetch" in examples
    for text in examples.values():
        assert programs.loads(text).icons


def test_a_check_has_errors_notes_and_python(operations: ProgramOperations, agent: Agent) -> None:
    agent.report.add_note("icons[1]", "is not checked")
    agent.report.add_finding("icons[2]", "seconds", "is too long")
    answer = operations.check_program("A", WAITS)
    assert findings(answer) == [
        ("error", "icons[2]", "seconds", "is too long"),
        ("note", "icons[1]", "", "is not checked"),
    ]
    assert not answer["is_executable"]
    assert "program.wait(2.0)" in answer["python"]


def test_what_is_no_program_is_a_finding_and_asks_nobody(operations: ProgramOperations, agent: Agent) -> None:
    answer = operations.check_program("A", '{"name": "x", "icons": [{"icon": "wait"}]}')
    assert findings(answer)[0][:3] == ("error", "icons[0]", "seconds")
    assert (answer["is_executable"], answer["python"], agent.calls) == (False, "", [])
    answer = operations.check_program("", WAITS)
    assert answer["is_executable"]
    assert findings(answer) == [("note", "", "", "no robot is chosen: drives and arms are not checked")]
    with pytest.raises(NotReachable, match="robot B"):
        operations.check_program("B", WAITS)


def test_a_program_is_loaded_and_run(operations: ProgramOperations, agent: Agent) -> None:
    operations.run_program("A", WAITS, step=True)
    assert (agent.loaded, agent.is_stepping) == (programs.loads(WAITS), True)
    assert programs.loads(operations.loaded_program("A")) == agent.loaded
    operations.run_program("A", WAITS, first=2)
    assert agent.loaded is not None
    assert agent.loaded.icons == programs.loads(WAITS).icons[2:]
    for order in ("pause", "resume", "step", "abort"):
        getattr(operations, f"{order}_program")("A")
    assert agent.calls == ["run", "run", "pause", "resume", "step", "abort"]


def test_a_program_that_is_refused_does_not_run(operations: ProgramOperations, agent: Agent) -> None:
    for first in (3, -1):
        with pytest.raises(InvalidArguments, match=f"no icon {first}; it has 3"):
            operations.run_program("A", WAITS, first=first)
    with pytest.raises(InvalidProgram):
        operations.run_program("A", "{}")
    agent.is_running = True
    with pytest.raises(IllegalOrder):
        operations.run_program("A", WAITS)
    assert agent.calls == []


def test_progress_has_what_is_new(operations: ProgramOperations) -> None:
    progress = operations.program_progress("A", 2)
    assert progress["begun"] == [{"number": 2, "icon": "icons[2]", "kind": "wait"}]
    assert (progress["report"]["result"], progress["report"]["icon"]) == ("no_result", "icons[1]")
    assert (progress["condition"], progress["adaptor"]) == ("running", "simulated")
    assert len(operations.program_progress("A", 0)["begun"]) == 3
    json.dumps(progress)


def test_another_robot_behind_the_agent(operations: ProgramOperations, agent: Agent) -> None:
    assert operations.adaptors("A") == ["simulated", "smartpal"]
    operations.switch_adaptor("A", "smartpal", ["--naming", "localhost:2809"])
    assert agent.switched == ("smartpal", ["--naming", "localhost:2809"])
    for arguments in (["x" * MAX_ARGUMENTS, "x"], [1], ["\0"], "-x", 5):
        with pytest.raises(InvalidArguments, match="arguments"):
            operations.switch_adaptor("A", "smartpal", arguments)  # type: ignore[arg-type]


def test_operations_are_called_by_name_and_a_property_that_raises_is_none(operations: ProgramOperations) -> None:
    class Part:
        @property
        def _rights(self) -> None:
            raise NotReachable("nobody")

        def answer(self) -> int:
            """42."""
            return 42

    table = Operations(None)  # type: ignore[arg-type]
    table.add(operations)
    table.add(Part())
    assert table.call("adaptors", {"robot": "A"}) == ["simulated", "smartpal"]
    with pytest.raises(InvalidArguments):
        table.call("run_program", {"robot": "A"})
    assert table.call("answer", {}) == 42
