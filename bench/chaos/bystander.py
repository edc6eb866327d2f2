"""A client that does nothing wrong: it calls every server again and again, and notes the longest calls.

    python -m bench.chaos.bystander NAMING CHANNEL ROBOT X,Y X,Y

It reads floor L1, asks for paths between the two points of it, and calls the event channel and the robot. It prints
`null`, then answers lines of JSON on stdin: `longest` returns the longest call of each object since the last question
[s], and the errors."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from omniORB import CORBA

from robocorba.corba.calls import error_of
from robocorba.corba.orb import Orb
from robocorba.names import CHANNELS, ROBOTS, SENSORS
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.json_process import answer_commands
from robocorba.testing.simulation import CROSS, NO_MOUNT

#: Interval between the calls of an object, and timeout of a call [s].
INTERVAL_S, CALL_TIMEOUT_S = 0.05, 10.0


class Bystander:
    """A thread for each object."""

    def __init__(self, orb: Orb, on_channel: str, of_robot: str, here: str, there: str) -> None:
        start, goal = (RoboCorba.Point("L1", *map(float, each.split(","))) for each in (here, there))
        pose = RoboCorba.Pose("L1", start.x, start.y, 0.0)
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
        database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase)
        sensor = orb.resolve(f"{SENSORS}/s1", RoboCorba.VirtualSensor)
        channel = orb.resolve(f"{CHANNELS}/{on_channel}", RoboCorba.EventChannel)
        robot = orb.resolve(f"{ROBOTS}/{of_robot}", RoboCorba.RobotAgent)
        calls: dict[str, Callable[[], Any]] = {
            "MapEditor": editor._get_currentVersion,
            "PathPlanner": lambda: planner.getPath(start, goal),
            "SimulationServer": server._get_state,
            "OmniDatabase": lambda: database.getFloor("L1"),
            "VirtualSensor": lambda: sensor.scan(pose, NO_MOUNT, CROSS),
            "EventChannel": channel._get_name,
            "RobotAgent": robot._get_state,
        }
        self._lock = threading.Lock()
        self._longest: dict[str, float] = {}
        self._errors: dict[str, str] = {}
        for name, call in calls.items():
            threading.Thread(target=self._call, args=(name, call), daemon=True).start()

    def longest(self) -> list[dict[str, Any]]:
        """The longest call of each object [s], and the errors."""
        with self._lock:
            found, self._longest, self._errors = [self._longest, self._errors], {}, {}
        return found

    def _call(self, name: str, call: Callable[[], Any]) -> None:
        while True:
            began = time.monotonic()
            try:
                call()
            except CORBA.UserException:  # such as NotFree: another robot is there
                pass
            except CORBA.SystemException as error:
                with self._lock:
                    self._errors[name] = error_of(error)
            took_s = time.monotonic() - began
            with self._lock:
                self._longest[name] = max(took_s, self._longest.get(name, 0.0))
            time.sleep(INTERVAL_S)


def main(naming: str, *about: str) -> None:
    with Orb(Address.parse(naming), call_timeout_s=CALL_TIMEOUT_S) as orb:
        answer_commands(Bystander(orb, *about).longest)


if __name__ == "__main__":
    main(*sys.argv[1:])
