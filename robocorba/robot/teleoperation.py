"""Teleoperation: the base drives at velocities that a person or another program orders again and again."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.simulation import InvalidChoice
from robocorba.robot.agent_state import TELEOPERATION, IconBegun, ProgramReport, ProgramResult
from robocorba.robot.execution_control import Aborted
from robocorba.robot.motion.driving import is_stationary
from robocorba.robot.motion.motion import MotionCommand
from robocorba.robot.motion.robot_state import ZERO_VELOCITY, RobotState, Velocity
from robocorba.robot.robot import Robot

#: Maximum validity of an order [s].
MAX_VALID_S = 5.0
#: Time after the last order for which the robot remains teleoperated [s]: short pauses between orders don't end it.
LINGER_S = 1.0


class Teleoperation:
    """A task of a control agent, and its motion: the base drives at the last ordered velocity while that is valid, and
    stops otherwise. It ends LINGER_S after the last order, once the base is stationary. Thread-safe. clock: [s]."""

    def __init__(self, robot: Robot, clock: Callable[[], float] = time.monotonic) -> None:
        self._robot, self._clock, self._began_at = robot, clock, clock()
        self._lock = threading.Lock()
        self._velocity, self._valid_until_s = ZERO_VELOCITY, clock()
        self._is_ended = False
        self._last_report = ProgramReport(TELEOPERATION)

    def order(self, velocity: Velocity, valid_for_s: float) -> bool:
        """Order a velocity of the base, ahead and to the left [m/s], turn [rad/s]; returns False if the task has
        ended."""
        with self._lock:
            if not self._is_ended:
                self._velocity, self._valid_until_s = velocity, self._clock() + valid_for_s
            return not self._is_ended

    def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
        with self._lock:
            overdue_s = self._clock() - self._valid_until_s
            if overdue_s < 0.0:
                return MotionCommand(self._velocity)
            if overdue_s >= LINGER_S and is_stationary(state):
                self._is_ended = True
                return None
        return MotionCommand(ZERO_VELOCITY)

    @property
    def report(self) -> ProgramReport:
        report = self._last_report
        return report if report.result is not ProgramResult.NO_RESULT else report._replace(seconds=self._seconds())

    def begun(self, first: int) -> list[IconBegun]:
        """It has no icons."""
        return []

    def run(self) -> ProgramReport:
        """Drive until no more orders come. Errors are in the returned report."""
        try:
            self._robot.drive_as_ordered(self)
            self._end(ProgramResult.DONE)
        except Aborted as error:
            self._end(ProgramResult.ABORTED, str(error))
        except RoboCorbaError as error:
            self._end(ProgramResult.FAILED, str(error))
        except Exception as error:
            self._end(ProgramResult.FAILED, f"{type(error).__name__}: {error}")
            raise
        return self.report

    def _end(self, result: ProgramResult, reason: str = "") -> None:
        with self._lock:
            self._is_ended = True
        self._last_report = ProgramReport(TELEOPERATION, result, reason=reason, seconds=self._seconds())

    def _seconds(self) -> float:
        return self._clock() - self._began_at


def check_order(velocity: Velocity, valid_for_s: float) -> None:
    """Raises InvalidChoice if an order is not possible."""
    for field, value in zip(("wanted.ahead", "wanted.left", "wanted.turn"), velocity, strict=True):
        if not abs(value) <= 1e6:  # less is reduced to the robot's limits
            raise InvalidChoice(field, f"{value:g} is no velocity")
    if not 0.0 < valid_for_s <= MAX_VALID_S:
        raise InvalidChoice("validFor", f"{valid_for_s} is not above 0 and at most {MAX_VALID_S:g} s")
