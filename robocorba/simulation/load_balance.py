"""Which virtual sensor process senses for which robot: the least busy one, by what it measured itself."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

#: A process that was not heard of for so long is gone, s.
SENSOR_LEASE_S = 2.0
#: What a robot costs a process at least, where nothing has been measured yet, as a share of a core.
LEAST_COST = 0.001
#: Robots move where one process is busier than another by so much of a core.
REBALANCE_ABOVE = 0.2


class Load(NamedTuple):
    """What a process says: share of a core that it was busy, how old what it knows is at most (s), scans a second, and
    robots."""

    busy: float
    lag_s: float
    scan_rate: float
    robots: int


class SensorProcess:
    """A virtual sensor process; `reference` is whatever calls it."""

    def __init__(self, name: str, reference: Any, load: Load, now: float) -> None:
        self.name, self.reference, self.load, self.reported_at = name, reference, load, now
        #: As busy as it was, and will be by what has changed since.
        self.expected = load.busy
        self.robots: set[str] = set()


class LoadBalance:
    """Safe from any thread. `clock` tells the time in s."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._sensors: dict[str, SensorProcess] = {}
        self._sensor_of: dict[str, SensorProcess] = {}

    @property
    def sensors(self) -> list[SensorProcess]:
        """Those that are there, by name."""
        with self._lock:
            self._drop_expired()
            return sorted(self._sensors.values(), key=lambda sensor: sensor.name)

    def name_for(self, robot: str) -> str:
        """The name of the process that a robot was given; empty for none."""
        sensor = self._sensor_of.get(robot)
        return sensor.name if sensor else ""

    def assign(self, robot: str) -> SensorProcess | None:
        """The process that senses for a robot: the one it has, else the least busy one; None where there is none."""
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
        """The robot is gone."""
        with self._lock:
            sensor = self._sensor_of.pop(robot, None)
            if sensor:
                sensor.robots.discard(robot)

    def report(self, name: str, reference: Any, load: Load) -> list[tuple[str, Any]]:
        """A process says that it is there; robots that it, or another one, is to let go so that they move."""
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
        """A process does not answer; its robots are handed others when they ask."""
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
        """Of a robot, on average."""
        busy = sum(sensor.load.busy for sensor in self._sensors.values())
        return max(busy / max(1, len(self._sensor_of)), LEAST_COST)

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
