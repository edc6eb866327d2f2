"""What reservations of areas have to do, on a grid and without geometry: a request waits for all earlier ones that
share a square with it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import pytest

from robocorba.map_editor.polygons import FloorArea
from robocorba.simulation.reservations import KEPT_S, Reservation, ReservedAreas

#: A rectangle of squares: number of the floor, x, y, width and height [m].
Box = tuple[int, int, int, int, int]
#: Number of a floor that is gone; its name is the last one.
NOWHERE = -1


def squares(boxes: Iterable[Box]) -> set[tuple[int, int, int]]:
    return {(floor, x + i, y + j) for floor, x, y, w, h in boxes for i in range(w) for j in range(h) if floor >= 0}


def areas(boxes: Iterable[Box], floors: Sequence[str]) -> tuple[FloorArea, ...]:
    """floors: their names by number."""
    corners = ((floor, (x, y), (x + w, y), (x + w, y + h), (x, y + h)) for floor, x, y, w, h in boxes)
    return tuple((floors[floor], tuple((float(x), float(y)) for x, y in polygon)) for floor, *polygon in corners)


@dataclass(eq=False)
class ModelRequest:
    owner: str
    boxes: list[Box]
    limit_s: float
    granted_at: float = math.inf
    #: Until when it is kept of a silent owner [s].
    kept_until: float = math.inf

    @property
    def is_granted(self) -> bool:
        return self.granted_at < math.inf

    @property
    def ending(self) -> str:
        """Why its grant ends."""
        return "the robot fell silent" if self.is_kept else f"its limit of {self.limit_s:g} s is over"

    @property
    def is_kept(self) -> bool:
        return self.kept_until < math.inf


class AreaModel:
    """All requests at time `now` [s], the first one first."""

    def __init__(self) -> None:
        self.now = 0.0
        self.queue: list[ModelRequest] = []
        #: Those of silent owners, in the order in which these fell silent.
        self.kept: list[ModelRequest] = []

    def of(self, owner: str) -> ModelRequest | None:
        return next((one for one in self.queue if one.owner == owner and not one.is_kept), None)

    def kept_of(self, owner: str) -> ModelRequest | None:
        return next((one for one in self.kept if one.owner == owner), None)

    def before(self, one: ModelRequest) -> list[ModelRequest]:
        """Those that it waits for."""
        earlier = self.queue[: self.queue.index(one)]
        return [other for other in earlier if squares(other.boxes) & squares(one.boxes)]

    def latest_grant(self, one: ModelRequest) -> float:
        return one.granted_at if one.is_granted else max(map(self.latest_end, self.before(one)), default=self.now)

    def latest_end(self, one: ModelRequest) -> float:
        return min(self.latest_grant(one) + one.limit_s, one.kept_until)

    def status(self, one: ModelRequest) -> Reservation:
        if one.is_granted:
            return Reservation(True, 0, 0.0, self.latest_end(one) - self.now)
        return Reservation(False, len(self.before(one)), self.latest_grant(one) - self.now, one.limit_s)

    # ---- what robots do ----

    def reserve(self, owner: str, alternatives: Sequence[list[Box]], limit_s: float) -> int:
        """The index of the alternative that is granted first, even if all others use their whole time."""
        latest = []
        for boxes in alternatives:
            self.queue.append(ModelRequest(owner, boxes, limit_s))
            latest.append(self.latest_grant(self.queue[-1]))
            del self.queue[-1]
        chosen = latest.index(min(latest))
        self.queue.append(ModelRequest(owner, alternatives[chosen], limit_s))
        self.settle()
        return chosen

    def keep(self, owner: str, kept: Sequence[Box]) -> None:
        if request := self.of(owner):
            request.boxes = [box for box in request.boxes if box in kept]
            if not request.boxes:
                self.queue.remove(request)
            self.settle()

    def exchange(self, owner: str, boxes: list[Box], least_s: float) -> bool:
        """Nobody has to wait for it who does not wait for this request already."""
        request = self.of(owner)
        if not request or not request.is_granted or self.latest_end(request) - self.now < least_s:
            return False
        touched = [one for one in self.queue if one is not request and squares(one.boxes) & squares(boxes)]
        if not all(request in self.before(one) for one in touched):
            return False
        request.boxes = boxes
        self.settle()
        return True

    def fall_silent(self, owner: str, former: str = "") -> None:
        request = self.of(owner)
        if request and request.is_granted:
            request.owner, request.kept_until = former or owner, self.now + KEPT_S
            self.kept.append(request)
        else:
            self.keep(owner, [])

    def take_over(self, owner: str, former: str) -> bool:
        request = self.kept_of(former)
        if request is None or self.of(owner):
            return False
        request.owner, request.kept_until = owner, math.inf
        self.kept.remove(request)
        return True

    def remove_floor(self, number: int) -> None:
        for one in self.queue:
            one.boxes = [(NOWHERE if box[0] == number else box[0], *box[1:]) for box in one.boxes]
        self.settle()

    def pass_time(self, until: float) -> list[tuple[str, str]]:
        """The owners whose grants ended, in this order, and why."""
        ended = []
        while over := [one for one in self.queue if one.is_granted and self.latest_end(one) <= until]:
            first = min(over, key=self.latest_end)
            self.now = self.latest_end(first)
            self.queue.remove(first)
            self.kept = [one for one in self.kept if one is not first]
            self.settle()
            ended.append((first.owner, first.ending))
        self.now = until
        return ended

    def settle(self) -> None:
        """Grant what waits for nothing."""
        for one in self.queue:
            if not one.is_granted and not self.before(one):
                one.granted_at = self.now

    # ---- comparison ----

    def check(self, found: Sequence[ReservedAreas], floors: Sequence[str]) -> None:
        """That these are all requests, with their status. floors: names by number."""
        wanted = [ReservedAreas(one.owner, areas(one.boxes, floors), self.status(one)) for one in self.queue]
        wanted.sort(key=_identity)
        found = sorted(found, key=_identity)
        assert [each[:2] for each in found] == [each[:2] for each in wanted]
        assert [each.status for each in found] == [pytest.approx(each.status) for each in wanted]


def _identity(reserved: ReservedAreas) -> tuple[object, ...]:
    return reserved.robot, reserved.areas, reserved.status.granted
