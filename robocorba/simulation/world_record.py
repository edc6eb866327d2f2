"""What is kept of the simulated building: where everything is that is not where the map says, who rides, and who has
reserved what."""

from __future__ import annotations

import msgspec


class RobotRecord(msgspec.Struct, frozen=True, array_like=True):
    """A robot's pose, m and rad; the object that it holds, and where (x, y)."""

    floor: str
    x: float
    y: float
    heading: float
    grip: tuple[str, float, float] | None = None
    collisions: int = 0


class RideRecord(msgspec.Struct, frozen=True, array_like=True):
    """A ride; `inside` where the robot is in the cabin."""

    robot: str
    origin: str
    destination: str
    radius_m: float
    called_at: float
    inside: bool
    #: Who ride together, and how many; empty and 1 for a robot alone.
    party: str = ""
    size: int = 1


class CabinRecord(msgspec.Struct, frozen=True, array_like=True):
    """An elevator: the floor where it stands, or which it left, and its rides, first call first."""

    floor: str
    rides: list[RideRecord]


class ReservationRecord(msgspec.Struct, frozen=True, array_like=True):
    """Areas (floor, corners) that a robot asked for; granted_at: simulated s, None while it waits."""

    owner: str
    areas: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]
    limit_s: float
    granted_at: float | None


class WorldRecord(msgspec.Struct, frozen=True, array_like=True):
    """After so many steps: robots, movable objects (floor, x, y, heading) and elevators by name."""

    steps: int
    robots: dict[str, RobotRecord]
    objects: dict[str, tuple[str, float, float, float]]
    cabins: dict[str, CabinRecord]
    #: Whose robots these are: the sessions' keys, by name.
    keys: dict[str, str] = {}
    #: First request first.
    reservations: list[ReservationRecord] = []
