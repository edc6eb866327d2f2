"""Client of the simulation server's administrator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import translated
from robocorba.errors.services import NotReachable
from robocorba.spatial.pose import Pose
from robocorba.stubs import RoboCorba

#: Timeout of a call [s]; the server stores most changes on disk before it answers.
CALL_TIMEOUT_S = 8.0
Answer = TypeVar("Answer")


class RemoteAdministrator:
    """The administrator whose reference is in a file, which is read in each call: a server may have been replaced.

    Every method raises NotReachable if there is no such file or the server does not answer. Thread-safe."""

    def __init__(self, orb: Orb, file: Path) -> None:
        self._orb, self._file = orb, file

    def place(self, body: str, at: Pose) -> None:
        """Put a robot or a movable object at a pose, at rest, and release what is gripped.

        Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice."""
        self._call(lambda to: to.place(body, RoboCorba.Pose(*at)))

    def evict(self, robot: str) -> None:
        """Log a robot off. Raises UnknownRobot."""
        self._call(lambda to: to.evict(robot))

    def set_limit(self, robots: int) -> None:
        """Limit the number of robots. Raises InvalidChoice."""
        self._call(lambda to: to.setLimit(robots))

    def set_pace(self, pace: float) -> None:
        """Set the simulated seconds per second, 0 for as fast as possible. Raises InvalidChoice."""
        self._call(lambda to: to.setPace(pace))

    def pause(self) -> None:
        """Pause simulated time."""
        self._call(lambda to: to.pause())

    def resume(self) -> None:
        """Resume simulated time."""
        self._call(lambda to: to.resume())

    def _call(self, operation: Callable[[Any], Answer]) -> Answer:
        try:
            text = self._file.read_text()
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "it is no text"
            raise NotReachable(f"there is no administrator's reference in {self._file} ({reason})") from None
        with translated("the simulation server"):
            return operation(self._orb.reference(text, RoboCorba.SimulationAdministrator, CALL_TIMEOUT_S))
