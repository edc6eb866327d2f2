"""The session of a robot without a simulation server: it is where its adaptor says, and its emergency stops are kept in
a file."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any, NoReturn

from robocorba.errors.robots import RobotLost
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.session import SessionState
from robocorba.simulation.emergency_stops import NOT_HELD, StopHold
from robocorba.simulation.registry import Pose
from robocorba.simulation.reservations import Reservation
from robocorba.simulation.sensing.scan import Mount, ScanSpec
from robocorba.system.record_file import RecordFile


def kept_pose(records: RecordFile) -> Pose | None:
    """Where the robot was last, by its file; None for a new one."""
    return next(iter(records.all("pose", Pose)), None)


class LocalSession:
    """A BuildingSession on one floor. start: the robot's pose that is in the file. robot: returns its state."""

    def __init__(self, records: RecordFile, start: Pose, robot: Callable[[], RobotState]) -> None:
        self._records, self._kept, self._robot = records, start, robot
        self._lock = threading.Lock()
        self._hold = next(iter(records.all("stop", StopHold)), NOT_HELD)

    @property
    def latest(self) -> SessionState:
        robot = self._robot()
        at = Pose(self._kept.floor, robot.x, robot.y, robot.heading)
        return SessionState(robot.time, at, robot.velocity, "", None, 0, "")

    def keep_pose(self) -> None:
        """Write the robot's pose if it has moved by a centimetre or 0.01 rad. Raises ServiceError."""
        at = self.latest.at
        moved_m = math.dist(at[1:3], self._kept[1:3])
        if moved_m > 0.01 or abs(at.heading - self._kept.heading) > 0.01:
            self._records.save("pose", "", at)
            self._kept = at

    def state(self) -> SessionState:
        return self.latest

    # ---- what only servers need ----

    def _nothing(self, *arguments: Any) -> None: ...

    log_on = log_off = heartbeat = command = brake = release = cancel_elevator = release_areas = _nothing

    def announce_body(self, is_robot: bool) -> None:
        if is_robot:
            _refuse("a virtual robot")

    # ---- emergency stops ----

    def hold(self) -> StopHold:
        return self._hold

    def report_stop(self, reason: str) -> tuple[bool, StopHold]:
        with self._lock:
            is_new = not self._hold.is_held
            if is_new:
                self._change(StopHold(True, self._hold.number + 1, reason))
            return is_new, self._hold

    def end_stops(self, number: int) -> StopHold:
        with self._lock:
            if self._hold.is_held and number >= self._hold.number:
                self._change(StopHold(False, self._hold.number, ""))
            return self._hold

    def _change(self, hold: StopHold) -> None:
        self._records.save("stop", "", hold)
        self._hold = hold

    # ---- what only the simulation server has ----

    def scan(self, at: Pose, mount: Mount, spec: ScanSpec) -> Floats:
        _refuse("a virtual sensor")

    def grip(self, what: str, x: float, y: float) -> None:
        _refuse(f"to grip {what}")

    def call_elevator(
        self, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        _refuse(f"a ride in {elevator}")

    def longest_elevator_wait_s(self) -> float:
        _refuse("an elevator ride")

    def _no_reservation(self, *arguments: Any) -> NoReturn:
        _refuse("a reservation")

    reserve = reserve_one_of = exchange_areas = take_over_areas = keep_areas = _no_reservation

    def reservation(self) -> Reservation | None:
        return None


def _refuse(what: str) -> NoReturn:
    raise RobotLost(f"{what} needs the simulation server, and this agent runs without it")
