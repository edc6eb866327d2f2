"""Which servers `robocorba up` runs: the map editor, and an event channel for each sub-network."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omniORB import CORBA

from robocorba.errors import NotReachable
from robocorba.orb import Orb, describe
from robocorba.remote.event_peers import CHANNELS
from robocorba.stubs import RoboCorba


@dataclass(frozen=True)
class Probe:
    """How to ask an object whether it serves: its `interface`, and a `call` that is cheap and changes nothing."""

    interface: Any
    call: Callable[[Any], object]

    def ask(self, orb: Orb, name: str, timeout_s: float = 1.0) -> float:
        """Make the call to what is bound to `name`; the milliseconds that it took. Raises NotReachable."""
        reference = orb.resolve(name, self.interface, timeout_s, call_timeout_s=timeout_s)
        began = time.perf_counter()
        try:
            self.call(reference)
        except CORBA.Exception as wrong:
            raise NotReachable(f"{name} does not answer ({describe(wrong)})") from None
        return (time.perf_counter() - began) * 1000


@dataclass(frozen=True)
class Server:
    """A server process: `python -m module` with the arguments of settings.ServerSettings and its own, binding
    `objects`."""

    name: str
    module: str
    objects: Mapping[str, Probe]
    arguments: tuple[str, ...] = ()


_MAP_EDITOR = {
    "MapEditor": Probe(RoboCorba.MapEditor, lambda editor: editor._get_currentVersion()),
    "PathPlanner": Probe(RoboCorba.PathPlanner, lambda planner: planner._get_mapVersion()),
}
_CHANNEL = Probe(RoboCorba.EventChannel, lambda channel: channel._get_name())


def servers(subnets: Sequence[str]) -> list[Server]:
    """The servers of a system with these sub-networks; the channel of each is linked with those of all others."""
    return [Server("map_editor", "servers.map_editor", _MAP_EDITOR), *(_channel(name, subnets) for name in subnets)]


def probe_of(name: str) -> Probe | None:
    """How to ask what is bound to `name`; None where no server of this version binds it."""
    return _CHANNEL if name.startswith(f"{CHANNELS}/") else _MAP_EDITOR.get(name)


def _channel(name: str, subnets: Sequence[str]) -> Server:
    peers = [argument for peer in subnets if peer != name for argument in ("--peer", peer)]
    objects = {f"{CHANNELS}/{name}": _CHANNEL}
    return Server(f"events_{name}", "servers.event_channel", objects, ("--name", name, *peers))
