"""Areas and cabins that robots have for themselves, and data pools: real servers, kills of the server and of robots."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from omniORB import CORBA

from robocorba.corba.conversion import maps
from robocorba.corba.event_client import Event, EventClient
from robocorba.corba.remote.data_pool import PoolFollower, RemotePool
from robocorba.corba.remote.omni_database import RemoteFloor
from robocorba.data_pool.pool import DataPool
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import UnknownPlan
from robocorba.errors.services import NotReachable
from robocorba.maps.model import Wall
from robocorba.maps.polygons import FloorArea
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import ROBOCORBA, eventually
from robocorba.testing.simulation import (
    BACK_LIMIT_S,
    CHAIR,
    CLIENT,
    GONE,
    Place,
    about,
    drive_to,
    error_lines,
    landing,
    simulation,
)
from tests.waits import stays

pytestmark = [pytest.mark.system, pytest.mark.full]

#: In the west hall of L1: two passages and what lies between, which overlap one after the other.
WEST: FloorArea = ("L1", ((1.0, 10.0), (4.0, 10.0), (4.0, 12.0), (1.0, 12.0)))
EAST: FloorArea = ("L1", ((5.0, 10.0), (7.0, 10.0), (7.0, 12.0), (5.0, 12.0)))
BOTH: FloorArea = ("L1", ((3.0, 10.5), (6.0, 10.5), (6.0, 11.5), (3.0, 11.5)))
LIMIT_S = 300.0
HALL = (2.0, 12.0)
GRANTED, WAITING = RoboCorba.AREAS_GRANTED, RoboCorba.WAITING_FOR_AREAS


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with simulation(tmp_path_factory.mktemp("simulation"), sensors=1) as place:
        yield place
        assert [line for line in error_lines(place.running.state) if "ended by SIGKILL" not in line] == []


@pytest.fixture
def place(whole: Place) -> Iterator[Place]:
    yield whole
    whole.let_go()


def struct(area: FloorArea) -> Any:
    floor, polygon = area
    return RoboCorba.FloorArea(floor, [RoboCorba.XY(*corner) for corner in polygon])


def three_robots(place: Place) -> list[Any]:
    """Robots in none of the areas."""
    return [place.log_on(name, x, 14.5) for name, x in (("first", 2.0), ("second", 4.0), ("third", 6.0))]


def phases(*sessions: Any) -> list[Any]:
    return [session.reservation().phase for session in sessions]


def answers(place: Place) -> bool:
    try:
        return bool(place.server._get_state().limit)
    except GONE:
        return False


# ---- areas and cabins ----


def test_reservations_outlive_the_server(place: Place) -> None:
    first, second, third = three_robots(place)
    first.reserveAreas([struct(WEST), struct(EAST)], LIMIT_S)
    second.reserveAreas([struct(BOTH)], LIMIT_S)
    third.reserveAreas([struct(EAST)], LIMIT_S)

    def check() -> None:
        assert phases(first) == [GRANTED]
        for waiter, ahead in ((second, 1), (third, 2)):
            found = waiter.reservation()
            assert (found.phase, found.ahead) == (WAITING, ahead)
            assert (ahead - 1) * LIMIT_S < found.longestWait < ahead * LIMIT_S

    eventually(lambda: first.reservation().left < LIMIT_S, what="time passes")
    check()
    pid = place.kill("simulation")
    eventually(lambda: answers(place), BACK_LIMIT_S, "the server is back")
    check()
    first.keepAreas([struct(EAST)])
    assert phases(second) == [WAITING]  # BOTH reaches into EAST
    first.releaseAreas()
    assert phases(second, third) == [GRANTED, WAITING]
    second.deregister()
    assert phases(third) == [GRANTED]
    for call in (second.reservation, second.releaseAreas, lambda: second.reserveAreas([struct(WEST)], 1.0)):
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            call()
    eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S, "it is recorded")


def test_a_robot_whose_process_was_killed_frees_its_areas(place: Place) -> None:
    process = place.launch(*CLIENT, str(place.running.naming))
    assert process.stdin is not None and process.stdout is not None
    rows, areas = (msgspec.json.encode(value).decode() for value in ([("doomed", "L1", 2.0, 14.5)], [WEST]))
    for order, answer in ((rows, "ready"), (f"reserve {areas}", "reserved")):
        process.stdin.write(f"{order}\n")
        process.stdin.flush()
        assert process.stdout.readline() == f"{answer}\n"
    waiter = place.log_on("waiter", 4.0, 14.5)
    waiter.reserveAreas([struct(BOTH)], LIMIT_S)
    stays(lambda: phases(waiter) == [WAITING], 1.0)  # the other one lives
    process.kill()
    eventually(lambda: phases(waiter) == [GRANTED], what="the areas of the dead robot are free")


def test_one_of_several_passages_is_reserved(place: Place) -> None:
    robots = three_robots(place)
    alternatives = [[struct(WEST)], [struct(EAST)]]
    assert [robot.reserveOneOf(alternatives, LIMIT_S) for robot in robots] == [0, 1, 0]
    assert phases(*robots) == [GRANTED, GRANTED, WAITING]
    robots[1].releaseAreas()
    for refused_call, field in (
        (lambda: robots[1].reserveOneOf([], LIMIT_S), "alternatives"),
        (lambda: robots[0].exchangeAreas([struct(EAST)], -1.0), "least"),
        (lambda: robots[1].takeOverAreas("first"), "former"),  # it is there
    ):
        with pytest.raises(RoboCorba.InvalidReservation) as refused:
            refused_call()
        assert refused.value.field == field
    assert robots[0].exchangeAreas([struct(EAST)], 1.0)  # and WEST is free for the third one
    assert phases(robots[2]) == [GRANTED]
    assert not robots[0].exchangeAreas([struct(BOTH)], 1.0)
    assert phases(robots[0]) == [GRANTED]


def test_another_robot_takes_over_what_a_silent_one_with_an_object_has_reserved(place: Place) -> None:
    chair = place.body("L1", CHAIR)
    x, y = chair["x"], chair["y"]
    silent = place.server.registerRobot(about("silent", x, y + 0.7))  # it never calls again
    silent.reserveAreas([struct(WEST), struct(EAST)], LIMIT_S)
    silent.grip(CHAIR, RoboCorba.XY(x, y + 0.25))
    waiter, successor = place.log_on("waiter", 2.0, 14.5), place.log_on("successor", 4.0, 14.5)
    waiter.reserveAreas([struct(EAST)], LIMIT_S)

    def is_taken_over() -> bool:
        with contextlib.suppress(RoboCorba.InvalidReservation):
            successor.takeOverAreas("silent")
            return True
        return False

    eventually(is_taken_over, what="the silent robot is logged off")
    assert "silent" not in place.names
    assert phases(successor, waiter) == [GRANTED, WAITING]
    successor.keepAreas([struct(WEST)])
    assert phases(successor, waiter) == [GRANTED, GRANTED]


def test_boarding_is_an_event_with_the_longest_wait(place: Place) -> None:
    found: list[Event] = []
    elevator = place.elevator()
    origin, destination = elevator.floors()[:2]
    with EventClient(place.orb, "main") as client:
        client.subscribe(found.append, "simulation.boarding")
        robot = place.log_on("rider", *landing(elevator, origin, 0.8), floor=origin)
        with pytest.raises(RoboCorba.InvalidRide) as refused:
            robot.callElevatorTogether(elevator.name, destination, "table", 999)
        assert refused.value.field == "partySize"
        robot.callElevator(elevator.name, destination)
        announced_s = robot.longestElevatorWait()
        eventually(lambda: found, 60.0, "the event")
        robot.giveUpElevator()
    (payload,) = [event.payload for event in found]
    assert (payload["floor"], payload["who"]) == (origin, ["rider"])
    assert 0.0 < payload["waited_s"] <= payload["longest_wait_s"]
    assert announced_s <= payload["longest_wait_s"]  # asked a moment later
    assert robot.state().riding.phase == RoboCorba.NO_RIDE


# ---- data pools ----


@contextlib.contextmanager
def following(place: Place, floor: str, oneself: str = "") -> Iterator[DataPool]:
    """A pool that is kept up to date, and knows the floor."""
    with contextlib.closing(PoolFollower(place.orb, floor, oneself).start()) as follower:
        assert follower.pool.floor == floor
        eventually(lambda: follower.pool.snapshot().is_known, BACK_LIMIT_S, "the pool knows its floor")
        yield follower.pool


def bodies(place: Place, floor: str) -> dict[str, tuple[float, ...]]:
    """Poses of all that is on a floor, by name, as the database has them."""
    copy = RemoteFloor(place.database, floor)
    copy.follow()
    rows = copy.view.motions[["x", "y", "heading"]].tolist()
    return {body.name: row for body, row in zip(copy.view.bodies.values(), rows, strict=True)}


def known(pool: DataPool) -> dict[str, tuple[float, ...]]:
    """The same as a pool has them."""
    snapshot = pool.snapshot()
    things = [*snapshot.robots, *(thing for thing in snapshot.objects() if thing.is_movable)]
    return {thing.name: (thing.x, thing.y, thing.heading) for thing in things}


def test_the_pool_follows_robots_and_the_map(place: Place) -> None:
    me = place.log_on("me", *HALL)
    place.log_on("other", HALL[0], HALL[1] + 2.0)
    place.log_on("above", *HALL, floor="L3")
    with following(place, "L1", "me") as pool:
        drive_to(me, (HALL[0] + 2.0, HALL[1]))
        at = eventually(lambda: me.state().moving.ahead == 0.0 and me.state().at)
        eventually(lambda: (one := pool.snapshot().robot("me")) and math.dist((one.x, one.y), (at.x, at.y)) < 1e-9)
        eventually(lambda: known(pool) == bodies(place, "L1"), what="it is as the database says")
        assert [near.robot.name for near in pool.snapshot().robots_near(*HALL, 3.0)] == ["other"]
        before = pool.snapshot().nearest_non_robot(1.2, 11.1)
        place.editor.create("L2", maps.element(Wall("new", (1.0, 11.0), (1.4, 11.0))))
        place.editor.create("L1", maps.element(Wall("newer", (1.0, 13.0), (1.4, 13.0))))
        eventually(lambda: pool.snapshot().nearest_non_robot(1.2, 13.1) == (pytest.approx(0.1), 1.2, 13.0, "newer"))
        assert pool.snapshot().nearest_non_robot(1.2, 11.1) == before  # L2 is another floor
        eventually(lambda: 0.0 <= pool.lag_s < 2.0)
        assert pool.change_floor("L3")
        assert known(pool) == bodies(place, "L3")
        assert pool.snapshot().robot("above") and not pool.snapshot().robot("other")
        walls = pool.snapshot().walls
        assert walls and walls.floor == "L3"
        with pytest.raises(UnknownFloor, match="L9"):
            pool.change_floor("L9")
        assert (pool.floor, pool.problem) == ("L3", "")


def test_pools_survive_kills_of_the_simulation_server(place: Place) -> None:
    me = place.log_on("me", *HALL)
    with following(place, "L1", "me") as pool:
        eventually(lambda: pool.snapshot().robot("me"))
        pid = place.kill("simulation")
        eventually(lambda: pool.problem, what="the pool notices")
        lag_s = pool.lag_s
        assert pool.snapshot().robot("me")  # what was known stays
        with following(place, "L1"):  # which begins before the server answers
            eventually(lambda: pool.lag_s > lag_s or not pool.problem)
        eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S)
        eventually(lambda: not pool.problem and pool.lag_s < 1.0, BACK_LIMIT_S, "the pool follows again")
        drive_to(me, (HALL[0] + 1.0, HALL[1]))
        eventually(lambda: abs((pool.snapshot().robot("me") or me.state().at).x - HALL[0] - 1.0) < 0.1)
        eventually(lambda: known(pool) == bodies(place, "L1"))


def test_the_pool_of_another_process_is_read_over_corba(place: Place) -> None:
    below = place.log_on("below", *HALL)
    below.reportPosture([0.5, -0.5])
    where = ("--floor", "L1", "--at", "4,14.5", "--naming", str(place.running.naming))
    robot = place.launch(ROBOCORBA, "robot", "leader", *where, "--state", str(place.launch.folder / "robot"))
    assert robot.stdout is not None and robot.stdout.readline() == "ready\n"
    pool = RemotePool.of_robot(place.orb, "leader", 20.0)
    eventually(lambda: pool.lag_s < math.inf, what="it knows its floor")
    whole = pool.content()
    assert (pool.floor, whole.floor, whole.since) == ("L1", "L1", 0)
    assert {"below", "leader"} <= {body.name for body in whole.came}
    assert (0.5, -0.5) in [posture.joints for posture in pool.postures(0.0)]
    below.command(RoboCorba.Velocity(0.5, 0.0, 0.0), 1.0)
    moved = eventually(lambda: len((update := pool.changes(whole.version)).motions) and update)
    assert (moved.since, moved.came) == (whole.version, [])
    assert pool.plans() == []
    with pytest.raises(UnknownPlan, match="fetch"):
        pool.plan("fetch")
    robot.kill()
    robot.wait()
    for ask in (pool.content, pool.plans, lambda: pool.lag_s):
        with pytest.raises(NotReachable, match="data pool"):
            ask()
    with pytest.raises(NotReachable):
        RemotePool.of_robot(place.orb, "nobody", 0.2)
