"""A robot for load tests: python -m tests.system.planning_client NAMING

Prints `ready`, asks for paths without a pause until a line comes on stdin, and prints as JSON how many answers
it had, the longest time in ms between two of them, and what went wrong."""

from __future__ import annotations

import itertools
import sys
import threading
import time

import msgspec
from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba

WEST, EAST, ABOVE = (RoboCorba.Point(*at) for at in (("L1", 3.0, 3.0), ("L1", 15.0, 3.0), ("L2", 14.0, 3.0)))
#: Nothing leads down again: the edge into the elevator is one-way.
TRIPS = ((WEST, EAST), (EAST, WEST), (WEST, ABOVE), (EAST, ABOVE))


def wait_for_line(stop: threading.Event) -> None:
    sys.stdin.readline()
    stop.set()


def main(naming: str) -> None:
    stop = threading.Event()
    with Orb(Address.parse(naming)) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        planner.getPath(WEST, EAST)
        print("ready", flush=True)
        threading.Thread(target=wait_for_line, args=(stop,), daemon=True).start()
        answers, longest_s, errors = 0, 0.0, []
        last = time.monotonic()
        for start, goal in itertools.cycle(TRIPS):
            if stop.is_set():
                break
            try:
                path = planner.getPath(start, goal)
                if (path[0].kind, path[-1].kind) != (RoboCorba.START, RoboCorba.GOAL):
                    errors.append(f"a path from {path[0].kind} to {path[-1].kind}")
            except CORBA.Exception as error:
                errors.append(f"{describe(error)} {error}")
            now = time.monotonic()
            answers, longest_s, last = answers + 1, max(longest_s, now - last), now
    print(msgspec.json.encode({"answers": answers, "longest_ms": 1000 * longest_s, "errors": errors[:10]}).decode())


if __name__ == "__main__":
    main(*sys.argv[1:])
