"""Where a robot goes that is in another one's way: to a place near by, out of the other one's lane."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robocorba.collision_avoidance.neighbours import Nearby, Other
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.spatial.pose import XY

#: Places that are looked at: so many directions, and so far, m; and the way there, each so many m.
DIRECTIONS, DISTANCES_M, LOOK_M = 16, (0.15, 0.3, 0.5, 0.8, 1.2), 0.1
#: So far from everything, m, or no nearer than now.
CLEAR_M = 0.03
#: Farther out of the lane is no better, m; nor is farther from the robot, m.
WIDE_M, APART_M = 0.15, 0.25
#: What a metre of way costs, in metres of room.
WAY_COSTS = 0.25
#: Another one that faces within this of us is coming, rad.
FACES_RAD = math.radians(60)


def aside(nearby: Nearby, here: XY, other: Other) -> XY | None:
    """The best place; None where `here` is as good. Raises NotReachable."""
    lane = _lane(here, other)

    def worth(place: XY) -> float:
        least_m = RADIUS_M + other.radius_m
        off_m = min(_off(place, (other.x, other.y), lane), least_m + WIDE_M)
        apart_m = min(math.dist(place, (other.x, other.y)), least_m + APART_M)
        return off_m + apart_m - WAY_COSTS * math.dist(here, place)

    best = max(_free(nearby, here), key=worth, default=here)
    return best if worth(best) > worth(here) + 0.01 else None


def _lane(here: XY, other: Other) -> float:
    """Where it wants to go: robots face where they go, but may have turned for their goal."""
    to_us = math.atan2(here[1] - other.y, here[0] - other.x)
    is_coming = abs(math.remainder(other.heading - to_us, math.tau)) < FACES_RAD
    return other.heading if is_coming else to_us


def _off(place: XY, start: XY, lane: float) -> float:
    """How far a place is from a ray, m."""
    dx, dy = place[0] - start[0], place[1] - start[1]
    along = dx * math.cos(lane) + dy * math.sin(lane)
    return abs(dy * math.cos(lane) - dx * math.sin(lane)) if along > 0.0 else math.hypot(dx, dy)


def _free(nearby: Nearby, here: XY) -> Iterator[XY]:
    """Places that can be driven to straight."""
    others = nearby.others(*here)
    least_m = min(RADIUS_M + CLEAR_M, nearby.room_m(*here) - 1e-3)

    def is_free(place: XY) -> bool:
        for other in others:
            away_m = math.dist(place, (other.x, other.y))
            if away_m < min(RADIUS_M + other.radius_m + CLEAR_M, math.dist(here, (other.x, other.y))):
                return False
        return nearby.room_m(*place) >= least_m

    for number in range(DIRECTIONS):
        turn = math.tau * number / DIRECTIONS
        step = math.cos(turn), math.sin(turn)
        looked_m = 0.0
        for distance_m in DISTANCES_M:
            while looked_m < distance_m - 1e-9:
                looked_m = min(looked_m + LOOK_M, distance_m)
                if not is_free((here[0] + step[0] * looked_m, here[1] + step[1] * looked_m)):
                    break
            else:
                yield here[0] + step[0] * distance_m, here[1] + step[1] * distance_m
                continue
            break
