"""The virtual sensor processes, as the simulation server calls them."""

from __future__ import annotations

import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from omniORB import CORBA

from robocorba.corba.calls import describe, limit_calls
from robocorba.simulation.load_balance import LoadBalance

#: How long a robot waits for a sensor process where there is none, s, and how many wait at most: the threads that
#: they hold are those of all calls.
FIND_LIMIT_S, MOST_WAITING = 5.0, 4
CALL_LIMIT_S = 1.0
PAUSE_S = 0.05
_log = logging.getLogger(__name__)


class RemoteSensors:
    """Finds the one that senses for a robot, and tells one that a robot has moved on."""

    def __init__(self, balance: LoadBalance) -> None:
        self._balance = balance
        self._waiting = threading.Semaphore(MOST_WAITING)
        self._dismissals = ThreadPoolExecutor(1, "sensor-dismissals")

    def find(self, robot: str) -> Any:
        """The reference of a robot's sensor, in a process that answers. Raises CORBA.TRANSIENT where there is none."""
        reference = self._assign(robot)
        if reference is None and self._waiting.acquire(blocking=False):
            try:
                deadline = time.monotonic() + FIND_LIMIT_S
                while reference is None and time.monotonic() < deadline:
                    time.sleep(PAUSE_S)
                    reference = self._assign(robot)
            finally:
                self._waiting.release()
        if reference is None:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        return reference

    def _assign(self, robot: str) -> Any:
        """The same, None where no process answers now."""
        while sensor := self._balance.assign(robot):
            try:
                limit_calls(sensor.reference, CALL_LIMIT_S)
                return sensor.reference.forRobot(robot)
            except CORBA.SystemException as wrong:
                _log.warning("virtual sensor %s does not answer (%s)", sensor.name, describe(wrong))
                self._balance.remove(sensor.name)
        return None

    def dismiss(self, reference: Any, robot: str) -> None:
        """Let a process forget a robot that was given to another; does not wait for it."""
        self._dismissals.submit(self._send_dismissal, reference, robot)

    def close(self) -> None:
        self._dismissals.shutdown(cancel_futures=True)

    @staticmethod
    def _send_dismissal(reference: Any, robot: str) -> None:
        try:
            limit_calls(reference, CALL_LIMIT_S)
            reference.dismiss(robot)
        except CORBA.SystemException as wrong:
            _log.warning("a virtual sensor was not told that %s moves on (%s)", robot, describe(wrong))
