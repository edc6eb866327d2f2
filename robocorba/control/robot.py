"""What a robot can do, one method a movement: what icons are made of.

Each method returns when it is done. It raises MotionFailed where the robot did not get there, RobotLost and
IllegalOrder where it can't move, and whatever interrupts its course."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence

import numpy as np

from robocorba.control.course import Course
from robocorba.control.driving import Drive, DriveAt, DriveBy, Stand
from robocorba.control.high_controller import HighController
from robocorba.control.joint_motion import GripMotion, JointMotion
from robocorba.control.motion import Motion
from robocorba.control.robot_state import Velocity
from robocorba.control.sensors import Sensors
from robocorba.control.session import BuildingSession
from robocorba.errors import MotionFailed, RoboCorbaError, RobotLost
from robocorba.frames import out_of
from robocorba.grids import Floats
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.kinematics.smartpal import ACCELERATION, BASE, GRIP, JOINTS, RADIUS_M, SPEED, Side
from robocorba.maps.model import XY
from robocorba.planning.request import PathPoint, PathRequest, Place, PointKind
from robocorba.programs.base_checks import Planner
from robocorba.simulation.elevator import Phase

#: A robot calls an elevator from so far before the middle of its cabin, m: outside its doors.
CALL_AT_M = 2.0
#: How long it waits for an elevator at most, s of its own time.
ELEVATOR_LIMIT_S = 300.0


class Robot:
    """A SmartPal. One thread at a time lets it move; its course may be steered by any."""

    def __init__(
        self,
        controller: HighController,
        session: BuildingSession,
        sensors: Sensors,
        kinematics: InverseKinematics,
        planner: Planner,
    ) -> None:
        self.controller, self.session, self.sensors = controller, session, sensors
        self.kinematics, self._planner = kinematics, planner
        self.course = Course(controller.cancel, self._hold)
        self._held: dict[Side, str] = {}

    # ---- the base ----

    def drive_path(
        self,
        floor: str,
        x: float,
        y: float,
        heading: float | None = None,
        speed: float = 0.0,
        around: Sequence[tuple[str, tuple[XY, ...]]] = (),
    ) -> None:
        """To a point in the building, across floors. around: polygons of floors that are not on the map, m. Raises
        PathError, InvalidRide, ElevatorFull as well."""
        here, state = self.session.latest.at, self.controller.state
        wanted = self._speed(speed)
        start, goal = Place(here.floor, state.x, state.y), Place(floor, x, y)
        request = PathRequest(start, goal, radius=RADIUS_M, speed=wanted, forbidden_areas=tuple(around))
        points = self._planner.paths(request)[0].points
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
        self._drive([(x, y)], heading, self._speed(speed))

    def drive_by(self, ahead: float, left: float, turn: float, speed: float = 0.0) -> None:
        """So far from where it is, m, turned by so much, rad."""
        self.move(DriveBy(ahead, left, turn, self._speed(speed), BASE))

    def drive_at(self, velocity: Velocity, seconds: float) -> None:
        """At a velocity for a time; then stand."""
        self.move(DriveAt(velocity, seconds))

    def stand(self) -> None:
        """Until the base does not move any more."""
        self.move(Stand())

    def _drive(
        self,
        points: Sequence[tuple[float, float]],
        heading: float | None,
        speed: float,
        speeds: Sequence[float] | None = None,
    ) -> None:
        self.move(Drive(points, heading, speed, BASE, speeds))

    def _speed(self, wanted: float) -> float:
        cap = self.controller.speed_cap
        return min(wanted, cap) if wanted else cap

    def call_elevator(self, elevator: str, destination: str) -> None:
        """Reserve a ride from this floor, and wait until the doors are open. Raises InvalidRide, ElevatorFull."""
        self.session.call_elevator(elevator, destination)
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

    def wait_for_ride(self, phase: Phase, otherwise: str) -> None:
        """Until the ride is in this phase; `otherwise` is what the failure says."""

        def is_there() -> bool:
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
