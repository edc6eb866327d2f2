"""What a virtual sensor process says of itself: how busy it is, and what its robots saw last."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.sensing.virtual_sensor import ScanResult, ScanSpec, VirtualSensor
from robocorba.simulation.load_balance import Load
from robocorba.simulation.omni_database import LastScan
from robocorba.spatial.floor_state import Pose


class Reports:
    """Safe from any thread. clock: time, s; cpu: time that this process has worked, s."""

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
        self._marked_at, self._cpu_at_mark = clock(), cpu()
        self._busy = self._scan_rate = 0.0
        #: Robots that were given to this process.
        self.robots = 0

    def record_scan(self, robot: str | None, floor: str, spec: ScanSpec, seen: ScanResult) -> None:
        """A scan of one sensor was made, for a robot where it is not None."""
        with self._lock:
            self._scans += 1
            if robot is not None:
                self._last[robot] = (floor, spec, seen)

    @property
    def load(self) -> Load:
        """Measured between the last two calls of `mark`."""
        with self._lock:
            return Load(self._busy, min(self._sensor.lag_s, 1e9), self._scan_rate, self.robots)

    def collect(self) -> list[LastScan]:
        """Measure the load anew; what was seen since."""
        with self._lock:
            now, cpu = self._clock(), self._cpu()
            passed = max(now - self._marked_at, 1e-6)
            self._busy, self._scan_rate = (cpu - self._cpu_at_mark) / passed, self._scans / passed
            self._marked_at, self._cpu_at_mark, self._scans = now, cpu, 0
            last, self._last = self._last, {}
        return [_last_scan(robot, *saw) for robot, saw in last.items()]


def _last_scan(robot: str, floor: str, spec: ScanSpec, seen: ScanResult) -> LastScan:
    x, y, heading = seen.sensors[0].tolist()
    place, fan = Pose(floor, x, y, heading), spec.fan
    return LastScan(robot, seen.time, place, fan.first_rad, fan.step_rad, seen.distances[0] + spec.rim_m)
