"""Movements of a robot's base: it drives along paths, yields to other robots, rides elevators."""

from __future__ import annotations

import contextlib
import logging
import math
import random
from collections.abc import Callable, Sequence
from itertools import product

from shapely import Polygon

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import PathError
from robocorba.errors.robots import MotionFailed, RideLost, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.temporary_obstacles import NO_OBSTACLES
from robocorba.robot.collision_avoidance.giving_way import Blocked, GiveWay, in_the_way
from robocorba.robot.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.robot.collision_avoidance.stepping_aside import place_aside
from robocorba.robot.elevator_rides import (
    ELEVATOR_LIMIT_S,
    RIDE_TRIALS,
    WhileRiding,
    check_boarding_time,
    split_at_doors,
    way_out_of_doors,
)
from robocorba.robot.execution_control import ExecutionControl
from robocorba.robot.high_controller import HighController
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M
from robocorba.robot.motion.driving import Drive, DriveAt, DriveBy
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, Velocity
from robocorba.robot.programs.base_checks import CONTACT_M, Planner
from robocorba.robot.session import BuildingSession
from robocorba.simulation.elevator import RidePhase

#: Clearances that are tried for a path [m], widest first, because the base cuts corners.
PATH_CLEARANCES_M = (0.06, 0.03, 0.0)

_log = logging.getLogger(__name__)


