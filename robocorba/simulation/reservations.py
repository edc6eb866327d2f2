"""Areas that robots reserve before they enter them with a load, granted in the order of requests.

A request is granted with all its areas or not at all, which excludes deadlocks. It waits for each earlier overlapping
request, granted or not, which excludes starvation. A grant expires after its limit, so every wait is bounded.
Reservations bind only robots that reserve.

What is granted to a robot that falls silent with an object in its hands stays reserved for a while, so that another one
can take it over: others may still stand there and hold the object.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import InvalidReservation, ReservationsFull
from robocorba.map_editor.polygons import FloorArea, check_polygon
from robocorba.map_editor.spatial.pose import XY
from robocorba.simulation.world_record import ReservationRecord

#: Maximum number of areas in a request.
MAX_AREAS = 32
#: Maximum number of corners of all areas in a request.
MAX_CORNERS = 512
#: Maximum duration of a grant [s].
MAX_LIMIT_S = 600.0
#: How long areas are kept that were granted to a robot that fell silent with an object in its hands [s].
KEPT_S = 20.0
#: Maximum number of alternatives of a request.
MAX_ALTERNATIVES = 4
#: In place of the name of a floor or an object that is gone.
GONE = ""
#: Each area is shrunk by this margin [m], so that rounding does not make adjacent areas overlap.
EDGE_M = 0.001


class AreaRequest(NamedTuple):
    """A request for areas. limit_s: duration of the grant [s]. shapes: union of its areas, by floor."""

    areas: tuple[FloorArea, ...]
    limit_s: float
    shapes: Mapping[str, BaseGeometry]


class Reservation(NamedTuple):
    """Status of a request, in simulated time.

    ahead: earlier requests that must end first. longest_wait_s: upper bound of the wait [s]. left_s: remaining
    duration of the grant [s], the whole duration while the request waits."""

    granted: bool
    ahead: int
    longest_wait_s: float
    left_s: float


class ReservedAreas(NamedTuple):
    """The areas that a robot has reserved, or waits for."""

    robot: str
    areas: tuple[FloorArea, ...]
    status: Reservation


class QueuedRequest:
    """A robot's request, granted or waiting. owner: the robot's name."""

    def __init__(self, owner: str, request: AreaRequest) -> None:
        self.owner = owner
        self.areas, self.limit_s, self.shapes = request
        #: The requests that it waits for.
        self.ahead: set[QueuedRequest] = set()
        #: Time of the grant [s]; None while it waits.
        self.granted_at: float | None = None
        #: Upper bound of that time [s].
        self.latest_grant = 0.0
        #: Time until which it is kept though its owner fell silent [s]; None while the owner is there.
        self.kept_until: float | None = None

    def overlaps(self, other: QueuedRequest) -> bool:
        return any(shape.intersects(other.shapes[name]) for name, shape in self.shapes.items() if name in other.shapes)

    @property
    def request(self) -> AreaRequest:
        return AreaRequest(self.areas, self.limit_s, self.shapes)

    @property
    def latest_end(self) -> float:
        """Upper bound of the time at which its grant ends [s]."""
        end = (self.latest_grant if self.granted_at is None else self.granted_at) + self.limit_s
        return end if self.kept_until is None else min(end, self.kept_until)

    def status_at(self, now: float) -> Reservation:
        """Status at a time [s]. Thread-safe."""
        granted_at = self.granted_at
        if granted_at is None:
            return Reservation(False, len(self.ahead), max(0.0, self.latest_grant - now), self.limit_s)
        return Reservation(True, 0, 0.0, max(0.0, self.latest_end - now))


class Reservations:
    """All requests of a building at time `now` [s]. One thread may use it; `find` and `all` are thread-safe.

    max_requests: maximum number of requests, granted and waiting."""

    def __init__(self, now: float = 0.0, max_requests: int = 500) -> None:
        self.now = now
        self._max_requests = max_requests
        #: By owner, first request first.
        self.requests: dict[str, QueuedRequest] = {}
        #: The grants of owners that fell silent.
        self._kept: list[QueuedRequest] = []

    def reserve(self, owner: str, alternatives: Sequence[AreaRequest]) -> int:
        """Request one of several alternatives, granted immediately or later: the one whose latest grant is the soonest,
        among equals the first. Returns its index. Raises InvalidReservation, ReservationsFull."""
        if owner in self.requests:
            raise InvalidReservation("robot", f"{owner} has a reservation already")
        if len(self.requests) + len(self._kept) >= self._max_requests:
            raise ReservationsFull(self._max_requests)
        requests = [self._queued(owner, areas) for areas in alternatives]
        request = min(requests, key=lambda each: max((other.latest_end for other in each.ahead), default=self.now))
        self.requests[owner] = request
        self._grant()
        return requests.index(request)

    def _queued(self, owner: str, areas: AreaRequest) -> QueuedRequest:
        request = QueuedRequest(owner, areas)
        request.ahead = {other for other in (*self.requests.values(), *self._kept) if request.overlaps(other)}
        return request

    def keep(self, owner: str, kept: Sequence[FloorArea]) -> None:
        """Release all areas of an owner but these; without any, the request ends.

        Raises InvalidReservation if one of them is not reserved by the owner."""
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
        request.ahead = {other for other in request.ahead if request.overlaps(other)}
        self._release_others(request)

    def exchange(self, owner: str, areas: AreaRequest, least_s: float) -> bool:
        """Replace what is granted to an owner by other areas, for the rest of its time, if that is `least_s` at least
        and nobody has to wait longer for it. Returns whether it was."""
        request = self.requests.get(owner)
        if request is None or request.granted_at is None or request.latest_end - self.now < least_s:
            return False
        wanted = QueuedRequest(owner, areas)
        for other in (*self.requests.values(), *self._kept):
            is_behind = other.granted_at is None and request in other.ahead
            if other is not request and not is_behind and wanted.overlaps(other):
                return False
        request.areas, request.shapes = areas.areas, areas.shapes
        self._release_others(request)
        return True

    def release(self, owner: str) -> None:
        """End an owner's request, if any."""
        if request := self.requests.pop(owner, None):
            self._remove(request)

    def fall_silent(self, owner: str, former: str = "") -> None:
        """The owner is gone without having released its areas. What is granted to it is kept for KEPT_S, as areas of
        the owner, or of a former one from which it has taken them over."""
        request = self.requests.get(owner)
        if request is None or request.granted_at is None:
            self.release(owner)
            return
        del self.requests[owner]
        request.owner = former or owner
        request.kept_until = self.now + KEPT_S
        self._kept.append(request)
        self._grant()

    def take_over(self, owner: str, former: str) -> None:
        """Give an owner what is kept of a former one that fell silent. Raises InvalidReservation if there is nothing,
        and if the owner has a reservation."""
        if owner in self.requests:
            raise InvalidReservation("robot", f"{owner} has a reservation already")
        for request in self._kept:
            if request.owner == former:
                self._kept.remove(request)
                request.owner, request.kept_until = owner, None
                self.requests[owner] = request
                self._grant()
                return
        raise InvalidReservation("former", f"nothing is kept of {former[:80]!r}")

    def rename_floors(self, names: Mapping[str, str]) -> None:
        """Follow the map: names of its floors by their former ones. Areas of floors that are gone block nobody."""
        requests = (*self.requests.values(), *self._kept)
        smaller = [request for request in requests if not request.shapes.keys() <= names.keys()]
        for request in requests:
            request.areas = tuple((names.get(floor, GONE), polygon) for floor, polygon in request.areas)
            request.shapes = {names[floor]: shape for floor, shape in request.shapes.items() if floor in names}
        self._release_others(*smaller)

    def _release_others(self, *changed: QueuedRequest) -> None:
        """The areas of requests have changed: others that no longer overlap one do not wait for it any more."""
        for other in self.requests.values():
            other.ahead -= {request for request in other.ahead.intersection(changed) if not other.overlaps(request)}
        self._grant()

    def _remove(self, request: QueuedRequest) -> None:
        request.shapes = {}
        self._release_others(request)

    def find(self, owner: str, now: float) -> Reservation | None:
        """Status of an owner's request at a time [s]; None without a request. Thread-safe."""
        request = self.requests.get(owner)
        return request.status_at(now) if request else None

    def all(self, now: float) -> list[ReservedAreas]:
        """All requests with their status at a time [s]: first request first, then what is kept. Thread-safe."""
        return [
            ReservedAreas(request.owner, request.areas, request.status_at(now))
            for request in [*self.requests.values(), *self._kept]
        ]

    def advance(self, now: float) -> list[QueuedRequest]:
        """Advance to a time [s]; return the requests whose grant expired."""
        ended = []
        while expired := [
            request
            for request in (*self.requests.values(), *self._kept)
            if request.granted_at is not None and request.latest_end <= now
        ]:
            first = min(expired, key=lambda request: request.latest_end)
            self.now = first.latest_end  # waiting requests are granted at this time
            if first.kept_until is None:
                del self.requests[first.owner]
            else:
                self._kept.remove(first)
            self._remove(first)
            ended.append(first)
        self.now = now
        return ended

    def record(self) -> list[ReservationRecord]:
        """All requests, granted ones first, for `restore`."""
        # A request comes after those that it waits for.
        return [
            ReservationRecord(request.owner, request.areas, request.limit_s, request.granted_at, request.kept_until)
            for request in sorted((*self._kept, *self.requests.values()), key=lambda each: each.granted_at is None)
        ]

    def restore(self, records: Iterable[ReservationRecord], now: float, owners: Collection[str]) -> None:
        """Restore what is kept, and the requests of these owners, in the order of the records."""
        self.now = now
        for record in records:
            areas = AreaRequest(record.areas, record.limit_s, _shapes(record.areas))
            if record.kept_until is not None:
                kept = QueuedRequest(record.owner, areas)
                kept.granted_at, kept.kept_until = record.granted_at, record.kept_until
                self._kept.append(kept)
            elif record.owner in owners:
                self.reserve(record.owner, [areas])
                if record.granted_at is not None:
                    self.requests[record.owner].granted_at = record.granted_at

    def _grant(self) -> None:
        """Grant requests that wait for no other, and compute the latest grant of the rest, in order of arrival."""
        for request in self.requests.values():
            if request.granted_at is None:
                request.latest_grant = max((other.latest_end for other in request.ahead), default=self.now)
                if not request.ahead:
                    request.granted_at = self.now


