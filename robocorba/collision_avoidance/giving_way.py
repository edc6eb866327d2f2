"""Robots that drive don't run into each other: each gives way to the others by the same rules.

The hard rule: the ways in which two robots can brake must fit between them, with a margin. Where both keep it they
don't touch, whoever should have yielded; one that can't go on stands. The soft rule: of two whose ways cross, the one
whose name comes later lets the other one pass first, where standing is enough for that. Those that are still in each
other's way are a knot: the one with the later name is the first to give up, so that it can go aside and around."""

from __future__ import annotations

import math
from collections.abc import Callable

from robocorba.collision_avoidance.neighbours import Nearby, Other
from robocorba.collision_avoidance.temporary_obstacles import STANDS_M_S
from robocorba.errors.robots import MotionFailed
from robocorba.errors.services import NotReachable
from robocorba.kinematics.smartpal import BASE, RADIUS_M
from robocorba.motion.motion import Motion, Wish
from robocorba.motion.robot_state import STANDING, RobotState, Velocity
from robocorba.spatial.frames import turned
from robocorba.spatial.pose import XY

#: Two robots stay so far apart, m; less on the last stretch, m long, where both may have places side by side.
MARGIN_M, NEAR_MARGIN_M, LAST_M = 0.05, 0.012, 0.6
#: As slowly as this it may use up the margin, m/s, so that it gets past who is beside it.
CREEP_M_S = 0.02
#: Of its limits a robot brakes with so much: what is left makes up for what others know too late.
BRAKING_M_S2 = 0.6 * BASE.acceleration
#: Whose ways come so near to each other within so long meet, m and s.
MEET_M, MEET_S = 0.15, 2.5
#: A robot that may drive at less than this share of what it wants is blocked: so long until it gives up, s. By one that
#: has been standing for PARKED_S; by one with an earlier name; by one with a later name, which should go aside first.
BLOCKED_SHARE = 0.1
PARKED_S = 2.0
GIVE_UP_PARKED_S, GIVE_UP_FIRST_S, GIVE_UP_LAST_S = 0.5, 1.0, 4.0
#: So far from walls and objects, m, where they are looked at.
WALL_M = 0.02


class Blocked(MotionFailed):
    """Somebody stands in the way; `other` is None where it is a wall or an object."""

    def __init__(self, state: RobotState, other: Other | None) -> None:
        self.other = other
        who = f"{other.name} is" if other else "a wall or an object is"
        super().__init__(f"blocked at ({state.x:.2f}, {state.y:.2f}): {who} in the way")


class GiveWay:
    """Another motion of the base, as far as others let it go. It is Blocked where they don't for some time.

    goal: where it shall end, by default anywhere; near it robots may stand side by side, which is so all the way where
    it is fine. A fine motion lets nobody pass first, and waits. heeds_walls: also as far as walls and objects let it
    go."""

    def __init__(
        self,
        motion: Motion,
        nearby: Nearby,
        goal: XY | None = None,
        is_fine: bool = False,
        heeds_walls: bool = False,
    ) -> None:
        self._motion, self._nearby, self._goal = motion, nearby, goal
        self._is_fine, self._heeds_walls = is_fine, heeds_walls
        self._blocked_since: float | None = None
        #: Since when each of the others stands, s.
        self._stand_since: dict[str, float] = {}

    def wish(self, state: RobotState, elapsed_s: float) -> Wish | None:
        """Raises MotionFailed, Blocked."""
        wish = self._motion.wish(state, elapsed_s)
        if wish is None:
            return None
        try:
            share, other = self._share(state, wish.velocity, elapsed_s)
        except NotReachable:
            return wish._replace(velocity=STANDING)  # a robot that sees nobody does not drive
        self._look_if_blocked(state, share, other, elapsed_s)
        ahead, left, turn = wish.velocity
        return wish._replace(velocity=(ahead * share, left * share, turn))

    def _share(self, state: RobotState, velocity: Velocity, now: float) -> tuple[float, Other | None]:
        """How much of a velocity is allowed, and who is the reason."""
        vx, vy = turned(velocity[0], velocity[1], state.heading)
        others = self._nearby.others(state.x, state.y)
        stand = {one.name for one in others if math.hypot(one.vx, one.vy) < STANDS_M_S}
        self._stand_since = {name: self._stand_since.get(name, now) for name in stand}
        best: tuple[float, Other | None] = (1.0, None)
        if self._heeds_walls:
            best = _wall_share(self._nearby.room_m, state, vx, vy), None
        margin_m = self._margin_m(state)
        for other in others:
            share = hard_share(state, vx, vy, other, margin_m)
            if not self._is_fine and other.name < self._nearby.name and lets_pass(state, vx, vy, other):
                share = 0.0
            if share < best[0]:
                best = share, other
        return best

    def _margin_m(self, state: RobotState) -> float:
        if self._is_fine:
            return NEAR_MARGIN_M
        is_near = self._goal is not None and math.dist(self._goal, (state.x, state.y)) < LAST_M
        return NEAR_MARGIN_M if is_near else MARGIN_M

    def _look_if_blocked(self, state: RobotState, share: float, other: Other | None, now: float) -> None:
        if share >= BLOCKED_SHARE:
            self._blocked_since = None
            return
        if self._blocked_since is None:
            self._blocked_since = now
        if now - self._blocked_since >= self._patience_s(other, self._blocked_since):
            raise Blocked(state, other)

    def _patience_s(self, other: Other | None, since: float) -> float:
        if other is None:
            return GIVE_UP_PARKED_S
        if self._is_fine:
            return math.inf  # the motion itself knows when it is stuck
        stands_since = self._stand_since.get(other.name, math.inf)
        if since - stands_since >= PARKED_S:
            return GIVE_UP_PARKED_S
        return GIVE_UP_FIRST_S if other.name < self._nearby.name else GIVE_UP_LAST_S


