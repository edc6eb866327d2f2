"""Collision avoidance between driving robots: all yield to each other by the same rules.

Hard rule: the braking distances of two robots plus a margin fit between them. If both keep it they don't touch,
whichever should have yielded; a robot that can't continue stops. Soft rule: if two robots' paths cross, the one whose
name sorts later lets the other pass first, where stopping suffices for that. Robots that block each other nevertheless
are in a deadlock: the one with the later name is Blocked first, so that it can step aside and drive around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from shapely import LineString, Point
from shapely.ops import substring

from robocorba.errors.robots import MotionFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.frames import turned
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import NO_OBSTACLES
from robocorba.robot.collision_avoidance.braking import REACTION_S, allowed_speed
from robocorba.robot.collision_avoidance.neighbours import STATIONARY_M_S, Nearby, OtherRobot
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M
from robocorba.robot.motion.motion import Motion, MotionCommand
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, RobotState, Velocity

#: Gap between two robots' rims [m].
MARGIN_M = 0.05
#: The same near the goal [m], where two robots may have places side by side.
NEAR_MARGIN_M = 0.012
#: Braking that the hard rule counts on [m/s^2]. The rest of the limit compensates for the delay of others' data.
BRAKING_M_S2 = 0.6 * BASE_LIMITS.acceleration
#: Time for which robots' paths are looked ahead [s].
MEET_S = 2.5
#: Time for which a robot stands and waits for the positions of others [s].
UNKNOWN_LIMIT_S = 20.0
#: Clearance to walls and objects [m], with `avoid_walls`.
WALL_M = 0.02


def in_the_way(other: OtherRobot | None) -> str:
    """Who is, a sentence. other: None for a wall or an object."""
    return f"{other.name if other else 'a wall or an object'} is in the way"


class Blocked(MotionFailed):
    """An obstacle blocks the robot: the robot `other`, or if that is None a wall or an object, or what was `seen`."""

    def __init__(self, state: RobotState, other: OtherRobot | None, seen: str = "") -> None:
        self.other = other
        blocker = in_the_way(other) if other or not seen else f"{seen} in the way"
        super().__init__(f"blocked at ({state.x:.2f}, {state.y:.2f}): {blocker}")


class GiveWay:
    """A motion of the base that yields to other robots, and stops before what the robot sees; raises Blocked once they
    have blocked it for some time, and as soon as the robot sees something on its path.

    path: its points [m]; within 0.6 m of the last one robots may be side by side. precise_positioning: NEAR_MARGIN_M
    holds on the whole path, the motion lets no robot pass first, and waits while it is blocked. avoid_walls: stop
    before walls and objects, too."""

    def __init__(
        self,
        motion: Motion,
        nearby: Nearby,
        path: Sequence[XY] = (),
        precise_positioning: bool = False,
        avoid_walls: bool = False,
    ) -> None:
        self._motion, self._nearby, self._policy, self._goal = motion, nearby, nearby.policy, path[-1] if path else None
        #: The path from the robot's start, and what it saw when that was checked last.
        self._path, self._checked = list(path), NO_OBSTACLES
        self._precise_positioning, self._avoid_walls = precise_positioning, avoid_walls
        self._blocked_since: float | None = None
        #: The last tick, since when the positions of others are unknown, and how long they were in all [s].
        self._last_s, self._unknown_s = 0.0, 0.0
        self._unknown_since: float | None = None
        #: Since when each stationary robot has been stationary [s], by name.
        self._stationary_since: dict[str, float] = {}

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        """Raises MotionFailed, Blocked."""
        if self._unknown_since is not None:
            self._unknown_s += elapsed_s - self._last_s
        self._last_s = elapsed_s
        command = self._motion.command(state, elapsed_s - self._unknown_s)
        if command is None:
            return None
        try:
            self._nearby.check_seen()
            self._check_path(state)
            share, other = self._allowed_share(state, command.velocity, elapsed_s)
        except NotReachable as error:
            self._check_patience(error, elapsed_s)
            # With unknown positions of others the robot does not drive.
            return command._replace(velocity=ZERO_VELOCITY, awaited=f"the positions of others: {error}")
        self._unknown_since = None
        self._check_blocked(state, share, other, elapsed_s)
        ahead, left, turn = command.velocity
        awaited = command.awaited
        if self._blocked_since is not None and elapsed_s - self._blocked_since >= self._policy.wait_shown_s:
            awaited = f"a free way: {in_the_way(other)}"
        return command._replace(velocity=(ahead * share, left * share, turn), awaited=awaited)

    def _check_path(self, state: RobotState) -> None:
        seen = self._nearby.seen
        if len(self._path) == 1:
            self._path.insert(0, (state.x, state.y))
        if not self._path or seen is self._checked:
            return
        self._checked, line = seen, LineString(self._path)
        rest = substring(line, line.project(Point(state.x, state.y)), line.length)
        if name := self._nearby.seen_on(list(rest.coords), RADIUS_M):
            raise Blocked(state, None, name)

    def _check_patience(self, error: NotReachable, now: float) -> None:
        """Data that are late for a moment, as on a busy machine, must not end a drive as if the robot were stuck."""
        if self._unknown_since is None:
            self._unknown_since = now
        if now - self._unknown_since >= UNKNOWN_LIMIT_S:
            raise MotionFailed(f"waited {UNKNOWN_LIMIT_S:g} s: {error}")

    def _allowed_share(self, state: RobotState, velocity: Velocity, now: float) -> tuple[float, OtherRobot | None]:
        """The share of a velocity that is allowed, and the robot that limits it."""
        vx, vy = turned(velocity[0], velocity[1], state.heading)
        others = self._nearby.others(state.x, state.y)
        stationary = {other.name for other in others if math.hypot(other.vx, other.vy) < STATIONARY_M_S}
        self._stationary_since = {name: self._stationary_since.get(name, now) for name in stationary}
        wall_share = _wall_share(self._nearby.clearance_m, state, vx, vy) if self._avoid_walls else 1.0
        least: tuple[float, OtherRobot | None] = (min(wall_share, self._seen_share(state, vx, vy)), None)
        margin_m = self._margin_m(state)
        for other in others:
            share = safe_share(state, vx, vy, other, margin_m)
            has_priority = not self._precise_positioning and other.name < self._nearby.name
            if has_priority and should_yield(state, vx, vy, other):
                share = 0.0
            if share < least[0]:
                least = share, other
        return least

    def _seen_share(self, state: RobotState, vx: float, vy: float) -> float:
        """The share of a velocity from which the robot stops before what it sees."""
        points, speed = self._nearby.seen_around(state.x, state.y), math.hypot(vx, vy)
        if not len(points) or speed == 0.0:
            return 1.0
        return min(1.0, allowed_speed(points, (vx / speed, vy / speed), REACTION_S)[0] / speed)

    def _margin_m(self, state: RobotState) -> float:
        is_near = self._goal is not None and math.dist(self._goal, (state.x, state.y)) < 0.6
        return NEAR_MARGIN_M if is_near or self._precise_positioning else MARGIN_M

    def _check_blocked(self, state: RobotState, share: float, other: OtherRobot | None, now: float) -> None:
        if share >= 0.1:  # it gets on
            self._blocked_since = None
            return
        if self._blocked_since is None:
            self._blocked_since = now
        if now - self._blocked_since >= self._patience_s(other, self._blocked_since):
            raise Blocked(state, other)

    def _patience_s(self, other: OtherRobot | None, since: float) -> float:
        if other is None:
            return self._policy.blocked_by_parked_s
        if self._precise_positioning:
            return math.inf  # the motion itself raises MotionFailed when it is stuck
        stationary_since = self._stationary_since.get(other.name, math.inf)
        if since - stationary_since >= self._policy.parked_s:
            return self._policy.blocked_by_parked_s
        is_earlier = other.name < self._nearby.name
        return self._policy.blocked_by_earlier_s if is_earlier else self._policy.blocked_by_later_s


def safe_share(state: RobotState, vx: float, vy: float, other: OtherRobot, margin_m: float) -> float:
    """The share of a velocity (vx, vy) [m/s, along the floor's axes] that leaves both robots room to brake; inside the
    margin 0.02 m/s, at which a robot gets past its neighbour."""
    dx, dy = other.x - state.x, other.y - state.y
    distance_m = math.hypot(dx, dy)
    if distance_m == 0.0:
        return 1.0
    closing = (vx * dx + vy * dy) / distance_m
    if closing <= 0.0:
        return 1.0
    other_closing = max(0.0, -(other.vx * dx + other.vy * dy) / distance_m)
    gap_m = distance_m - RADIUS_M - other.radius_m
    free_m = gap_m - margin_m - other_closing * other_closing / (2.0 * BRAKING_M_S2)
    allowed = max(math.sqrt(2.0 * BRAKING_M_S2 * max(free_m, 0.0)), 0.02 if gap_m > NEAR_MARGIN_M else 0.0)
    return min(1.0, allowed / closing)


def should_yield(state: RobotState, vx: float, vy: float, other: OtherRobot) -> bool:
    """Whether a moving robot would meet this one, rims within 0.15 m, if both continue, and would not if this one
    stops."""
    if math.hypot(other.vx, other.vy) < STATIONARY_M_S:
        return False
    at, least_m = (other.x - state.x, other.y - state.y), RADIUS_M + other.radius_m
    continuing_m = _nearest_m(at, (other.vx - vx, other.vy - vy))
    stopped_m = _nearest_m(at, (other.vx, other.vy))
    return continuing_m < least_m + 0.15 and stopped_m > least_m + MARGIN_M and continuing_m < stopped_m


def _nearest_m(at: XY, velocity: XY) -> float:
    """The least distance [m] from the origin, within MEET_S, of a point that moves at a constant velocity."""
    speed2 = velocity[0] ** 2 + velocity[1] ** 2
    time = -(at[0] * velocity[0] + at[1] * velocity[1]) / speed2 if speed2 > 0.0 else 0.0
    time = min(max(time, 0.0), MEET_S)
    return math.hypot(at[0] + time * velocity[0], at[1] + time * velocity[1])


def _wall_share(clearance_m: Callable[[float, float], float], state: RobotState, vx: float, vy: float) -> float:
    """The share of a velocity that lets the robot stop before the obstacle that it approaches."""
    speed = math.hypot(vx, vy)
    if speed == 0.0:
        return 1.0
    here_m = clearance_m(state.x, state.y)
    lookahead_m = WALL_M + speed * speed / (2.0 * BRAKING_M_S2)
    there_m = clearance_m(state.x + vx / speed * lookahead_m, state.y + vy / speed * lookahead_m)
    if there_m >= min(here_m, RADIUS_M + WALL_M):
        return 1.0
    return min(1.0, math.sqrt(2.0 * BRAKING_M_S2 * max(here_m - RADIUS_M - WALL_M, 0.0)) / speed)
