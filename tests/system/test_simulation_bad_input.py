"""Nonsense of every kind over the wire, and clients that stall or ask for much: a typed exception each time, and a
simulation that goes on as it was."""

from __future__ import annotations

import contextlib
import functools
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
from testkit.simulation import CROSS, NO_MOUNT, NO_NOISE, STAND, Place, about, error_lines, simulation
from tests.system.refusals import refused
from tests.waits import pause

pytestmark = [pytest.mark.system, pytest.mark.full]

#: What servers may grow by over all of this module, MiB. Single messages of it have up to 40 MB.
GROWTH_MIB = 200
#: The fixtures are of the module, so they are the same for all examples of a test.
MANY = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
#: Robots that want to log on and may not, before the crowd goes, and how long it tries at most [s].
CROWD, CROWD_LIMIT_S = 2_000, 200.0
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


def test_reservations_of_any_size_are_refused_soon(place: Place) -> None:
    area = functools.partial(RoboCorba.FloorArea, "L1")
    with robot(place, "owner") as owner:
        for areas in ([area(SQUARE)] * 33, [area(SQUARE)] * 5_000, [area(SQUARE * 129)], [area(SQUARE * 5_000)]):
            began = time.monotonic()
            assert refused(RoboCorba.InvalidReservation, owner.reserveAreas, areas, 5.0).field == "areas"
            assert time.monotonic() - began < 10.0
        assert owner.reservation().phase == RoboCorba.NO_RESERVATION


def test_a_crowd_that_wants_to_log_on_is_turned_away(place: Place) -> None:
    limit = place.server._get_state().limit
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
    assert most <= limit and len(turned_away) >= CROWD
    assert all(one.limit == one.now == limit and one.retryAfter <= 2.0 for one in turned_away)
    assert max(one.result() for one in crowd) < ANSWER_S
    place.let_go()
    assert place.server._get_state().robots == 0
    place.editor.remove(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", "field"), created)
    eventually(lambda: "field" not in place.database.floors(), what="the floor is gone")


# ---- sensors ----


def test_a_million_rays_are_the_most_at_once(sensor: Any) -> None:
    turn = RoboCorba.ScanSpec(0.0, math.tau / 8001, 8000, 30.0, 0.0, NO_NOISE)
    most = [RoboCorba.Pose("L1", 3.0, 12.0, 0.01 * step) for step in range(125)]
    began = time.monotonic()
    assert [len(one.distances) for one in sensor.scanMany(most, NO_MOUNT, turn)] == [8000] * 125
    assert time.monotonic() - began < 10.0
    on_all = [RoboCorba.Pose(f"L{level}", 3.0, 12.0, 0.0) for level in range(1, 6) for _ in range(26)]
    for batch in ([*most, most[0]], most * 100, on_all):
        assert refused(RoboCorba.InvalidScan, sensor.scanMany, batch, NO_MOUNT, turn).field == "rays"
    assert sensor.scanMany([], NO_MOUNT, turn) == []
    unknown = [most[0], RoboCorba.Pose("L9", 0.0, 0.0, 0.0)]
    refused(RoboCorba.UnknownFloor, sensor.scanMany, unknown, NO_MOUNT, CROSS)
    lost = RoboCorba.ScanSpec(0.0, 0.1, 60, 30.0, 0.0, RoboCorba.ScanNoise(0.0, 0.0, 1.1, 0))
    assert refused(RoboCorba.InvalidScan, sensor.scan, most[0], NO_MOUNT, lost).field == "lost"


def test_sensors_of_robots_that_nobody_knows_cost_nothing(place: Place, sensor: Any) -> None:
    process = psutil.Process(place.pid("sensor_s1"))
    before = process.memory_info().rss
    for number in range(100):
        for name in ("", LONG, f"two\nlines{number}", f"../a{number}"):
            with contextlib.suppress(CORBA.BAD_PARAM):
                sensor.forRobot(name)
            sensor.dismiss(name)
    assert process.memory_info().rss - before < 20 * 2**20


# ---- the building ----


def test_missions_that_are_kept_can_be_read(place: Place) -> None:
    """A message has 64 MiB at most."""
    kept = []
    try:
        for number in range(70):
            try:
                place.database.putMission(RoboCorba.MissionRecord(f"m{number}", 0, bytes(2**20)))
            except RoboCorba.InvalidMission as full:
                assert full.reason
                break
            kept.append(f"m{number}")
        assert sorted(mission.name for mission in place.database.missions()) == sorted(kept)
    finally:
        for name in kept:
            place.database.removeMission(name)
    assert len(kept) > 10


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


# ---- an administrator: last, because who loses time loses all ----


def test_no_setting_is_out_of_range_and_time_goes_on_after_any_pace(place: Place) -> None:
    for call, field, values in (
        (place.administrator.setLimit, "robots", (10_001, 2**32 - 1)),
        (place.administrator.step, "steps", (0, 2**32 - 1)),
        (place.administrator.setPace, "pace", (math.nan, math.inf, -math.inf, -1.0, -5e-324, 1000.1, 1.7e308)),
    ):
        for value in values:
            assert refused(RoboCorba.InvalidSetting, call, value).field == field
    state = place.server._get_state()
    assert (state.limit, state.pace, state.paused) == (300, 1.0, False)
    for pace in (1000.0, 0.0, 0.5, 1e-3, 1e-300, 5e-324):
        place.administrator.setPace(pace)
        pause(0.05)  # a step at the least
        assert place.server._get_state().pace == pace
        place.administrator.setPace(1.0)
        began = place.server._get_state().time
        eventually(lambda: place.server._get_state().time > began, 30.0, f"time passes after a pace of {pace}")  # noqa: B023
