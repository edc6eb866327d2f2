"""The emergency stop of one robot, at the robot's end: what holds it, whatever adaptor it has.

Two latches hold a robot, and each is enough: the one here, which works while the simulation server does not answer, and
the server's for the robot's name, which outlives this process. Each side reports its stops to the other. A reset ends
both, and only the stops that it has seen: at the server up to the last number that this process has latched, and here
up to the number that the latch had when the reset began."""

from __future__ import annotations

import contextlib
import logging
import math
import threading

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import IllegalOrder, RobotLost, ServerAway
from robocorba.robot.session import BuildingSession
from robocorba.simulation.emergency_stops import StopHold
from robocorba.system.repeating import Repeating
from robocorba.system.stop_latch import StopLatch

#: Pause before a stop that could not be reported is reported again [s].
RETRY_S = 0.5

_log = logging.getLogger(__name__)


class EmergencyStop:
    """Thread-safe. `stop` takes no lock that is held during a call."""

    def __init__(self, session: BuildingSession) -> None:
        self.latch = StopLatch()
        self._session = session
        #: Held during the calls about stops, so that none overtakes another.
        self._calling = threading.Lock()
        self._changed = threading.Condition()
        #: Number of the server's last stop that is in the latch.
        self._known = 0
        #: The last stop of the latch that the server has to hold, too, and the last one of which it knows.
        self._to_report = self._reported = 0
        #: Why the last report failed.
        self._problem = ""
        self._reporter = Repeating("emergency stop", self._report, lambda: RETRY_S if self._is_pending else math.inf)

    def start(self) -> None:
        self._reporter.start()

    def close(self) -> None:
        self._reporter.close()

    def stop(self, reason: str, number: int = 0) -> None:
        """Hold the robot, and let the server hold it. number: of the server's stop; 0 for one of which it may not
        know. Does not block."""
        if number and number == self._known and self.latch.is_on:
            return
        with self._changed:
            was_pending, self._to_report = self._is_pending, self.latch.stop(reason)
            if number:
                # The server may end its stop before it knows of an earlier one of the robot.
                self._known, self._reported = number, self._reported if was_pending else self._to_report
        self._reporter.wake()

    def wait_until_reported(self, limit_s: float) -> bool:
        """Whether the server holds the robot, too, within `limit_s`."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._is_pending, limit_s)

    def attend(self) -> None:
        """After a log-on: the server may hold the robot's name, or have lost that. Raises RobotLost."""
        with self._calling:
            hold = self._session.hold()
            if hold.is_held:
                self._learn(hold)
            else:
                self._known, self._reported = hold.number, 0
        self._reporter.wake()

    def end(self, seen: int) -> None:
        """End the stops up to number `seen` of the latch, at the server first: only its answer shows that it holds the
        robot no longer. If that is missing, both ends hold. Raises RobotLost; IllegalOrder if there is a later stop."""
        with self._calling:
            self._report_pending()
            if self.latch.number > seen:
                raise IllegalOrder("restart", f"was stopped again: {self.latch.reason_after(seen)}")
            try:
                hold = self._session.end_stops(self._known)
            except RobotLost:  # it may have ended them
                self._reported = 0
                self._reporter.wake()
                raise
            if hold.is_held:
                self._learn(hold)
                raise IllegalOrder("restart", f"is held by the simulation server: {hold.reason}; reset it again")
            self.latch.end(seen)
            with contextlib.suppress(RobotLost):  # then the reporter does
                self._report_pending()  # a stop that came during the call, before this robot is refused its reset

    # ---- implementation ----

    @property
    def _is_pending(self) -> bool:
        """Whether a stop that holds has to be reported."""
        return self._to_report > max(self._reported, self.latch.ended)

    def _report(self) -> None:
        try:
            with self._calling:
                self._report_pending()
            self._problem = ""
        except ServerAway as error:
            self._note(error)
        except RobotLost:
            try:
                self._session.log_on()
                self.attend()
            except RoboCorbaError as error:
                self._note(error)

    def _note(self, error: RoboCorbaError) -> None:
        if str(error) != self._problem:
            self._problem = str(error)
            _log.info("the emergency stop is not reported yet, attempts every %g s: %s", RETRY_S, error)

    def _report_pending(self) -> None:
        """Raises RobotLost. Requires `_calling`."""
        if self._is_pending:
            number = self._to_report
            is_new, hold = self._session.report_stop(self.latch.reason)
            with self._changed:
                self._reported = max(self._reported, number)
                self._changed.notify_all()
            if is_new:
                self._known = hold.number
            else:
                self._learn(hold)

    def _learn(self, hold: StopHold) -> None:
        """Latch a stop of the server that is not in the latch yet."""
        if hold.is_held and (hold.number != self._known or not self.latch.is_on):
            self.stop(hold.reason, hold.number)
