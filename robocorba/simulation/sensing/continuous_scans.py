"""Continuous laser scans of robots, as ROS expects them: our robots scan only when a program asks for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping, Sequence

from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.system_view import RobotPlace
from robocorba.system.repeating import Repeating

#: Time after a scan of the robot's own for which no others are made [s, simulated].
OWN_SCAN_S = 1.0


class ContinuousScans:
    """Scans in a thread of its own, `rate_hz` times a second, until `close`. scans_of: scans for each of these robots
    from its pose at a simulated time [s]. places: of the robots, and their simulated time [s]. actual: names of robots
    that have sensors of their own."""

    def __init__(
        self,
        scans_of: Callable[[Sequence[tuple[str, Pose]], float], list[RobotScan]],
        places: Callable[[], tuple[float, Mapping[str, RobotPlace]]],
        rate_hz: float,
        actual: Callable[[], Collection[str]] = tuple,
    ) -> None:
        self._scans_of, self._places, self._actual = scans_of, places, actual
        self._lock = threading.Lock()
        self._own_scan_at_s: dict[str, float] = {}
        self._last_s = -1.0
        self._taken: list[RobotScan] = []
        #: Why there are no scans; empty if there are.
        self.problem = ""
        self._thread = Repeating("scans", self._scan, 1.0 / rate_hz).start()

    def close(self) -> None:
        self._thread.close()

    def note(self, scans: Collection[RobotScan]) -> None:
        """Robots have scanned themselves."""
        with self._lock:
            self._own_scan_at_s.update((scan.robot, scan.time) for scan in scans)

    def take(self) -> list[RobotScan]:
        """The scans since the last call, of each robot the last one."""
        with self._lock:
            taken, self._taken = self._taken, []
            return taken

    def _scan(self) -> None:
        time_s, places = self._places()
        actual = self._actual()
        with self._lock:
            self._own_scan_at_s = {
                name: at_s
                for name, at_s in self._own_scan_at_s.items()
                if name in places and 0.0 <= time_s - at_s < OWN_SCAN_S
            }
            robots = [
                (name, Pose(place.floor, place.x, place.y, place.heading))
                for name, place in places.items()
                if name not in self._own_scan_at_s and name not in actual
            ]
        if not robots or time_s == self._last_s:
            return
        try:
            scans = [
                scan._replace(time=places[scan.robot].time_s) for scan in self._scans_of(robots, time_s)
            ]  # each is from where its robot was at the time of its floor
            with self._lock:
                self._taken, self._last_s, self.problem = scans, time_s, ""
        except RoboCorbaError as error:
            self.problem = str(error)
