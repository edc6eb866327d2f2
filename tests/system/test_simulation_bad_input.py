"""Nonsense of every kind over the wire, and clients that stall or ask for much: a typed exception each time, and a
simulation that goes on as it was."""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omniORB import CORBA

from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.attacks import connections, greedy_clients, stalled_connections
from testkit.processes import eventually
from testkit.simulation import CROSS, NO_MOUNT, STAND, Place, about, error_lines, simulation
from tests.system.refusals import refused
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.full]

#: What servers may grow by over all of this module, MiB. Single messages of it have up to 40 MB.
GROWTH_MIB = 200
#: The fixtures are of the module, so they are the same for all examples of a test.
MANY = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
#: Robots that may log on, and how many more want to before the crowd goes; how long it tries at most [s].
ROOM, CROWD, CROWD_LIMIT_S = 50, 1_000, 200.0
#: Time limit of each of their calls [s]; its usual time is measured in bench/.
ANSWER_S = 20.0
#: No text of an answer is longer, whatever was asked.
MAX_TEXT = 1000
SERVERS = ("simulation", "sensor_s1")


LONG = "x" * 1_000_000
numbers = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 1.7e308, -1.7e308, 5e-324, 1e7, -1.0, 0.0]), st.floats()
)
velocities = st.builds(RoboCorba.Velocity, numbers, numbers, numbers)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """The same processes serve at the end, have not grown much and complain of nothing."""
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=1) as place:
        processes = {name: psutil.Process(place.pid(name)) for name in SERVERS}
        began = {name: process.memory_info().rss for name, process in processes.items()}
        yield place
        assert {name: place.pid(name) for name in SERVERS} == {name: one.pid for name, one in processes.items()}
        grown_mib = {name: (one.memory_info().rss - began[name]) / 2**20 for name, one in processes.items()}
        print("\n" + ", ".join(f"{name} grew by {grown:.0f} MiB" for name, grown in grown_mib.items()))
        assert max(grown_mib.values()) < GROWTH_MIB
        assert error_lines(place.running.state) == []


@pytest.fixture(autouse=True)
def all_is_well(place: Place) -> Iterator[None]:
    """After each test time goes on, and a robot can log on, drive and see."""
    yield
    place.let_go()
    began = place.server._get_state()
    assert (began.pace, began.paused, began.limit) == (1.0, False, 300)
    robot = place.log_on("well", 2.0, 12.0)
    robot.command(RoboCorba.Velocity(1.0, 0.0, 0.0), 0.2)
    eventually(lambda: robot.state().at.x > 2.01, 30.0, "a robot drives")
    eventually(lambda: place.server._get_state().time > began.time, 30.0, "time passes")
    sensor = robot._get_sensor()
    eventually(lambda: 4.0 < sensor.scan(robot.state().at, NO_MOUNT, CROSS).distances[0] < 7.0, 30.0, "it sees a wall")
    place.let_go()


@pytest.fixture(scope="module")
def sensor(place: Place) -> Any:
    return place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)


# ---- robots ----


@given(velocities, numbers)
@MANY
def test_no_command_takes_a_robot_out_of_the_world(place: Place, wanted: Any, valid_s: float) -> None:
    with robot(place, "fast") as fast:
        is_velocity = math.isfinite(wanted.ahead + wanted.left + wanted.turn)
        if is_velocity and 0.0 <= valid_s <= 5.0:
            fast.command(wanted, valid_s)
        else:
            refused(RoboCorba.InvalidCommand, fast.command, wanted, valid_s)
        fast.command(wanted if is_velocity else STAND, 5.0)
        began = fast.state().time
        eventually(lambda: fast.state().time > began + 0.02, what="two steps")
        state = fast.state()
        found = (state.at.x, state.at.y, state.at.heading, state.moving.ahead, state.moving.left, state.moving.turn)
        assert all(map(math.isfinite, found)), state


@contextlib.contextmanager
def robot(place: Place, name: str) -> Iterator[Any]:
    """The fastest robot that there may be, in the west hall."""
    try:
        yield place.log_on(name, 3.0, 12.0, limits=(10.0, 4 * math.pi, 50.0, 50.0))
    finally:
        place.let_go()


SQUARE = [RoboCorba.XY(2.0, 11.0), RoboCorba.XY(3.0, 11.0), RoboCorba.XY(3.0, 12.0), RoboCorba.XY(2.0, 12.0)]


