"""The body in the simulated building of an actual robot that does without the simulation server: while that answers,
others see the robot, and its stops reach the robot. The robot waits for none of it."""

from __future__ import annotations

import logging
import math

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import RobotHeld, RobotLost
from robocorba.robot.agent import BODY_LOST_M, ControlAgent, follow_velocity
from robocorba.robot.session import BuildingSession
from robocorba.simulation.registry import Pose

#: Interval between commands to the body, and between attempts to log on [s].
FOLLOW_S, RETRY_S = 0.1, 2.0

_log = logging.getLogger(__name__)


class BodyInBuilding:
    """One thread calls `follow`, any thread `stop`. session: at the simulation server."""

    def __init__(self, session: BuildingSession, agent: ControlAgent) -> None:
        self._session, self._agent = session, agent
        self._is_there, self._problem = False, ""
        #: Number of the server's last stop that has stopped the robot, until neither holds it any more.
        self._known = 0

    @property
    def pause_s(self) -> float:
        """Time until the next call of `follow` [s]."""
        return FOLLOW_S if self._is_there else RETRY_S

    def stop(self, reason: str, number: int = 0) -> None:
        """Stop the robot. number: of the server's stop, 0 for another one."""
        self._agent.stop(reason)
        self._known = number or self._known

    def follow(self) -> None:
        """Make the body follow the robot, and each side's stops hold the other, too."""
        try:
            self._follow()
            self._problem = ""
        except RobotHeld:  # its body stands; so does the robot
            pass
        except RoboCorbaError as error:
            self._is_there = False
            if str(error) != self._problem:
                self._problem = str(error)
                _log.info("others do not see the robot at present: %s", error)

    def leave(self) -> None:
        """Log off."""
        self._session.log_off()

    def _follow(self) -> None:
        robot = self._agent.actor
        if robot is None:
            return
        at = Pose(self._agent.session.latest.at.floor, robot.x, robot.y, robot.heading)
        if not self._is_there:
            self._session.log_on(at)
            self._session.announce_body(False)
            self._is_there = True
        self._share_stops()
        body = self._session.state().at
        if body.floor != at.floor or math.dist(body[1:3], at[1:3]) > BODY_LOST_M:
            self._session.log_off()
            self._is_there = False
            raise RobotLost("its body did not follow it")
        self._session.command(follow_velocity(robot, body), 3 * FOLLOW_S)

    def _share_stops(self) -> None:
        known, hold, reason = self._known, self._session.hold(), self._agent.held
        if self._known != known:  # a stop came at the same time
            return
        is_known = hold.number == known or not hold.is_held
        if not hold.is_held and reason:
            is_known, hold = self._session.report_stop(reason)
        elif is_known and hold.is_held and not reason:  # the robot was reset
            self._session.end_stops(known)
        if not is_known:  # a smaller number is that of another server
            self.stop(hold.reason, hold.number)
        elif self._known == known:
            self._known = hold.number if reason else 0