def hard_share(state: RobotState, vx: float, vy: float, other: Other, margin_m: float) -> float:
    """Of a velocity, m/s along the floor's axes: as much as leaves room for both to brake."""
    dx, dy = other.x - state.x, other.y - state.y
    apart_m = math.hypot(dx, dy)
    if apart_m == 0.0:
        return 1.0
    closing = (vx * dx + vy * dy) / apart_m
    if closing <= 0.0:
        return 1.0
    its_closing = max(0.0, -(other.vx * dx + other.vy * dy) / apart_m)
    gap_m = apart_m - RADIUS_M - other.radius_m
    room_m = gap_m - margin_m - its_closing * its_closing / (2.0 * BRAKING_M_S2)
    allowed = max(math.sqrt(2.0 * BRAKING_M_S2 * max(room_m, 0.0)), CREEP_M_S if gap_m > NEAR_MARGIN_M else 0.0)
    return min(1.0, allowed / closing)


def lets_pass(state: RobotState, vx: float, vy: float, other: Other) -> bool:
    """Whether another one that moves would meet this one if both go on, and would not if this one stands."""
    if math.hypot(other.vx, other.vy) < STANDS_M_S:
        return False
    at, least_m = (other.x - state.x, other.y - state.y), RADIUS_M + other.radius_m
    goes_on_m = _nearest_m(at, (other.vx - vx, other.vy - vy))
    stands_m = _nearest_m(at, (other.vx, other.vy))
    return goes_on_m < least_m + MEET_M and stands_m > least_m + MARGIN_M and goes_on_m < stands_m


def _nearest_m(at: XY, velocity: XY) -> float:
    """How near something that is at a place and moves comes to the origin within MEET_S."""
    speed2 = velocity[0] ** 2 + velocity[1] ** 2
    time = -(at[0] * velocity[0] + at[1] * velocity[1]) / speed2 if speed2 > 0.0 else 0.0
    time = min(max(time, 0.0), MEET_S)
    return math.hypot(at[0] + time * velocity[0], at[1] + time * velocity[1])


def _wall_share(room_m: Callable[[float, float], float], state: RobotState, vx: float, vy: float) -> float:
    """Of a velocity: as much as lets it stand before what it comes nearer to."""
    speed = math.hypot(vx, vy)
    if speed == 0.0:
        return 1.0
    here_m = room_m(state.x, state.y)
    look_m = WALL_M + speed * speed / (2.0 * BRAKING_M_S2)
    there_m = room_m(state.x + vx / speed * look_m, state.y + vy / speed * look_m)
    if there_m >= min(here_m, RADIUS_M + WALL_M):
        return 1.0
    return min(1.0, math.sqrt(2.0 * BRAKING_M_S2 * max(here_m - RADIUS_M - WALL_M, 0.0)) / speed)