def area_request(areas: Sequence[tuple[str, Sequence[XY]]], limit_s: float, floors: Collection[str]) -> AreaRequest:
    """Validate a request for areas on these floors; the grant lasts `limit_s` of simulated time.

    Raises InvalidReservation, UnknownFloor."""
    if not 0.0 < limit_s <= MAX_LIMIT_S:  # also refuses NaN
        raise InvalidReservation("limit", f"{limit_s} s is not above 0 and at most {MAX_LIMIT_S:g} s")
    checked = canonical_areas(areas)
    if not checked:
        raise InvalidReservation("areas", "a request needs at least one area")
    for i, (floor, polygon) in enumerate(checked):
        if floor not in floors:
            raise UnknownFloor(f"areas[{i}]", floor[:200], tuple(floors))
        check_polygon(f"areas[{i}].polygon", polygon, InvalidReservation)
        if shapely.Polygon(polygon).buffer(-EDGE_M).is_empty:
            raise InvalidReservation(f"areas[{i}].polygon", f"is nowhere wider than {2 * EDGE_M:g} m")
    return AreaRequest(checked, limit_s, _shapes(checked))


def area_requests(
    alternatives: Sequence[Sequence[tuple[str, Sequence[XY]]]], limit_s: float, floors: Collection[str]
) -> list[AreaRequest]:
    """Validate the alternatives of a request. Raises InvalidReservation, UnknownFloor."""
    check_alternatives(alternatives)
    return [area_request(areas, limit_s, floors) for areas in alternatives]


