"""Operations of the supervisor: the processes of the system, robots to start and end, logs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robocorba.console.arguments import count, number, text, texts
from robocorba.orb.orb import Orb
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.processes import MAX_LOG_LINES, ProcessState, RobotOrder


class ProcessOperations:
    """Operations of the system's supervisor. file: with its reference."""

    def __init__(self, orb: Orb, file: Path) -> None:
        self._supervisor = RemoteSupervisor(orb, file)

    def processes(self) -> list[dict[str, Any]]:
        """All processes of the system: servers, the console, and robots that were started here."""
        return [_row(state) for state in self._supervisor.processes()]

    def start_robot(
        self,
        name: str,
        adaptor: str = "simulated",
        adaptor_arguments: list[str] | None = None,
        floor: str = "",
        x: float | None = None,
        y: float | None = None,
        heading: float = 0.0,
        channel: str = "",
    ) -> None:
        """Start a robot as a process of the system; returns at once. x, y [m] and heading [rad]: its place on `floor`,
        by default the first free path node. floor: empty for the lowest one."""
        at = None
        if x is not None or y is not None:
            at = number("x", x), number("y", y), number("heading", heading)
        arguments = texts("adaptor_arguments", adaptor_arguments or [])
        order = RobotOrder(
            text("name", name), text("adaptor", adaptor), arguments, text("floor", floor), at, text("channel", channel)
        )
        self._supervisor.start_robot(order)

    def end_robot(self, robot: str) -> None:
        """End a robot that was started here; one that has ended is forgotten."""
        self._supervisor.end_robot(text("robot", robot))

    def log_lines(self, process: str, lines: int = 200) -> list[str]:
        """The last lines of a process's log, at most 500."""
        return self._supervisor.log_lines(text("process", process), count("lines", lines, MAX_LOG_LINES))


def _row(state: ProcessState) -> dict[str, Any]:
    return {
        "name": state.name,
        "robot": state.robot,
        "phase": state.phase.value,
        "processId": state.pid,
        "restarts": state.restarts,
        "since": state.since,
        "boundNames": state.bound_names,
        "problem": state.problem,
    }
