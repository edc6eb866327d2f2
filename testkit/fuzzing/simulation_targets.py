"""The objects of the simulation server and of the virtual sensors."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from functools import partial
from typing import Any

import msgpack
from omniORB import CORBA

from robocorba.missions.subplan import VERSION
from robocorba.stubs import RoboCorba
from testkit.fuzzing.calls import Target
from testkit.fuzzing.examples import MISSIONS, OTHER, OURS, ROBOT, always, example
from testkit.fuzzing.fuzzed_system import FuzzedSystem
from testkit.fuzzing.operations import operations
from testkit.simulation import CROSS, NO_MOUNT, about


def end_robot(system: FuzzedSystem, name: str, result: Any) -> None:
    """Log a robot off."""
    if name == "registerRobot" and result is not None:
        result.deregister()


def resume(system: FuzzedSystem, name: str, result: Any) -> None:
    """Let the time of the simulation pass as before."""
    system.administrator.resume()
    system.administrator.setPace(1.0)
    system.administrator.setLimit(200)


def end_missions(system: FuzzedSystem, name: str, result: Any) -> None:
    """Remove the missions that a call may have stored."""
    for mission in system.database.missions() if name in ("putMission", "start") else ():
        with contextlib.suppress(CORBA.UserException):
            system.database.removeMission(mission.name)


def targets(system: FuzzedSystem) -> Iterator[Target]:
    """One for each interface, two for those whose objects differ."""
    square = [RoboCorba.XY(1.0, 1.0), RoboCorba.XY(2.0, 1.0), RoboCorba.XY(2.0, 2.0)]
    areas = [RoboCorba.FloorArea("L1", square)]
    pose = RoboCorba.Pose("L1", 5.0, 5.0, 0.0)
    on_session = {
        "command": [example(RoboCorba.Velocity(0.1, 0.0, 0.1), 0.2)],
        "grip": [example("box", RoboCorba.XY(2.0, 2.0))],
        "callElevator": [example("E1", "L2")],
        "callElevatorTogether": [example("E1", "L2", "party", 2)],
        "callElevatorFor": [example("E1", "L2", "party", 2, 20.0)],
        "reserveAreas": [example(areas, 5.0)],
        "reserveOneOf": [example([areas, areas], 5.0)],
        "exchangeAreas": [example(areas, 5.0)],
        "takeOverAreas": [example(OTHER)],
        "keepAreas": [example(areas)],
        "reportPosture": [example([0.1] * 18)],
    }
    yield Target(RoboCorba.RobotSession, system.session, on_session, omitted=frozenset({"deregister"}))
    others = frozenset(one.name for one in operations(RoboCorba.RobotSession)) - {"deregister"}
    ends = frozenset({"deregister"})
    yield Target(RoboCorba.RobotSession, system.new_session, ends=ends, omitted=others, name="RobotSession, ended")
    load = RoboCorba.SensorLoad(0.1, 0.1, 10.0, 1)
    scan = RoboCorba.ScanData(1.0, 0.0, 0.1, [1.0, 2.0, 3.0, 4.0])
    data = RoboCorba.SensorData(ROBOT, pose, scan)
    whole = RoboCorba.RobotScan(ROBOT, pose, NO_MOUNT, CROSS, scan, bytes(4))
    on_server = {
        "registerRobot": [lambda: (about(f"f{next(system.numbers)}", 8.0, 8.0),)],
        "renderFloor": [example("L1", 200)],
        "reportSensor": [example("fake", system.sensor, load, [data]), example("fake", None, load, [])],
        "reportScans": [example("s1", [whole])],
    }
    yield Target(RoboCorba.SimulationServer, lambda: system.server, on_server, partial(end_robot, system))
    on_registration = {"report": [example(load, [data])], "reportScans": [example([whole])]}
    yield Target(RoboCorba.SensorRegistration, system.registration, on_registration)
    on_administrator = {
        "place": [example(OTHER, pose)],
        "evict": [example("nobody")],
        "keepOut": [example("outsider")],
        "admit": [example("outsider")],
        "setPace": [example(1.0)],
        "setLimit": [example(200)],
        "step": [example(1)],
    }
    end = partial(resume, system)
    yield Target(RoboCorba.SimulationAdministrator, always(system.administrator), on_administrator, end)
    record = RoboCorba.MissionRecord("m", 0, b"document")
    on_database = {
        "getFloor": [example("L1")],
        "floorChanges": [example("L1", 1)],
        "putMission": [example(record), example(_stored_mission())],
        "removeMission": [example("m")],
        "lastScans": [example("L1")],
        "scansSince": [example("L1", 0.0)],
        "postures": [example("L1", 0.0)],
    }
    yield Target(RoboCorba.OmniDatabase, lambda: system.database, on_database, partial(end_missions, system))
    on_control = {
        "start": [example(OTHER, json.dumps(icon)) for icon in MISSIONS],
        "missionsSince": [example(0)],
        "mission": [example("m")],
        "report": [example("m")],
        "abort": [example("m")],
    }
    yield Target(RoboCorba.MissionControl, lambda: system.control, on_control, partial(end_missions, system))
    on_sensor = {"scan": [example(pose, NO_MOUNT, CROSS)], "scanMany": [example([pose, pose], NO_MOUNT, CROSS)]}
    yield Target(RoboCorba.VirtualSensor, lambda: system.sensor, on_sensor)
    own = {**on_sensor, "forRobot": [example(OURS)]}
    of_robot = "VirtualSensor of a robot"
    yield Target(RoboCorba.VirtualSensor, lambda: system.session()._get_sensor(), own, name=of_robot)


def _stored_mission() -> Any:
    document = {"version": VERSION, "kind": "move_table", "leader": OTHER, "result": "running", "begun": 1.0}
    return RoboCorba.MissionRecord("stored", 0, msgpack.packb(document))