def check_alternatives(alternatives: Sequence[object]) -> None:
    """Check the number of alternatives of a request. Raises InvalidReservation."""
    if not 1 <= len(alternatives) <= MAX_ALTERNATIVES:
        raise InvalidReservation("alternatives", f"{len(alternatives)} is not 1 to {MAX_ALTERNATIVES}")


def canonical_areas(areas: Sequence[tuple[str, Sequence[XY]]]) -> tuple[FloorArea, ...]:
    """Areas in canonical form. Raises InvalidReservation for too many areas or corners."""
    check_sizes([polygon for _, polygon in areas])
    return tuple((floor, tuple((float(x), float(y)) for x, y in polygon)) for floor, polygon in areas)


def check_sizes(polygons: Sequence[Sequence[object]]) -> None:
    """Check the numbers of areas and corners of a request. Raises InvalidReservation."""
    if len(polygons) > MAX_AREAS:
        raise InvalidReservation("areas", f"{len(polygons)} areas; at most {MAX_AREAS}")
    corners = sum(map(len, polygons))
    if corners > MAX_CORNERS:
        raise InvalidReservation("areas", f"{corners} corners in total; at most {MAX_CORNERS}")


def _shapes(areas: Iterable[FloorArea]) -> dict[str, BaseGeometry]:
    """Union of areas on each floor, shrunk by EDGE_M; without those of floors that are gone."""
    polygons: dict[str, list[BaseGeometry]] = {}
    for floor, polygon in areas:
        polygons.setdefault(floor, []).append(shapely.Polygon(polygon))
    polygons.pop(GONE, None)
    shapes = {floor: shapely.union_all(parts).buffer(-EDGE_M, join_style="mitre") for floor, parts in polygons.items()}
    for shape in shapes.values():
        shapely.prepare(shape)
    return shapes
