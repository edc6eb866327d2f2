"""What a robot can do, one method a movement: what icons are made of.

Each method returns when it is done. It raises MotionFailed where the robot did not get there, RobotLost and
IllegalOrder where it can't move, and whatever interrupts its course."""

from __future__ import annotations

import contextlib
import logging
import math
import random
from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from robocorba.collision_avoidance.giving_way import Blocked, GiveWay
from robocorba.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.collision_avoidance.stepping_aside import aside
from robocorba.collision_avoidance.temporary_obstacles import TemporaryObstacles
from robocorba.control.execution_control import ExecutionControl
from robocorba.control.high_controller import HighController
from robocorba.control.sensors import Sensors
from robocorba.control.session import BuildingSession
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import PathError
from robocorba.errors.robots import MotionFailed, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.kinematics.smartpal import ACCELERATION, BASE, GRIP, JOINTS, RADIUS_M, SPEED, Side
from robocorba.motion.driving import Drive, DriveAt, DriveBy, StopBase
from robocorba.motion.joint_motion import GripMotion, JointMotion
from robocorba.motion.motion import Motion
from robocorba.motion.robot_state import Velocity
from robocorba.planning.request import Path, PathPoint, PathRequest, Place, PointKind, RouteMode
from robocorba.programs.base_checks import Planner
from robocorba.simulation.elevator import Phase
from robocorba.spatial.frames import out_of
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import XY

#: A robot calls an elevator from so far before the middle of its cabin, m: outside its doors.
CALL_AT_M = 2.0
#: How long it waits for an elevator at most, s of its own time.
ELEVATOR_LIMIT_S = 300.0
#: A robot that touches something, m, may drive away from there.
TOUCH_M = 0.02
#: A way keeps so far from everything, m, as far as it can: corners are cut. It may be longer for that, times and m.
ROOMS_M = (0.06, 0.03, 0.0)
LONGER, LONGER_M = 1.05, 0.5
#: Who is blocked on its way goes aside, m/s, and waits a moment, s. Then it looks for a way around each so many s, for
#: so long; a way may have so many such knots.
ASIDE_SPEED, PAUSES_S, LOOK_S, LONGEST_PAUSE_S, MOST_KNOTS = 0.2, (0.2, 0.8), 0.5, 10.0, 8

_log = logging.getLogger(__name__)


