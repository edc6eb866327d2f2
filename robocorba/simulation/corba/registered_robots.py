"""The robots that are logged on at the simulation server."""

from __future__ import annotations

from typing import Any

from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.stubs import RoboCorba


class RegisteredRobots:
    """One call for all robots. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        self._server = RemoteObject(
            orb,
            "SimulationServer",
            RoboCorba.SimulationServer,
            "the simulation server",
            resolve_timeout_s=0.5,
            call_timeout_s=2.0,
        )

    def floors(self) -> dict[str, str]:
        """The floor of each robot, by its name. Raises NotReachable."""
        clients: list[Any] = self._server.call(lambda server: server.clients())
        return {client.name: client.at.floor for client in clients}
