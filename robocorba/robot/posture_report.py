"""Reports of a robot's joint angles for viewers, when they have changed."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

import numpy as np

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.arrays import Floats

_log = logging.getLogger(__name__)

#: Interval of the calls [s].
INTERVAL_S = 0.1
#: Smallest change of an angle that is reported [rad]: encoders are noisy.
MIN_CHANGE_RAD = 0.001
#: Interval at which unchanged angles are reported [s]: the server keeps them in memory only, and may have restarted.
REFRESH_S = 2.0


class PostureReport:
    """Joint angles (n,) [rad] from `read` to `report`; both may raise RoboCorbaError. clock: returns the time [s].

    Call `update` every INTERVAL_S in a thread of its own: a server that hangs must not stop the robot."""

    def __init__(
        self, read: Callable[[], Floats], report: Callable[[Floats], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._read, self._report, self._clock = read, report, clock
        self._reported: Floats = np.zeros(0)
        self._reported_at = -np.inf

    def update(self) -> None:
        """Report the present angles if they are news. A failed report is repeated in the next call."""
        try:
            joints, now = self._read(), self._clock()
            if self._is_news(joints, now):
                self._reported_at = -np.inf
                self._report(joints)
                self._reported, self._reported_at = joints.copy(), now
        except RoboCorbaError as error:
            _log.debug("the posture was not reported: %s", error)

    def _is_news(self, joints: Floats, now: float) -> bool:
        if not len(joints) or not np.isfinite(joints).all():
            return False
        if now - self._reported_at >= REFRESH_S or len(joints) != len(self._reported):
            return True
        return bool(np.abs(joints - self._reported).max() >= MIN_CHANGE_RAD)