class Robot:
    """A SmartPal. One thread at a time lets it move; its course may be steered by any.

    nearby: what it knows of others; without that it drives as if it were alone."""

    def __init__(
        self,
        controller: HighController,
        session: BuildingSession,
        sensors: Sensors,
        kinematics: InverseKinematics,
        planner: Planner,
        nearby: Nearby | None = None,
    ) -> None:
        self._nearby = nearby
        self.controller, self.session, self.sensors = controller, session, sensors
        self.kinematics, self._planner = kinematics, planner
        self.course = ExecutionControl(controller.cancel, self._hold)
        self._held: dict[Side, str] = {}

    # ---- the base ----

    def drive_path(
        self,
        floor: str,
        x: float,
        y: float,
        heading: float | None = None,
        speed: float = 0.0,
        looks_around: bool = False,
    ) -> None:
        """To a point in the building, across floors; around who and what stands in the way now once it was blocked,
        or from the beginning. Raises PathError, InvalidRide, ElevatorFull as well."""
        goal, wanted = Place(floor, x, y), self._speed(speed)
        points = (self._around(goal, wanted) if looks_around else None) or self._past_objects(goal, wanted)
        for _ in range(MOST_KNOTS):
            try:
                self._along(points, heading, wanted)
                return
            except Blocked as blocked:
                if not self._nearby or not blocked.other:
                    raise
                _log.info("%s", blocked)
                self._go_aside(self._nearby, blocked.other)
                points = self._after(blocked.other, goal, wanted)
        self._along(points, heading, wanted)

    def _past_objects(self, goal: Place, speed: float) -> list[PathPoint]:
        """By the map, but for objects that are known to be somewhere else now: along its roads, or through free space
        where such an object stands on them. Also from a place that touches something."""
        request = self._request(goal, speed)
        if self._nearby:
            known = self._nearby.objects(self.session.latest.holding)
            request = request._replace(**known._asdict())
        first: PathError | None = None
        for radius, mode in product((RADIUS_M, RADIUS_M - TOUCH_M), (RouteMode.SMOOTHED, RouteMode.GEOMETRIC)):
            try:
                found = self._planner.paths(request._replace(radius=radius, mode=mode))[0]
            except PathError as wrong:
                first = first or wrong
            else:
                return self._with_room(request._replace(mode=mode), found).points
        assert first
        raise first

    def _with_room(self, request: PathRequest, found: Path) -> Path:
        """As far from everything as a way can be that is hardly longer than one that was found."""
        for room_m in ROOMS_M[:-1]:
            with contextlib.suppress(PathError):
                wider = self._planner.paths(request._replace(radius=RADIUS_M + room_m))[0]
                if wider.distance <= LONGER * found.distance + LONGER_M:
                    return wider
        return found

    def _around(self, goal: Place, speed: float, other: str = "") -> list[PathPoint] | None:
        """Around what stands there now, and another robot; None where that is not known, or there is no way."""
        here = self.session.latest
        there = (goal.x, goal.y) if goal.floor == here.at.floor else None
        known = self._nearby.temporary_obstacles(other, there, here.holding) if self._nearby else TemporaryObstacles()
        if known == TemporaryObstacles():
            return None
        request = self._request(goal, speed)._replace(**known._asdict())
        for room_m, mode in product(ROOMS_M, (RouteMode.SMOOTHED, RouteMode.GEOMETRIC)):
            with contextlib.suppress(PathError):
                return self._planner.paths(request._replace(radius=RADIUS_M + room_m, mode=mode))[0].points
        return None

    def _request(self, goal: Place, speed: float) -> PathRequest:
        here, state = self.session.latest.at, self.controller.state
        return PathRequest(Place(here.floor, state.x, state.y), goal, radius=RADIUS_M, speed=speed)

    def _go_aside(self, nearby: Nearby, other: OtherRobot) -> None:
        """As far as that can be done, so that the other one gets by; and give it some time."""
        state = self.controller.state
        with contextlib.suppress(MotionFailed, NotReachable):
            if place := aside(nearby, (state.x, state.y), other):
                self.move(GiveWay(Drive([place], None, ASIDE_SPEED, BASE), nearby, avoid_walls=True))
        self.wait(random.uniform(*PAUSES_S))

    def _after(self, other: OtherRobot, goal: Place, speed: float) -> list[PathPoint]:
        """As soon as there is a way around the other one, or it is gone; as on the map where that takes too long."""
        deadline = self.clock() + LONGEST_PAUSE_S
        while self.clock() < deadline:
            if points := self._around(goal, speed, other.name):
                return points
            self.wait(LOOK_S)
        return self._past_objects(goal, speed)

    def _along(self, points: Sequence[PathPoint], heading: float | None, wanted: float) -> None:
        """From point to point, and from floor to floor."""
        state = self.controller.state
        leg: list[tuple[float, float]] = []
        speeds: list[float] = []
        for before, point, after in zip([points[0], *points], points, [*points[1:], None], strict=False):
            if point.kind is PointKind.ELEVATOR_ENTRY and after:
                came_from = leg[-1] if leg else (state.x, state.y)
                leg.append(_before(came_from, (point.x, point.y), CALL_AT_M))
                self._drive(leg, None, wanted, [*speeds, _speed_between(before, point)])
                self._ride(point, after, _speed_between(before, point))
                leg, speeds = [], []
            elif point.kind is not PointKind.ELEVATOR_EXIT:
                leg.append((point.x, point.y))
                speeds.append(_speed_between(before, point))
        self._drive(leg, heading, wanted, speeds)

    def drive_to(self, x: float, y: float, heading: float | None = None, speed: float = 0.0) -> None:
        """Straight to a point on this floor."""
        self.move(self._giving_way(Drive([(x, y)], heading, self._speed(speed), BASE), precise_positioning=True))

    def drive_by(
        self, ahead: float, left: float, turn: float, speed: float = 0.0, as_far_as_free: bool = False
    ) -> None:
        """So far from where it is, m, turned by so much, rad; or only until something is in the way."""
        motion = DriveBy(ahead, left, turn, self._speed(speed), BASE)
        try:
            self.move(self._giving_way(motion, precise_positioning=True, avoid_walls=as_far_as_free))
        except Blocked as blocked:
            if not as_far_as_free:
                raise
            _log.info("%s", blocked)

    def drive_at(self, velocity: Velocity, seconds: float) -> None:
        """At a velocity for a time; then stand."""
        self.move(DriveAt(velocity, seconds))

    def stand(self) -> None:
        """Until the base does not move any more."""
        self.move(StopBase())

    def _drive(
        self,
        points: Sequence[tuple[float, float]],
        heading: float | None,
        speed: float,
        speeds: Sequence[float] | None = None,
    ) -> None:
        self.move(self._giving_way(Drive(points, heading, speed, BASE, speeds), points[-1]))

    def _giving_way(
        self, motion: Motion, goal: XY | None = None, precise_positioning: bool = False, avoid_walls: bool = False
    ) -> Motion:
        return GiveWay(motion, self._nearby, goal, precise_positioning, avoid_walls) if self._nearby else motion

    def _speed(self, wanted: float) -> float:
        cap = self.controller.speed_cap
        return min(wanted, cap) if wanted else cap

    def call_elevator(self, elevator: str, destination: str, party: str = "", size: int = 1) -> None:
        """Reserve a ride from this floor, for a party of so many robots where it is named, and wait until the doors
        are open. Raises InvalidRide, ElevatorFull."""
        self.session.call_elevator(elevator, destination, party, size)
        self.session.state()  # from here on the ride is known
        self.wait_for_ride(Phase.BOARDING, f"{elevator} did not come to {self.session.latest.at.floor}")

    def _ride(self, entry: PathPoint, exit: PathPoint, speed: float) -> None:
        try:
            self.call_elevator(entry.elevator, exit.floor)
            self._drive([(entry.x, entry.y)], None, speed)
            self.wait_for_ride(Phase.ALIGHTING, f"{entry.elevator} did not arrive at {exit.floor}")
        except RoboCorbaError:
            with contextlib.suppress(RobotLost):
                self.session.give_up_elevator()
            raise

    def wait_for_ride(self, phase: Phase, otherwise: str, check: Callable[[], None] = lambda: None) -> None:
        """Until the ride is in this phase; `otherwise` is what the failure says. check: raises what else ends it."""

        def is_there() -> bool:
            check()
            ride = self.session.latest.ride
            if ride is None:
                raise MotionFailed(f"{otherwise}: the ride was lost")
            return ride.phase is phase

        if not self.wait(ELEVATOR_LIMIT_S, is_there):
            raise MotionFailed(otherwise)

    # ---- arms, lumbar, grippers ----

    def joints_along(self, postures: Sequence[Floats], seconds: float = 0.0) -> None:
        """All joints from posture to posture, (18,) each, rad, in at least so much time."""
        waypoints = np.array([self.joints, *postures])
        self.move(JointMotion(waypoints, JOINTS, SPEED, ACCELERATION, seconds))

    def grip(self, sides: Sequence[Side], angle: float, force_n: float | None = None, thing: str = "") -> None:
        """Grippers to an angle, rad; no harder than `force_n`. With the name of an object, hold it where the hand is.
        Raises CannotGrip as well."""
        wanted = self.joints.copy()
        wanted[[GRIP[side] for side in sides]] = angle
        fingers = [GRIP[side] for side in sides]
        self.move(GripMotion(self.joints, wanted, fingers, JOINTS, SPEED, ACCELERATION, force_n))
        if thing:
            state = self.controller.state
            hand = self.kinematics.body.hand(sides[0], state.joints)
            self.hold(thing, *out_of(hand.x, hand.y, (state.x, state.y, state.heading)))
            self._held.update(dict.fromkeys(sides, thing))

    def hold(self, thing: str, x: float, y: float) -> None:
        """Hold an object at a place of the floor, m. Raises CannotGrip as well."""
        self.session.grip(thing, x, y)
        self.session.state()  # from here on it is known

    def release(self, sides: Sequence[Side], angle: float) -> None:
        """Open grippers, and let go of what these hands held last."""
        held = [self._held.pop(side, "") for side in sides]
        if any(held) and not self._held:
            self.session.release()
        self.grip(sides, angle)

    def holds(self, side: Side) -> bool:
        """Whether a hand holds something in the building."""
        return bool(self._held.get(side)) and bool(self.session.latest.holding)

    @property
    def joints(self) -> Floats:
        """Where the joints (18,) were told to be, rad. Raises MotionFailed for a robot that has none."""
        joints = self.controller.targets
        if len(joints) != len(JOINTS):
            raise MotionFailed(f"this robot has {len(joints)} joints, not SmartPal's {len(JOINTS)}")
        return joints

    # ---- all of it ----

    def move(self, motion: Motion) -> None:
        """Let a motion run to its end."""
        self.course.check()
        self.controller.move(motion)

    def wait(self, seconds: float, is_so: Callable[[], bool] = lambda: False) -> bool:
        """Stand for a time, or until something is so; whether it is."""

        def look() -> bool:
            self.controller.check()  # the clock of a robot that is stopped stands still
            return is_so()

        return self.course.wait_for(look, seconds, self.clock)

    def clock(self) -> float:
        """The robot's time, s."""
        return self.controller.state.time

    def _hold(self, is_held: bool) -> None:
        self.controller.is_paused = is_held


def _speed_between(one: PathPoint, other: PathPoint) -> float:
    """That the path planning agent drives with from point to point, m/s: slower where the map says so."""
    seconds = other.time - one.time
    return (other.distance - one.distance) / seconds if seconds > 0.0 else math.inf


def _before(start: tuple[float, float], goal: tuple[float, float], distance_m: float) -> tuple[float, float]:
    """On the line to a goal, so far before it; where the line starts if that is nearer."""
    length = math.dist(start, goal)
    if length <= distance_m:
        return start
    share = 1.0 - distance_m / length
    return start[0] + share * (goal[0] - start[0]), start[1] + share * (goal[1] - start[1])