class BaseMovements:
    """Without `nearby` the base does not give way to other robots. One thread at a time moves the robot; any thread may
    use `execution`."""

    #: The path that is being driven, from its start; empty if there is none.
    path: Sequence[PathPoint] = ()

    def __init__(
        self, controller: HighController, session: BuildingSession, planner: Planner, nearby: Nearby | None
    ) -> None:
        self.controller, self.session = controller, session
        self._planner, self._nearby = planner, nearby
        self.execution = ExecutionControl(controller.cancel, self._hold)

    def move(self, motion: Motion) -> None:
        """Run a motion to its end."""
        self.execution.check()
        self.controller.move(motion)

    def wait(self, seconds: float, is_met: Callable[[], bool] = lambda: False) -> bool:
        """Wait for some time [s, robot's clock] or until a condition is met; returns whether it is."""

        def check() -> bool:
            self.controller.check()  # the clock of a robot that is stopped does not advance
            return is_met()

        return self.execution.wait_for(check, seconds, self.clock)

    def clock(self) -> float:
        """The robot's time [s]."""
        return self.controller.state.time

    def _hold(self, is_held: bool) -> None:
        self.controller.is_paused = is_held

    # ---- along paths ----

    def drive_path(
        self,
        floor: str,
        x: float,
        y: float,
        heading: float | None = None,
        speed: float = 0.0,
        around_obstacles: bool = False,
    ) -> None:
        """Drive to a point (x, y) [m] in the building, across floors, around what the robot sees.

        The path avoids temporary obstacles once the robot was blocked; with `around_obstacles`, from the start. speed:
        limit [m/s], 0 for the controller's. Also raises PathError, InvalidRide, ElevatorFull."""
        goal, limit = Place(floor, x, y), self._speed(speed)
        points = (self._path_around(goal, limit) if around_obstacles else None) or self._path_past_seen(goal, limit)
        blockages = detours = 0
        stuck_since = self.clock()
        while True:
            start = self.controller.state
            try:
                self._drive_along(points, heading, limit)
                return
            except Blocked as blocked:
                if (nearby := self._nearby) is None or not (blocked.other or nearby.seen.names):
                    raise
                now = self.controller.state
                is_stuck = math.dist((start.x, start.y), (now.x, now.y)) < 0.1  # [m]
                stuck_since = stuck_since if is_stuck else self.clock()
                blockages, detours = blockages + bool(blocked.other), detours + (not blocked.other)
                if blockages > nearby.policy.max_blockages or detours > nearby.policy.max_detours:
                    raise
                if not blocked.other and self.clock() - stuck_since > nearby.policy.max_stuck_s:
                    raise
                _log.info("%s", blocked)
                if blocked.other:
                    self._step_aside(nearby, blocked.other)
                    points = self._path_after_blockage(nearby, blocked.other, goal, limit)
                else:
                    if is_stuck:  # by something that moves, perhaps
                        self.wait(random.uniform(0.3, 0.8))
                    points = self._path_past_seen(goal, limit)

    def _path_past_seen(self, goal: Place, speed: float) -> list[PathPoint]:
        """A path past objects and what the robot sees, as soon as it does: while that blocks every path, searched twice
        a second until the policy's longest pause is over."""
        if (nearby := self._nearby) is None:
            return self._path_past_objects(goal, speed)
        deadline = self.clock() + nearby.policy.max_search_s
        with self.execution.awaiting(lambda: "a free way past what it sees"):
            while True:
                is_late = self.clock() >= deadline
                try:
                    nearby.check_seen()
                except NotReachable:
                    if is_late:
                        raise
                    self.wait(0.05)
                    continue
                try:
                    return self._path_past_objects(goal, speed)
                except PathError:
                    if is_late or not nearby.seen.names:
                        raise
                self.wait(0.5)

    def _path_past_objects(self, goal: Place, speed: float) -> list[PathPoint]:
        """A path by the map, with movable objects at their present poses and what the robot sees: along the roadmap, or
        through free space if they block the roadmap. It may begin where the robot touches an obstacle."""
        holding, state = self.session.latest.holding, self.controller.state
        objects = NO_OBSTACLES
        if nearby := self._nearby:
            objects = nearby.with_seen(nearby.movable_objects(holding), (state.x, state.y))
        request = objects.added_to(self._request(goal, speed))
        first: PathError | None = None
        for radius, mode in product((RADIUS_M, RADIUS_M - CONTACT_M), (RouteMode.SMOOTHED, RouteMode.GEOMETRIC)):
            try:
                found = self._planner.paths(request._replace(radius=radius, mode=mode))[0]
            except PathError as error:
                first = first or error
            else:
                return self._with_clearance(request._replace(mode=mode), found).points
        assert first
        raise objects.explained(first)

    def _with_clearance(self, request: PathRequest, found: Path) -> Path:
        """The path with the widest clearance that is at most 5 % and 0.5 m longer than `found`."""
        for clearance_m in PATH_CLEARANCES_M[:-1]:
            with contextlib.suppress(PathError):
                wider = self._planner.paths(request._replace(radius=RADIUS_M + clearance_m))[0]
                if wider.distance <= 1.05 * found.distance + 0.5:
                    return wider
        return found

    def _path_around(self, goal: Place, speed: float, other: str = "") -> list[PathPoint] | None:
        """A path around temporary obstacles, including the robot `other`; None if none are known or no path exists."""
        here = self.session.latest
        point = (goal.x, goal.y) if goal.floor == here.at.floor else None
        if (nearby := self._nearby) is None:
            return None
        state = self.controller.state
        known = nearby.with_seen(nearby.temporary_obstacles(other, point, here.holding), (state.x, state.y))
        if known == NO_OBSTACLES:
            return None
        request = known.added_to(self._request(goal, speed))
        for clearance_m, mode in product(PATH_CLEARANCES_M, (RouteMode.SMOOTHED, RouteMode.GEOMETRIC)):
            with contextlib.suppress(PathError):
                return self._planner.paths(request._replace(radius=RADIUS_M + clearance_m, mode=mode))[0].points
        return None

    def _request(self, goal: Place, speed: float) -> PathRequest:
        here, state = self.session.latest.at, self.controller.state
        return PathRequest(Place(here.floor, state.x, state.y), goal, radius=RADIUS_M, speed=speed)

    def _step_aside(self, nearby: Nearby, other: OtherRobot) -> None:
        """Step aside as far as possible, at 0.2 m/s, so that another robot gets past, then pause for a random time [s]:
        two robots that wait for each other do not go on at the same time."""
        state = self.controller.state
        with contextlib.suppress(MotionFailed, NotReachable):
            if place := place_aside(nearby, (state.x, state.y), other):
                self.move(GiveWay(Drive([place], None, 0.2, BASE_LIMITS), nearby, avoid_walls=True))
        self.wait(random.uniform(0.2, 0.8))

    def _path_after_blockage(self, nearby: Nearby, other: OtherRobot, goal: Place, speed: float) -> list[PathPoint]:
        """A path around another robot as soon as there is one, searched twice a second; after the policy's longest
        pause the map's path."""
        deadline = self.clock() + nearby.policy.max_search_s
        with self.execution.awaiting(lambda: f"a free way: {in_the_way(other)}"):
            while self.clock() < deadline:
                if points := self._path_around(goal, speed, other.name):
                    return points
                self.wait(0.5)
        return self._path_past_objects(goal, speed)

    def _drive_along(self, points: Sequence[PathPoint], heading: float | None, limit: float) -> None:
        """Drive from point to point, and ride from floor to floor."""
        self.path = points
        try:
            self._drive_legs(points, heading, limit)
        finally:
            self.path = ()

    def _drive_legs(self, points: Sequence[PathPoint], heading: float | None, limit: float) -> None:
        leg: list[XY] = []
        speeds: list[float] = []
        for before, point, after in zip([points[0], *points], points, [*points[1:], None], strict=False):
            if point.kind is PointKind.ELEVATOR_EXIT:
                continue
            leg.append((point.x, point.y))
            speeds.append(_speed_between(before, point))
            if point.kind is PointKind.ELEVATOR_ENTRY and after:
                state = self.controller.state
                outside, inside = split_at_doors([(state.x, state.y), *leg], self._shaft(point.elevator))
                check_boarding_time(point.elevator, [outside[-1], *inside], speeds[-len(inside) :], limit)
                self.move(self._driving(outside, None, limit, speeds[: len(outside)]))
                self._ride(point.elevator, after.floor, inside, limit, speeds[-len(inside) :])
                leg, speeds = [], []
        self.move(self._driving(leg, heading, limit, speeds))

    def _driving(
        self, points: Sequence[XY], heading: float | None, speed: float, speeds: Sequence[float] | None = None
    ) -> Motion:
        return self._giving_way(Drive(points, heading, speed, BASE_LIMITS, speeds), points)

    def _shaft(self, elevator: str) -> Polygon | None:
        return self._nearby.shaft(elevator) if self._nearby else None

    # ---- elevators ----

    def call_elevator(
        self, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        """Reserve a ride from this floor, and wait until the doors are open. party: name of a group of `size` robots
        that ride together. boarding_s: time that it needs to drive in, and to drive out; 0 if that is unknown. Raises
        InvalidRide, ElevatorFull, RideLost."""
        self.session.call_elevator(elevator, destination, party, size, boarding_s)
        self.session.state()  # the latest state now has the ride
        limit_s = ELEVATOR_LIMIT_S + self.session.longest_elevator_wait_s()
        self.wait_for_ride(RidePhase.BOARDING, f"{elevator} did not come to {self.session.latest.at.floor}", limit_s)

    def wait_for_ride(
        self,
        phase: RidePhase,
        otherwise: str,
        limit_s: float = ELEVATOR_LIMIT_S,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Wait until the ride has come to this phase, or beyond: who calls from within the cabin boards at once.
        otherwise: text of the MotionFailed if it has not within `limit_s`. check: raises another error that ends the
        wait. Raises RideLost."""

        def is_there() -> bool:
            check()
            ride = self.session.latest.ride
            if ride is None:
                raise RideLost(otherwise)
            return ride.phase.value >= phase.value

        with self.execution.awaiting(self._awaited_cabin):
            if not self.wait(limit_s, is_there):
                raise MotionFailed(otherwise)

    def _awaited_cabin(self) -> str:
        """The elevator, while the robot waits for its doors, or the floor to which it rides."""
        ride = self.session.latest.ride
        if ride and ride.phase is RidePhase.RIDING:
            return f"{ride.destination}, in elevator {ride.elevator}"
        if ride is None or ride.phase is not RidePhase.WAITING:
            return ""
        return f"elevator {ride.elevator}" + (f", {ride.ahead} ahead" if ride.ahead else "")

    def _ride(
        self, elevator: str, destination: str, inside: Sequence[XY], limit: float, speeds: Sequence[float]
    ) -> None:
        """Ride to another floor from where the robot waits. inside: the way into the cabin [m], with limits on the
        segment before each point.

        A ride that is lost before the robot is in the cabin is asked for again, RIDE_TRIALS times in all. Raises
        RideLost, MotionFailed, InvalidRide, ElevatorFull."""
        if self.session.latest.ride:  # of the cabin that it was to leave, until its way out was blocked
            self.session.cancel_elevator()
        start, shaft = self.controller.state, self._shaft(elevator)
        way = [(start.x, start.y), *inside]
        try:
            for trial in range(RIDE_TRIALS, 0, -1):
                try:
                    self.call_elevator(elevator, destination)
                    self.move(WhileRiding(self._driving(inside, None, limit, speeds), self.session, elevator))
                    break
                except RideLost as lost:
                    self.session.cancel_elevator()
                    state = self.controller.state
                    if back := way_out_of_doors((state.x, state.y), way, shaft):
                        self.move(self._driving(back, None, limit))
                    if trial == 1:
                        raise
                    _log.info("%s; the robot asks again", lost)
            self.wait_for_ride(RidePhase.ALIGHTING, f"{elevator} did not arrive at {destination}")
        except RoboCorbaError:
            with contextlib.suppress(RobotLost):
                self.session.cancel_elevator()
            raise

    # ---- on this floor ----

    def drive_to(self, x: float, y: float, heading: float | None = None, speed: float = 0.0) -> None:
        """Drive straight to a point (x, y) [m] on this floor."""
        self.move(self._giving_way(Drive([(x, y)], heading, self._speed(speed), BASE_LIMITS), precise_positioning=True))

    def drive_by(self, ahead: float, left: float, turn: float, speed: float = 0.0, until_blocked: bool = False) -> None:
        """Drive by an offset, ahead and left [m], turn [rad]. until_blocked: return where an obstacle blocks it."""
        motion = DriveBy(ahead, left, turn, self._speed(speed), BASE_LIMITS)
        try:
            self.move(self._giving_way(motion, precise_positioning=True, avoid_walls=until_blocked))
        except Blocked as blocked:
            if not until_blocked:
                raise
            _log.info("%s", blocked)

    def drive_at(self, velocity: Velocity, seconds: float) -> None:
        """Drive at a velocity for some time, then stop."""
        self.move(DriveAt(velocity, seconds))

    def drive_as_ordered(self, motion: Motion) -> None:
        """Drive as `motion` orders; where a wall, an object or another robot is in the way, the base waits."""
        while True:
            try:
                self.move(self._giving_way(motion, avoid_walls=True))
                return
            except Blocked as blocked:
                _log.debug("%s", blocked)

    def stop_base(self) -> None:
        """Stop the base, and wait until it is stationary."""
        self.move(DriveAt(ZERO_VELOCITY, 0.0))

    def _giving_way(
        self, motion: Motion, path: Sequence[XY] = (), precise_positioning: bool = False, avoid_walls: bool = False
    ) -> Motion:
        return GiveWay(motion, self._nearby, path, precise_positioning, avoid_walls) if self._nearby else motion

    def _speed(self, limit: float) -> float:
        cap = self.controller.speed_cap
        return min(limit, cap) if limit else cap


def _speed_between(one: PathPoint, other: PathPoint) -> float:
    """The path planning agent's speed between two points of a drive [m/s]; the map limits it. Waits and rides lie
    between an elevator's entry and its exit, between which nobody drives."""
    seconds = other.time - one.time
    return (other.distance - one.distance) / seconds if seconds > 0.0 else math.inf
