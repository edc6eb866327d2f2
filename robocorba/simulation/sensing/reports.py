"""Reports of a virtual sensor server: its load, and the scans of its robots, the last one of each."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.load_balance import Load
from robocorba.simulation.robot_scans import LastScan, LastScans, RobotScan
from robocorba.simulation.sensing.scan import Mount, ScanResult, ScanSpec, robot_scan
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor


class Reports:
    """Collects the load and the last scans. Thread-safe.

    clock: returns the time [s]. cpu: returns the CPU time of this process [s]."""

    def __init__(
        self,
        sensor: VirtualSensor,
        clock: Callable[[], float] = time.monotonic,
        cpu: Callable[[], float] = time.process_time,
    ) -> None:
        self._sensor, self._clock, self._cpu = sensor, clock, cpu
        self._lock = threading.Lock()
        self._scans = 0
        self._last: dict[str, tuple[str, ScanSpec, ScanResult]] = {}
        self._robot_scans = LastScans()
        self._measured_at, self._cpu_at_measurement = clock(), cpu()
        self._cpu_use = self._scan_rate = 0.0
        #: Robots assigned to this server.
        self.robots = 0

    def record_scan(self, robot: str | None, at: Pose, mount: Mount, spec: ScanSpec, result: ScanResult) -> None:
        """Count a scan, and keep it as the last one of `robot`, which is at a pose, unless that is None."""
        scan = robot_scan(robot, at, mount, spec, result) if robot is not None else None
        with self._lock:
            self._scans += 1
            if scan:
                self._last[scan.robot] = (at.floor, spec, result)
                self._robot_scans.record(scan)

    @property
    def load(self) -> Load:
        """Load between the last two calls of `collect`."""
        with self._lock:
            return Load(self._cpu_use, min(self._sensor.lag_s, 1e9), self._scan_rate, self.robots)

    def collect(self) -> list[LastScan]:
        """Measure the load since the last call; return the last scan of each robot that scanned since."""
        with self._lock:
            now, cpu = self._clock(), self._cpu()
            passed = max(now - self._measured_at, 1e-6)
            self._cpu_use, self._scan_rate = (cpu - self._cpu_at_measurement) / passed, self._scans / passed
            self._measured_at, self._cpu_at_measurement, self._scans = now, cpu, 0
            last, self._last = self._last, {}
        return [_last_scan(robot, *scan) for robot, scan in last.items()]

    def collect_robot_scans(self) -> list[RobotScan]:
        """The last scan of each sensor on a robot since the last call."""
        with self._lock:
            last, self._robot_scans = self._robot_scans, LastScans()
        return last.all()


def _last_scan(robot: str, floor: str, spec: ScanSpec, result: ScanResult) -> LastScan:
    x, y, heading = result.sensors[0].tolist()
    pose, fan = Pose(floor, x, y, heading), spec.fan
    return LastScan(robot, result.time, pose, fan.first_rad, fan.step_rad, result.distances[0] + spec.rim_m)
