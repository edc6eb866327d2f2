"""The way of a body while it is carried: how fast it may go on, and who is asked to step aside."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial

from shapely import Point

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.missions.clearing import Requests
from robocorba.missions.leader_policy import LeaderPolicy
from robocorba.missions.lookout import Lookout, Seen
from robocorba.missions.messages import WayMade
from robocorba.system.background import Background

_log = logging.getLogger(__name__)


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
