"""Elevator rides of a robot: it waits clear of the doors, and drives into a cabin only while it has a ride."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

import shapely
from shapely import LineString, Point, Polygon
from shapely.ops import substring

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed, RideLost, RobotLost
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.motion.motion import Motion, MotionCommand
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.movements import Movements
from robocorba.robot.session import BuildingSession
from robocorba.simulation.elevator import BOARDING_LIMIT_S, RidePhase

#: Distance from the middle of a cabin at which a robot calls the elevator [m], at least.
ELEVATOR_CALL_DISTANCE_M = 2.0
#: Gap between a robot that waits for an elevator and its doors [m].
DOOR_GAP_M = 0.1
#: Timeout of a ride, and of waiting for the elevator beyond its announced longest wait [s, robot's clock].
ELEVATOR_LIMIT_S = 300.0
#: How often a robot asks for a ride that it loses before it is in the cabin.
RIDE_TRIALS = 3
#: Part of the time for boarding that is left for acceleration and for others in the way [s].
BOARDING_RESERVE_S = 3.0

_log = logging.getLogger(__name__)


class WhileRiding:
    """A motion into a cabin, which ends with RideLost if the robot has no ride any more."""

    def __init__(self, motion: Motion, session: BuildingSession, elevator: str) -> None:
        self._motion, self._session, self._elevator = motion, session, elevator

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        ride = self._session.latest.ride
        if ride is None or ride.phase is RidePhase.WAITING:
            raise RideLost(self._elevator, f"while the robot drove in, at ({state.x:.2f}, {state.y:.2f})")
        return self._motion.command(state, elapsed_s)


class RideMovements(Movements):
    """Mixin of Robot."""

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

        if not self.wait(limit_s, is_there):
            raise MotionFailed(otherwise)

    def ride(
        self,
        elevator: str,
        destination: str,
        inside: Sequence[XY],
        shaft: Polygon | None,
        drive: Callable[[Sequence[XY], Callable[[Motion], Motion]], None],
    ) -> None:
        """Ride to another floor from where the robot waits. inside: the way into the cabin [m]. shaft: [m]; None if it
        is not known. drive: drives through points, with what it gets around the motion.

        A ride that is lost before the robot is in the cabin is asked for again, RIDE_TRIALS times in all. Raises
        RideLost, MotionFailed, InvalidRide, ElevatorFull."""
        start = self.controller.state
        way = [(start.x, start.y), *inside]
        try:
            for trial in range(RIDE_TRIALS, 0, -1):
                try:
                    self.call_elevator(elevator, destination)
                    drive(inside, lambda motion: WhileRiding(motion, self.session, elevator))
                    break
                except RideLost as lost:
                    self.session.cancel_elevator()
                    self._leave_doors(way, shaft, drive)
                    if trial == 1:
                        raise
                    _log.info("%s; the robot asks again", lost)
            self.wait_for_ride(RidePhase.ALIGHTING, f"{elevator} did not arrive at {destination}")
        except RoboCorbaError:
            with contextlib.suppress(RobotLost):
                self.session.cancel_elevator()
            raise

    def _leave_doors(
        self,
        way: Sequence[XY],
        shaft: Polygon | None,
        drive: Callable[[Sequence[XY], Callable[[Motion], Motion]], None],
    ) -> None:
        """Drive back along the way into a cabin to where the robot waits, unless it is completely inside: the doors may
        close then, and it asks from there."""
        state = self.controller.state
        here = Point(state.x, state.y)
        if shaft is not None and shaft.contains(here) and shaft.exterior.distance(here) >= RADIUS_M:
            return
        line = LineString(way)
        back = substring(line, line.project(here), 0.0)
        if back.length > 0.0:
            drive([(x, y) for x, y in back.coords[1:]], lambda motion: motion)


def check_boarding_time(elevator: str, way: Sequence[XY], speeds: Sequence[float], limit: float) -> None:
    """Raise MotionFailed if the way into a cabin, from where the robot waits, takes longer than its doors are open.
    way: points [m]. speeds: limits on the segments [m/s]; limit: of all."""
    seconds = sum(math.dist(*ends) / min(speed, limit) for ends, speed in zip(pairwise(way), speeds, strict=True))
    if seconds > BOARDING_LIMIT_S - BOARDING_RESERVE_S:
        length_m = sum(math.dist(*ends) for ends in pairwise(way))
        raise MotionFailed(
            f"the doors of {elevator} close after {BOARDING_LIMIT_S:g} s; boarding needs {seconds:.0f} s, and "
            f"{BOARDING_RESERVE_S:g} s in reserve ({length_m:.1f} m at {length_m / seconds:.2f} m/s): drive faster"
        )


def split_at_doors(path: Sequence[XY], shaft: Polygon | None) -> tuple[list[XY], list[XY]]:
    """A robot's path to the middle of a cabin, from where it is, split where it waits for it.

    That is clear of the doors, and at least ELEVATOR_CALL_DISTANCE_M before the middle; if no place of the path is, the
    robot stays where it is. Both parts are without their start."""
    line = LineString(path)
    until_m = max(0.0, line.length - ELEVATOR_CALL_DISTANCE_M)
    if shaft is not None:
        clear = substring(line, 0.0, until_m).difference(shaft.buffer(RADIUS_M + DOOR_GAP_M))
        until_m = max((line.project(Point(end)) for end in shapely.get_coordinates(clear)), default=0.0)
    lengths = accumulate(math.dist(*ends) for ends in pairwise(path))
    beyond = next((number for number, length in enumerate(lengths, 1) if length > until_m), len(path) - 1)
    at = line.interpolate(until_m)
    return [*path[1:beyond], (at.x, at.y)], list(path[beyond:])
