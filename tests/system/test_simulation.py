"""Robots in the simulated building: real servers, two virtual sensor servers, the sample building."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
from omniORB import CORBA

from robocorba.events.corba.event_client import Event, EventClient
from robocorba.map_editor.spatial import floor_format
from robocorba.map_editor.spatial.floor_update import MOTION
from robocorba.simulation.corba.announcer import TYPED_S
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from testkit.simulation import CROSS, NO_MOUNT, RADIUS_M, Place, drive_to, error_lines, is_gone, simulation

pytestmark = pytest.mark.system

#: Simulated seconds in a second, so that robots are sooner where they go.
PACE = 5.0
AHEAD = RoboCorba.Velocity(1.0, 0.0, 0.0)
#: A place in the west hall of L1, and how far robots are apart that don't touch, m.
HALL, APART_M = (2.0, 12.0), 2.0


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=2) as place:
        yield place
        killed = "ended by SIGKILL"
        assert [line for line in error_lines(place.running.state) if killed not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    """The system, with no robots, as many as there may be as usual, and time that passes faster."""
    limit = whole.server._get_state().limit
    whole.administrator.setPace(PACE)
    yield whole
    whole.let_go()
    whole.administrator.setLimit(limit)
    whole.administrator.resume()


def pair(place: Place) -> tuple[Any, Any]:
    """Robots a and b, which face each other in the hall."""
    x, y = HALL
    return place.log_on("a", x, y), place.log_on("b", x + APART_M, y, math.pi)


def state_of(place: Place) -> Any:
    return place.server._get_state()


def test_the_threads_of_connections_share_a_core(place: Place) -> None:
    """As all threads that the server's first one starts."""
    assert len(os.sched_getaffinity(place.pid("simulation"))) == 1
    assert os.sched_getaffinity(place.pid("sensor_s1")) == os.sched_getaffinity(0)


def test_nobody_can_guess_the_reference_of_a_session(place: Place) -> None:
    a, b = pair(place)
    known = bytes.fromhex(place.orb.uri(a).removeprefix("IOR:"))
    key = known[known.index(b"sessions/") + 9 :][:32]
    assert len(set(key)) > 10 and key not in bytes.fromhex(place.orb.uri(b).removeprefix("IOR:"))
    other = key[:-1] + (b"x" if key[-1:] != b"x" else b"y")
    at = place.endpoint("simulation")
    for guess in (
        "IOR:" + known.replace(key, other).hex(),
        f"corbaloc:iiop:1.2@{at}/sessions/a",
        f"corbaloc:iiop:1.2@{at}/sessions/",
        f"corbaloc:iiop:1.2@{at}/a",
        f"corbaloc:iiop:1.2@{at}/RobotSession/a",
    ):
        session = place.orb.reference(guess, RoboCorba.RobotSession)
        for call in (session.state, session.deregister, lambda session=session: session.command(AHEAD, 1.0)):
            with pytest.raises(CORBA.OBJECT_NOT_EXIST):
                call()
    assert place.orb.reference("IOR:" + known.hex(), RoboCorba.RobotSession)._get_name() == "a"
    assert not is_gone(b)


def test_a_robot_that_has_just_logged_on_does_not_see_itself(place: Place) -> None:
    for number in range(120):
        a = place.log_on("a", *HALL)
        ahead = seen_ahead(a._get_sensor(), a.state().at)
        # A robot 2 m ahead that has just left may still be seen, this robot would be nearer.
        assert ahead > 1.0, f"robot {number} saw something {ahead:g} m ahead"
        a.deregister()


def seen_ahead(sensor: Any, at: Any) -> float:
    return float(sensor.scan(at, NO_MOUNT, CROSS).distances[0])


def test_many_scans_in_one_call_are_those_of_single_calls(place: Place) -> None:
    a, _ = pair(place)
    sensor, spec = a._get_sensor(), a._get_sensor().laser()
    spec.noise = RoboCorba.ScanNoise(0.01, 0.01, 0.1, 7)
    mount = RoboCorba.Mount(0.2, 0.1, 0.5)
    poses = [
        RoboCorba.Pose(floor, 2.0 + step, 9.25, 0.7 * step) for step, floor in itertools.product(range(8), ("L1", "L3"))
    ]
    eventually(lambda: seen_ahead(sensor, a.state().at) == pytest.approx(APART_M - RADIUS_M, abs=0.01), what="b")
    other, behind = (
        place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor),
        RoboCorba.Pose("L1", 1.0, 12.0, 0.0),
    )
    assert seen_ahead(sensor, behind) == pytest.approx(1.0 + APART_M - RADIUS_M, abs=0.01)  # not itself
    eventually(lambda: seen_ahead(other, behind) == pytest.approx(1.0 - RADIUS_M, abs=0.01), what="a")
    singles = [sensor.scan(pose, mount, spec).distances for pose in poses]
    assert [found.distances for found in sensor.scanMany(poses, mount, spec)] == singles
    assert len({tuple(single) for single in singles}) == len(poses)
    last = eventually(lambda: [scan for scan in place.database.lastScans("L3") if scan.robot == "a"])[0]
    assert (last.at.floor, len(last.seen.distances)) == ("L3", spec.rays)


