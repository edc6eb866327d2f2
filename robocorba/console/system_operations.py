"""Operations with the rights of the simulation's administrator (pause, pace, step, evict, place), and of the system's
supervisor (processes, robots to start and end, logs)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robocorba.console.arguments import NotPossible, count, number
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_administrator import RemoteAdministrator
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.processes import MAX_LOG_LINES, ProcessState, RobotOrder


class SystemOperations:
    """Operations with the rights of the simulation's administrator, and of the system's supervisor.

    administrator, supervisor: files with their references; administrator: None for no rights."""

    def __init__(self, orb: Orb, administrator: Path | None, supervisor: Path) -> None:
        self._administrator = RemoteAdministrator(orb, administrator) if administrator else None
        self._supervisor, self._supervisor_file = RemoteSupervisor(orb, supervisor), supervisor

    def rights(self) -> dict[str, bool]:
        """What this console may do: as the administrator of the simulation, and with the supervisor's processes."""
        return {"administrator": self._administrator is not None, "supervisor": self._supervisor_file.is_file()}

    # ---- the administrator ----

    def pause_simulation(self) -> None:
        """Pause simulated time."""
        self._with_rights().pause()

    def resume_simulation(self) -> None:
        """Let simulated time go on."""
        self._with_rights().resume()

    def set_pace(self, pace: float) -> None:
        """Set the simulated seconds per second; 1: real time, 0: as many as possible, at most 1000."""
        self._with_rights().set_pace(pace)

    def step_simulation(self, steps: int = 1) -> None:
        """Simulate some steps of 0.02 s while time is paused."""
        self._with_rights().step(count("steps", steps, 10_000))  # more would take longer than a call may

    def evict(self, robot: str) -> None:
        """Log a robot off."""
        self._with_rights().evict(robot)

    def place(self, body: str, floor: str, x: float, y: float, heading: float = 0.0) -> None:
        """Put a robot or a movable object at a place [m, rad], at rest; an object that is held is released."""
        self._with_rights().place(body, Pose(floor, x, y, heading))

    def _with_rights(self) -> RemoteAdministrator:
        if self._administrator is None:
            raise NotPossible("this needs a console with the rights of an administrator")
        return self._administrator

    # ---- the supervisor ----

    def processes(self) -> list[dict[str, Any]]:
        """All processes of the system: servers, the console, and robots that were started here."""
        return [_row(state) for state in self._supervisor.processes()]

    def start_robot(
        self,
        name: str,
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
            at = number("x", x), number("y", y), heading
        self._supervisor.start_robot(RobotOrder(name, floor=floor, at=at, channel=channel))

    def end_robot(self, robot: str) -> None:
        """End a robot that was started here; one that has ended is forgotten."""
        self._supervisor.end_robot(robot)

    def log_lines(self, process: str, lines: int = 200) -> list[str]:
        """The last lines of a process's log, at most 500."""
        return self._supervisor.log_lines(process, count("lines", lines, MAX_LOG_LINES))


def _row(state: ProcessState) -> dict[str, Any]:
    return {
        "name": state.name,
        "robot": state.robot,
        "phase": state.phase.value,
        "restarts": state.restarts,
        "since": state.since,
        "problem": state.problem,
    }
