"""Client of the virtual sensor servers, for the simulation server."""

from __future__ import annotations

import logging
import threading
from typing import Any

from omniORB import CORBA

from robocorba.orb.calls import describe, set_call_timeout
from robocorba.simulation.load_balance import LoadBalance
from robocorba.system.background import Workers
from robocorba.system.backoff import Backoff

#: Maximum number of calls that wait at the same time; each looks for a server 20 times a second.
MAX_WAITING = 4
#: Timeout of a call to a sensor server [s].
CALL_TIMEOUT_S = 1.0
_log = logging.getLogger(__name__)


class RemoteSensors:
    """Finds the assigned sensor server of a robot, and dismisses robots that were reassigned."""

    def __init__(self, balance: LoadBalance) -> None:
        self._balance = balance
        self._waiting = threading.Semaphore(MAX_WAITING)
        # A server that was not notified keeps an object for a robot that nobody calls.
        self._dismissals = Workers("sensor-dismissals", 1, lambda reason: None)

    def find(self, robot: str) -> Any:
        """Reference of a robot's sensor in a server that answers. Raises CORBA.TRANSIENT if there is none."""
        reference = self._assign(robot)
        if reference is None and self._waiting.acquire(blocking=False):
            try:
                # An attempt every 0.05 s, for at most 5 s.
                reference = Backoff(0.05, 0.05).poll(lambda: self._assign(robot), 5.0)
            finally:
                self._waiting.release()
        if reference is None:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        return reference

    def _assign(self, robot: str) -> Any:
        """Reference of a robot's sensor; None if no server answers now."""
        while server := self._balance.assign(robot):
            try:
                set_call_timeout(server.reference, CALL_TIMEOUT_S)
                return server.reference.forRobot(robot)
            except CORBA.SystemException as error:
                _log.warning(
                    "virtual sensor server %s does not answer (%s); reassigning its robots",
                    server.name,
                    describe(error),
                )
                self._balance.remove(server.name)
        return None

    def dismiss(self, reference: Any, robot: str) -> None:
        """Dismiss a robot at its previous server, without waiting."""
        self._dismissals.submit(self._send_dismissal, reference, robot)

    def close(self) -> None:
        self._dismissals.close()

    @staticmethod
    def _send_dismissal(reference: Any, robot: str) -> None:
        try:
            set_call_timeout(reference, CALL_TIMEOUT_S)
            reference.dismiss(robot)
        except CORBA.SystemException as error:
            _log.warning("could not dismiss %s at its previous virtual sensor (%s)", robot, describe(error))
