"""A client compiled with the IDL of a release, without the package robocorba: python released_client.py HOST:PORT

It calls what clients of every kind call, and prints what it got as JSON. The stubs, the module RoboCorba, must be on
PYTHONPATH."""

from __future__ import annotations

import json
import sys
import threading
import time

from omniORB import CORBA

import RoboCorba  # isort: skip
import RoboCorba__POA  # isort: skip

#: Time limit for an event [s].
EVENT_S = 20.0


class Consumer(RoboCorba__POA.EventConsumer):
    """Keeps the number of the first event."""

    def __init__(self) -> None:
        self.has_come = threading.Event()
        self.type = ""

    def pushRuns(self, runs: list[RoboCorba.EventRun]) -> None:
        self.type = runs[0].first.type
        self.has_come.set()

    def disconnect_push_consumer(self) -> None:
        pass


def main(naming: str) -> None:
    orb = CORBA.ORB_init(["-ORBclientCallTimeOutPeriod", "20000", "-ORBnativeCharCodeSet", "UTF-8"], CORBA.ORB_ID)
    poa = orb.resolve_initial_references("RootPOA")
    poa._get_the_POAManager().activate()

    def find(name: str, interface: type) -> CORBA.Object:
        return orb.string_to_object(f"corbaname::{naming}#RoboCorba/{name}")._narrow(interface)

    found: dict[str, object] = {}

    planner = find("PathPlanner", RoboCorba.PathPlanner)
    start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 14.0, 3.0)
    found["path"] = [str(point.kind) for point in planner.getPath(start, goal)]
    found["paths"] = len(planner.findPaths(planner.defaultRequest(start, goal)))
    try:
        planner.getPath(start, RoboCorba.Point("L9", 0.0, 0.0))
    except RoboCorba.UnknownFloor as error:
        found["refused"] = [error.which, error.floorName, error.known]

    editor = find("MapEditor", RoboCorba.MapEditor)
    wall = RoboCorba.Wall("released", RoboCorba.XY(1.0, 1.0), RoboCorba.XY(1.0, 1.5), 2.0)
    version = editor.create("L1", RoboCorba.Element(aWall=wall))
    record = editor.read(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "released"))
    found["edited"] = record.changedAt == version and record.value.aWall.toPoint.y == 1.5
    editor.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "released"), version)

    server = find("SimulationServer", RoboCorba.SimulationServer)
    limits = RoboCorba.MotionLimits(1.0, 1.0, 1.0, 1.0)
    place = RoboCorba.Pose("L1", 3.0, 3.0, 0.0)
    robot = server.registerRobot(RoboCorba.RobotDescription("released", place, 0.4, 100.0, limits))
    try:
        robot.command(RoboCorba.Velocity(0.3, 0.0, 0.0), 0.5)
        scan = robot._get_sensor().scan(robot.state().at, RoboCorba.Mount(0.0, 0.0, 0.0), robot._get_sensor().laser())
        found["rays"] = len(scan.distances)
        database = find("OmniDatabase", RoboCorba.OmniDatabase)
        floor = database.getFloor("L1")
        found["bodies"] = [body.name for body in floor.came if body.kind == RoboCorba.ROBOT_BODY]
        found["since"] = database.floorChanges("L1", floor.current).since == floor.current
    finally:
        robot.deregister()

    channel = find("EventChannels/main", RoboCorba.EventChannel)
    consumer = Consumer()
    poa.activate_object(consumer)
    wanted = [RoboCorba.Clause([RoboCorba.EventPattern("released.*", "*")], 0.0)]
    queue = RoboCorba.QueuePolicy(100, RoboCorba.DISCARD_OLDEST, 0.0)
    proxy = channel.subscribe("", consumer._this(), wanted, queue)
    header = RoboCorba.EventHeader("released.client", "it", "", 0, time.time(), 0, 0.0, RoboCorba.MSGPACK)
    channel.supply("released").pushEvent(RoboCorba.Event(header, b"\xc0"))
    consumer.has_come.wait(EVENT_S)
    found["event"] = consumer.type
    proxy.disconnect_push_supplier()

    found["missions"] = len(find("MissionControl", RoboCorba.MissionControl).missionsSince(0))
    if hasattr(server, "_get_release"):
        found["release"] = server._get_release()
    print(json.dumps(found))
    orb.destroy()
    for _ in range(200):  # at most 10 s, until omniORB's threads that called the consumer have ended
        if threading.active_count() == 1:
            break
        time.sleep(0.05)


if __name__ == "__main__":
    main(sys.argv[1])
