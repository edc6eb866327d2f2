"""The way of a body while it is carried: what comes into it, by the data pool of the leader, how fast the body may go
on, and who is asked to step aside."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import NamedTuple

import shapely
import shapely.affinity
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.missions.clearing import Requests
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.messages import WayMade
from robocorba.missions.obstacles import placed
from robocorba.missions.trajectory import Trajectory
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


class Seen(NamedTuple):
    """A robot or an object: where it stands [m], and its velocity along the floor's axes [m/s]. number: its identity
    while edits of the map change names; 0 if it has none."""

    name: str
    is_robot: bool
    shape: BaseGeometry
    vx: float
    vy: float
    number: int = 0

    def swept(self, seconds: float) -> BaseGeometry:
        """What it covers within this time if it moves on as now."""
        if self.vx == self.vy == 0.0:
            return self.shape
        there = shapely.affinity.translate(self.shape, self.vx * seconds, self.vy * seconds)
        return shapely.union_all([self.shape, there]).convex_hull


#: Returns the robots and movable objects on the floor. Raises NotReachable while they are unknown.
Look = Callable[[], Sequence[Seen]]


class Lookout:
    """Watches the way of a body along its trajectory. footprint: of the body, its carriers included, in its frame [m].
    team: names of the robots and of the object that move with it."""

    def __init__(
        self, trajectory: Trajectory, footprint: BaseGeometry, team: Collection[str], look: Look, policy: LeaderPolicy
    ) -> None:
        self._trajectory, self._footprint, self._team = trajectory, footprint, team
        self._look, self._policy = look, policy
        #: Numbers of those of the team that have been seen, by name.
        self._numbers: dict[str, int] = {}
        self._reach_m = max(math.hypot(x, y) for x, y in shapely.get_coordinates(footprint).tolist())

    def ahead(self, trajectory_s: float) -> tuple[Seen, float] | None:
        """The first thing in the way after this time of the trajectory, and the time until the body is there [s]; None
        if the way is free, as far as it is watched. Raises NotReachable."""
        others, policy = self._others(), self._policy
        if not others:
            return None
        end_s = min(trajectory_s + policy.look_ahead_s, self._trajectory.duration)
        count = max(1, math.ceil((end_s - trajectory_s) / policy.look_step_s))
        for number in range(count + 1):
            after_s = number / count * max(0.0, end_s - trajectory_s)
            pose = self._trajectory.at(trajectory_s + after_s)[0]
            near = [seen for seen in others if seen.shape.distance(Point(pose[:2])) < self._reach_m + 2.0]
            body = placed(self._footprint, pose) if near else Polygon()
            for seen in near:
                if seen.swept(policy.predicted_s).distance(body) < policy.way_gap_m:
                    return seen, after_s
        return None

    def _others(self) -> list[Seen]:
        """What is not of the team, also under other names than at first. Raises NotReachable."""
        found = self._look()
        self._numbers.update((seen.name, seen.number) for seen in found if seen.name in self._team and seen.number)
        named = {seen.name for seen in found}
        renamed = {number for name, number in self._numbers.items() if name not in named}
        return [seen for seen in found if seen.name not in self._team and seen.number not in renamed]


class WayAhead:
    """Watches the way by `lookout`. ask: returns the requests to a robot in the way; may block, and is called by a
    thread of its own. Its other methods are called by the leader's thread."""

    def __init__(self, lookout: Lookout, ask: Callable[[str], Requests], policy: LeaderPolicy) -> None:
        self._lookout, self._ask, self._policy = lookout, ask, policy
        #: What the body waits for, without a name if that is unknown; None while it goes on.
        self.blocker: Seen | None = None
        self._since = self._blocked_at = self._known_at = time.monotonic()
        self._looked_at, self._rate = 0.0, 1.0
        self._requests: Requests | None = None

    @property
    def waited_s(self) -> float:
        """How long the body has waited for the blocker [s]."""
        return time.monotonic() - self._since if self.blocker else 0.0

    @property
    def reason(self) -> str:
        """Why the body waits; empty while it goes on."""
        if self.blocker is None:
            return ""
        return f"{self.blocker.name} is in the way" if self.blocker.name else "what is in the way is unknown"

    @property
    def staying(self) -> str:
        """Why the blocker, a robot, stays; empty if that is unknown."""
        return self._requests.staying.get(self.blocker.name, "") if self._requests and self.blocker else ""

    def rate(self, trajectory_s: float) -> float:
        """The rate at which the body may go on from here, 0 to 1."""
        now = time.monotonic()
        if now - self._looked_at >= self._policy.look_interval_s:
            self._looked_at = now
            try:
                ahead = self._lookout.ahead(trajectory_s)
            except NotReachable as unknown:
                if now - self._known_at < self._policy.unknown_timeout_s:
                    return self._rate
                if self.blocker is None or self.blocker.name:
                    _log.info("the carry waits: %s", unknown)
                ahead = Seen("", False, Point(), 0.0, 0.0), 0.0
            else:
                self._known_at = now
            self._rate = self._rate_for(ahead, now)
        if self._requests:
            self._requests.update()
        return self._rate

    def receive(self, answer: WayMade) -> None:
        """Take a robot's answer into account."""
        if self._requests:
            self._requests.receive(answer)

    def _rate_for(self, ahead: tuple[Seen, float] | None, now: float) -> float:
        if ahead is None or ahead[1] > self._policy.stop_ahead_s:
            if self.blocker and now - self._blocked_at < self._policy.settle_s:
                return 0.0
            self.blocker = self._requests = None
            return self._policy.approach_rate if ahead else 1.0
        self._blocked_at, seen = now, ahead[0]
        if self.blocker is None or self.blocker.name != seen.name:
            self._since = self._since if self.blocker else now
            self.blocker, self._requests = seen, None
            if seen.is_robot:
                # Without an answer it is not asked to step aside, and the carry waits for its limit.
                Background("aside", partial(self._find_requests, seen.name), lambda reason: None).start()
        return 0.0

    def _find_requests(self, robot: str) -> None:
        try:
            requests = self._ask(robot)
        except RoboCorbaError as error:
            _log.info("%s is not asked to step aside: %s", robot, error)
            return
        if self.blocker and self.blocker.name == robot:
            self._requests = requests
