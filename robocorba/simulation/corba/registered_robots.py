"""The robots that are logged on at the simulation server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.stubs import RoboCorba


def floors_of_robots(orb: Orb) -> Callable[[], dict[str, str]]:
    """What returns the floor of each robot, by its name, and raises NotReachable. Thread-safe; one call for all."""
    what, timeouts_s = "the simulation server", (0.5, 2.0)
    server = RemoteObject(orb, "SimulationServer", RoboCorba.SimulationServer, what, *timeouts_s)

    def floors() -> dict[str, str]:
        clients: list[Any] = server.call(lambda server: server.clients())
        return {client.name: client.at.floor for client in clients}

    return floors
