"""The logged-on robots and their leases: a lease expires unless a call of its robot renews it."""

from __future__ import annotations

import hashlib
import math
import re
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from robocorba.errors.simulation import InvalidDescription, NameTaken, ServerFull, SessionExpired, UnknownRobot
from robocorba.map_editor.spatial.pose import Limits, Pose

#: Lease of a robot [s]: it is logged off after this time without a call.
LEASE_S = 2.0
#: Maximum length of a robot's name [characters].
MAX_NAME = 60
_NAME = re.compile(rf"[A-Za-z0-9_][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}")


def name_fault(name: str) -> str:
    """Why this can't be the name of a robot; empty if it can."""
    if _NAME.fullmatch(name):
        return ""
    return f"{name[:80]!r} is not 1 to {MAX_NAME} letters, digits or . _ -"


def pose_faults(pose: Pose) -> Iterator[tuple[str, str]]:
    """The members of a pose that no body can have, each with the reason."""
    for member, value, maximum in (("x", pose.x, 1e6), ("y", pose.y, 1e6), ("heading", pose.heading, 1e3)):
        if not abs(value) <= maximum:  # also finds NaN
            yield member, f"{value} is not a number between -{maximum:g} and {maximum:g}"


@dataclass(frozen=True)
class Description:
    """What a robot states about itself to log on. Raises InvalidDescription."""

    name: str
    pose: Pose
    radius_m: float = 0.4
    mass_kg: float = 127.0
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        if fault := name_fault(self.name):
            raise InvalidDescription("name", fault)
        for name, reason in pose_faults(self.pose):
            raise InvalidDescription(name, reason)
        for name, value, minimum, maximum in (
            ("radius", self.radius_m, 0.05, 5.0),
            ("mass", self.mass_kg, 0.1, 10_000.0),
            ("speed", self.limits.speed, 0.0, 10.0),
            ("turn", self.limits.turn_speed, 0.0, 4 * math.pi),
            ("acceleration", self.limits.acceleration, 1e-3, 50.0),
            ("turn acceleration", self.limits.turn_acceleration, 1e-3, 50.0),
        ):
            if not minimum <= value <= maximum:
                raise InvalidDescription(name, f"{value} is not {minimum:g} to {maximum:g}")


def digest_of(secret: str) -> str:
    """What is stored of a random secret: it recognises the secret, and does not give it away."""
    return hashlib.sha256(secret.encode()).hexdigest()


class RobotClient:
    """A logged-on robot. Thread-safe.

    secret: authorizes a caller to act as this robot; after a restart empty until the first call. key: its digest, all
    that is stored. since: POSIX time of the log-on [s]. clock: the time of leases [s]."""

    def __init__(
        self, description: Description, key: str, since: float, clock: Callable[[], float], secret: str = ""
    ) -> None:
        self.description, self.key, self.since, self.secret = description, key, since, secret
        self._clock = clock
        self.last_call_at = now = clock()
        self.is_logged_off = False
        #: Calls per second, and moving average of the time to answer a call [s].
        self.call_rate = self.latency_s = 0.0
        self._calls, self._counted_at = 0, now
        self._in_progress, self._lock = 0, threading.Lock()

    @property
    def name(self) -> str:
        return self.description.name

    @property
    def silent_s(self) -> float:
        """Time since the last call [s]."""
        return self._clock() - self.last_call_at

    def renew_lease(self) -> None:
        """Count a call and renew the lease. Raises SessionExpired if the robot is logged off."""
        if self.is_logged_off:
            raise SessionExpired()
        self.last_call_at = self._clock()
        self._calls += 1

    @property
    def is_calling(self) -> bool:
        """Whether a call of the robot is in progress."""
        return self._in_progress > 0

    def begin_call(self) -> None:
        """A call of the robot begins; the lease does not expire until `end_call`."""
        with self._lock:
            self._in_progress += 1

    def end_call(self) -> None:
        """A call ends, and the lease begins again."""
        with self._lock:
            self.last_call_at = max(self.last_call_at, self._clock())
            self._in_progress -= 1

    def update_call_rate(self, now: float) -> None:
        """Update `call_rate`, at most once a second."""
        passed = now - self._counted_at
        if passed >= 1.0:
            self.call_rate, self._calls, self._counted_at = self._calls / passed, 0, now


class ServerState(NamedTuple):
    """State of the server, as clients read it. limit, robots: allowed and logged-on robots. time: simulated [s]. pace,
    achieved: requested (0: as fast as possible) and achieved simulated seconds per second. event_rate: published events
    per second."""

    limit: int
    robots: int
    time: float
    pace: float
    achieved: float
    is_paused: bool
    map_version: int
    collisions: int
    event_rate: float


class Registry:
    """The logged-on robots, at most `limit`. clock: returns the time of leases [s]."""

    def __init__(self, limit: int, clock: Callable[[], float]) -> None:
        self._clock, self.lease_s = clock, LEASE_S
        self._by_key: dict[str, RobotClient] = {}
        self._by_name: dict[str, RobotClient] = {}
        self.limit = limit
        #: Names that an administrator keeps out.
        self.kept_out: set[str] = set()

    def __len__(self) -> int:
        return len(self._by_key)

    @property
    def clients(self) -> list[RobotClient]:
        """Clients in the order of their log-on."""
        return list(self._by_key.values())

    def check(self, description: Description) -> None:
        """Check that a robot may log on. Raises InvalidDescription for one that is kept out, NameTaken, ServerFull."""
        if description.name in self.kept_out:
            name = description.name
            reason = f"an administrator keeps {name} out, until `robocorba simulation admit {name}`"
            raise InvalidDescription("name", reason)
        if description.name in self._by_name:
            raise NameTaken(description.name)
        if len(self) >= self.limit:
            raise ServerFull(self.limit, len(self), self._next_slot_s())

    def register(self, description: Description) -> RobotClient:
        """Log a robot on. Raises InvalidDescription for one that is kept out, NameTaken, ServerFull."""
        self.check(description)
        secret = secrets.token_urlsafe(24)
        client = RobotClient(description, digest_of(secret), time.time(), self._clock, secret)
        self._admit(client)
        return client

    def restore(self, description: Description, key: str, since: float) -> RobotClient:
        """Log a robot on again after a restart, with a full lease."""
        client = RobotClient(description, key, since, self._clock)
        self._admit(client)
        return client

    def remove(self, client: RobotClient) -> None:
        """Log a robot off. Raises SessionExpired if it is not logged on."""
        if client.is_logged_off:
            raise SessionExpired()
        client.is_logged_off = True
        del self._by_key[client.key], self._by_name[client.name]

    def find(self, name: str) -> RobotClient:
        """The client of this name. Raises UnknownRobot."""
        if name not in self._by_name:
            raise UnknownRobot(name)
        return self._by_name[name]

    def expired(self) -> list[RobotClient]:
        """Clients whose lease has expired, unless a call is in progress. Updates the call rates of all clients."""
        now = self._clock()
        for client in self.clients:
            client.update_call_rate(now)
        silent_since = now - self.lease_s
        # In this order: the end of a call sets the time before it is no longer in progress.
        return [client for client in self.clients if not client.is_calling and client.last_call_at < silent_since]

    def _admit(self, client: RobotClient) -> None:
        self._by_key[client.key] = self._by_name[client.name] = client

    def _next_slot_s(self) -> float:
        """Time until a slot may be free at the earliest [s]: until the first lease would expire."""
        oldest = min((client.last_call_at for client in self._by_key.values()), default=self._clock())
        return max(0.0, oldest + self.lease_s - self._clock())
