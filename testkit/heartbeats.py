"""Heartbeats of the robots of a test or an attack."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from typing import Any

from omniORB import CORBA

from robocorba.system.repeating import Repeating

#: Interval between heartbeats [s].
HEARTBEAT_INTERVAL_S = 0.4


def heartbeats(sessions: Callable[[], Iterable[Any]]) -> Repeating:
    """Renew the leases of RobotSessions, asked for each time, until it is closed. Errors are ignored: sessions may have
    ended, and tests check them themselves."""

    def renew() -> None:
        for session in list(sessions()):
            with contextlib.suppress(CORBA.Exception):
                session.heartbeat()

    return Repeating("heartbeats", renew, HEARTBEAT_INTERVAL_S).start()
