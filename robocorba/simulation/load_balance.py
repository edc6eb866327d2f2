"""Assignment of robots to virtual sensor servers: each robot gets the least busy one, by the load that it reports."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

#: Lease of a sensor server [s]: without a report for this long it is dropped.
SENSOR_LEASE_S = 2.0
#: Least assumed load of one robot, as a share of a core; holds before anything was measured.
MIN_COST = 0.001
#: Difference between the busiest and the least busy server above which robots move, as a share of a core.
REBALANCE_ABOVE = 0.2


class Load(NamedTuple):
    """Reported load of a sensor server.

    busy: share of a core. lag_s: largest age of its floor data [s]. scan_rate: scans per second. robots: assigned."""

    busy: float
    lag_s: float
    scan_rate: float
    robots: int


class SensorProcess:
    """A virtual sensor server; `reference` is its object reference."""

    def __init__(self, name: str, reference: Any, load: Load, now: float) -> None:
        self.name, self.reference, self.load, self.reported_at = name, reference, load, now
        #: Reported load, corrected by the assignments since the report.
        self.expected = load.busy
        self.robots: set[str] = set()


class LoadBalance:
    """Thread-safe. `clock` returns the time [s]."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._sensors: dict[str, SensorProcess] = {}
        self._sensor_of: dict[str, SensorProcess] = {}

    @property
    def sensors(self) -> list[SensorProcess]:
        """Live sensor servers, sorted by name."""
        with self._lock:
            self._drop_expired()
            return sorted(self._sensors.values(), key=lambda sensor: sensor.name)

    def name_for(self, robot: str) -> str:
        """Name of a robot's assigned sensor server; empty for none."""
        sensor = self._sensor_of.get(robot)
        return sensor.name if sensor else ""

    def assign(self, robot: str) -> SensorProcess | None:
        """Sensor server of a robot: its current one, else the least busy one; None if there is none."""
        with self._lock:
            self._drop_expired()
            known = self._sensor_of.get(robot)
            if known:
                return known
            least = min(self._sensors.values(), key=lambda sensor: (sensor.expected, sensor.name), default=None)
            if least:
                self._assign_to(robot, least)
            return least

    def release(self, robot: str) -> None:
        """End the assignment of a robot."""
        with self._lock:
            sensor = self._sensor_of.pop(robot, None)
            if sensor:
                sensor.robots.discard(robot)

    def report(self, name: str, reference: Any, load: Load) -> list[tuple[str, Any]]:
        """Renew a server's lease and load; reassign robots if the load is uneven.

        Returns the reassigned robots, each with its previous server's reference."""
        with self._lock:
            sensor = self._sensors.get(name)
            if sensor is None:
                self._sensors[name] = SensorProcess(name, reference, load, self._clock())
            else:
                sensor.reference, sensor.load, sensor.reported_at = reference, load, self._clock()
                sensor.expected = load.busy
            self._drop_expired()
            return self._rebalance()

    def remove(self, name: str) -> None:
        """Drop a server that does not answer; its robots get another one with their next request."""
        with self._lock:
            self._drop(name)

    def _drop_expired(self) -> None:
        before = self._clock() - SENSOR_LEASE_S
        for name in [name for name, sensor in self._sensors.items() if sensor.reported_at < before]:
            self._drop(name)

    def _drop(self, name: str) -> None:
        sensor = self._sensors.pop(name, None)
        for robot in sensor.robots if sensor else ():
            del self._sensor_of[robot]

    def _assign_to(self, robot: str, sensor: SensorProcess) -> None:
        sensor.robots.add(robot)
        sensor.expected += self._cost()
        self._sensor_of[robot] = sensor

    def _cost(self) -> float:
        """Average load of a robot, as a share of a core."""
        busy = sum(sensor.load.busy for sensor in self._sensors.values())
        return max(busy / max(1, len(self._sensor_of)), MIN_COST)

    def _rebalance(self) -> list[tuple[str, Any]]:
        busiest = max(self._sensors.values(), key=lambda sensor: sensor.expected)
        least = min(self._sensors.values(), key=lambda sensor: sensor.expected)
        uneven = busiest.expected - least.expected
        if uneven < REBALANCE_ABOVE or len(busiest.robots) < 2:
            return []
        cost = busiest.expected / len(busiest.robots)
        moving = sorted(busiest.robots)[: min(int(uneven / cost / 2), len(busiest.robots) - 1)]
        for robot in moving:
            busiest.robots.discard(robot)
            busiest.expected -= cost
            self._assign_to(robot, least)
        return [(robot, busiest.reference) for robot in moving]
