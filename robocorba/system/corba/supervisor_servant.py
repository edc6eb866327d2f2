"""Servant of the supervisor of `robocorba up`."""

from __future__ import annotations

from typing import Any

from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.stubs import RoboCorba__POA
from robocorba.system.corba import processes as conversion
from robocorba.system.processes import Processes


class SupervisorServant(ServerServant, RoboCorba__POA.Supervisor):
    """RoboCorba::Supervisor."""

    def __init__(self, supervisor: Processes) -> None:
        self._supervisor = supervisor

    @translating
    def processes(self) -> list[Any]:
        return [conversion.process_state(state) for state in self._supervisor.processes()]

    @translating
    def startRobot(self, order: Any) -> None:
        self._supervisor.start_robot(conversion.robot_order_of(order))

    endRobot = forwarded("_supervisor", Processes.end_robot)
    logLines = forwarded("_supervisor", Processes.log_lines)
