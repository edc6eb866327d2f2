"""Where a robot steps aside that blocks another one: to a nearby place outside the other robot's lane."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robocorba.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.spatial.pose import XY

#: Candidate places: directions around the robot, and distances from it [m].
DIRECTIONS, DISTANCES_M = 16, (0.15, 0.3, 0.5, 0.8, 1.2)
#: Step at which the straight line to a candidate is checked [m].
CHECK_STEP_M = 0.1
#: Least clearance of a candidate [m], or that of the present place if it is smaller.
MIN_CLEARANCE_M = 0.03
#: Beyond this gap between the rim and the lane [m], a candidate gets no better.
LANE_GAP_M = 0.15
#: Beyond this gap between the two rims [m], a candidate gets no better.
ROBOT_GAP_M = 0.25
#: Cost of a metre of driving, in metres of gap.
DRIVING_COST = 0.25
#: Another robot approaches if it faces this robot within this angle [rad].
FACING_RAD = math.radians(60)


def place_aside(nearby: Nearby, here: XY, other: OtherRobot) -> XY | None:
    """The best place (x, y) [m] to step aside for `other`; None if `here` is as good. Raises NotReachable."""
    lane = _lane(here, other)

    def score_m(place: XY) -> float:
        contact_m = RADIUS_M + other.radius_m
        from_lane_m = min(_distance_from_ray(place, (other.x, other.y), lane), contact_m + LANE_GAP_M)
        from_robot_m = min(math.dist(place, (other.x, other.y)), contact_m + ROBOT_GAP_M)
        return from_lane_m + from_robot_m - DRIVING_COST * math.dist(here, place)

    best = max(_free_places(nearby, here), key=score_m, default=here)
    return best if score_m(best) > score_m(here) + 0.01 else None


def _lane(here: XY, other: OtherRobot) -> float:
    """The direction in which another robot wants to drive [rad]: its heading if it approaches, else towards this robot.

    Robots face their direction of travel, but may have turned for their goal."""
    towards_us = math.atan2(here[1] - other.y, here[0] - other.x)
    is_approaching = abs(math.remainder(other.heading - towards_us, math.tau)) < FACING_RAD
    return other.heading if is_approaching else towards_us


def _distance_from_ray(place: XY, start: XY, direction: float) -> float:
    dx, dy = place[0] - start[0], place[1] - start[1]
    along = dx * math.cos(direction) + dy * math.sin(direction)
    return abs(dy * math.cos(direction) - dx * math.sin(direction)) if along > 0.0 else math.hypot(dx, dy)


def _free_places(nearby: Nearby, here: XY) -> Iterator[XY]:
    """Candidates that the robot can reach on a straight line."""
    others = nearby.others(*here)
    least_m = min(RADIUS_M + MIN_CLEARANCE_M, nearby.clearance_m(*here) - 1e-3)

    def is_free(place: XY) -> bool:
        for other in others:
            distance_m = math.dist(place, (other.x, other.y))
            if distance_m < min(RADIUS_M + other.radius_m + MIN_CLEARANCE_M, math.dist(here, (other.x, other.y))):
                return False
        return nearby.clearance_m(*place) >= least_m

    for number in range(DIRECTIONS):
        angle = math.tau * number / DIRECTIONS
        direction = math.cos(angle), math.sin(angle)
        checked_m = 0.0
        for distance_m in DISTANCES_M:
            while checked_m < distance_m - 1e-9:
                checked_m = min(checked_m + CHECK_STEP_M, distance_m)
                if not is_free((here[0] + direction[0] * checked_m, here[1] + direction[1] * checked_m)):
                    break
            else:
                yield here[0] + direction[0] * distance_m, here[1] + direction[1] * distance_m
                continue
            break
