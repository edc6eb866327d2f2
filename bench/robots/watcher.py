"""Observes a robot from outside every LOOK_S: its body in the building, or its own units.

    python -m bench.robots.watcher building HOST:PORT FLOOR NAME
    python -m bench.robots.watcher units HOST:PORT

HOST:PORT is the naming service. The watcher prints `null` when it has found the robot. Then it answers each line on
stdin with its observations since the line before: rows of [monotonic time, is the base driving, x, y, heading, joint,
...], in m and rad. The time of an observation is that of the answer. Calls without an answer are left out."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable

from omniORB import CORBA

from bench.common.harness import sampled
from robocorba.errors.base import RoboCorbaError
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL
from robocorba.system.settings import Address
from testkit.json_process import answer_lines
from testkit.simulation import RemoteFloor

#: Interval between observations [s].
LOOK_S = 0.002
#: Timeouts for resolving and for calls [s].
RESOLVE_TIMEOUT_S, CALL_LIMIT_S = 0.5, 1.0
#: A base below this speed is stationary [m/s] and [rad/s].
STANDS_M_S = 0.005
_MOBILITY_BUSY = 0x11
Look = Callable[[], list[float]]


def body_of(orb: Orb, floor: str, name: str) -> Look:
    """Observes the robot's body through the Omni database."""
    copy: list[RemoteFloor] = []

    def look() -> list[float]:
        try:
            if not copy:
                database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, RESOLVE_TIMEOUT_S, CALL_LIMIT_S)
                copy.append(RemoteFloor(database, floor))
            copy[0].follow()
        except RoboCorbaError:
            copy.clear()  # reload the floor from the restarted server
            raise
        view = copy[0].view
        (number,) = [number for number, body in view.bodies.items() if body.name == name]
        row = view.motion(number)
        is_driving = math.hypot(row["vx"], row["vy"]) >= STANDS_M_S or abs(row["turn"]) >= STANDS_M_S
        return [float(is_driving), float(row["x"]), float(row["y"]), float(row["heading"])]

    return look


def units(orb: Orb) -> Look:
    """Observes the robot's base and left arm through the robot's public interface."""
    mobility = orb.resolve_in_other_naming_service(orb.naming, "Mobility.Unit", YeRTUnitMobility.mobility, CALL_LIMIT_S)
    arm = orb.resolve_in_other_naming_service(orb.naming, "MnpL", _GlobalIDL.ArmUnit, CALL_LIMIT_S)

    def look() -> list[float]:
        _, state, _ = mobility.getState()
        _, x, y, heading = mobility.getPosition()
        _, joints = arm.getFeedbackPos(_GlobalIDL.JOINT)
        return [float(state == _MOBILITY_BUSY), x / 1e3, y / 1e3, math.radians(heading), *map(math.radians, joints)]

    return look


def main(what: str, naming: str, *more: str) -> None:
    with Orb(Address.parse(naming, "HOST:PORT"), call_timeout_s=CALL_LIMIT_S) as orb:
        look = body_of(orb, *more) if what == "building" else units(orb)
        look()

        def watch() -> list[float] | None:
            with contextlib.suppress(RoboCorbaError, ValueError, KeyError, CORBA.SystemException):
                return look()
            return None

        with sampled(watch, LOOK_S) as looks:
            answer_lines(lambda _: [[at, *seen] for at, seen in (looks.pop(0) for _ in range(len(looks))) if seen])


if __name__ == "__main__":
    main(*sys.argv[1:])
