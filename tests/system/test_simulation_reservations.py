"""Areas and cabins that robots have for themselves: real servers, kills of the server and of a robot's process."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from omniORB import CORBA

from robocorba.corba.event_client import Event, EventClient
from robocorba.corba.remote.session import RemoteSession
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import RobotLost
from robocorba.errors.simulation import InvalidReservation, InvalidRide
from robocorba.maps.polygons import FloorArea
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import Reservation
from robocorba.spatial.pose import Pose
from robocorba.stubs import RoboCorba
from robocorba.testing.heartbeats import heartbeats
from robocorba.testing.processes import eventually
from robocorba.testing.simulation import (
    BACK_LIMIT_S,
    CHAIR,
    CLIENT,
    GONE,
    RADIUS_M,
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
    stays(lambda: phase(waiter) == RoboCorba.WAITING_FOR_AREAS, 1.0)  # the other one lives
    process.kill()
    eventually(lambda: phase(waiter) == RoboCorba.AREAS_GRANTED, what="the areas of the dead robot are free")


def test_one_of_several_passages_is_reserved(place: Place) -> None:
    robots = [place.log_on(name, x, 14.5) for name, x in (("first", 2.0), ("second", 4.0), ("third", 6.0))]
    alternatives = [[struct(WEST)], [struct(EAST)]]
    assert [robot.reserveOneOf(alternatives, LIMIT_S) for robot in robots] == [0, 1, 0]
    granted, waiting = RoboCorba.AREAS_GRANTED, RoboCorba.WAITING_FOR_AREAS
    assert [phase(robot) for robot in robots] == [granted, granted, waiting]
    robots[1].releaseAreas()
    for wrong in ([], [[struct(EAST)]] * 5):
        with pytest.raises(RoboCorba.InvalidReservation) as refused:
            robots[1].reserveOneOf(wrong, LIMIT_S)
        assert refused.value.field == "alternatives"
    assert robots[0].exchangeAreas([struct(EAST)], 1.0)  # and WEST is free for the third one
    assert phase(robots[2]) == granted
    assert not robots[0].exchangeAreas([struct(BOTH)], 1.0)
    assert not robots[1].exchangeAreas([struct(EAST)], 1.0)
    for least, areas, field in ((-1.0, [struct(EAST)], "least"), (1.0, [], "areas")):
        with pytest.raises(RoboCorba.InvalidReservation) as refused:
            robots[0].exchangeAreas(areas, least)
        assert refused.value.field == field
    assert phase(robots[0]) == granted


def test_another_robot_takes_over_what_a_silent_one_with_an_object_has_reserved(place: Place) -> None:
    chair = place.body("L1", CHAIR)
    x, y = chair["x"], chair["y"]
    silent = place.server.registerRobot(about("silent", x, y + 0.7))  # it never calls again
    silent.reserveAreas([struct(WEST), struct(EAST)], LIMIT_S)
    silent.grip(CHAIR, RoboCorba.XY(x, y + 0.25))
    waiter, successor = place.log_on("waiter", 2.0, 14.5), place.log_on("successor", 4.0, 14.5)
    waiter.reserveAreas([struct(EAST)], LIMIT_S)
    with pytest.raises(RoboCorba.InvalidReservation) as refused:
        successor.takeOverAreas("waiter")  # it is there
    assert refused.value.field == "former"

    def is_taken_over() -> bool:
        with contextlib.suppress(RoboCorba.InvalidReservation):
            successor.takeOverAreas("silent")
            return True
        return False

    eventually(is_taken_over, what="the silent robot is logged off")
    assert "silent" not in place.names
    assert (phase(successor), phase(waiter)) == (RoboCorba.AREAS_GRANTED, RoboCorba.WAITING_FOR_AREAS)
    successor.keepAreas([struct(WEST)])
    assert (phase(successor), phase(waiter)) == (RoboCorba.AREAS_GRANTED, RoboCorba.AREAS_GRANTED)


def test_boarding_is_an_event_with_the_longest_wait(place: Place) -> None:
    found: list[Event] = []
    elevator = place.elevator()
    origin, destination = elevator.floors()[:2]
    with EventClient(place.orb, "main") as client:
        client.subscribe(found.append, "simulation.boarding")
        robot = place.log_on("rider", *landing(elevator, origin, 0.8), floor=origin)
        robot.callElevator(elevator.name, destination)
        announced_s = robot.longestElevatorWait()
        eventually(lambda: found, 60.0, "the event")
        robot.giveUpElevator()
    (payload,) = [event.payload for event in found]
    assert (payload["floor"], payload["who"]) == (origin, ["rider"])
    assert 0.0 < payload["waited_s"] <= payload["longest_wait_s"]
    assert announced_s <= payload["longest_wait_s"]  # asked a moment later


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
    with contextlib.closing(heartbeats(lambda: [one])):
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
