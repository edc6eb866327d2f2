"""Operations of the touch panel of one robot, which need no more than the robot's PIN."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.console.arguments import InvalidArguments
from robocorba.console.operations import Operations
from robocorba.console.program_operations import ProgramOperations
from robocorba.errors.services import NotReachable

Answer = dict[str, Any]


class PanelOperations:
    """Their names begin with `panel`; `robot` is the robot's name. rows: as MonitorState.rows. All but `panel` raise
    NotReachable if the robot does not answer."""

    def __init__(self, robots: Operations, programs: ProgramOperations, rows: Callable[[], Answer]) -> None:
        self._programs, self._rows = programs, rows
        self._stop = robots.stop
        self._orders: dict[str, Callable[[str], None]] = {
            "pause": programs.pause_program,
            "resume": programs.resume_program,
            "abort": programs.abort_program,
            "reset": robots.reset_stop,
        }

    def panel(self, robot: str) -> Answer:
        """`age` of the last news [s] and `problem`; of the robot, all None before its first answer: `display`,
        `question` (`number`, 0 for none, and `text`), `condition`, `adaptor`, and `program`, the name of the running or
        last one. Raises NotReachable for a robot that was never seen."""
        row = self._rows()["robots"].get(robot)
        if row is None:
            raise NotReachable(f"there is no robot {robot!r:.80}")
        state = row["state"] or {}
        found = {name: state.get(name) for name in ("display", "question", "condition", "adaptor")}
        return {**found, "program": state.get("program", {}).get("name"), "age": row["age"], "problem": row["problem"]}

    def panel_choices(self, robot: str) -> Answer:
        """`adaptors`: names of those that the robot can switch to. `programs`: of the sample programs, and of those in
        the console's folder of programs. `loaded`: of the one that the robot has loaded, empty for none."""
        return {
            "adaptors": self._programs.adaptors(robot),
            "programs": list(self._programs.example_programs()),
            "loaded": self._programs.loaded_name(robot),
        }

    def panel_run(self, robot: str, program: str = "") -> None:
        """Load a program of the choices and run it; without a name the loaded one. Raises InvalidProgram,
        IllegalOrder."""
        programs = self._programs.example_programs()
        if program and program not in programs:
            raise InvalidArguments(f"there is no program {program!r:.80}")
        self._programs.run_program(robot, programs[program] if program else self._programs.loaded_program(robot))

    def panel_order(self, robot: str, order: str) -> None:
        """pause, resume or abort the program, or reset an emergency stop. Raises IllegalOrder, AdaptorFailed."""
        if order not in self._orders:
            raise InvalidArguments(f"there is no order {order!r:.80}")
        self._orders[order](robot)

    def panel_stop(self, robot: str) -> None:
        """Emergency stop of the robot."""
        self._stop(robot)

    def panel_answer(self, robot: str, number: int, yes: bool) -> None:
        """Answer the question of this number. Raises IllegalOrder if it is not asked at present."""
        self._programs.answer_question(robot, number, yes)

    def panel_switch(self, robot: str, adaptor: str) -> None:
        """Connect another robot to the agent, with the arguments with which it was started last. Raises UnknownAdaptor,
        AdaptorFailed, IllegalOrder."""
        self._programs.switch_adaptor(robot, adaptor)