def test_what_changes_is_told_on_the_event_channel(place: Place) -> None:
    heard: list[Event] = []
    with EventClient(place.orb, "main") as client:
        client.subscribe(heard.append, ("floor.changed", "L1"), "simulation.*")
        a, _ = pair(place)
        a.command(AHEAD, 5.0)
        eventually(lambda: any(event.type == "simulation.collision" for event in heard))
        at = drive_to(a, HALL).at
        came = [body for event in heard for body in event.payload.get("came", ())]
        number = next(body["number"] for body in came if body["name"] == "a")

        def is_told() -> bool:
            rows = np.concatenate([update.motions for update in floors(heard)])
            return tuple(rows[rows["number"] == number][-1])[4:7] == pytest.approx((at.x, at.y, at.heading), abs=1e-3)

        eventually(is_told, what="an event with the last pose")
    told = [event.payload for event in heard if event.type == "simulation.collision"]
    assert [(set(one["who"]), one["floor"], one["reason"]) for one in told] == [({"a", "b"}, "L1", "")]
    assert all(update.since == before.version for before, update in itertools.pairwise(floors(heard)))


def test_changes_of_a_floor_are_published_as_structs_on_request(place: Place) -> None:
    """So that languages without msgpack can read them; they continue each other like the others."""
    received: list[Event] = []
    with EventClient(place.orb, "main") as client:
        client.subscribe(received.append, ("typed.*", "*"))
        a = place.log_on("a", *HALL)
        number = next(body.number for body in place.database.getFloor("L1").came if body.name == "a")
        assert place.database.publishTypedChanges("L1") == TYPED_S

        def continues() -> bool:
            a.command(RoboCorba.Velocity(0.1, 0.0, 0.0), 2.0)
            updates = [event.payload for event in received]
            return any(update.since == before.current for before, update in itertools.pairwise(updates))

        eventually(continues, what="an update that continues the one before")
        a.command(RoboCorba.Velocity(0.0, 0.0, 0.0), 5.0)

        def has_last_pose() -> bool:
            place.database.publishTypedChanges("L1")  # events of a busy machine expire; the next one is the whole floor
            update, at = received[-1].payload, a.state().at
            row = next((row for row in update.motions if row.number == number), None)
            return update.since == 0 and (row.x, row.y, row.heading) == pytest.approx((at.x, at.y, at.heading))

        eventually(has_last_pose, what="the whole floor with the last pose")
    with pytest.raises(RoboCorba.UnknownFloor):
        place.database.publishTypedChanges("L9")
    assert {(event.type, event.source) for event in received} == {("typed.floor_changed", "L1")}
    structs, rows = place.database.typedFloorChanges("L1", 0), place.database.getFloor("L1")
    assert [body.name for body in structs.came] == [body.name for body in rows.came]
    assert [row.number for row in structs.motions] == np.frombuffer(rows.motions, MOTION)["number"].tolist()


def floors(heard: list[Event]) -> list[Any]:
    """The updates in these events."""
    return [floor_format.loads(msgpack.packb(event.payload)) for event in heard if event.type == "floor.changed"]


def test_an_edit_of_the_map_stands_in_the_way(place: Place) -> None:
    x, y, far = 4.0, 12.0, 1.5
    a = place.log_on("a", x, y)
    sensor = a._get_sensor()
    eventually(lambda: seen_ahead(sensor, a.state().at) == pytest.approx(8.0 - x), what="a wall of the building")
    wall = RoboCorba.Wall("new", RoboCorba.XY(x + far, y - 0.5), RoboCorba.XY(x + far, y + 0.5), 3.0)
    version = place.editor.create("L1", RoboCorba.Element(aWall=wall))
    try:
        eventually(lambda: state_of(place).mapVersion == version, what="the simulation follows")
        eventually(lambda: seen_ahead(sensor, a.state().at) == pytest.approx(far), what="the sensor follows")
        a.command(AHEAD, 5.0)
        eventually(lambda: a.state().collisions)
        assert a.state().at.x < x + far - 0.9 * RADIUS_M
    finally:
        version = place.editor.remove(RoboCorba.ElementId(RoboCorba.WALL_ELEMENT, "L1", "new"), version)
    eventually(lambda: state_of(place).mapVersion == version)
    a.command(AHEAD, 5.0)
    eventually(lambda: a.state().at.x > x + far, what="the way is free again")
