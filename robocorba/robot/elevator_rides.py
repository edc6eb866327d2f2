"""Elevator rides of a robot: it waits clear of the doors, and drives into a cabin only while it has a ride."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import shapely
from shapely import LineString, Point, Polygon
from shapely.ops import substring

from robocorba.errors.robots import MotionFailed, RideLost
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.motion.motion import Motion, MotionCommand
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.session import BuildingSession
from robocorba.simulation.elevator import BOARDING_LIMIT_S, RidePhase

#: Distance from the middle of a cabin at which a robot calls the elevator [m], at least.
ELEVATOR_CALL_DISTANCE_M = 2.0
#: Gap between a robot that waits for an elevator and its doors [m], at least; and that through which another leaves the
#: cabin, unless it is this much farther from the middle, as along the shaft's walls [m].
DOOR_GAP_M = 0.1
PASSING_GAP_M, PASSING_WAY_M = 2.0 * RADIUS_M + 0.25, 1.5
#: Timeout of a ride, and of waiting for the elevator beyond its announced longest wait [s, robot's clock].
ELEVATOR_LIMIT_S = 300.0
#: How often a robot asks for a ride that it loses before it is in the cabin.
RIDE_TRIALS = 3
#: Part of the time for boarding that is left for acceleration and for others in the way [s].
BOARDING_RESERVE_S = 3.0


class WhileRiding:
    """A motion into a cabin, which ends with RideLost if the robot has no ride any more."""

    def __init__(self, motion: Motion, session: BuildingSession, elevator: str) -> None:
        self._motion, self._session, self._elevator = motion, session, elevator

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        ride = self._session.latest.ride
        if ride is None or ride.phase is RidePhase.WAITING:
            raise RideLost(self._elevator, f"while the robot drove in, at ({state.x:.2f}, {state.y:.2f})")
        return self._motion.command(state, elapsed_s)


def way_out_of_doors(here: XY, way: Sequence[XY], shaft: Polygon | None) -> list[XY]:
    """The points from a place on the way into a cabin back to its start; none if the robot is there, or completely
    inside of the shaft: the doors may close then, and it asks from there. shaft: None if it is not known."""
    at = Point(here)
    if shaft is not None and shaft.contains(at) and shaft.exterior.distance(at) >= RADIUS_M:
        return []
    line = LineString(way)
    back = substring(line, line.project(at), 0.0)
    return [(x, y) for x, y in back.coords[1:]] if back.length > 0.0 else []


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

    That is clear of the doors, by PASSING_GAP_M where it can, and at least ELEVATOR_CALL_DISTANCE_M before the middle;
    if no place of the path is, the robot stays where it is. Both parts are without their start."""
    line = LineString(path)
    until_m = max(0.0, line.length - ELEVATOR_CALL_DISTANCE_M)
    if shaft is not None:
        near_m, passing_m = (_clear_until_m(line, until_m, shaft, gap_m) for gap_m in (DOOR_GAP_M, PASSING_GAP_M))
        until_m = passing_m if near_m - passing_m <= PASSING_WAY_M else near_m
    lengths = accumulate(math.dist(*ends) for ends in pairwise(path))
    beyond = next((number for number, length in enumerate(lengths, 1) if length > until_m), len(path) - 1)
    at = line.interpolate(until_m)
    return [*path[1:beyond], (at.x, at.y)], list(path[beyond:])


def _clear_until_m(line: LineString, until_m: float, shaft: Polygon, gap_m: float) -> float:
    """The last point of a line, as a distance from its start up to `until_m` [m], at which a robot is clear of a shaft
    by `gap_m` [m]; 0 if none is."""
    clear = substring(line, 0.0, until_m).difference(shaft.buffer(RADIUS_M + gap_m))
    return max((line.project(Point(end)) for end in shapely.get_coordinates(clear)), default=0.0)
