"""Queries at places where planners fail: on nodes and edges, in cabins, at corners, in line with walls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from robocorba.map_editor.geometry import bounds, obstacles
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.grids import segments_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Place

#: Shares of queries whose ends are equal, nearly equal, or on both sides of a wall in line with it.
EQUAL, NEARLY_EQUAL, IN_LINE = 0.03, 0.03, 0.06
#: Relative frequencies of kinds of places: anywhere, on a node, on an edge, in a cabin, exactly at the radius from the
#: end of a wall, exactly at the radius beside one, in line with one beyond its end, on a grid of half metres, on which
#: drawn walls and nodes lie, and at the end of a wall, where no robot fits.
KINDS = {
    **{"free": 8.0, "node": 3.0, "edge": 3.0, "cabin": 2.0, "corner": 3.0},
    **{"beside": 3.0, "beyond": 3.0, "grid": 2.0, "end": 0.5},
}
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
        shares = np.array(list(KINDS.values()))
        kind = str(self._rng.choice(list(KINDS), p=shares / shares.sum()))
        place = None
        for _ in range(TRIES):
            floor = self._one_of(self._floors)
            if (at := self._spot(kind, floor)) is None:
                kind = "free"
                continue
            place = Place(floor, *at)
            if kind == "end" or self._is_free(place, self._radius):
                return kind, place
        return (f"{kind} blocked", place) if place is not None else self._place()

    def _both_sides(self) -> tuple[Place, Place] | None:
        """Two places in line with a wall, beyond both of its ends."""
        floor = self._one_of(self._floors)
        if not len(self._lines[floor]):
            return None
        a, b = self._one_of(self._lines[floor])
        along = (b - a) / np.hypot(*(b - a))
        first, second = self._radius + self._rng.uniform(0.0, 1.0, 2)
        return Place(floor, *_xy(a - first * along)), Place(floor, *_xy(b + second * along))

    def _one_of(self, these: Sequence[Any] | np.ndarray) -> Any:
        return these[int(self._rng.integers(len(these)))]

    def _spot(self, kind: str, floor: str) -> XY | None:
        """A spot of a kind, as KINDS says; None where a floor has none."""
        x0, y0, x1, y1 = self._boxes[floor]
        anywhere = self._rng.uniform((x0, y0), (x1, y1))
        topological = self._building.floors[floor].topological
        if kind in ("free", "grid"):
            return _xy(anywhere if kind == "free" else np.round(2 * anywhere) / 2)
        if kind == "node":
            return self._one_of(list(topological.nodes.values())).at if topological.nodes else None
        if kind == "edge":
            if not topological.edges:
                return None
            edge = self._one_of(list(topological.edges.values()))
            a, b = np.array(topological.nodes[edge.a].at), np.array(topological.nodes[edge.b].at)
            return _xy(a + float(self._rng.choice([0.5, self._rng.random()])) * (b - a))
        if kind == "cabin":
            cabins = [lift for lift in self._building.elevators.values() if floor in lift.floors()]
            if not cabins:
                return None
            cabin = self._one_of(cabins)
            spread = float(self._rng.choice([0.0, 0.25])) * min(cabin.size)
            return _xy(np.array(cabin.at) + self._rng.uniform(-spread, spread, 2))
        if not len(self._lines[floor]):
            return None
        a, b = self._one_of(self._lines[floor])
        if self._rng.random() < 0.5:
            a, b = b, a
        along = (b - a) / np.hypot(*(b - a))
        if kind == "corner":
            turn = float(self._rng.choice([*np.arange(8) * math.pi / 4, self._rng.uniform(0.0, 2 * math.pi)]))
            return _xy(a + self._radius * np.array([math.cos(turn), math.sin(turn)]))
        if kind == "beside":
            away = self._radius + float(self._rng.choice([0.0, 1e-9, 1e-6, 1e-3]))
            return _xy(a + float(self._rng.random()) * (b - a) + away * np.array([-along[1], along[0]]))
        if kind == "beyond":
            return _xy(b + (self._radius + float(self._rng.choice([0.0, 1e-9, self._rng.uniform(0.0, 1.0)]))) * along)
        return _xy(a)


def _segments(building: Building, floor: str) -> np.ndarray:
    """(n, 2, 2): the lines of all obstacles of a floor."""
    shapes = np.array([item.geometry for item in obstacles(building, floor)], object)
    lines = segments_of(shapes)[0].reshape(-1, 2, 2)
    return lines[np.hypot(*(lines[:, 1] - lines[:, 0]).T) > 1e-6]


def _xy(at: np.ndarray) -> XY:
    return float(at[0]), float(at[1])
