"""Movements of a robot's base: it drives along paths, yields to other robots, rides elevators."""

from __future__ import annotations

import contextlib
import logging
import math
import random
from collections.abc import Callable, Sequence
from itertools import product

from robocorba.errors.paths import PathError
from robocorba.errors.robots import MotionFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.temporary_obstacles import NO_OBSTACLES
from robocorba.robot.collision_avoidance.giving_way import Blocked, GiveWay
from robocorba.robot.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.robot.collision_avoidance.stepping_aside import place_aside
from robocorba.robot.elevator_rides import RideMovements, check_boarding_time, split_at_doors
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M
from robocorba.robot.motion.driving import Drive, DriveAt, DriveBy, StopBase
from robocorba.robot.motion.motion import Motion
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.programs.base_checks import CONTACT_M, Planner

#: Clearances that are tried for a path [m], widest first, because the base cuts corners.
PATH_CLEARANCES_M = (0.06, 0.03, 0.0)
#: Maximum length of a path with clearance: this factor of the shortest path plus this distance [m].
DETOUR_FACTOR, DETOUR_M = 1.05, 0.5
#: Speed of stepping aside [m/s].
STEP_ASIDE_M_S = 0.2
#: Random pause after stepping aside [s], from and to.
PAUSES_S = (0.2, 0.8)
#: Interval between searches for a path around the blocking robot [s].
REPLAN_INTERVAL_S = 0.5

_log = logging.getLogger(__name__)


class BaseMovements(RideMovements):
    """Mixin of Robot, which sets the attributes. Without `_nearby` the base does not give way to other robots."""

    _planner: Planner
    _nearby: Nearby | None
    #: The path that is being driven, from its start; empty if there is none.
    path: Sequence[PathPoint] = ()

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
        """Drive to a point (x, y) [m] in the building, across floors.

        The path avoids temporary obstacles once the robot was blocked; with `around_obstacles`, from the start. speed:
        limit [m/s], 0 for the controller's. Also raises PathError, InvalidRide, ElevatorFull."""
        goal, limit = Place(floor, x, y), self._speed(speed)
        points = (self._path_around(goal, limit) if around_obstacles else None) or self._path_past_objects(goal, limit)
        for _ in range(self._nearby.policy.max_blockages if self._nearby else 0):
            try:
                self._drive_along(points, heading, limit)
                return
            except Blocked as blocked:
                if not self._nearby or not blocked.other:
                    raise
                _log.info("%s", blocked)
                self._step_aside(self._nearby, blocked.other)
                points = self._path_after_blockage(self._nearby, blocked.other, goal, limit)
        self._drive_along(points, heading, limit)

    def _path_past_objects(self, goal: Place, speed: float) -> list[PathPoint]:
        """A path by the map, with movable objects at their present poses: along the roadmap, or through free space if
        an object blocks the roadmap. It may begin where the robot touches an obstacle."""
        holding = self.session.latest.holding
        objects = self._nearby.movable_objects(holding) if self._nearby else NO_OBSTACLES
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
        """The path with the widest clearance that is hardly longer than `found`."""
        for clearance_m in PATH_CLEARANCES_M[:-1]:
            with contextlib.suppress(PathError):
                wider = self._planner.paths(request._replace(radius=RADIUS_M + clearance_m))[0]
                if wider.distance <= DETOUR_FACTOR * found.distance + DETOUR_M:
                    return wider
        return found

    def _path_around(self, goal: Place, speed: float, other: str = "") -> list[PathPoint] | None:
        """A path around temporary obstacles, including the robot `other`; None if none are known or no path exists."""
        here = self.session.latest
        point = (goal.x, goal.y) if goal.floor == here.at.floor else None
        known = self._nearby.temporary_obstacles(other, point, here.holding) if self._nearby else NO_OBSTACLES
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
        """Step aside as far as possible so that another robot gets past, then pause."""
        state = self.controller.state
        with contextlib.suppress(MotionFailed, NotReachable):
            if place := place_aside(nearby, (state.x, state.y), other):
                self.move(GiveWay(Drive([place], None, STEP_ASIDE_M_S, BASE_LIMITS), nearby, avoid_walls=True))
        self.wait(random.uniform(*PAUSES_S))

    def _path_after_blockage(self, nearby: Nearby, other: OtherRobot, goal: Place, speed: float) -> list[PathPoint]:
        """A path around another robot as soon as there is one; after the policy's longest pause the map's path."""
        deadline = self.clock() + nearby.policy.max_search_s
        while self.clock() < deadline:
            if points := self._path_around(goal, speed, other.name):
                return points
            self.wait(REPLAN_INTERVAL_S)
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
                shaft = self._nearby.shaft(point.elevator) if self._nearby else None
                outside, inside = split_at_doors([(state.x, state.y), *leg], shaft)
                check_boarding_time(point.elevator, [outside[-1], *inside], speeds[-len(inside) :], limit)
                self._drive(outside, None, limit, speeds[: len(outside)])
                self._ride(point.elevator, after.floor, inside, limit, speeds[-len(inside) :])
                leg, speeds = [], []
        self._drive(leg, heading, limit, speeds)

    def _ride(
        self, elevator: str, destination: str, inside: Sequence[XY], limit: float, speeds: Sequence[float]
    ) -> None:
        """Ride to another floor. inside: the way into the cabin, with limits on the segment before each point."""

        def drive(points: Sequence[XY], around: Callable[[Motion], Motion]) -> None:
            limits = speeds if points is inside else None
            self.move(around(self._giving_way(Drive(points, None, limit, BASE_LIMITS, limits), points[-1])))

        shaft = self._nearby.shaft(elevator) if self._nearby else None
        self.ride(elevator, destination, inside, shaft, drive)

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
        self.move(StopBase())

    def _drive(
        self,
        points: Sequence[tuple[float, float]],
        heading: float | None,
        speed: float,
        speeds: Sequence[float] | None = None,
    ) -> None:
        self.move(self._giving_way(Drive(points, heading, speed, BASE_LIMITS, speeds), points[-1]))

    def _giving_way(
        self, motion: Motion, goal: XY | None = None, precise_positioning: bool = False, avoid_walls: bool = False
    ) -> Motion:
        return GiveWay(motion, self._nearby, goal, precise_positioning, avoid_walls) if self._nearby else motion

    def _speed(self, limit: float) -> float:
        cap = self.controller.speed_cap
        return min(limit, cap) if limit else cap


def _speed_between(one: PathPoint, other: PathPoint) -> float:
    """The path planning agent's speed between two points of a drive [m/s]; the map limits it. Waits and rides lie
    between an elevator's entry and its exit, between which nobody drives."""
    seconds = other.time - one.time
    return (other.distance - one.distance) / seconds if seconds > 0.0 else math.inf
