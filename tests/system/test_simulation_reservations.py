"""Areas and cabins that robots have for themselves: real servers, kills of the server and of a robot's process."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from omniORB import CORBA

from robocorba.corba.remote.session import RemoteSession
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import RobotLost
from robocorba.errors.simulation import InvalidReservation, InvalidRide
from robocorba.maps.polygons import FloorArea
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import Reservation
from robocorba.spatial.floor_state import Pose
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import eventually
from robocorba.testing.simulation import (
    BACK_LIMIT_S,
    CLIENT,
    GONE,
    RADIUS_M,
    RELEASE_LIMIT_S,
    Place,
    drive_to,
    error_lines,
    landing,
    simulation,
)

pytestmark = pytest.mark.system

#: In the west hall of L1: two passages and what lies between, which overlap one after the other.
WEST: FloorArea = ("L1", ((1.0, 10.0), (4.0, 10.0), (4.0, 12.0), (1.0, 12.0)))
EAST: FloorArea = ("L1", ((5.0, 10.0), (7.0, 10.0), (7.0, 12.0), (5.0, 12.0)))
BOTH: FloorArea = ("L1", ((3.0, 10.5), (6.0, 10.5), (6.0, 11.5), (3.0, 11.5)))
LIMIT_S = 300.0


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


def encoded(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def phase(session: Any) -> Any:
    return session.reservation().phase


def answers(place: Place) -> bool:
    try:
        return bool(place.server._get_state().limit)
    except GONE:
        return False


def test_reservations_outlive_the_server(place: Place) -> None:
    first, second = place.log_on("first", 2.0, 14.5), place.log_on("second", 4.0, 14.5)
    third, free = place.log_on("third", 6.0, 14.5), place.log_on("free", 6.0, 13.0)
    first.reserveAreas([struct(WEST), struct(EAST)], LIMIT_S)
    second.reserveAreas([struct(BOTH)], LIMIT_S)
    third.reserveAreas([struct(EAST)], LIMIT_S)
    free.reserveAreas([struct(("L2", WEST[1]))], LIMIT_S)

    def check() -> None:
        assert (phase(first), phase(free)) == (RoboCorba.AREAS_GRANTED, RoboCorba.AREAS_GRANTED)
        for waiter, ahead in ((second, 1), (third, 2)):
            found = waiter.reservation()
            assert (found.phase, found.ahead) == (RoboCorba.WAITING_FOR_AREAS, ahead)
            assert (ahead - 1) * LIMIT_S < found.longestWait < ahead * LIMIT_S

    eventually(lambda: first.reservation().left < LIMIT_S, what="time passes")
    check()
    pid = place.kill("simulation")
    eventually(lambda: answers(place), BACK_LIMIT_S, "the server is back")
    check()
    first.keepAreas([struct(EAST)])
    assert phase(second) == RoboCorba.WAITING_FOR_AREAS  # BOTH reaches into EAST
    first.releaseAreas()
    assert (phase(second), phase(third)) == (RoboCorba.AREAS_GRANTED, RoboCorba.WAITING_FOR_AREAS)
    second.deregister()
    assert phase(third) == RoboCorba.AREAS_GRANTED
    for call in (second.reservation, second.releaseAreas, lambda: second.reserveAreas([struct(WEST)], 1.0)):
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            call()
    eventually(lambda: place.is_again("simulation", pid), BACK_LIMIT_S, "it is recorded")


def test_a_robot_whose_process_was_killed_frees_its_areas(place: Place) -> None:
    process = place.launch(*CLIENT, str(place.running.naming))
    assert process.stdin is not None and process.stdout is not None
    rows = [("doomed", "L1", 2.0, 14.5)]
    for order, answer in ((encoded(rows), "ready"), (f"reserve {encoded([WEST])}", "reserved")):
        process.stdin.write(f"{order}\n")
        process.stdin.flush()
        assert process.stdout.readline() == f"{answer}\n"
    waiter = place.log_on("waiter", 4.0, 14.5)
    waiter.reserveAreas([struct(BOTH)], LIMIT_S)
    assert phase(waiter) == RoboCorba.WAITING_FOR_AREAS
    time.sleep(1.0)
    assert phase(waiter) == RoboCorba.WAITING_FOR_AREAS  # the other one lives
    process.kill()
    killed = time.monotonic()
    eventually(lambda: phase(waiter) == RoboCorba.AREAS_GRANTED, what="the areas of the dead robot are free")
    took_s = time.monotonic() - killed
    print(f"\nthe areas of a robot whose process was killed were granted to the next one after {took_s:.2f} s")
    assert took_s < RELEASE_LIMIT_S


def test_a_grant_that_is_over_is_told_and_the_next_one_begins(place: Place) -> None:
    first, second = place.log_on("first", 2.0, 14.5), place.log_on("second", 4.0, 14.5)
    first.reserveAreas([struct(WEST)], 0.5)
    second.reserveAreas([struct(WEST)], 0.5)
    assert 0.0 < second.reservation().longestWait < 0.5 + 1e-9  # a difference of times, which are rounded
    eventually(lambda: phase(second) == RoboCorba.AREAS_GRANTED, what="the second one's turn")
    assert phase(first) == RoboCorba.NO_RESERVATION
    eventually(lambda: phase(second) == RoboCorba.NO_RESERVATION, what="its end")


def test_a_robots_own_process_reserves_and_rides_with_others(place: Place) -> None:
    """As missions do it: through the session of the control agent."""
    elevator = place.elevator()
    origin, destination = elevator.floors()[:2]
    x, y = landing(elevator, origin, 0.8)
    one = RemoteSession(place.orb, Description("one", Pose(origin, x, y), RADIUS_M))
    with pytest.raises(RobotLost):
        one.reserve([WEST], 5.0)
    one.log_on()
    try:
        assert one.reservation() is None
        with pytest.raises(InvalidReservation) as refused:
            one.reserve([WEST], -1.0)
        assert refused.value.field == "limit"
        with pytest.raises(UnknownFloor):
            one.reserve([("L99", WEST[1])], 5.0)
        one.reserve([WEST, EAST], LIMIT_S)
        found = one.reservation()
        assert found is not None and found[:3] == (True, 0, 0.0) and isinstance(found, Reservation)
        one.keep_areas([EAST])
        with pytest.raises(InvalidReservation):
            one.keep_areas([WEST])
        one.release_areas()
        assert one.reservation() is None
        with pytest.raises(InvalidRide) as wrong:
            one.call_elevator(elevator.name, destination, "table", 999)
        assert wrong.value.field == "partySize"
        one.call_elevator(elevator.name, destination, "table", 1)

        def is_boarding() -> bool:
            ride = one.state().ride
            return ride is not None and ride.phase is RidePhase.BOARDING

        eventually(is_boarding, 60.0, "the doors open")
        one.cancel_elevator()
    finally:
        one.log_off()


def test_a_party_rides_alone(place: Place) -> None:
    """Two that carry something, and one that goes the same way and called before the second of them."""
    elevator = place.elevator()
    origin, destination = elevator.floors()[:2]
    before = [landing(elevator, origin, away_m) for away_m in (0.8, 1.6, 2.4)]
    first, second, alone = (
        place.log_on(name, *at, floor=origin, radius=0.2)
        for name, at in zip(("first", "second", "alone"), before, strict=True)
    )
    place.administrator.setPace(5.0)
    try:
        first.callElevatorTogether(elevator.name, destination, "table", 2)
        alone.callElevator(elevator.name, destination)
        second.callElevatorTogether(elevator.name, destination, "table", 2)

        def has(session: Any, *phases: Any) -> Any:
            return eventually(lambda: session.state().riding.phase in phases, 60.0, f"{phases}")

        has(first, RoboCorba.BOARDING)
        drive_to(first, landing(elevator, origin, -1.2))
        has(first, RoboCorba.RIDING)
        has(second, RoboCorba.BOARDING)
        drive_to(second, landing(elevator, origin, -0.4))
        has(second, RoboCorba.RIDING, RoboCorba.ALIGHTING)
        assert alone.state().riding.phase == RoboCorba.WAITING_FOR_CABIN
        has(first, RoboCorba.ALIGHTING)
        assert (first.state().at.floor, second.state().at.floor) == (destination, destination)
        assert (alone.state().at.floor, alone.state().riding.phase) == (origin, RoboCorba.WAITING_FOR_CABIN)
    finally:
        place.administrator.setPace(1.0)
