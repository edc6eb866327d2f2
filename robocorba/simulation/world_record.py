"""Records of the simulated building for the store: poses, grips, rides and reservations."""

from __future__ import annotations

import msgspec


class RobotRecord(msgspec.Struct, frozen=True, array_like=True):
    """A robot's pose [m, rad]. grip: the held object and the grip point x, y [m]."""

    floor: str
    x: float
    y: float
    heading: float
    grip: tuple[str, float, float] | None = None
    collisions: int = 0


class ObjectRecord(msgspec.Struct, frozen=True, array_like=True):
    """An object's pose [m, rad]. map_pose: the one that it had on the map; None in records of earlier releases."""

    floor: str
    x: float
    y: float
    heading: float
    map_pose: tuple[str, float, float, float] | None = None


class RideRecord(msgspec.Struct, frozen=True, array_like=True):
    """A ride. called_at: simulated time [s]. inside: whether the robot is in the cabin."""

    robot: str
    origin: str
    destination: str
    radius_m: float
    called_at: float
    inside: bool
    #: Name and size of the party; empty and 1 for a lone robot.
    party: str = ""
    size: int = 1
    #: Time limit for boarding, and for alighting [s].
    limit_s: float = 15.0


class CabinRecord(msgspec.Struct, frozen=True, array_like=True):
    """An elevator. floor: where the cabin is, or its last stop. rides: first call first. is_open: whether its doors are
    open."""

    floor: str
    rides: list[RideRecord]
    is_open: bool = False


class ReservationRecord(msgspec.Struct, frozen=True, array_like=True):
    """A request for areas (floor, corners). granted_at: simulated time [s], None while it waits. kept_until: simulated
    time [s] until which it is kept though its owner fell silent; None while the owner is there."""

    owner: str
    areas: tuple[tuple[str, tuple[tuple[float, float], ...]], ...]
    limit_s: float
    granted_at: float | None
    kept_until: float | None = None


class WorldRecord(msgspec.Struct, frozen=True, array_like=True):
    """The world after `steps` steps: robots, elevators, and movable objects that are not where the map has them.

    All by name. Objects have the name FLOOR/NAME of the map; in records of earlier releases that of `movables`."""

    steps: int
    robots: dict[str, RobotRecord]
    objects: dict[str, ObjectRecord]
    cabins: dict[str, CabinRecord]
    #: Digests of the secrets of the robots' sessions, by name.
    keys: dict[str, str] = {}
    #: In the order of the requests.
    reservations: list[ReservationRecord] = []
    #: Version of the map whose names these are; 0 in records of earlier releases.
    map_version: int = 0
