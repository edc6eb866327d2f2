"""Where a robot steps aside that blocks another one: to a nearby place outside the other robot's lane."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robocorba.map_editor.spatial.frames import into, out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.collision_avoidance.neighbours import Nearby, OtherRobot
from robocorba.robot.kinematics.smartpal import RADIUS_M

#: Step at which the straight line to a candidate is checked [m].
CHECK_STEP_M = 0.1
#: Minimum gap between the robot's rim and obstacles at a candidate [m], or that of the present place if it is smaller.
MIN_GAP_M = 0.03


def place_aside(nearby: Nearby, here: XY, other: OtherRobot) -> XY | None:
    """The best place (x, y) [m] to step aside for `other`; None if `here` is as good. Raises NotReachable."""
    lane_direction, contact_m = _lane_direction(here, other), RADIUS_M + other.radius_m

    def score_m(place: XY) -> float:
        """The gaps to the lane and to the other robot, as far as they are of use: 0.15 m and 0.25 m; a metre of driving
        costs 0.25 m of gap."""
        from_lane_m = min(_distance_from_ray(place, (other.x, other.y), lane_direction), contact_m + 0.15)
        from_robot_m = min(math.dist(place, (other.x, other.y)), contact_m + 0.25)
        return from_lane_m + from_robot_m - 0.25 * math.dist(here, place)

    best = max(_free_places(nearby, here), key=score_m, default=here)
    return best if score_m(best) > score_m(here) + 0.01 else None


def _lane_direction(here: XY, other: OtherRobot) -> float:
    """The direction in which another robot wants to drive [rad]: towards this robot, which is in its way, or its own
    heading if that is within 60 degrees of it. A robot that waits may have turned for its goal."""
    bearing = math.atan2(here[1] - other.y, here[0] - other.x)
    is_approaching = abs(math.remainder(other.heading - bearing, math.tau)) < math.radians(60)
    return other.heading if is_approaching else bearing


def _distance_from_ray(place: XY, start: XY, direction: float) -> float:
    ahead_m, left_m = into(*place, (*start, direction))
    return abs(left_m) if ahead_m > 0.0 else math.hypot(ahead_m, left_m)


def _free_places(nearby: Nearby, here: XY) -> Iterator[XY]:
    """Candidates that the robot can reach on a straight line: in 16 directions, at several distances."""
    others = nearby.others(*here)
    least_m = min(RADIUS_M + MIN_GAP_M, nearby.clearance_m(*here) - 1e-3)

    def is_free(place: XY) -> bool:
        for other in others:
            distance_m = math.dist(place, (other.x, other.y))
            if distance_m < min(RADIUS_M + other.radius_m + MIN_GAP_M, math.dist(here, (other.x, other.y))):
                return False
        return nearby.clearance_m(*place) >= least_m

    for number in range(16):
        ray = (*here, math.tau * number / 16)
        checked_m = 0.0
        for distance_m in (0.15, 0.3, 0.5, 0.8, 1.2):
            steps = math.ceil((distance_m - checked_m) / CHECK_STEP_M - 1e-9)
            distances_m = (min(checked_m + step * CHECK_STEP_M, distance_m) for step in range(1, steps + 1))
            if not all(is_free(out_of(each, 0.0, ray)) for each in distances_m):
                break
            yield out_of(distance_m, 0.0, ray)
            checked_m = distance_m
