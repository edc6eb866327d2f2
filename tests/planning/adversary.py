"""Queries at places where planners fail: on nodes and edges, in cabins, at corners, in line with walls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from robocorba.maps.geometry import bounds, obstacles
from robocorba.maps.model import Building
from robocorba.planning.request import Place
from robocorba.spatial.grids import segments_of
from robocorba.spatial.pose import XY

#: Shares of queries whose ends are equal, nearly equal, or on both sides of a wall in line with it.
EQUAL, NEARLY_EQUAL, IN_LINE = 0.03, 0.03, 0.06
#: Number of attempts to find a free place of a kind.
TRIES = 20


class Query(NamedTuple):
    """Start and goal, and their kinds of places."""

    kind: str
    start: Place
    goal: Place


class Adversary:
    """Random and adversarial queries for one building and radius."""

    def __init__(
        self, building: Building, radius_m: float, is_free: Callable[[Place, float], bool], seed: int = 0
    ) -> None:
        """`is_free` returns whether a robot of a radius fits at a place."""
        self._building, self._radius, self._is_free = building, radius_m, is_free
        self._rng = np.random.default_rng(seed)
        self._floors = list(building.floors)
        self._boxes = {floor: bounds(building, floor, 0.0) for floor in self._floors}
        self._lines = {floor: _segments(building, floor) for floor in self._floors}
        #: How to make a place of each kind, and its relative frequency.
        self._kinds: dict[str, tuple[Callable[[str], XY | None], float]] = {
            "free": (self._anywhere, 8.0),
            "node": (self._node, 3.0),
            "edge": (self._edge, 3.0),
            "cabin": (self._cabin, 2.0),
            "corner": (self._corner, 3.0),
            "beside": (self._beside, 3.0),
            "beyond": (self._beyond, 3.0),
            "grid": (self._grid, 2.0),
            "end": (self._end, 0.5),
        }
        weights = np.array([weight for _, weight in self._kinds.values()])
        self._shares = weights / weights.sum()

    def queries(self, count: int) -> Iterator[Query]:
        """This number of queries."""
        for _ in range(count):
            yield self._query()

    def _query(self) -> Query:
        chance = float(self._rng.random())
        if chance < IN_LINE:
            ends = self._both_sides()
            if ends is not None:
                return Query("in line", *ends)
        kind, start = self._place()
        if chance > 1.0 - EQUAL:
            return Query(f"{kind} equal", start, start)
        if chance > 1.0 - EQUAL - NEARLY_EQUAL:
            step, turn = 10.0 ** float(self._rng.uniform(-10.0, -1.0)), float(self._rng.uniform(0.0, 2 * math.pi))
            goal = Place(start.floor, start.x + step * math.cos(turn), start.y + step * math.sin(turn))
            return Query(f"{kind} nearly equal", start, goal)
        other, goal = self._place()
        return Query(f"{kind} to {other}", start, goal)

    def _place(self) -> tuple[str, Place]:
        """A place of a random kind. It is free, except for kinds that never are, or after TRIES attempts."""
        kind = str(self._rng.choice(list(self._kinds), p=self._shares))
        place = None
        for _ in range(TRIES):
            floor = self._floors[int(self._rng.integers(len(self._floors)))]
            at = self._kinds[kind][0](floor)
            if at is None:
                kind = "free"
                continue
            place = Place(floor, *at)
            if kind == "end" or self._is_free(place, self._radius):
                return kind, place
        return (f"{kind} blocked", place) if place is not None else self._place()

    def _both_sides(self) -> tuple[Place, Place] | None:
        """Two places in line with a wall, beyond both of its ends."""
        floor = self._floors[int(self._rng.integers(len(self._floors)))]
        segment = self._segment(floor)
        if segment is None:
            return None
        a, b = segment
        along = (b - a) / np.hypot(*(b - a))
        first, second = self._radius + self._rng.uniform(0.0, 1.0, 2)
        return Place(floor, *_xy(a - first * along)), Place(floor, *_xy(b + second * along))

    def _segment(self, floor: str) -> np.ndarray | None:
        lines = self._lines[floor]
        return lines[int(self._rng.integers(len(lines)))] if len(lines) else None

    def _anywhere(self, floor: str) -> XY:
        x0, y0, x1, y1 = self._boxes[floor]
        return float(self._rng.uniform(x0, x1)), float(self._rng.uniform(y0, y1))

    def _grid(self, floor: str) -> XY:
        """On a grid of half metres, on which drawn walls and nodes lie."""
        x, y = self._anywhere(floor)
        return round(2 * x) / 2, round(2 * y) / 2

    def _node(self, floor: str) -> XY | None:
        nodes = list(self._building.floors[floor].topological.nodes.values())
        return nodes[int(self._rng.integers(len(nodes)))].at if nodes else None

    def _edge(self, floor: str) -> XY | None:
        topological = self._building.floors[floor].topological
        edges = list(topological.edges.values())
        if not edges:
            return None
        edge = edges[int(self._rng.integers(len(edges)))]
        a, b = np.array(topological.nodes[edge.a].at), np.array(topological.nodes[edge.b].at)
        return _xy(a + float(self._rng.choice([0.5, self._rng.random()])) * (b - a))

    def _cabin(self, floor: str) -> XY | None:
        """At the centre of a cabin, or anywhere in it."""
        cabins = [lift for lift in self._building.elevators.values() if floor in lift.floors()]
        if not cabins:
            return None
        cabin = cabins[int(self._rng.integers(len(cabins)))]
        spread = float(self._rng.choice([0.0, 0.25])) * min(cabin.size)
        return _xy(np.array(cabin.at) + self._rng.uniform(-spread, spread, 2))

    def _corner(self, floor: str) -> XY | None:
        """At exactly the radius from the end of a wall or from a corner."""
        segment = self._segment(floor)
        if segment is None:
            return None
        turn = float(self._rng.choice([*np.arange(8) * math.pi / 4, self._rng.uniform(0.0, 2 * math.pi)]))
        return _xy(segment[int(self._rng.integers(2))] + self._radius * np.array([math.cos(turn), math.sin(turn)]))

    def _beside(self, floor: str) -> XY | None:
        """At exactly the radius, or a little more, beside a wall."""
        segment = self._segment(floor)
        if segment is None:
            return None
        a, b = segment
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a)) * float(self._rng.choice([-1.0, 1.0]))
        away = self._radius + float(self._rng.choice([0.0, 1e-9, 1e-6, 1e-3]))
        return _xy(a + float(self._rng.random()) * (b - a) + away * normal)

    def _beyond(self, floor: str) -> XY | None:
        """Exactly in line with a wall, beyond its end."""
        segment = self._segment(floor)
        if segment is None:
            return None
        a, b = segment if self._rng.random() < 0.5 else segment[::-1]
        away = self._radius + float(self._rng.choice([0.0, 1e-9, self._rng.uniform(0.0, 1.0)]))
        return _xy(b + away * (b - a) / np.hypot(*(b - a)))

    def _end(self, floor: str) -> XY | None:
        """On the end of a wall: no robot fits there."""
        segment = self._segment(floor)
        return None if segment is None else _xy(segment[0])


def _segments(building: Building, floor: str) -> np.ndarray:
    """(n, 2, 2): the lines of all obstacles of a floor."""
    shapes = np.array([item.geometry for item in obstacles(building, floor)], object)
    lines = segments_of(shapes)[0].reshape(-1, 2, 2)
    return lines[np.hypot(*(lines[:, 1] - lines[:, 0]).T) > 1e-6]


def _xy(at: np.ndarray) -> XY:
    return float(at[0]), float(at[1])
