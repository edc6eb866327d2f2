"""The communication management agent: which robots are logged on, for how long, and who senses for them.

Nobody is asked whether it lives: a lease runs out unless a call of its robot renews it.
"""

from __future__ import annotations

import math
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from robocorba.errors import InvalidDescription, NameTaken, ServerFull, SessionExpired, UnknownRobot
from robocorba.simulation.physics import Limits

#: A robot that was not heard of for so long is logged off, s.
LEASE_S = 2.0
MAX_NAME = 60
#: What a robot costs a sensor process at least, where none has been measured yet.
LEAST_COST = 0.001


class Pose(NamedTuple):
    """Where a robot stands: x, y in m, heading in rad."""

    floor: str
    x: float
    y: float
    heading: float = 0.0


@dataclass(frozen=True)
class Description:
    """What a robot says of itself when it logs on. Raises InvalidDescription."""

    name: str
    pose: Pose
    radius_m: float = 0.4
    mass_kg: float = 127.0
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        if not re.fullmatch(rf"[A-Za-z0-9_][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}", self.name):
            raise InvalidDescription("name", f"{self.name[:80]!r} is not 1 to {MAX_NAME} letters, digits or . _ -")
        for what, value, most in (
            ("x", self.pose.x, 1e6),
            ("y", self.pose.y, 1e6),
            ("heading", self.pose.heading, 1e3),
        ):
            if not abs(value) <= most:  # also refuses NaN
                raise InvalidDescription(what, f"{value} is not a number between -{most:g} and {most:g}")
        for what, value, least, most in (
            ("radius", self.radius_m, 0.05, 5.0),
            ("mass", self.mass_kg, 0.1, 10_000.0),
            ("speed", self.limits.speed, 0.0, 10.0),
            ("turn", self.limits.turn, 0.0, 4 * math.pi),
            ("acceleration", self.limits.acceleration, 1e-3, 50.0),
            ("turn acceleration", self.limits.turn_acceleration, 1e-3, 50.0),
        ):
            if not least <= value <= most:
                raise InvalidDescription(what, f"{value} is not {least:g} to {most:g}")


class Client:
    """A robot that is logged on. `key` is its secret: whoever knows it may act as this robot."""

    def __init__(self, description: Description, key: str, now: float) -> None:
        self.description, self.key = description, key
        self.since = self.heard_at = now
        self.calls = 0
        self.sensor = ""

    @property
    def name(self) -> str:
        return self.description.name


@dataclass
class _Sensor:
    """How busy a sensor process said it is, 0 to 1, and robots that it was given since."""

    busy: float
    given: int = 0


class Registry:
    """At most `limit` clients; `clock` tells the time in s."""

    def __init__(self, limit: int, clock: Callable[[], float], lease_s: float = LEASE_S) -> None:
        self._clock, self.lease_s = clock, lease_s
        self._by_key: dict[str, Client] = {}
        self._by_name: dict[str, Client] = {}
        self.limit = limit
        self._sensors: dict[str, _Sensor] = {}

    def __len__(self) -> int:
        return len(self._by_key)

    @property
    def clients(self) -> list[Client]:
        """In the order in which they logged on."""
        return list(self._by_key.values())

    # ---- robots ----

    def register(self, description: Description) -> Client:
        """Log a robot on. Raises NameTaken, ServerFull."""
        if description.name in self._by_name:
            raise NameTaken(description.name)
        if len(self) >= self.limit:
            raise ServerFull(self.limit, len(self), self._next_slot_s())
        client = Client(description, secrets.token_urlsafe(24), self._clock())
        self._admit(client)
        return client

    def restore(self, description: Description, key: str) -> Client:
        """Log on again who was before a restart; its lease begins anew."""
        client = Client(description, key, self._clock())
        self._admit(client)
        return client

    def heard(self, key: str) -> Client:
        """A client called: its lease is renewed. Raises SessionExpired where it has none any more."""
        client = self._by_key.get(key)
        if client is None:
            raise SessionExpired()
        client.heard_at = self._clock()
        client.calls += 1
        return client

    def deregister(self, key: str) -> Client:
        """Log a robot off. Raises SessionExpired."""
        client = self._by_key.get(key)
        if client is None:
            raise SessionExpired()
        return self._dismiss(client)

    def evict(self, name: str) -> Client:
        """Log a robot off by its name, as an administrator may. Raises UnknownRobot."""
        return self._dismiss(self.find(name))

    def find(self, name: str) -> Client:
        """Raises UnknownRobot."""
        if name not in self._by_name:
            raise UnknownRobot(name)
        return self._by_name[name]

    def expire(self) -> list[Client]:
        """Log off whoever was not heard of for its lease."""
        before = self._clock() - self.lease_s
        return [self._dismiss(client) for client in self.clients if client.heard_at < before]

    def _admit(self, client: Client) -> None:
        self._by_key[client.key] = self._by_name[client.name] = client
        self._assign(client)

    def _dismiss(self, client: Client) -> Client:
        del self._by_key[client.key], self._by_name[client.name]
        return client

    def _next_slot_s(self) -> float:
        """When a slot may be free at the earliest: when the first lease would run out."""
        oldest = min((client.heard_at for client in self._by_key.values()), default=self._clock())
        return max(0.0, oldest + self.lease_s - self._clock())

    # ---- sensors ----

    def sensor_is(self, name: str, busy: float) -> None:
        """A sensor process is there, and so busy, 0 to 1."""
        self._sensors[name] = _Sensor(busy)
        for client in self._by_key.values():
            if not client.sensor:
                self._assign(client)

    def sensor_is_gone(self, name: str) -> list[Client]:
        """A sensor process died; its robots, which have others now if there are any."""
        self._sensors.pop(name, None)
        orphans = [client for client in self._by_key.values() if client.sensor == name]
        for client in orphans:
            self._assign(client)
        return orphans

    def _assign(self, client: Client) -> None:
        """Give a robot the sensor process that will be the least busy: as busy as it said, and more by what a robot
        costs on average for each that it was given since."""
        cost = max(sum(sensor.busy for sensor in self._sensors.values()) / max(1, len(self)), LEAST_COST)
        loads = {name: sensor.busy + cost * sensor.given for name, sensor in self._sensors.items()}
        client.sensor = min(loads, key=lambda name: (loads[name], name), default="")
        if client.sensor:
            self._sensors[client.sensor].given += 1
