"""Where a robot steps aside that blocks another one: to a nearby place outside the other robot's lane."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robocorba.map_editor.spatial.frames import into, out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Candidate places: directions around the robot, and distances from it [m].
DIRECTIONS, DISTANCES_M = 16, (0.15, 0.3, 0.5, 0.8, 1.2)
#: Step at which the straight line to a candidate is checked [m].
CHECK_STEP_M = 0.1
#: Minimum gap between the robot's rim and obstacles at a candidate [m], or that of the present place if it is smaller.
MIN_GAP_M = 0.03
#: Beyond this gap between the robot's rim and the lane [m], the score of a candidate does not increase.
LANE_GAP_M = 0.15
#: Beyond this gap between the two robots' rims [m], the score of a candidate does not increase.
ROBOT_GAP_M = 0.25
#: Cost of a metre of driving, in metres of gap.
DRIVING_COST = 0.25
#: Another robot approaches if it faces this robot within this angle [rad].
FACING_RAD = math.radians(60)


def place_aside(nearby: Nearby, here: XY, other: OtherRobot) -> XY | None:
    """The best place (x, y) [m] to step aside for `other`; None if `here` is as good. Raises NotReachable."""
    lane_direction, contact_m = _lane_direction(here, other), RADIUS_M + other.radius_m

    def score_m(place: XY) -> float:
        from_lane_m = min(_distance_from_ray(place, (other.x, other.y), lane_direction), contact_m + LANE_GAP_M)
        from_robot_m = min(math.dist(place, (other.x, other.y)), contact_m + ROBOT_GAP_M)
        return from_lane_m + from_robot_m - DRIVING_COST * math.dist(here, place)

    best = max(_free_places(nearby, here), key=score_m, default=here)
    return best if score_m(best) > score_m(here) + 0.01 else None


def _lane_direction(here: XY, other: OtherRobot) -> float:
    """The direction in which another robot wants to drive [rad]: towards this robot, which is in its way, or its own
    heading if that is within FACING_RAD of it. A robot that waits may have turned for its goal."""
    bearing = math.atan2(here[1] - other.y, here[0] - other.x)
    is_approaching = abs(math.remainder(other.heading - bearing, math.tau)) < FACING_RAD
    return other.heading if is_approaching else bearing


def _distance_from_ray(place: XY, start: XY, direction: float) -> float:
    ahead_m, left_m = into(*place, (*start, direction))
    return abs(left_m) if ahead_m > 0.0 else math.hypot(ahead_m, left_m)


def _free_places(nearby: Nearby, here: XY) -> Iterator[XY]:
    """Candidates that the robot can reach on a straight line."""
    others = nearby.others(*here)
    least_m = min(RADIUS_M + MIN_GAP_M, nearby.clearance_m(*here) - 1e-3)

    def is_free(place: XY) -> bool:
        for other in others:
            distance_m = math.dist(place, (other.x, other.y))
            if distance_m < min(RADIUS_M + other.radius_m + MIN_GAP_M, math.dist(here, (other.x, other.y))):
                return False
        return nearby.clearance_m(*place) >= least_m

    for number in range(DIRECTIONS):
        ray = (*here, math.tau * number / DIRECTIONS)
        checked_m = 0.0
        for distance_m in DISTANCES_M:
            steps = math.ceil((distance_m - checked_m) / CHECK_STEP_M - 1e-9)
            distances_m = (min(checked_m + step * CHECK_STEP_M, distance_m) for step in range(1, steps + 1))
            if not all(is_free(out_of(each, 0.0, ray)) for each in distances_m):
                break
            yield out_of(distance_m, 0.0, ray)
            checked_m = distance_m
