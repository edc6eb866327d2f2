"""Operations of the program page: schema and examples, check, run, adaptors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol

import msgspec

from robocorba.console.arguments import InvalidArguments, texts
from robocorba.errors.robots import InvalidProgram
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentState, IconBegun
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.programs import program as programs
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.python_source import python_source
from robocorba.robot.programs.report import CheckReport

#: Timeout for finding a robot [s].
RESOLVE_TIMEOUT_S = 1.0
#: Maximum length of an adaptor's arguments together [characters].
MAX_ARGUMENTS = 2000

Answer = dict[str, Any]


class Agent(Protocol):
    """The part of a RemoteAgent that these operations call."""

    def state(self) -> AgentState: ...

    def program(self) -> str: ...

    def check(self, json: str) -> CheckReport: ...

    def load(self, json: str) -> None: ...

    def run(self, is_stepping: bool = False) -> None: ...

    def begun(self, first: int) -> list[IconBegun]: ...

    def pause(self) -> None: ...

    def resume(self) -> None: ...

    def step(self) -> None: ...

    def abort(self) -> None: ...

    def adaptors(self) -> list[str]: ...

    def switch(self, adaptor: str, argv: Sequence[str]) -> None: ...


class ProgramOperations:
    """Operations of the program page. `robot` is a robot's name, `program` the JSON text of a program file. All of
    them raise NotReachable if the robot does not answer."""

    def __init__(self, orb: Orb, agent: Callable[[str], Agent] | None = None) -> None:
        self._agent = agent or (lambda robot: RemoteAgent(orb, robot, RESOLVE_TIMEOUT_S))

    # ---- what there is ----

    def program_schema(self) -> Answer:
        """`schema`: the JSON schema of program files. `postures`: names of the arms' postures."""
        return {"schema": programs.schema(), "postures": list(POSTURES)}

    def example_programs(self) -> dict[str, str]:
        """The sample programs: JSON text by name."""
        folder = Path(str(files("robocorba") / "samples"))
        return {file.stem: file.read_text() for file in sorted(folder.glob("*.json"))}

    def loaded_program(self, robot: str) -> str:
        """The JSON text of the program that a robot has loaded; empty if there is none."""
        return self._agent(robot).program()

    # ---- check and run ----

    def check_program(self, robot: str, program: str) -> Answer:
        """Check a program from a robot's present state; without a robot only its form.

        `findings`: each with `kind` (error or note), `icon` (its path), `parameter` and `reason`. `is_executable`:
        there is no error. `python`: the program as Python; empty if it can't be read."""
        try:
            read = programs.loads(program)
        except InvalidProgram as error:
            return _checked(CheckReport(error), None)
        if robot:
            return _checked(self._agent(robot).check(program), read)
        report = CheckReport()
        report.add_note("", "no robot is chosen: drives and arms are not checked")
        return _checked(report, read)

    def run_program(self, robot: str, program: str, step: bool = False, first: int = 0) -> None:
        """Load a program and run it from icon `first` on; with `step` it pauses before each icon. Raises InvalidProgram
        (whose icons count from `first`), IllegalOrder."""
        wanted = program
        if first:
            read = programs.loads(program)
            if not 0 < first < len(read.icons):
                raise InvalidArguments(f"the program has no icon {first}; it has {len(read.icons)}")
            wanted = programs.dumps(msgspec.structs.replace(read, icons=read.icons[first:]))
        agent = self._agent(robot)
        agent.load(wanted)
        agent.run(step)

    def pause_program(self, robot: str) -> None:
        """Let the robot slow down and wait. Raises IllegalOrder if it runs no program."""
        self._agent(robot).pause()

    def resume_program(self, robot: str) -> None:
        """Continue a paused program. Raises IllegalOrder if the robot runs none."""
        self._agent(robot).resume()

    def step_program(self, robot: str) -> None:
        """Continue a paused program up to the next icon. Raises IllegalOrder if the robot runs none."""
        self._agent(robot).step()

    def abort_program(self, robot: str) -> None:
        """End a robot's program; the robot slows down and stops."""
        self._agent(robot).abort()

    def program_progress(self, robot: str, first: int) -> Answer:
        """`begun`: icons of the present or last program that have begun from number `first` on, each with `number`,
        `icon` (its path) and `kind`. `report`: `name`, `result` (no_result while it runs), `icon`, `reason`,
        `icons_done`, `seconds`. `condition`, `reason` (why the robot is stopped) and `adaptor` of the robot."""
        agent = self._agent(robot)
        state = agent.state()  # before the icons, so that all icons of an ended program are among them
        begun = agent.begun(first)
        report = state.program
        return {
            "begun": [{"number": icon.number, "icon": icon.icon, "kind": icon.kind} for icon in begun],
            "report": {**report._asdict(), "result": report.result.name.lower()},
            "condition": state.condition.name.lower(),
            "reason": state.reason,
            "adaptor": state.adaptor,
        }

    # ---- virtual and actual robot ----

    def adaptors(self, robot: str) -> list[str]:
        """Names of the adaptors that a robot can switch to."""
        return self._agent(robot).adaptors()

    def switch_adaptor(self, robot: str, adaptor: str, arguments: list[str] | None = None) -> None:
        """Connect another robot to a robot's agent. Raises UnknownAdaptor, AdaptorFailed; IllegalOrder while a program
        runs."""
        words = texts("arguments", arguments or [])
        if sum(map(len, words)) > MAX_ARGUMENTS:
            raise InvalidArguments(f"arguments of an adaptor have at most {MAX_ARGUMENTS} characters together")
        self._agent(robot).switch(adaptor, list(words))


def _checked(report: CheckReport, read: Program | None) -> Answer:
    errors = [
        {"kind": "error", "icon": found.icon, "parameter": found.parameter, "reason": found.reason}
        for found in report.findings
    ]
    notes = [{"kind": "note", "icon": note.icon, "parameter": "", "reason": note.what} for note in report.notes]
    return {
        "findings": errors + notes,
        "is_executable": report.is_valid,
        "python": python_source(read) if read else "",
    }