def test_a_crowd_that_wants_to_log_on_is_turned_away(place: Place) -> None:
    limit = place.server._get_state().limit
    place.administrator.setLimit(ROOM)
    turned_away: list[RoboCorba.ServerFull] = []
    field = RoboCorba.Floor("field", 99, 99.0, 3.0, [])  # without an outline
    created = place.editor.create("", RoboCorba.Element(aFloor=field))
    eventually(lambda: "field" in place.database.floors(), what="the new floor")
    numbers, until = itertools.count(), time.monotonic() + CROWD_LIMIT_S

    def want() -> float:
        """The longest time of a call [s]."""
        longest_s = 0.0
        while len(turned_away) < CROWD and time.monotonic() < until:
            number, began = next(numbers), time.monotonic()
            try:
                place.log_on(f"crowd-{number}", 1.0 * (number % 100), 1.0 * (number // 100 % 100), floor="field")
            except RoboCorba.ServerFull as full:
                turned_away.append(full)
            longest_s = max(longest_s, time.monotonic() - began)
        return longest_s

    most = 0
    with ThreadPoolExecutor() as pool:
        crowd = [pool.submit(want) for _ in range(4)]
        while not all(one.done() for one in crowd):
            most = max(most, place.server._get_state().robots)
            pause(0.05)
    assert most <= ROOM and len(turned_away) >= CROWD
    assert all(one.limit == one.now == ROOM and one.retryAfter <= 2.0 for one in turned_away)
    assert max(one.result() for one in crowd) < ANSWER_S
    place.let_go()
    assert place.server._get_state().robots == 0
    place.administrator.setLimit(limit)
    place.editor.remove(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", "field"), created)
    eventually(lambda: "field" not in place.database.floors(), what="the floor is gone")


# ---- texts ----


def test_no_answer_repeats_a_text_that_is_too_long(place: Place) -> None:
    server, database, administrator = place.server, place.database, place.administrator
    there = RoboCorba.Pose(LONG, 5.0, 12.0, 0.0)
    with robot(place, "echo") as echo:
        for call, *arguments in (
            (server.registerRobot, about(LONG, 5.0, 12.0)),
            (server.registerRobot, about("other", 5.0, 12.0, floor=LONG)),
            (server.renderFloor, LONG, 400),
            (database.getFloor, LONG),
            (database.putMission, RoboCorba.MissionRecord(LONG, 1, b"")),
            (database.removeMission, LONG),
            (database.scansSince, LONG, 0.0),
            (administrator.evict, LONG),
            (administrator.place, LONG, RoboCorba.Pose("L1", 5.0, 12.0, 0.0)),
            (echo.grip, LONG, RoboCorba.XY(3.0, 12.0)),
            (echo.callElevator, LONG, "L2"),
            (echo.callElevator, "E1", LONG),
            (echo.callElevatorTogether, "E1", "L2", LONG, 1),
            (echo.reserveAreas, [RoboCorba.FloorArea(LONG, SQUARE)], 5.0),
            (echo._get_sensor().scan, there, NO_MOUNT, CROSS),
        ):
            said = refused(CORBA.UserException, call, *arguments)
            assert max(len(text) for text in texts_in(said)) <= MAX_TEXT, type(said)
            if isinstance(said, RoboCorba.UnknownFloor):
                assert said.known == ["L1", "L2", "L3", "L4", "L5"] and LONG.startswith(said.floorName)
    assert refused(RoboCorba.InvalidPicture, server.renderFloor, "L1", 10**9).field == "width"
    assert database.floorChanges("L1", 2**64 - 1).since == 0


def texts_in(value: Any) -> Iterator[str]:
    """All texts in an exception of the IDL."""
    if isinstance(value, str):
        yield value
    for one in value if isinstance(value, list) else getattr(value, "__dict__", {}).values():
        yield from texts_in(one)


# ---- clients that stall or ask for much, beside a robot and other clients ----

#: More than a server has threads in any pool.
STALLED = 40
#: Simulated time that passes during an attack [s]; the lease of a robot is 2 s.
ATTACK_S = 3.0


def check_a_robot_and_a_client(place: Place) -> None:
    """A robot stays logged on and scans, and every server answers a client, while time passes."""
    session = place.log_on("R", 6.0, 6.0)
    began = session.state().time
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    channel = place.orb.resolve("EventChannels/main", RoboCorba.EventChannel)
    sensor = session._get_sensor()
    start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0)

    def has_passed() -> bool:
        assert (channel._get_name(), planner._get_mapVersion() > 0) == ("main", True)
        assert place.editor._get_currentVersion() > 0
        assert len(sensor.scan(session.state().at, NO_MOUNT, sensor.laser()).distances) > 100
        assert place.server._get_state().robots == 1
        place.orb.check_naming()
        return bool(session.state().time > began + ATTACK_S)

    eventually(has_passed, 60.0, "the simulated time")
    assert place.names == {"R"}
    assert len(planner.getPath(start, goal)) > 1
    assert len(planner.findPaths(planner.defaultRequest(start, goal))) == 1


def test_stalled_connections_harm_nobody(place: Place) -> None:
    with contextlib.ExitStack() as attack:
        endpoints = [process.endpoint for process in place.running.record().processes if process.endpoint]
        assert len(endpoints) == 5  # naming service, map editor, simulation, sensor and channel
        for endpoint in endpoints:
            attack.enter_context(stalled_connections(Address.parse(endpoint), STALLED))
        check_a_robot_and_a_client(place)


def test_garbage_fills_no_log(place: Place) -> None:
    logs = [place.running.state / "logs" / f"{name}.log" for name in ("simulation", "map_editor", "omniNames")]
    before = [log.stat().st_size if log.exists() else 0 for log in logs]
    garbage = b"GIOP\1\2\3\1\xff\xff\xff\xff garbage"  # omniORB reports messages of this length
    for process in place.running.record().processes:
        if process.endpoint:
            with connections(Address.parse(process.endpoint), [garbage] * 50):
                pass
    check_a_robot_and_a_client(place)
    after = [log.stat().st_size if log.exists() else 0 for log in logs]
    assert all(then <= now < then + 2000 for then, now in zip(before, after, strict=True))


@pytest.mark.parametrize(("wanted", "clients"), [("pictures", 10), ("plans", 40), ("scans", 30)])
def test_greedy_clients_harm_nobody(place: Place, wanted: str, clients: int) -> None:
    """Each of their plans takes up to a second, each of their calls for scans is for a million rays."""
    with greedy_clients(place.launch, place.running.naming, wanted, clients):
        check_a_robot_and_a_client(place)
