"""Nonsense of every kind over the wire: a typed exception each time, and a simulation that goes on as it was."""

from __future__ import annotations

import contextlib
import itertools
import math
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import psutil
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omniORB import CORBA

from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from robocorba.testing.simulation import (
    CROSS,
    NO_MOUNT,
    NO_NOISE,
    STAND,
    Place,
    about,
    error_lines,
    is_gone,
    simulation,
)
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


class Named(str):
    """A text that is too long to be printed."""

    def __repr__(self) -> str:
        return f"{self[:5]!r}..."


LONG = Named("x" * 1_000_000)
numbers = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 1.7e308, -1.7e308, 5e-324, 1e7, -1.0, 0.0]), st.floats()
)
texts = st.sampled_from(
    ["", LONG, "ж" * 201, "two\nlines", "\x1b[2J", "\N{RIGHT-TO-LEFT OVERRIDE}", "\x7f", "../a", "a b", "'", "-a", "."]
)
floors = st.one_of(st.sampled_from(["L9", "l1", "L1 ", "L1/", "\n"]), texts)
counts = st.sampled_from([0, 1, 2**31, 2**32 - 1, 10**9])
velocities = st.builds(RoboCorba.Velocity, numbers, numbers, numbers)
poses = st.builds(RoboCorba.Pose, st.one_of(st.just("L1"), floors), numbers, numbers, numbers)
mounts = st.builds(RoboCorba.Mount, numbers, numbers, numbers)
noises = st.builds(RoboCorba.ScanNoise, numbers, numbers, numbers, st.sampled_from([0, 2**63, 2**64 - 1]))
specs = st.builds(RoboCorba.ScanSpec, numbers, numbers, counts, numbers, numbers, noises)


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


def answer_to(call: Callable[..., Any], *arguments: Any, may: tuple[type[Exception], ...]) -> Any:
    """What the call returns, or the exception that it raised, one of those that it may."""
    try:
        return call(*arguments)
    except may as refused:
        return refused


# ---- robots ----

#: Members of a description, by their path; all of them are numbers.
MEMBERS = [
    *("start.x", "start.y", "start.heading", "radius", "mass"),
    *("limits.speed", "limits.turn", "limits.acceleration", "limits.turnAcceleration"),
]


@given(
    st.one_of(
        st.tuples(st.just("name"), texts),
        st.tuples(st.just("start.floor"), floors),
        st.tuples(st.sampled_from(MEMBERS), numbers),
    )
)
@MANY
def test_a_robot_is_what_it_says_or_may_not_log_on(place: Place, wrong: tuple[str, Any]) -> None:
    description = about("odd", 3.0, 12.0)
    *before, last = wrong[0].split(".")
    owner = getattr(description, before[0]) if before else description
    assert hasattr(owner, last)
    setattr(owner, last, wrong[1])
    may = (RoboCorba.InvalidDescription, RoboCorba.UnknownFloor, RoboCorba.PlaceTaken)
    answer = answer_to(place.server.registerRobot, description, may=may)
    if isinstance(answer, RoboCorba.InvalidDescription):
        assert answer.field.replace(" ", "") in wrong[0].lower() and answer.reason
    elif isinstance(answer, RoboCorba.UnknownFloor):
        assert wrong[0] == "start.floor" and wrong[1].startswith(answer.floorName)
    elif not isinstance(answer, Exception):
        assert math.isfinite(wrong[1]) if isinstance(wrong[1], float) else wrong[0] != "start.floor"
        at = answer.state().at
        assert (at.floor, at.x, at.y) == (description.start.floor, description.start.x, description.start.y)
        assert len(place.database.getFloor("L1").came) and place.server.renderFloor("L1", 400)
        with contextlib.suppress(CORBA.OBJECT_NOT_EXIST):  # on a busy machine its lease may have expired
            answer.deregister()


@given(velocities, numbers)
@MANY
def test_no_command_takes_a_robot_out_of_the_world(place: Place, wanted: Any, valid_s: float) -> None:
    with robot(place, "fast") as fast:
        answer = answer_to(fast.command, wanted, valid_s, may=(RoboCorba.InvalidCommand,))
        is_velocity = math.isfinite(wanted.ahead + wanted.left + wanted.turn)
        assert (answer is None) == (is_velocity and 0.0 <= valid_s <= 5.0)
        fast.command(wanted if is_velocity else STAND, 5.0)
        began = fast.state().time
        eventually(lambda: fast.state().time > began + 0.02, what="two steps")
        state = fast.state()
        found = (state.at.x, state.at.y, state.at.heading, state.moving.ahead, state.moving.left, state.moving.turn)
        assert all(map(math.isfinite, found)), state


