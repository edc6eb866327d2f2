"""Complete scans of robots' sensors, for viewers: the last one of each sensor."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import Pose

#: Sensors remembered for each robot; beyond that the one without a scan for the longest time is forgotten.
MAX_SENSORS = 8
#: Interval between reports that sensor processes are asked for: while somebody reads scans, and otherwise [s].
READ_INTERVAL_S, IDLE_INTERVAL_S = 0.05, 0.5
#: Time after the last reading until nobody reads any more [s].
READ_WINDOW_S = 3.0


class RobotScan(NamedTuple):
    """A scan of a sensor on a robot. time: simulated [s]. at: pose of the robot. mount: of the sensor in the robot's
    frame: ahead, left [m], heading [rad]. Ray k begins `rim_m` from the sensor and has the length distances[k] [m],
    at most range_m; hits[k] is whether it hit something. noise: sigma [m], relative, lost and seed. is_virtual: the
    sensor is virtual, not an actual robot's. unmapped: (rays,) whether ray k hit what no map has; empty: unknown."""

    robot: str
    time: float
    at: Pose
    mount: tuple[float, float, float]
    first_rad: float
    step_rad: float
    range_m: float
    rim_m: float
    noise: tuple[float, float, float, int]
    distances: Floats
    hits: NDArray[np.bool_]
    is_virtual: bool = True
    unmapped: NDArray[np.bool_] = np.zeros(0, bool)

    @property
    def sensor(self) -> tuple[object, ...]:
        """What distinguishes the sensors of a robot."""
        return self.mount, self.first_rad, self.step_rad, self.range_m, len(self.distances)


class LastScans:
    """The last scan of each sensor by robot, at most MAX_SENSORS for each. Not thread-safe."""

    def __init__(self) -> None:
        self.by_robot: dict[str, dict[tuple[object, ...], RobotScan]] = {}

    def record(self, scan: RobotScan) -> None:
        """Keep a scan in place of the last one of its sensor."""
        sensors = self.by_robot.setdefault(scan.robot, {})
        sensors.pop(scan.sensor, None)
        sensors[scan.sensor] = scan
        if len(sensors) > MAX_SENSORS:
            del sensors[next(iter(sensors))]

    def all(self) -> list[RobotScan]:
        return [scan for sensors in self.by_robot.values() for scan in sensors.values()]


class LastScan(NamedTuple):
    """Last scan of a robot. time: simulated [s]. at: pose of the sensor. first_rad, step_rad: angle of the first ray
    from the sensor's heading, and between rays, counter-clockwise [rad]. distances: lengths of the rays [m].
    is_virtual, unmapped: as of RobotScan."""

    robot: str
    time: float
    at: Pose
    first_rad: float
    step_rad: float
    distances: Floats
    is_virtual: bool = True
    unmapped: NDArray[np.bool_] = np.zeros(0, bool)


def from_sensor(scan: RobotScan) -> LastScan:
    """A scan as it is seen from its sensor. A ray without an echo between two others counts as the shorter of these."""
    ahead, left, heading = scan.mount
    x, y = out_of(ahead, left, scan.at[1:])
    at = Pose(scan.at.floor, x, y, scan.at.heading + heading)
    lengths, hits = scan.distances + scan.rim_m, scan.hits
    is_lost = ~hits[1:-1] & hits[:-2] & hits[2:]
    lengths[1:-1][is_lost] = np.minimum(lengths[:-2], lengths[2:])[is_lost]
    return LastScan(scan.robot, scan.time, at, scan.first_rad, scan.step_rad, lengths, scan.is_virtual, scan.unmapped)


class RobotScans:
    """Scans that viewers read. Thread-safe. clock: returns the time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._last = LastScans()
        self._read_at = -READ_WINDOW_S

    @property
    def interval_s(self) -> float:
        """The wanted interval between reports [s]."""
        is_read = self._clock() - self._read_at < READ_WINDOW_S
        return READ_INTERVAL_S if is_read else IDLE_INTERVAL_S

    def record(self, scan: RobotScan) -> None:
        """Keep a scan in place of the last one of its sensor."""
        with self._lock:
            self._last.record(scan)

    def forget(self, robot: str) -> None:
        """Forget the scans of a robot that logged off."""
        with self._lock:
            self._last.by_robot.pop(robot, None)

    def keep(self, robots: Collection[str]) -> None:
        """Forget the scans of all other robots."""
        with self._lock:
            for robot in self._last.by_robot.keys() - robots:
                del self._last.by_robot[robot]

    def since(self, floor: str, time_s: float) -> list[RobotScan]:
        """Scans on a floor after a simulated time [s]."""
        self._read_at = self._clock()
        with self._lock:
            return [scan for scan in self._last.all() if scan.at.floor == floor and scan.time > time_s]
