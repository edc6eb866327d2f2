"""What the 3D simulator shows of another robot: its path, and its data pool."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.corba.calls import set_call_timeout
from robocorba.corba.conversion import floors
from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import Answer, translated
from robocorba.errors.services import NotReachable
from robocorba.names import ROBOTS
from robocorba.spatial.floor_update import FloorUpdate
from robocorba.stubs import RoboCorba

#: Timeouts for finding the robot and for each call [s].
RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S = 1.0, 2.0


class RemoteRobotView:
    """Client of the robot `name`. Its methods raise NotReachable, the constructor too."""

    def __init__(self, orb: Orb, name: str) -> None:
        self.name = name
        self._agent = orb.resolve(f"{ROBOTS}/{name}", RoboCorba.RobotAgent, RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S)
        self._pool = self._call(self._agent._get_pool)
        if self._pool is None:
            raise NotReachable(f"{name} has no data pool")
        set_call_timeout(self._pool, CALL_TIMEOUT_S)

    def path(self) -> list[dict[str, Any]]:
        """The path that the base drives, from its start: floor, x, y [m], heading [rad] of each point."""
        return [
            {"floor": point.position.floor, "x": point.position.x, "y": point.position.y, "heading": point.heading}
            for point in self._call(self._agent._get_path)
        ]

    def floor(self) -> str:
        """The floor in its data pool."""
        return str(self._call(self._pool._get_floorName))

    def lag_s(self) -> float:
        """Age of the data pool's content [s]."""
        return float(self._call(self._pool._get_lag))

    def changes(self, since: int) -> FloorUpdate:
        """What changed in its data pool since a version."""
        return floors.update_of(self._call(self._pool.changes, since))

    def postures(self, since_s: float) -> list[tuple[str, float, list[float]]]:
        """Robots on its floor that reported joints after `since_s`: name, time [simulated s], joints [rad]."""
        return [
            (posture.robot, posture.time, list(posture.joints)) for posture in self._call(self._pool.postures, since_s)
        ]

    def _call(self, call: Callable[..., Answer], *arguments: Any) -> Answer:
        with translated(f"robot {self.name}"):
            return call(*arguments)
