"""What the 3D simulator shows of another robot: its path, and its data pool."""

from __future__ import annotations

from typing import Any

from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_data_pool import CALL_TIMEOUT_S, RemotePool, pool_of
from robocorba.stubs import RoboCorba
from robocorba.system.names import ROBOTS

#: Timeout for finding the robot [s].
RESOLVE_TIMEOUT_S = 1.0


class RemoteRobotView(RemotePool):
    """Client of the robot `name` and of its data pool. The constructor raises NotReachable too."""

    def __init__(self, orb: Orb, name: str) -> None:
        self._agent = orb.resolve(f"{ROBOTS}/{name}", RoboCorba.RobotAgent, RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S)
        super().__init__(pool_of(self._agent, name), f"robot {name}")

    def path(self) -> list[dict[str, Any]]:
        """The path that the base drives, from its start: floor, x, y [m], heading [rad] of each point."""
        return [
            {"floor": point.position.floor, "x": point.position.x, "y": point.position.y, "heading": point.heading}
            for point in self._answer(self._agent._get_path)
        ]