@contextlib.contextmanager
def robot(place: Place, name: str) -> Iterator[Any]:
    """The fastest robot that there may be, in the west hall."""
    fastest = (10.0, 4 * math.pi, 50.0, 50.0)
    session = place.server.registerRobot(about(name, 3.0, 12.0, limits=fastest))
    try:
        yield session
    finally:
        session.deregister()


@given(st.one_of(texts, st.just("room-101-chair-1")), st.builds(RoboCorba.XY, numbers, numbers))
@MANY
def test_a_robot_grips_nothing_that_is_not_there(place: Place, what: str, at: Any) -> None:
    with robot(place, "hand") as hand:
        refused = answer_to(hand.grip, what, at, may=(RoboCorba.CannotGrip,))
        assert isinstance(refused, RoboCorba.CannotGrip) and what.startswith(refused.what) and refused.reason
        assert hand.state().holding == ""


@given(st.one_of(texts, st.sampled_from(["E1", "E2"])), floors)
@MANY
def test_no_ride_goes_anywhere_else(place: Place, elevator: str, destination: str) -> None:
    with robot(place, "rider") as rider:
        refused = answer_to(rider.callElevator, elevator, destination, may=(RoboCorba.InvalidRide,))
        assert isinstance(refused, RoboCorba.InvalidRide)
        assert refused.field == ("destination" if elevator in ("E1", "E2") else "elevator")
        rider.giveUpElevator()
        assert rider.state().riding.phase == RoboCorba.NO_RIDE


@given(texts, counts)
@MANY
def test_no_party_is_other_than_may_be(place: Place, party: str, size: int) -> None:
    with robot(place, "rider") as rider:
        answer = answer_to(rider.callElevatorTogether, "E1", "L2", party, size, may=(RoboCorba.InvalidRide,))
        is_party = 1 <= len(party) <= 200
        assert (answer is None) == (is_party and size == 1)
        if answer:
            assert answer.field == ("partySize" if is_party else "party") and answer.reason
        assert (rider.state().riding.phase == RoboCorba.NO_RIDE) == (answer is not None)


SQUARE = [RoboCorba.XY(2.0, 11.0), RoboCorba.XY(3.0, 11.0), RoboCorba.XY(3.0, 12.0), RoboCorba.XY(2.0, 12.0)]
corners = st.lists(
    st.one_of(st.sampled_from(SQUARE), st.builds(RoboCorba.XY, numbers, numbers)), min_size=0, max_size=6
)
reserved = st.builds(RoboCorba.FloorArea, st.one_of(st.just("L1"), floors), st.one_of(st.just(SQUARE), corners))
RESERVATION_MAY = (RoboCorba.InvalidReservation, RoboCorba.UnknownFloor)


@given(st.lists(reserved, max_size=3), st.one_of(st.just(5.0), numbers))
@MANY
def test_what_is_reserved_is_an_area_for_a_while(place: Place, areas: list[Any], limit_s: float) -> None:
    with robot(place, "owner") as owner:
        answer = answer_to(owner.reserveAreas, areas, limit_s, may=RESERVATION_MAY)
        if isinstance(answer, RoboCorba.UnknownFloor):
            assert any(area.onFloor.startswith(answer.floorName) for area in areas) and answer.which.startswith(
                "areas["
            )
        elif answer:
            assert answer.field.startswith(("areas", "limit")) and answer.reason
        else:
            assert areas and 0.0 < limit_s <= 600.0 and all(area.onFloor == "L1" for area in areas)
        found = owner.reservation()
        assert (found.phase == RoboCorba.AREAS_GRANTED) == (answer is None) or limit_s < 1.0
        assert all(map(math.isfinite, (found.longestWait, found.left)))
        other = answer_to(owner.keepAreas, [RoboCorba.FloorArea("L2", SQUARE)], may=RESERVATION_MAY)
        assert isinstance(other, RoboCorba.InvalidReservation)
        owner.releaseAreas()
        assert owner.reservation().phase == RoboCorba.NO_RESERVATION


