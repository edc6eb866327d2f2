"""Assignment of robots to virtual sensor servers: each robot gets the least busy one, by the load that it reports."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

#: Lease of a sensor server [s]: without a report for this long it is dropped.
SENSOR_LEASE_S = 2.0


class Load(NamedTuple):
    """Reported load of a sensor server.

    busy: CPU use, 1.0 for one core. lag_s: largest age of its floor data [s]. scan_rate: scans per second. robots:
    assigned."""

    busy: float
    lag_s: float
    scan_rate: float
    robots: int


class SensorServer:
    """A virtual sensor server; `reference` is its object reference."""

    def __init__(self, name: str, reference: Any, load: Load, now: float) -> None:
        self.name, self.reference, self.load, self.reported_at = name, reference, load, now
        #: Reported load plus the assumed load of the robots assigned since [cores].
        self.expected_load = load.busy
        self.robots: set[str] = set()


class LoadBalance:
    """The assignment of robots to sensor servers. Thread-safe. clock: returns the time [s]."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._servers: dict[str, SensorServer] = {}
        self._server_of: dict[str, SensorServer] = {}

    @property
    def servers(self) -> list[SensorServer]:
        """Live sensor servers, sorted by name."""
        with self._lock:
            self._drop_expired()
            return sorted(self._servers.values(), key=lambda server: server.name)

    def name_for(self, robot: str) -> str:
        """Name of a robot's assigned server, which may have died since; empty for none."""
        server = self._server_of.get(robot)
        return server.name if server else ""

    def assign(self, robot: str) -> SensorServer | None:
        """Server of a robot: its current one, else the least busy one; None if there is none."""
        with self._lock:
            self._drop_expired()
            if robot in self._server_of:
                return self._server_of[robot]
            least_busy = min(self._servers.values(), key=lambda s: (s.expected_load, s.name), default=None)
            if least_busy:
                self._assign_to(robot, least_busy)
            return least_busy

    def release(self, robot: str) -> None:
        """End the assignment of a robot."""
        with self._lock:
            server = self._server_of.pop(robot, None)
            if server:
                server.robots.discard(robot)

    def report(self, name: str, reference: Any, load: Load) -> list[tuple[str, Any]]:
        """Renew a server's lease and load; reassign robots if the load is uneven.

        Returns the reassigned robots, each with its previous server's reference."""
        with self._lock:
            server = self._servers.setdefault(name, SensorServer(name, reference, load, self._clock()))
            server.reference, server.load, server.reported_at = reference, load, self._clock()
            server.expected_load = load.busy
            self._drop_expired()
            return self._rebalance()

    def remove(self, name: str) -> None:
        """Drop a server that does not answer; its robots get another one with their next request."""
        with self._lock:
            self._drop(name)

    def _drop_expired(self) -> None:
        before = self._clock() - SENSOR_LEASE_S
        for name in [name for name, server in self._servers.items() if server.reported_at < before]:
            self._drop(name)

    def _drop(self, name: str) -> None:
        server = self._servers.pop(name, None)
        for robot in server.robots if server else ():
            del self._server_of[robot]

    def _assign_to(self, robot: str, server: SensorServer) -> None:
        """Assign a robot to a server, and expect the average load of a robot there."""
        total_load = sum(server.load.busy for server in self._servers.values())
        server.robots.add(robot)
        # At least 0.001 cores, before anything was measured.
        server.expected_load += max(total_load / max(1, len(self._server_of)), 0.001)
        self._server_of[robot] = server

    def _rebalance(self) -> list[tuple[str, Any]]:
        """Move half of the difference in load from the busiest server to the least busy one, if it is 0.2 cores."""
        busiest = max(self._servers.values(), key=lambda server: server.expected_load)
        least_busy = min(self._servers.values(), key=lambda server: server.expected_load)
        difference = busiest.expected_load - least_busy.expected_load
        if difference < 0.2 or len(busiest.robots) < 2:
            return []
        load_per_robot = busiest.expected_load / len(busiest.robots)
        moving = sorted(busiest.robots)[: min(int(difference / load_per_robot / 2), len(busiest.robots) - 1)]
        for robot in moving:
            busiest.robots.discard(robot)
            busiest.expected_load -= load_per_robot
            self._assign_to(robot, least_busy)
        return [(robot, busiest.reference) for robot in moving]
