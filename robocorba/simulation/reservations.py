"""Areas that robots reserve before they go there with what they carry: who asked first goes first.

A request is granted with all its areas or not at all, so nobody holds one and waits for another. It waits for each
request before it, granted or not, that overlaps it: nobody is passed over. A grant ends by itself when its limit is
over, so a wait has a bound. Areas keep only those out who reserve too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidReservation, ReservationsFull
from robocorba.maps.polygons import FloorArea, check_polygon
from robocorba.simulation.world_record import ReservationRecord
from robocorba.spatial.pose import XY

#: Areas of a request, their corners together, and requests at once, at most.
MOST_AREAS, MOST_CORNERS, MOST_REQUESTS = 32, 512, 500
#: A grant ends after so long at the latest, s.
MOST_LIMIT_S = 600.0
#: Areas that overlap by less than twice this don't, so that rounding lets neighbours be neighbours, m.
EDGE_M = 0.001


class Wanted(NamedTuple):
    """What is asked for. shapes: all its areas together, by floor."""

    areas: tuple[FloorArea, ...]
    limit_s: float
    shapes: Mapping[str, BaseGeometry]


class Reservation(NamedTuple):
    """How far a request has come, in simulated seconds.

    ahead: requests that have to end before. longest_wait_s: until it is granted, at most. left_s: that its grant
    lasts, or will last."""

    granted: bool
    ahead: int
    longest_wait_s: float
    left_s: float


class Request:
    """A robot's request; `ahead` are the owners of those that it waits for."""

    def __init__(self, owner: str, wanted: Wanted) -> None:
        self.owner = owner
        self.areas, self.limit_s, self.shapes = wanted
        self.ahead: set[str] = set()
        self.granted_at: float | None = None
        #: The latest time at which it is granted.
        self.granted_by = 0.0

    def overlaps(self, other: Request) -> bool:
        return any(shape.intersects(other.shapes[name]) for name, shape in self.shapes.items() if name in other.shapes)

    @property
    def ends_by(self) -> float:
        """The latest time at which its grant ends."""
        return (self.granted_by if self.granted_at is None else self.granted_at) + self.limit_s

    def seen_at(self, now: float) -> Reservation:
        """How far it has come. Safe from any thread."""
        granted_at = self.granted_at
        if granted_at is None:
            return Reservation(False, len(self.ahead), max(0.0, self.granted_by - now), self.limit_s)
        return Reservation(True, 0, 0.0, max(0.0, granted_at + self.limit_s - now))