@pytest.mark.parametrize(
    ("field", "areas", "limit_s"),
    [
        ("areas", [], 5.0),
        ("areas", [RoboCorba.FloorArea("L1", SQUARE)] * 33, 5.0),
        ("areas", [RoboCorba.FloorArea("L1", SQUARE)] * 5_000, 5.0),
        ("areas", [RoboCorba.FloorArea("L1", SQUARE * 129)], 5.0),
        ("areas", [RoboCorba.FloorArea("L1", SQUARE * 5_000)], 5.0),
        ("limit", [RoboCorba.FloorArea("L1", SQUARE)], math.nan),
        ("limit", [RoboCorba.FloorArea("L1", SQUARE)], math.inf),
        ("limit", [RoboCorba.FloorArea("L1", SQUARE)], 600.5),
        ("limit", [RoboCorba.FloorArea("L1", SQUARE)], 0.0),
        ("areas[1].polygon", [RoboCorba.FloorArea("L1", SQUARE), RoboCorba.FloorArea("L1", SQUARE[:2])], 5.0),
        ("areas[0].polygon", [RoboCorba.FloorArea("L1", SQUARE[::2] + SQUARE[1::2])], 5.0),
        ("areas[0].polygon", [RoboCorba.FloorArea("L1", SQUARE[:1] * 4)], 5.0),
        ("areas[0].polygon[4]", [RoboCorba.FloorArea("L1", [*SQUARE, RoboCorba.XY(math.nan, 0.0)])], 5.0),
        ("areas[0].polygon[4]", [RoboCorba.FloorArea("L1", [*SQUARE, RoboCorba.XY(0.0, 1e9)])], 5.0),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_reservation_is_refused_by_the_name_of_its_member(
    place: Place, field: str, areas: list[Any], limit_s: float
) -> None:
    with robot(place, "owner") as owner:
        began = time.monotonic()
        with pytest.raises(RoboCorba.InvalidReservation) as refused:
            owner.reserveAreas(areas, limit_s)
        assert refused.value.field == field and refused.value.reason
        assert time.monotonic() - began < 10.0
        assert owner.reservation().phase == RoboCorba.NO_RESERVATION


@given(st.one_of(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")), st.just(LONG[:10_000])))
@MANY
def test_a_made_up_reference_leads_to_nobody(place: Place, key: str) -> None:
    at = place.endpoint("simulation")
    with robot(place, "known") as known:
        for guess in (key, "known", secrets.token_urlsafe(24), ""):
            quoted = "".join(f"%{byte:02x}" for byte in f"sessions/{guess}".encode())
            session = place.orb.reference(f"corbaloc:iiop:1.2@{at}/{quoted}", RoboCorba.RobotSession)
            for call in (session.state, session.deregister, session.release):
                with pytest.raises(CORBA.OBJECT_NOT_EXIST):
                    call()
        assert not is_gone(known)


def test_a_crowd_that_wants_to_log_on_is_turned_away(place: Place) -> None:
    limit = place.server._get_state().limit
    took: list[float] = []
    refused: list[RoboCorba.ServerFull] = []
    field = RoboCorba.Floor("field", 99, 99.0, 3.0, [])  # without an outline
    created = place.editor.create("", RoboCorba.Element(aFloor=field))
    eventually(lambda: "field" in place.database.floors(), what="the new floor")

    numbers, until = itertools.count(), time.monotonic() + CROWD_LIMIT_S

    def want() -> None:
        while len(refused) < CROWD and time.monotonic() < until:
            number, began = next(numbers), time.monotonic()
            try:
                place.log_on(f"crowd-{number}", 1.0 * (number % 100), 1.0 * (number // 100 % 100), floor="field")
            except RoboCorba.ServerFull as full:
                refused.append(full)
            took.append(time.monotonic() - began)

    threads = [threading.Thread(target=want) for _ in range(4)]
    for thread in threads:
        thread.start()
    most = 0
    while any(thread.is_alive() for thread in threads):
        most = max(most, place.server._get_state().robots)
        pause(0.05)
    assert most <= limit and len(refused) >= CROWD
    assert all(one.limit == one.now == limit and one.retryAfter <= 2.0 for one in refused)
    assert max(took) < ANSWER_S
    place.let_go()
    assert place.server._get_state().robots == 0
    place.editor.remove(RoboCorba.ElementId(RoboCorba.FLOOR_ELEMENT, "", "field"), created)
    eventually(lambda: "field" not in place.database.floors(), what="the floor is gone")


# ---- sensors ----

SCAN_MAY = (RoboCorba.InvalidScan, RoboCorba.UnknownFloor)


@given(poses, mounts, specs)
@MANY
def test_a_scan_is_right_or_refused(place: Place, pose: Any, mount: Any, spec: Any) -> None:
    sensor = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    good = RoboCorba.ScanSpec(0.0, 0.1, 60, 30.0, 0.0, NO_NOISE)
    here = RoboCorba.Pose("L1", 3.0, 12.0, 0.0)
    for which in ((pose, NO_MOUNT, good), (here, mount, good), (here, NO_MOUNT, spec), (pose, mount, spec)):
        answer = answer_to(sensor.scan, *which, may=SCAN_MAY)
        many = answer_to(sensor.scanMany, [which[0]] * 3, *which[1:], may=SCAN_MAY)
        if isinstance(answer, Exception):
            assert type(many) is type(answer)
        else:
            assert [one.distances for one in many] == [answer.distances] * 3
            assert len(answer.distances) == which[2].rays
            assert all(0.0 <= distance <= which[2].range for distance in answer.distances)


def wrong_spec(**members: Any) -> Any:
    spec = RoboCorba.ScanSpec(0.0, 0.1, 60, 30.0, 0.0, RoboCorba.ScanNoise(0.0, 0.0, 0.0, 0))
    for name, value in members.items():
        owner = spec if hasattr(spec, name) else spec.noise
        assert hasattr(owner, name)
        setattr(owner, name, value)
    return spec


@pytest.mark.parametrize(
    "members",
    [
        {"rays": 0},
        {"rays": 8193},
        {"rays": 10**9},
        {"firstAngle": math.nan},
        {"firstAngle": 1e300},
        {"step": 0.0},
        {"step": -0.1},
        {"step": math.inf},
        {"step": 1.0},
        {"range": -8.0},
        {"range": 0.0},
        {"range": 1001.0},
        {"range": math.nan},
        {"rim": -1.0},
        {"rim": math.inf},
        {"sigma": -1.0},
        {"relative": math.nan},
        {"lost": 1.1},
    ],
    ids=str,
)
def test_a_wrong_scan_is_refused_by_the_name_of_its_member(place: Place, members: dict[str, Any]) -> None:
    sensor = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    with pytest.raises(RoboCorba.InvalidScan) as refused:
        sensor.scan(RoboCorba.Pose("L1", 3.0, 12.0, 0.0), NO_MOUNT, wrong_spec(**members))
    assert refused.value.field in members and refused.value.reason


def test_a_million_rays_are_the_most_at_once(place: Place) -> None:
    sensor = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    names = ["L1", "L2", "L3", "L4", "L5"]
    turn = wrong_spec(rays=8000, step=math.tau / 8001)
    most = [RoboCorba.Pose("L1", 3.0, 12.0, 0.01 * step) for step in range(125)]
    began = time.monotonic()
    assert [len(one.distances) for one in sensor.scanMany(most, NO_MOUNT, turn)] == [8000] * 125
    assert time.monotonic() - began < 10.0
    on_all = [RoboCorba.Pose(floor, 3.0, 12.0, 0.0) for floor in names for _ in range(26)]
    batches = ([*most, most[0]], most * 100, on_all)
    for batch in batches:
        with pytest.raises(RoboCorba.InvalidScan) as refused:
            sensor.scanMany(batch, NO_MOUNT, turn)
        assert refused.value.field == "rays"
    assert sensor.scanMany([], NO_MOUNT, turn) == []
    with pytest.raises(RoboCorba.UnknownFloor):
        sensor.scanMany([most[0], RoboCorba.Pose("L9", 0.0, 0.0, 0.0)], NO_MOUNT, CROSS)


@given(numbers)
@MANY
def test_a_ring_of_sensors_is_as_wide_as_a_robot(place: Place, radius: float) -> None:
    sensor = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    answer = answer_to(sensor.proximity, radius, may=(RoboCorba.InvalidScan,))
    assert isinstance(answer, RoboCorba.InvalidScan) or answer.rim == radius


@given(texts)
@settings(MANY, max_examples=30)
def test_sensors_of_robots_that_nobody_knows_cost_nothing(place: Place, name: str) -> None:
    sensor = place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    process = psutil.Process(place.pid("sensor_s1"))
    before = process.memory_info().rss
    for number in range(5):
        with contextlib.suppress(CORBA.BAD_PARAM):
            sensor.forRobot(f"{name}{number}")
        sensor.dismiss(f"{name}-{number}")
    assert process.memory_info().rss - before < 20 * 2**20


loads = st.builds(RoboCorba.SensorLoad, numbers, numbers, numbers, counts)
sights = st.builds(
    RoboCorba.SensorData,
    st.one_of(texts, st.sampled_from(["r0", "r1"])),
    poses,
    st.builds(RoboCorba.ScanData, numbers, numbers, numbers, st.lists(numbers, max_size=20)),
)


@given(st.one_of(texts, st.sampled_from(["s1", "s2"])), st.booleans(), loads, st.lists(sights, max_size=5))
@settings(MANY, max_examples=40)
def test_nobody_is_blinded_by_a_false_sensor_process(
    place: Place, name: str, is_nil: bool, load: Any, seen: list[Any]
) -> None:
    for number in range(3):
        if not any(f"r{number}" == known for known in place.names):
            place.log_on(f"r{number}", 2.0 + number, 12.0)
    reference = None if is_nil else place.orb.resolve("VirtualSensors/s1", RoboCorba.VirtualSensor)
    answer_to(place.server.reportSensor, name, reference, load, seen, may=(CORBA.BAD_PARAM, CORBA.NO_PERMISSION))
    assert place.server.sensors() and len(place.server.clients()) == 3
    for floor in ("L1", "L2"):
        assert all(isinstance(one.robot, str) for one in place.database.lastScans(floor))
    assert bytes(place.server.renderFloor("L1", 200)).startswith(b"\x89PNG")


# ---- the building ----


@given(floors, st.sampled_from([0, 1, 2**63, 2**64 - 1]))
@MANY
def test_a_floor_that_is_not_there_is_unknown(place: Place, floor: str, since: int) -> None:
    database = place.database
    for call in (
        lambda: database.getFloor(floor),
        lambda: database.floorChanges(floor, since),
        lambda: database.lastScans(floor),
        lambda: place.server.renderFloor(floor, 400),
    ):
        answer = answer_to(call, may=(RoboCorba.UnknownFloor,))
        assert isinstance(answer, RoboCorba.UnknownFloor)
        assert answer.known == ["L1", "L2", "L3", "L4", "L5"] and floor.startswith(answer.floorName)
    update = database.floorChanges("L1", since)
    assert update.since in (0, since) and update.current < 2**63


@pytest.mark.parametrize("width", [0, 1, 199, 4097, 10**9, 2**32 - 1])
def test_no_picture_is_larger_than_may_be(place: Place, width: int) -> None:
    with pytest.raises(RoboCorba.InvalidPicture) as refused:
        place.server.renderFloor("L1", width)
    assert refused.value.field == "width" and refused.value.reason


missions = st.one_of(
    st.builds(RoboCorba.MissionRecord, st.sampled_from(["", LONG, "ж" * 201]), st.just(0), st.just(b"")),
    st.builds(RoboCorba.MissionRecord, texts, st.sampled_from([1, 2**63, 2**64 - 1]), st.just(b"")),
    st.builds(RoboCorba.MissionRecord, st.just("large"), st.just(0), st.just(bytes(2**20 + 1))),
)


@given(missions)
@MANY
def test_a_wrong_mission_is_not_kept(place: Place, mission: Any) -> None:
    may = (RoboCorba.InvalidMission, RoboCorba.StaleMission)
    answer = answer_to(place.database.putMission, mission, may=may)
    assert isinstance(answer, may) and place.database.missions() == []
    assert isinstance(
        answer_to(place.database.removeMission, mission.name, may=(RoboCorba.UnknownMission,)), RoboCorba.UnknownMission
    )


def test_missions_that_are_kept_can_be_read(place: Place) -> None:
    """A message has 64 MiB at most."""
    kept = []
    try:
        for number in range(70):
            try:
                place.database.putMission(RoboCorba.MissionRecord(f"m{number}", 0, bytes(2**20)))
            except RoboCorba.InvalidMission as refused:
                assert refused.reason
                break
            kept.append(f"m{number}")
        assert sorted(mission.name for mission in place.database.missions()) == sorted(kept)
    finally:
        for name in kept:
            place.database.removeMission(name)
    assert len(kept) > 10


def test_no_answer_repeats_a_text_that_is_too_long(place: Place) -> None:
    long_record = RoboCorba.MissionRecord(LONG, 1, b"")
    with robot(place, "echo") as echo:
        for call in (
            lambda: place.server.registerRobot(about(LONG, 5.0, 12.0)),
            lambda: place.server.registerRobot(about("other", 5.0, 12.0, floor=LONG)),
            lambda: place.server.renderFloor(LONG, 400),
            lambda: place.database.getFloor(LONG),
            lambda: place.database.floorChanges(LONG, 1),
            lambda: place.database.lastScans(LONG),
            lambda: place.database.putMission(long_record),
            lambda: place.database.removeMission(LONG),
            lambda: place.database.scansSince(LONG, 0.0),
            lambda: place.database.postures(LONG, 0.0),
            lambda: place.administrator.evict(LONG),
            lambda: place.administrator.place(LONG, RoboCorba.Pose("L1", 5.0, 12.0, 0.0)),
            lambda: place.administrator.place("echo", RoboCorba.Pose(LONG, 5.0, 12.0, 0.0)),
            lambda: echo.grip(LONG, RoboCorba.XY(3.0, 12.0)),
            lambda: echo.callElevator(LONG, "L2"),
            lambda: echo.callElevator("E1", LONG),
            lambda: echo.callElevatorTogether("E1", "L2", LONG, 1),
            lambda: echo.callElevatorTogether(LONG, LONG, LONG, 1),
            lambda: echo.reserveAreas([RoboCorba.FloorArea(LONG, SQUARE)], 5.0),
            lambda: echo.keepAreas([RoboCorba.FloorArea(LONG, SQUARE)]),
            lambda: echo._get_sensor().scan(RoboCorba.Pose(LONG, 3.0, 12.0, 0.0), NO_MOUNT, CROSS),
        ):
            with pytest.raises(CORBA.UserException) as refused:
                call()
            longest = max(len(text) for text in texts_in(refused.value))
            assert longest <= MAX_TEXT, type(refused.value)


def texts_in(value: Any) -> Iterator[str]:
    """All texts in an exception of the IDL."""
    if isinstance(value, str):
        yield value
    for one in value if isinstance(value, list) else getattr(value, "__dict__", {}).values():
        yield from texts_in(one)


# ---- administrators: last, because who loses time loses all ----


REFUSED = (RoboCorba.InvalidSetting,)


@given(st.integers(10_001, 2**32 - 1), counts, texts)
@MANY
def test_a_setting_out_of_range_changes_nothing(place: Place, limit: int, steps: int, name: str) -> None:
    administrator, before = place.administrator, place.server._get_state()
    for call, field in (
        (lambda: administrator.setLimit(limit), "robots"),
        (lambda: administrator.step(steps), "steps"),
    ):
        answer = answer_to(call, may=REFUSED)
        assert isinstance(answer, REFUSED) and answer.field == field
    unknown = answer_to(administrator.evict, name, may=(RoboCorba.UnknownRobot,))
    assert isinstance(unknown, RoboCorba.UnknownRobot) and name.startswith(unknown.name)
    after = place.server._get_state()
    assert (after.limit, after.pace, after.paused) == (before.limit, before.pace, before.paused)


def test_time_goes_on_after_any_pace(place: Place) -> None:
    for pace in (math.nan, math.inf, -math.inf, -1.0, -5e-324, 1000.1, 1.7e308):
        assert isinstance(answer_to(place.administrator.setPace, pace, may=REFUSED), REFUSED), pace
        assert place.server._get_state().pace == 1.0
    for pace in (1000.0, 0.0, 0.5, 1e-3, 1e-300, 5e-324):
        place.administrator.setPace(pace)
        pause(0.05)  # a step at the least
        assert place.server._get_state().pace == pace
        place.administrator.setPace(1.0)
        began = place.server._get_state().time
        eventually(lambda: place.server._get_state().time > began, 30.0, f"time passes after a pace of {pace}")  # noqa: B023
