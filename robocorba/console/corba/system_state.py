"""What the simulation server, robots and channels report of themselves, as JSON types with the members of the IDL."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.orb.plain import plain
from robocorba.orb.remote_object import RemoteObject
from robocorba.robot.corba.remote_agent import question_of, shown_by
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS, ROBOTS

#: Timeout to resolve an object, and of each call [s].
CALL_LIMIT_S = 1.0
#: Decimals of the points of a path [m].
DECIMALS = 2
#: Asks one object. Raises NotReachable.
Question = Callable[[], Any]


def server_state(orb: Orb) -> Question:
    """The simulation server's `state`, `stopOfAll`, `clients` and `sensors`."""
    return _question(orb, "SimulationServer", RoboCorba.SimulationServer, _server)


def robot_state(orb: Orb, name: str) -> Question:
    """The members of RobotAgent::state of a robot; its `display`: `kind` (working, waiting, exceptional), `text` and
    `seconds`; its `question`: `number`, 0 for none, and `text`; its `channel` and `mission`, and the `path` that it
    drives: for each floor in turn `floor` and its `points` [x, y] in m. A robot that does not know one of the last
    three lacks it."""
    return _question(orb, f"{ROBOTS}/{name}", RoboCorba.RobotAgent, _robot)


def channel_state(orb: Orb, name: str) -> Question:
    """The members of EventChannel::state of a channel."""
    return _question(orb, f"{CHANNELS}/{name}", RoboCorba.EventChannel, lambda channel: plain(channel.state()))


def _question(orb: Orb, name: str, interface: Any, ask: Callable[[Any], Any]) -> Question:
    remote = RemoteObject(orb, name, interface, name.rpartition("/")[2], CALL_LIMIT_S, CALL_LIMIT_S)
    return lambda: remote.call(ask)


def _robot(agent: Any) -> dict[str, Any]:
    state: dict[str, Any] = plain(agent._get_state())
    shown = shown_by(agent)
    state["display"] = {**shown._asdict(), "kind": shown.kind.name.lower()}
    asked = question_of(agent)._asdict() if agent_is_driving(state) else {"number": 0, "text": ""}
    state["question"] = asked
    # Attributes that robots of earlier releases do not have.
    with contextlib.suppress(CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT):
        state["channel"], state["mission"] = agent._get_channel(), agent._get_mission()
        is_driving = agent_is_driving(state)
        state["path"] = path_by_floor(point.position for point in agent._get_path()) if is_driving else []
    return state


def agent_is_driving(state: Mapping[str, Any]) -> bool:
    """Whether a robot may drive a path at present, from the members of its AgentState."""
    moving = state["actor"]["moving"]
    return state["condition"] in ("RUNNING", "PAUSED") or any(moving[axis] for axis in ("ahead", "left", "turn"))


def path_by_floor(points: Iterable[Any]) -> list[dict[str, Any]]:
    """Points of the IDL as runs on the same floor: each with `floor` and `points`, to DECIMALS."""
    return [
        {"floor": floor, "points": [[round(point.x, DECIMALS), round(point.y, DECIMALS)] for point in run]}
        for floor, run in itertools.groupby(points, key=lambda point: point.floor)
    ]


def _server(server: Any) -> dict[str, Any]:
    stop_of_all: dict[str, Any] = {}
    with contextlib.suppress(CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT):  # of an earlier release
        stop_of_all = plain(server._get_stopOfAll())
    return {
        "stopOfAll": stop_of_all,
        "state": plain(server._get_state()),
        "clients": [plain(client) for client in server.clients()],
        "sensors": [plain(sensor) for sensor in server.sensors()],
    }
