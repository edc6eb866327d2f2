"""Operations of the simulation server's administrator: pause, pace, step, evict, place."""

from __future__ import annotations

from pathlib import Path

from robocorba.console.arguments import count, text
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.simulation.corba.remote_administrator import RemoteAdministrator

#: Steps at most in one call; more would take longer than a call may.
MAX_STEPS = 10_000


class NoRights(RoboCorbaError):
    """The console has not been given the administrator's reference."""

    def __init__(self) -> None:
        super().__init__(
            "this needs the administrator's rights: start the console with --administrator FILE "
            "(administrator.ior of the state folder)"
        )


class SimulationOperations:
    """Operations of the simulation's administrator.

    administrator, supervisor: files with their references; administrator: None for no rights."""

    def __init__(self, orb: Orb, administrator: Path | None, supervisor: Path) -> None:
        self._remote = RemoteAdministrator(orb, administrator) if administrator else None
        self._supervisor_file = supervisor

    def rights(self) -> dict[str, bool]:
        """What this console may do: as the administrator of the simulation, and with the supervisor's processes."""
        return {"administrator": self._remote is not None, "supervisor": self._supervisor_file.is_file()}

    def pause_simulation(self) -> None:
        """Pause simulated time."""
        self._administrator().pause()

    def resume_simulation(self) -> None:
        """Let simulated time go on."""
        self._administrator().resume()

    def set_pace(self, pace: float) -> None:
        """Set the simulated seconds per second; 1: real time, 0: as many as possible, at most 1000."""
        self._administrator().set_pace(pace)

    def step_simulation(self, steps: int = 1) -> None:
        """Simulate some steps of 0.02 s while time is paused."""
        self._administrator().step(count("steps", steps, MAX_STEPS))

    def evict(self, robot: str) -> None:
        """Log a robot off."""
        self._administrator().evict(text("robot", robot))

    def place(self, body: str, floor: str, x: float, y: float, heading: float = 0.0) -> None:
        """Put a robot or a movable object at a place [m, rad], at rest; an object that is held is released."""
        at = Pose(text("floor", floor), x, y, heading)
        self._administrator().place(text("body", body), at)

    def _administrator(self) -> RemoteAdministrator:
        if self._remote is None:
            raise NoRights()
        return self._remote
