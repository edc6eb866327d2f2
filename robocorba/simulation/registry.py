"""Which robots are logged on, and for how long.

Nobody is asked whether it lives: a lease runs out unless a call of its robot renews it.
"""

from __future__ import annotations

import math
import re
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from robocorba.errors.simulation import InvalidDescription, NameTaken, ServerFull, SessionExpired, UnknownRobot
from robocorba.spatial.pose import Limits, Pose

#: A robot that was not heard of for so long is logged off, s.
LEASE_S = 2.0
MAX_NAME = 60


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


class RobotClient:
    """A robot that is logged on. `key` is its secret: whoever knows it may act as this robot.

    since: when it logged on, POSIX time, s. What it is asked is safe from any thread."""

    __slots__ = (
        "_calls",
        "_counted_at",
        "call_rate",
        "description",
        "is_logged_off",
        "key",
        "last_call_at",
        "latency_s",
        "since",
    )

    def __init__(self, description: Description, key: str, since: float, now: float) -> None:
        self.description, self.key, self.since = description, key, since
        self.last_call_at = now
        self.is_logged_off = False
        #: Calls a second, and seconds that a call took, on average of the last ones.
        self.call_rate = self.latency_s = 0.0
        self._calls, self._counted_at = 0, now

    @property
    def name(self) -> str:
        return self.description.name

    def renew_lease(self, now: float) -> None:
        """It called: its lease is renewed. Raises SessionExpired where it has none any more."""
        if self.is_logged_off:
            raise SessionExpired()
        self.last_call_at = now
        self._calls += 1

    def record_latency(self, seconds: float) -> None:
        """Its call was answered in this time."""
        self.latency_s += 0.05 * (seconds - self.latency_s)

    def update_call_rate(self, now: float) -> None:
        """Find out how often it calls, at most once a second."""
        passed = now - self._counted_at
        if passed >= 1.0:
            self.call_rate, self._calls, self._counted_at = self._calls / passed, 0, now


class Registry:
    """At most `limit` clients; `clock` tells the time in s."""

    def __init__(self, limit: int, clock: Callable[[], float], lease_s: float = LEASE_S) -> None:
        self._clock, self.lease_s = clock, lease_s
        self._by_key: dict[str, RobotClient] = {}
        self._by_name: dict[str, RobotClient] = {}
        self.limit = limit

    def __len__(self) -> int:
        return len(self._by_key)

    @property
    def clients(self) -> list[RobotClient]:
        """In the order in which they logged on."""
        return list(self._by_key.values())

    def check(self, description: Description) -> None:
        """Whether a robot may log on. Raises NameTaken, ServerFull."""
        if description.name in self._by_name:
            raise NameTaken(description.name)
        if len(self) >= self.limit:
            raise ServerFull(self.limit, len(self), self._next_slot_s())

    def register(self, description: Description) -> RobotClient:
        """Log a robot on. Raises NameTaken, ServerFull."""
        self.check(description)
        client = RobotClient(description, secrets.token_urlsafe(24), time.time(), self._clock())
        self._admit(client)
        return client

    def restore(self, description: Description, key: str, since: float) -> RobotClient:
        """Log on again who was before a restart; its lease begins anew."""
        client = RobotClient(description, key, since, self._clock())
        self._admit(client)
        return client

    def remove(self, client: RobotClient) -> None:
        """Log a robot off. Raises SessionExpired where it is not logged on."""
        if client.is_logged_off:
            raise SessionExpired()
        client.is_logged_off = True
        del self._by_key[client.key], self._by_name[client.name]

    def find(self, name: str) -> RobotClient:
        """Raises UnknownRobot."""
        if name not in self._by_name:
            raise UnknownRobot(name)
        return self._by_name[name]

    def expired(self) -> list[RobotClient]:
        """Who was not heard of for its lease; and find out how often the others call."""
        now = self._clock()
        for client in self.clients:
            client.update_call_rate(now)
        return [client for client in self.clients if client.last_call_at < now - self.lease_s]

    def _admit(self, client: RobotClient) -> None:
        self._by_key[client.key] = self._by_name[client.name] = client

    def _next_slot_s(self) -> float:
        """When a slot may be free at the earliest: when the first lease would run out."""
        oldest = min((client.last_call_at for client in self._by_key.values()), default=self._clock())
        return max(0.0, oldest + self.lease_s - self._clock())