class Reservations:
    """Of a building, at a time in s. One thread uses it; any may use `find`."""

    def __init__(self, now: float = 0.0) -> None:
        self.now = now
        #: By owner, first request first.
        self.requests: dict[str, Request] = {}

    def reserve(self, owner: str, wanted: Wanted) -> Request:
        """Ask for areas; they are granted with this call or later. Raises InvalidReservation, ReservationsFull."""
        if owner in self.requests:
            raise InvalidReservation("robot", f"{owner} has a reservation already")
        if len(self.requests) >= MOST_REQUESTS:
            raise ReservationsFull(MOST_REQUESTS)
        request = Request(owner, wanted)
        request.ahead = {other.owner for other in self.requests.values() if request.overlaps(other)}
        self.requests[owner] = request
        self._settle()
        return request

    def keep(self, owner: str, kept: Sequence[FloorArea]) -> None:
        """Give back all but these of an owner's areas; without any its request ends.

        Raises InvalidReservation where one of them is not the owner's."""
        request = self.requests.get(owner)
        if request is None:
            raise InvalidReservation("robot", f"{owner} has no reservation")
        for i, area in enumerate(kept):
            if area not in request.areas:
                raise InvalidReservation(f"areas[{i}]", f"{owner} has not reserved it")
        if not kept:
            self.release(owner)
            return
        request.areas = tuple(area for area in request.areas if area in kept)
        request.shapes = _shapes(request.areas)
        request.ahead = {other for other in request.ahead if request.overlaps(self.requests[other])}
        for other in self.requests.values():
            if owner in other.ahead and not other.overlaps(request):
                other.ahead.discard(owner)
        self._settle()

    def release(self, owner: str) -> None:
        """End an owner's request, if there is one."""
        if self.requests.pop(owner, None):
            for other in self.requests.values():
                other.ahead.discard(owner)
            self._settle()

    def find(self, owner: str, now: float) -> Reservation | None:
        """How far an owner's request has come; None where there is none."""
        request = self.requests.get(owner)
        return request.seen_at(now) if request else None

    def longest_wait(self, owner: str) -> float:
        """How long an owner has to wait for its areas at most, s; 0 where it does not wait."""
        found = self.find(owner, self.now)
        return found.longest_wait_s if found else 0.0

    def advance(self, now: float) -> list[Request]:
        """Let time pass; those whose grant is over."""
        ended = []
        while over := [r for r in self.requests.values() if r.granted_at is not None and r.ends_by <= now]:
            first = min(over, key=lambda request: request.ends_by)
            self.now = first.ends_by  # when those that wait for it are granted
            self.release(first.owner)
            ended.append(first)
        self.now = now
        return ended

    def record(self) -> list[ReservationRecord]:
        """To go on from."""
        return [
            ReservationRecord(request.owner, request.areas, request.limit_s, request.granted_at)
            for request in self.requests.values()
        ]

    def restore(self, records: Iterable[ReservationRecord], now: float, owners: Collection[str]) -> None:
        """Go on from a record, in its order, with the requests of these owners."""
        self.now = now
        for record in records:
            if record.owner in owners:
                wanted = Wanted(record.areas, record.limit_s, _shapes(record.areas))
                self.reserve(record.owner, wanted)
                if record.granted_at is not None:
                    self.requests[record.owner].granted_at = record.granted_at

    def _settle(self) -> None:
        """Grant what nobody is ahead of, and say by when the others are granted. First come is first here."""
        for request in self.requests.values():
            if request.granted_at is None:
                request.granted_by = max((self.requests[other].ends_by for other in request.ahead), default=self.now)
                if not request.ahead:
                    request.granted_at = self.now


def wanted_of(areas: Sequence[tuple[str, Sequence[XY]]], limit_s: float, floors: Collection[str]) -> Wanted:
    """A request for areas on these floors, for so long after it is granted, simulated s.

    Raises InvalidReservation, UnknownFloor."""
    if not 0.0 < limit_s <= MOST_LIMIT_S:  # also refuses NaN
        raise InvalidReservation("limit", f"{limit_s} is not more than 0 and at most {MOST_LIMIT_S:g} s")
    asked = kept_of(areas)
    if not asked:
        raise InvalidReservation("areas", "there are none")
    for i, (floor, polygon) in enumerate(asked):
        if floor not in floors:
            raise UnknownFloor(f"areas[{i}]", floor[:200], tuple(floors))
        check_polygon(f"areas[{i}].polygon", polygon, InvalidReservation)
        if shapely.Polygon(polygon).buffer(-EDGE_M).is_empty:
            raise InvalidReservation(f"areas[{i}].polygon", f"is nowhere wider than {2 * EDGE_M:g} m")
    return Wanted(asked, limit_s, _shapes(asked))


def kept_of(areas: Sequence[tuple[str, Sequence[XY]]]) -> tuple[FloorArea, ...]:
    """Areas as they are kept. Raises InvalidReservation where there are too many, or too many corners."""
    check_sizes([polygon for _, polygon in areas])
    return tuple((floor, tuple((float(x), float(y)) for x, y in polygon)) for floor, polygon in areas)


def check_sizes(polygons: Sequence[Sequence[object]]) -> None:
    """Whether so many areas with so many corners may be asked for. Raises InvalidReservation."""
    if len(polygons) > MOST_AREAS:
        raise InvalidReservation("areas", f"{len(polygons)} are more than {MOST_AREAS}")
    corners = sum(map(len, polygons))
    if corners > MOST_CORNERS:
        raise InvalidReservation("areas", f"{corners} corners are more than {MOST_CORNERS} in all")


def _shapes(areas: Iterable[FloorArea]) -> dict[str, BaseGeometry]:
    polygons: dict[str, list[BaseGeometry]] = {}
    for floor, polygon in areas:
        polygons.setdefault(floor, []).append(shapely.Polygon(polygon))
    shapes = {floor: shapely.union_all(found).buffer(-EDGE_M, join_style="mitre") for floor, found in polygons.items()}
    for shape in shapes.values():
        shapely.prepare(shape)
    return shapes
