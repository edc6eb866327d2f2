"""The way of a body while it is carried: how fast it may go on, and who is asked to step aside."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.missions.clearing import Requests
from robocorba.missions.lookout import STOP_S, Ahead, Lookout
from robocorba.missions.messages import WayMade
from robocorba.system.background import Background

#: Interval between looks [s].
LOOK_INTERVAL_S = 0.1
#: The body stops once what is around it is unknown for this time [s].
UNKNOWN_S = 1.0
#: The body goes on once its way has been free for this time [s].
SETTLE_S = 0.5
#: Share of the planned speed with which it approaches what is in its way.
SLOW_RATE = 0.5

_log = logging.getLogger(__name__)


class WayAhead:
    """Watches the way by `lookout`. ask: returns the requests to a robot in the way, None if it can't be asked; may
    block, and is called by a thread of its own. Its other methods are called by the leader's thread."""

    def __init__(self, lookout: Lookout, ask: Callable[[str], Requests | None]) -> None:
        self._lookout, self._ask = lookout, ask
        #: What the body waits for, without a name if that is unknown; None while it goes on.
        self.blocker: Ahead | None = None
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
        if now - self._looked_at >= LOOK_INTERVAL_S:
            self._looked_at = now
            try:
                ahead = self._lookout.ahead(trajectory_s)
            except NotReachable as unknown:
                if now - self._known_at < UNKNOWN_S:
                    return self._rate
                if self.blocker is None or self.blocker.name:
                    _log.info("the carry waits: %s", unknown)
                ahead = Ahead("", False, 0.0, 0.0, 0.0)
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

    def _rate_for(self, ahead: Ahead | None, now: float) -> float:
        if ahead is None or ahead.after_s > STOP_S:
            if self.blocker and now - self._blocked_at < SETTLE_S:
                return 0.0
            self.blocker = self._requests = None
            return SLOW_RATE if ahead else 1.0
        self._blocked_at = now
        if self.blocker is None or self.blocker.name != ahead.name:
            self._since = self._since if self.blocker else now
            self.blocker, self._requests = ahead, None
            if ahead.is_robot:
                # Without an answer it is not asked to step aside, and the carry waits for its limit.
                Background("aside", partial(self._find_requests, ahead.name), lambda reason: None).start()
        return 0.0

    def _find_requests(self, robot: str) -> None:
        try:
            requests = self._ask(robot)
        except RoboCorbaError as error:
            _log.info("%s is not asked to step aside: %s", robot, error)
            return
        if self.blocker and self.blocker.name == robot:
            self._requests = requests
