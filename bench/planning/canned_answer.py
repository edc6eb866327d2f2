"""A server that answers every getPath with the same path: the cost of the wire and the ORB without planning.

python -m bench.planning.canned_answer HOST:PORT POINTS
"""

from __future__ import annotations

import sys
from typing import Any

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.settings import Address


class CannedPlanner(RoboCorba__POA.PathPlanner):
    """Answers with `points` points, constructed for each call like those of a planner."""

    def __init__(self, points: int) -> None:
        self._points = range(points)

    def getPath(self, start: Any, goal: Any) -> list[Any]:
        return [
            RoboCorba.PathPoint(
                RoboCorba.NODE, "room-101-door", RoboCorba.Point("L1", 1.0, float(i)), 0.5, 1.0 * i, 2.0 * i, ""
            )
            for i in self._points
        ]


if __name__ == "__main__":
    address = Address.parse(sys.argv[1])
    with Orb(Address(address.host, 1), address) as orb:  # port 1 is unused: clients use corbaloc, no naming service
        orb.serve({"PathPlanner": CannedPlanner(int(sys.argv[2]))})
        orb.run()
