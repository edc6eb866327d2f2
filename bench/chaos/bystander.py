"""A client that does nothing wrong: it repeats calls, and notes the longest ones and the errors.

    python -m bench.chaos.bystander NAMING CHANNEL ROBOT X,Y X,Y UNTOUCHED

It calls every server: it reads floor L1, asks for paths between the two points of it, and calls the event channel and
the robot. UNTOUCHED is the reference of a server that nobody attacks. It prints `null`, then answers lines of JSON on
stdin: `longest` returns the longest call of each object since the last question [s], and the errors."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from omniORB import CORBA

from bench.chaos.beside import UNTOUCHED
from robocorba.errors.base import RoboCorbaError
from robocorba.orb.calls import error_of
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from testkit.json_process import answer_commands
from testkit.simulation import CROSS, NO_MOUNT

#: Interval between two calls of an object [s].
INTERVAL_S = 0.05
#: Timeout of a call [s].
CALL_TIMEOUT_S = 10.0


class Bystander:
    """Repeats each call in a thread of its own, `interval_s` [s] after its return, until it is closed."""

    def __init__(self, calls: Mapping[str, Callable[[], object]], interval_s: float = INTERVAL_S) -> None:
        self._lock = threading.Lock()
        self._longest: dict[str, float] = {}
        self._errors: dict[str, str] = {}
        self._repeating = [
            Repeating(name, partial(self._call, name, call), interval_s).start() for name, call in calls.items()
        ]

    def close(self) -> None:
        for each in self._repeating:
            each.close()

    def longest(self) -> tuple[dict[str, float], dict[str, str]]:
        """The duration of the longest of each call since the last question [s], and the last error of those that
        failed."""
        with self._lock:
            found, self._longest, self._errors = (self._longest, self._errors), {}, {}
        return found

    def _call(self, name: str, call: Callable[[], object]) -> None:
        began, error = time.monotonic(), ""
        try:
            call()
        except (CORBA.Exception, RoboCorbaError) as raised:
            error = error_of(raised)
        took_s = time.monotonic() - began
        with self._lock:
            self._longest[name] = max(took_s, self._longest.get(name, 0.0))
            if error:
                self._errors[name] = error


def calls_of_every_server(
    orb: Orb, on_channel: str, of_robot: str, here: str, there: str, untouched: str
) -> dict[str, Any]:
    """A call of each server, of a virtual sensor, a robot, and a server that nobody attacks. here, there: of L1."""
    start, goal = (RoboCorba.Point("L1", *map(float, each.split(","))) for each in (here, there))
    pose = RoboCorba.Pose("L1", start.x, start.y, 0.0)
    planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
    sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
    return {
        "MapEditor": orb.resolve("MapEditor", RoboCorba.MapEditor)._get_currentVersion,
        "PathPlanner": lambda: planner.getPath(start, goal),
        "SimulationServer": orb.resolve("SimulationServer", RoboCorba.SimulationServer)._get_state,
        "OmniDatabase": lambda: database.getFloor("L1"),
        "VirtualSensor": lambda: sensor.scan(pose, NO_MOUNT, CROSS),
        "EventChannel": orb.resolve(f"{CHANNELS}/{on_channel}", RoboCorba.EventChannel)._get_name,
        "RobotAgent": orb.resolve(f"{ROBOTS}/{of_robot}", RoboCorba.RobotAgent)._get_state,
        UNTOUCHED: orb.reference(untouched, RoboCorba.VirtualSensor)._get_load,
    }


def _or_refused(call: Callable[[], object]) -> None:
    """A server may refuse a call, such as for a path to where another robot stands."""
    with contextlib.suppress(CORBA.UserException):
        call()


def main(naming: str, *about: str) -> None:
    with Orb(Address.parse(naming), call_timeout_s=CALL_TIMEOUT_S) as orb:
        calls = calls_of_every_server(orb, *about)
        answer_commands(Bystander({name: partial(_or_refused, call) for name, call in calls.items()}).longest)


if __name__ == "__main__":
    main(*sys.argv[1:])
