"""Rides by every elevator of the sample buildings, rides that are lost, and where a robot waits for an elevator."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from robocorba.errors.robots import MotionFailed, RideLost
from robocorba.errors.simulation import SessionExpired
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.model import Building
from robocorba.map_editor.samples import SAMPLES, load_sample
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.planner import PathPlanner
from robocorba.robot.elevator_rides import (
    DOOR_GAP_M,
    ELEVATOR_CALL_DISTANCE_M,
    PASSING_GAP_M,
    RIDE_TRIALS,
    split_at_doors,
)
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.registry import Pose
from tests.robot.stepped_robot import ByElevator, Session, SteppedRobot, World

#: How far a robot that has lost its ride may still get towards the cabin: its stopping distance [m].
STOPS_WITHIN_M = 0.6
#: Places of a landing from which robots begin: beside its node by these offsets [m].
OFFSETS_M = ((0.0, 0.0), (0.3, 0.1), (-0.3, 0.15), (0.1, -0.2))


class Storeys:
    """A sample building with one robot after the other."""

    def __init__(self, building: Building, world: World) -> None:
        self.building, self.world = building, world
        self.planner = ByElevator(PathPlanner(building), building)

    def robot(self, floor: str, at: tuple[float, float]) -> tuple[SteppedRobot, Session]:
        session = Session(self.world, Pose(floor, *at, 0.0))
        return SteppedRobot(self.world, session, self.planner), session

    def landing(self, elevator: str, floor: str) -> tuple[float, float]:
        """The path node before the doors."""
        (x, y), shaft = self.building.elevators[elevator].at, shaft_polygon(self.building.elevators[elevator])
        clear = shaft.buffer(RADIUS_M)
        nodes = self.building.floors[floor].topological.nodes.values()
        outside = [node.at for node in nodes if not clear.contains(Point(node.at))]
        return min(outside, key=lambda place: math.dist(place, (x, y)))

    def rides(self) -> list[tuple[str, str, str]]:
        """Each elevator, between each landing and the next one, up and down in turn."""
        steps = [
            (name, *step)
            for name, elevator in self.building.elevators.items()
            for step in pairwise(sorted(elevator.floors(), key=lambda name: self.building.floors[name].floor.elevation))
        ]
        return [
            (name, high, low) if number % 2 else (name, low, high) for number, (name, low, high) in enumerate(steps)
        ]

    def ride(self, elevator: str, origin: str, destination: str, offset: tuple[float, float] = (0.0, 0.0)) -> Session:
        """Ride, from beside the landing. Raises as drive_path."""
        self.planner.elevator = elevator
        x, y = self.landing(elevator, origin)
        robot, session = self.robot(origin, (x + offset[0], y + offset[1]))
        try:
            robot.drive_path(destination, *self.landing(elevator, destination))
        finally:
            session.log_off()
        return session


@pytest.fixture(scope="module", params=[name for name in SAMPLES if load_sample(name).elevators])
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Storeys]:
    building = load_sample(request.param)
    world = World(building, tmp_path_factory.mktemp("world"))
    yield Storeys(building, world)
    world.close()


def test_every_elevator_is_ridden_from_every_landing(place: Storeys) -> None:
    rides = place.rides()
    assert len(rides) >= 2
    for number, (elevator, origin, destination) in enumerate(rides):
        session = place.ride(elevator, origin, destination, OFFSETS_M[number % len(OFFSETS_M)])
        at = session.latest.at
        assert (at.floor, session.calls) == (destination, 1), f"{elevator} from {origin} to {destination}"
        assert math.dist((at.x, at.y), place.landing(elevator, destination)) < 0.01


class LosingRides:
    """Watches a robot that drives into E1 of five-floors and loses its ride on the way, `times` times. is_late: it is
    held up until the elevator ends the ride; else its session ends."""

    def __init__(self, place: Storeys, times: int, is_late: bool) -> None:
        self.place, self.times, self.is_late = place, times, is_late
        self.shaft = shaft_polygon(place.building.elevators["E1"])
        place.planner.elevator = "E1"
        self.robot, self.session = place.robot("L1", (11.0, 9.25))
        self.robot.on_cycle = self.watch
        #: Where the robot lost its ride, as a distance from the cabin's middle [m]; None while it has or awaits one.
        self.lost_at_m: float | None = None

    @property
    def distance_m(self) -> float:
        at = self.session.latest.at
        return math.dist((at.x, at.y), self.place.building.elevators["E1"].at)

    def watch(self) -> None:
        latest = self.session.latest
        at, ride = latest.at, latest.ride
        if ride is None and at.floor == "L1" and self.lost_at_m is not None:
            assert self.distance_m > self.lost_at_m - STOPS_WITHIN_M, "it drives on without a ride"
        elif ride is not None:
            self.lost_at_m = None
        is_in_doors = self.shaft.buffer(RADIUS_M / 2).contains(Point(at.x, at.y))
        if self.times and ride is not None and ride.phase is RidePhase.BOARDING and is_in_doors:
            self.times -= 1
            if self.is_late:
                while self.session.state().ride is not None:
                    self.session.command((0.0, 0.0, 0.0), 2 * STEP_S)
                    self.place.world.step()
            else:
                self.session.cancel_elevator()
                self.session.state()
            self.lost_at_m = self.distance_m

    def drive(self, speed: float = 0.0) -> None:
        try:
            self.robot.drive_path("L2", 11.0, 9.25, speed=speed)
        finally:
            self.session.log_off()


@pytest.mark.parametrize(("times", "is_late"), [(1, True), (RIDE_TRIALS - 1, False), (100, True)])
def test_a_robot_that_loses_its_ride_asks_again_or_stands_before_the_doors(
    place: Storeys, times: int, is_late: bool
) -> None:
    losing = LosingRides(place, times, is_late)
    if times < RIDE_TRIALS:
        losing.drive()
    else:
        with pytest.raises(RideLost, match=r"^E1: the ride was lost while the robot drove in, at \(11.*\)$"):
            losing.drive()
    at = losing.session.latest.at
    assert (at.floor, losing.session.calls) == ("L2" if times < RIDE_TRIALS else "L1", min(1 + times, RIDE_TRIALS))
    assert losing.shaft.distance(Point(at.x, at.y)) > RADIUS_M


def test_a_robot_that_is_too_slow_to_board_does_not_call_the_cabin(place: Storeys) -> None:
    losing = LosingRides(place, 0, False)
    with pytest.raises(MotionFailed, match=r"the doors of E1 close after 15 s; boarding needs 47 s, .* at 0.05 m/s"):
        losing.drive(speed=0.05)
    assert losing.session.calls == 0
    assert losing.session.latest.at[:3] == ("L1", 11.0, 9.25)


class Leaves(Exception):
    """The robot's process ends."""


