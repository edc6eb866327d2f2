"""The servers that `robocorba up` runs: map editor, simulation, virtual sensors, and one event channel per
sub-network."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS


@dataclass(frozen=True)
class Probe:
    """How to check that an object serves: its `interface`, and a cheap `call` that changes nothing."""

    interface: Any
    call: Callable[[Any], object]

    def call_object(self, orb: Orb, name: str, timeout_s: float = 1.0) -> float:
        """Call the object bound to `name`; returns the duration of the call [ms]. Raises NotReachable."""
        return self._call(orb.resolve(name, self.interface, timeout_s, call_timeout_s=timeout_s), name)

    def call_at(self, orb: Orb, endpoint: str, name: str, timeout_s: float = 1.0) -> float:
        """The same without the naming service: call the object at HOST:PORT."""
        return self._call(orb.reference(orb.uri_at(endpoint, name), self.interface, call_timeout_s=timeout_s), name)

    def _call(self, reference: Any, name: str) -> float:
        began = time.perf_counter()
        try:
            self.call(reference)
        except CORBA.Exception as error:
            raise NotReachable(f"{name} does not answer ({describe(error)})") from None
        return (time.perf_counter() - began) * 1000


@dataclass(frozen=True)
class Server:
    """A server process: `python -m module` with the arguments of settings.ServerSettings and its own.

    objects: the names that it binds. starts_first: before those without it, since they call it when they start."""

    name: str
    module: str
    objects: Mapping[str, Probe]
    arguments: tuple[str, ...] = ()
    starts_first: bool = False


_MAP_EDITOR = {
    "MapEditor": Probe(RoboCorba.MapEditor, lambda editor: editor._get_currentVersion()),
    "PathPlanner": Probe(RoboCorba.PathPlanner, lambda planner: planner._get_mapVersion()),
}
_SIMULATION = {
    "SimulationServer": Probe(RoboCorba.SimulationServer, lambda server: server._get_state()),
    "OmniDatabase": Probe(RoboCorba.OmniDatabase, lambda database: database.floors()),
    "MissionControl": Probe(RoboCorba.MissionControl, lambda control: control._non_existent()),
}
_SENSOR = Probe(RoboCorba.VirtualSensor, lambda sensor: sensor._get_load())
_CHANNEL = Probe(RoboCorba.EventChannel, lambda channel: channel._get_name())


def servers(subnets: Sequence[str], sensors: int, bidirectional: bool = False, accept: str = "") -> list[Server]:
    """The servers of a system with these sub-networks, whose channels are all linked, and `sensors` sensor servers.

    The simulation server publishes its events at the first channel, and the map editor listens there. bidirectional:
    channels call consumers that want it over the connections that these have opened. accept: which proposals the map
    editor accepts."""
    at_first = ("--channel", subnets[0])
    return [
        Server("map_editor", "robocorba.servers.map_editor", _MAP_EDITOR, (*at_first, "--accept", accept)),
        Server("simulation", "robocorba.servers.simulation", _SIMULATION, at_first),
        *(_sensor(f"s{number}") for number in range(1, sensors + 1)),
        *(_channel(name, subnets, bidirectional) for name in subnets),
    ]


def probe_of(name: str) -> Probe | None:
    """The probe for the object bound to `name`; None where no process of this version binds it."""
    robot = Probe(RoboCorba.RobotAgent, lambda agent: agent._get_state())
    contexts = {CHANNELS: _CHANNEL, SENSORS: _SENSOR, ROBOTS: robot}
    return contexts.get(name.partition("/")[0]) or {**_MAP_EDITOR, **_SIMULATION}.get(name)


def _sensor(name: str) -> Server:
    return Server(
        f"sensor_{name}", "robocorba.servers.virtual_sensor", {f"{SENSORS}/{name}": _SENSOR}, ("--name", name)
    )


def _channel(name: str, subnets: Sequence[str], bidirectional: bool) -> Server:
    peers = [argument for peer in subnets if peer != name for argument in ("--peer", peer)]
    objects = {f"{CHANNELS}/{name}": _CHANNEL}
    arguments = ("--name", name, *peers, *(["--bidirectional"] if bidirectional else []))
    return Server(f"events_{name}", "robocorba.servers.event_channel", objects, arguments, starts_first=True)
