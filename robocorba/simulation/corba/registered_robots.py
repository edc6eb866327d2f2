"""The robots that are logged on at the simulation server."""

from __future__ import annotations

from typing import Any

from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.stubs import RoboCorba

#: Timeouts to resolve the server, and of a call [s].
RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S = 0.5, 2.0


class RegisteredRobots:
    """One call for all robots. Thread-safe."""

    def __init__(self, orb: Orb) -> None:
        timeouts = RESOLVE_TIMEOUT_S, CALL_TIMEOUT_S
        self._server = RemoteObject(
            orb, "SimulationServer", RoboCorba.SimulationServer, "the simulation server", *timeouts
        )

    def floors(self) -> dict[str, str]:
        """The floor of each robot, by its name. Raises NotReachable."""
        clients: list[Any] = self._server.call(lambda server: server.clients())
        return {client.name: client.at.floor for client in clients}
