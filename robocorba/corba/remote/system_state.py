"""What the simulation server, robots and channels report of themselves, as JSON types with the members of the IDL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.corba.orb import Orb
from robocorba.corba.plain import plain
from robocorba.corba.remote.remote_object import RemoteObject
from robocorba.names import CHANNELS, ROBOTS
from robocorba.stubs import RoboCorba

#: Timeout to resolve an object, and of each call [s].
CALL_LIMIT_S = 1.0
#: Asks one object. Raises NotReachable.
Question = Callable[[], Any]


def server_state(orb: Orb) -> Question:
    """The simulation server's `state`, its `clients` and its `sensors`."""
    return _question(orb, "SimulationServer", RoboCorba.SimulationServer, _server)


def robot_state(orb: Orb, name: str) -> Question:
    """The members of RobotAgent::state of a robot."""
    return _question(orb, f"{ROBOTS}/{name}", RoboCorba.RobotAgent, lambda agent: plain(agent._get_state()))


def channel_state(orb: Orb, name: str) -> Question:
    """The members of EventChannel::state of a channel."""
    return _question(orb, f"{CHANNELS}/{name}", RoboCorba.EventChannel, lambda channel: plain(channel.state()))


def _question(orb: Orb, name: str, interface: Any, ask: Callable[[Any], Any]) -> Question:
    remote = RemoteObject(orb, name, interface, name.rpartition("/")[2], CALL_LIMIT_S, CALL_LIMIT_S)
    return lambda: remote.call(ask)


def _server(server: Any) -> dict[str, Any]:
    return {
        "state": plain(server._get_state()),
        "clients": [plain(client) for client in server.clients()],
        "sensors": [plain(sensor) for sensor in server.sensors()],
    }
