"""Client of the supervisor of `robocorba up`."""

from __future__ import annotations

from pathlib import Path

from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import FileObject
from robocorba.stubs import RoboCorba
from robocorba.system.corba import processes as conversion
from robocorba.system.processes import ProcessState, RobotOrder


class RemoteSupervisor:
    """robocorba.system.processes.Processes of the system whose supervisor's reference is in `file`. Thread-safe. All
    methods raise NotReachable; the file is read by the first call."""

    def __init__(self, orb: Orb, file: Path) -> None:
        # An order to start a robot asks other servers first, so that a call may take 8 s.
        self._supervisor = FileObject(orb, file, RoboCorba.Supervisor, "the supervisor", 8.0)

    def processes(self) -> list[ProcessState]:
        structs = self._supervisor.call(lambda supervisor: supervisor.processes())
        return [conversion.process_state_of(struct) for struct in structs]

    def start_robot(self, order: RobotOrder) -> None:
        """Raises InvalidChoice, ProcessExists."""
        struct = conversion.robot_order(order)
        self._supervisor.call(lambda supervisor: supervisor.startRobot(struct))

    def end_robot(self, name: str) -> None:
        """Raises UnknownProcess."""
        self._supervisor.call(lambda supervisor: supervisor.endRobot(name))

    def log_lines(self, name: str, lines: int) -> list[str]:
        """Raises UnknownProcess."""
        return list(self._supervisor.call(lambda supervisor: supervisor.logLines(name, lines)))
