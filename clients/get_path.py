"""Ask the path planning agent for a path: python -m robocorba.clients.get_path L1 3 4 L3 10 2 [HOST:PORT]"""

import sys

from omniORB import CORBA

from robocorba.stubs import RoboCorba
from robocorba.system.printing import fail, line


def main(start_floor: str, x1: str, y1: str, goal_floor: str, x2: str, y2: str, naming: str = "127.0.0.1:2809") -> None:
    orb = CORBA.ORB_init(["client", "-ORBclientCallTimeOutPeriod", "10000"], CORBA.ORB_ID)
    try:
        planner = orb.string_to_object(f"corbaname::{naming}#RoboCorba/PathPlanner")._narrow(RoboCorba.PathPlanner)
        start = RoboCorba.Point(start_floor, float(x1), float(y1))
        path = planner.getPath(start, RoboCorba.Point(goal_floor, float(x2), float(y2)))
    except (RoboCorba.NotFree, RoboCorba.NoPath, RoboCorba.UnknownFloor, RoboCorba.InvalidPoint) as refusal:
        fail(f"no path: {refusal}")
    except CORBA.TRANSIENT:
        fail(f"nothing answers at {naming}: is `robocorba up` running there?")
    for point in path:
        at = point.position
        line(f"{point.time:6.1f} s  {at.floor}:{at.x:.2f},{at.y:.2f}  {point.kind} {point.elevator or point.node}")


if __name__ == "__main__":
    if len(sys.argv) not in (7, 8):
        sys.exit(__doc__)
    main(*sys.argv[1:])
