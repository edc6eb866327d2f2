"""Client of the simulation's administrator."""

from __future__ import annotations

from pathlib import Path

from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import FileObject
from robocorba.stubs import RoboCorba


class RemoteAdministrator:
    """The administrator whose reference is in `file`. Thread-safe. All methods raise NotReachable; the file is read by
    the first call."""

    def __init__(self, orb: Orb, file: Path) -> None:
        interface, what = RoboCorba.SimulationAdministrator, "the simulation's administrator"
        # A long timeout, since `step` waits for the steps.
        self._administrator = FileObject(orb, file, interface, what, call_timeout_s=60.0)

    def set_limit(self, robots: int) -> None:
        """Raises InvalidChoice."""
        self._administrator.call(lambda administrator: administrator.setLimit(robots))

    def evict(self, robot: str) -> None:
        """Raises UnknownRobot."""
        self._administrator.call(lambda administrator: administrator.evict(robot))

    def reset_stop(self, robot: str) -> None:
        """End the stop of a robot without an agent, or that has left. Raises UnknownRobot."""
        self._administrator.call(lambda administrator: administrator.resetStop(robot))

    def keep_out(self, robot: str) -> bool:
        """Log a robot off and keep it out; whether it was logged on. Raises InvalidChoice."""
        return bool(self._administrator.call(lambda administrator: administrator.keepOut(robot)))

    def admit(self, robot: str) -> bool:
        """Let a robot in again; whether it was kept out."""
        return bool(self._administrator.call(lambda administrator: administrator.admit(robot)))

    def kept_out(self) -> list[str]:
        """The names of robots that are kept out, sorted."""
        return list(self._administrator.call(lambda administrator: administrator.keptOut()))

    def set_pace(self, pace: float) -> None:
        """Raises InvalidChoice."""
        self._administrator.call(lambda administrator: administrator.setPace(pace))

    def pause(self) -> None:
        self._administrator.call(lambda administrator: administrator.pause())

    def resume(self) -> None:
        self._administrator.call(lambda administrator: administrator.resume())

    def step(self, steps: int) -> None:
        """Raises InvalidChoice."""
        self._administrator.call(lambda administrator: administrator.step(steps))

    def place(self, body: str, at: Pose) -> None:
        """Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice."""
        self._administrator.call(lambda administrator: administrator.place(body, RoboCorba.Pose(*at)))