@settings(
    max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(st.sampled_from(list(RidePhase)), st.booleans(), st.integers(0, 60), st.sampled_from(["log off", "evict"]))
def test_a_robot_that_loses_its_ride_while_it_leaves_blocks_nothing(
    place: Storeys, phase: RidePhase, is_in_doors: bool, cycles: int, way: str
) -> None:
    """Whatever it does when it loses its ride: `cycles` later its session ends, as it logs off or its lease expires."""
    elevator, low, high = place.rides()[0]
    place.planner.elevator = elevator
    shaft = shaft_polygon(place.building.elevators[elevator])
    robot, session = place.robot(low, place.landing(elevator, low))
    area = (low, tuple(shaft.exterior.coords)[:-1])
    session._session.reserve([area], 600.0)
    left: list[int] = []

    def watch() -> None:
        at, ride = session.latest.at, session.latest.ride
        is_there = shaft.buffer(RADIUS_M).contains(Point(at.x, at.y)) or not is_in_doors
        if not left and ride is not None and ride.phase is phase and is_there:
            session.cancel_elevator()
            left.append(cycles)
        elif left:
            left[0] -= 1
            if left[0] <= 0:
                raise Leaves

    robot.on_cycle = watch
    with contextlib.suppress(Leaves, RideLost):
        robot.drive_path(high, *place.landing(elevator, high))
    if way == "evict":
        place.world.agent.evict("A")
        with pytest.raises(SessionExpired):
            session.cancel_elevator()  # what the end of its program calls
    else:
        session.log_off()
    _, next_one = place.robot(high, place.landing(elevator, high))
    next_one._session.reserve([area], 600.0)
    reservation = next_one._session.reservation()
    assert reservation is not None and reservation.granted
    next_one.log_off()
    place.ride(elevator, low, high)


CLEAR_M, PASSING_M = RADIUS_M + DOOR_GAP_M, RADIUS_M + PASSING_GAP_M
LARGE = shapely.box(-1.6, -1.6, 1.6, 1.6)


def waits_at(start: XY, shaft: shapely.Polygon | None) -> XY:
    """Where a robot waits that drives straight to the middle of a cabin."""
    outside, inside = split_at_doors([start, (0.0, 0.0)], shaft)
    assert inside == [(0.0, 0.0)]
    (at,) = outside
    return at


def test_a_robot_waits_clear_of_the_doors_or_stays_where_it_is_nearer() -> None:
    assert waits_at((-5.0, 0.0), None) == pytest.approx((-ELEVATOR_CALL_DISTANCE_M, 0.0))
    assert waits_at((-5.0, 0.0), shapely.box(-1, -1, 1, 1)) == pytest.approx((-1.0 - PASSING_M, 0.0))
    assert waits_at((-5.0, 0.0), LARGE) == pytest.approx((-1.6 - PASSING_M, 0))
    x, _ = waits_at((-3.2, 1.3), LARGE)  # once stuck at these doors
    assert x == pytest.approx(-1.6 - PASSING_M, abs=1e-3)
    for near, shaft in (((-1.5, 0.0), None), ((-1.9, 0.0), LARGE), ((0.0, 0.0), LARGE)):
        assert waits_at(near, shaft) == pytest.approx(near)
    # The path around the post of a door passes the closed door more closely than its robot is wide.
    path = [(4.0, -3.0), (4.0, -2.05), (0.66, -2.0), (0.6, -1.7), (0.0, 0.0)]
    outside, inside = split_at_doors(path, LARGE)
    assert outside == [path[1], pytest.approx((2.98, -2.03), abs=0.01)]
    assert inside == path[2:]
    # Along the wall to the doors: others get past only far from there, from where it would board too late.
    outside, inside = split_at_doors([(-6.0, -2.2), (0.0, -2.2), (0.0, 0.0)], LARGE)
    assert outside[-1] == pytest.approx((0.0, -1.6 - CLEAR_M), abs=0.01)


#: To the micrometre, beyond which lengths of almost nothing are not exact.
coordinates = st.integers(-6_000_000, 6_000_000).map(lambda micrometres: micrometres / 1e6)
points = st.tuples(coordinates, coordinates)


@given(st.lists(points, min_size=1, max_size=5), st.floats(0.5, 3.0), st.floats(0.5, 3.0))
@settings(deadline=None)
def test_the_parts_are_the_path_and_the_first_is_clear(corners: list[XY], half_x: float, half_y: float) -> None:
    path, shaft = [*corners, (0.0, 0.0)], shapely.box(-half_x, -half_y, half_x, half_y)
    outside, inside = split_at_doors(path, shaft)
    both = [path[0], *outside, *inside]
    assert sum(np.hypot(*np.subtract(*ends)) for ends in pairwise(both)) == pytest.approx(LineString(path).length)
    assert both[-1] == path[-1]
    assert all(LineString(path).distance(Point(point)) < 1e-9 for point in both)
    clear_m = min(CLEAR_M, shaft.distance(Point(path[0])))
    assert shaft.distance(Point(outside[-1])) >= clear_m - 0.01  # corners of the buffer are polygons
