"""Looks at a robot from outside, as often as it can: at its body in the building, or at its own units.

    python -m bench.robots.watcher building HOST:PORT FLOOR NAME
    python -m bench.robots.watcher units HOST:PORT

HOST:PORT is the naming service. Says `null` when it has found the robot. Then each line on stdin is answered with what
was seen since the line before: rows of [monotonic time, is the base driving, x, y, heading, joint, ...], in m and rad.
A look is timed when it was answered: what it saw was so by then. What does not answer is left out."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import threading
import time
from collections import deque
from collections.abc import Callable

from omniORB import CORBA

from robocorba.corba.orb import Orb
from robocorba.corba.remote.floors import RemoteFloor
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL

LOOK_S = 0.002
#: Looks that are kept: a minute of them.
MOST_LOOKS = 30_000
FIND_S, CALL_LIMIT_S = 0.5, 1.0
#: Slower than this it stands, m/s.
STANDS_M_S = 0.005
_MOBILITY_BUSY = 0x11
Look = Callable[[], list[float]]


def building(orb: Orb, floor: str, name: str) -> Look:
    """Its body, by the Omni database."""
    copy: list[RemoteFloor] = []

    def look() -> list[float]:
        try:
            if not copy:
                database = orb.resolve("OmniDatabase", RoboCorba.OmniDatabase, FIND_S, CALL_LIMIT_S)
                copy.append(RemoteFloor(database, floor))
            copy[0].follow()
        except RoboCorbaError:
            copy.clear()  # it begins anew with the server
            raise
        view = copy[0].view
        (number,) = [number for number, body in view.bodies.items() if body.name == name]
        row = view.motion(number)
        is_driving = math.hypot(row["vx"], row["vy"]) >= STANDS_M_S or abs(row["turn"]) >= STANDS_M_S
        return [float(is_driving), float(row["x"]), float(row["y"]), float(row["heading"])]

    return look


def units(orb: Orb, naming: Address) -> Look:
    """Its base and its left arm, by the robot's public interface."""
    mobility = orb.resolve_elsewhere(naming, "Mobility.Unit", YeRTUnitMobility.mobility, CALL_LIMIT_S)
    arm = orb.resolve_elsewhere(naming, "MnpL", _GlobalIDL.ArmUnit, CALL_LIMIT_S)

    def look() -> list[float]:
        _, state, _ = mobility.getState()
        _, x, y, heading = mobility.getPosition()
        _, joints = arm.getFeedbackPos(_GlobalIDL.JOINT)
        return [float(state == _MOBILITY_BUSY), x / 1e3, y / 1e3, math.radians(heading), *map(math.radians, joints)]

    return look


def main(what: str, naming: str, *more: str) -> None:
    looks: deque[list[float]] = deque(maxlen=MOST_LOOKS)
    ended = threading.Event()
    with Orb(Address.parse(naming, "HOST:PORT"), call_timeout_s=CALL_LIMIT_S) as orb:
        look = building(orb, *more) if what == "building" else units(orb, orb.naming)
        look()

        def watch() -> None:
            while not ended.wait(LOOK_S):
                with contextlib.suppress(NotReachable, RoboCorbaError, ValueError, KeyError, CORBA.SystemException):
                    seen = look()
                    looks.append([time.monotonic(), *seen])

        watcher = threading.Thread(target=watch, name="watcher")
        watcher.start()
        print("null", flush=True)
        for _ in sys.stdin:
            seen = [looks.popleft() for _ in range(len(looks))]
            print(json.dumps(seen), flush=True)
        ended.set()
        watcher.join()


if __name__ == "__main__":
    main(*sys.argv[1:])
