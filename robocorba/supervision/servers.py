"""Which servers `robocorba up` runs. A new server is one entry in SERVERS."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from omniORB import CORBA

from robocorba.errors import NotReachable
from robocorba.orb import Orb, describe
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
    """A server process: `python -m module` with the arguments of settings.ServerSettings, binding `objects`."""

    name: str
    module: str
    objects: Mapping[str, Probe]


SERVERS: tuple[Server, ...] = (
    Server(
        "map_editor",
        "servers.map_editor",
        {
            "MapEditor": Probe(RoboCorba.MapEditor, lambda editor: editor._get_currentVersion()),
            "PathPlanner": Probe(RoboCorba.PathPlanner, lambda planner: planner._get_mapVersion()),
        },
    ),
)
