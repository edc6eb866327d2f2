"""The graph of roadmap in the making, and the few questions that every step asks of it."""

from __future__ import annotations

import math
from itertools import count

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.spatial.pose import XY

#: A bend closer to the chord than this share of its clearance is straightened.
BEND_SHARE = 0.5
#: Nodes this close are one, even where each has its reason, m.
SAME_PLACE_M = 0.02

Array = NDArray[np.float64]


class RoadmapGraph:
    """RoadmapGraph of a robot of `radius` m in `space`, the places where its centre may be.

    Attributes of a node in `graph`: `at` (x, y) in m, `clear` (distance to the nearest
    obstacle in m, about), `fixed` (never moved or merged away), `elevator` (its name, in a
    cabin), `place` (the name that it has on the map already). `hubs` are the nodes, beside
    the fixed ones, that pruning leaves."""

    def __init__(self, space: BaseGeometry, radius_m: float) -> None:
        self.space, self.radius = space, radius_m
        self.rooms: list[Polygon] = [room for room in shapely.get_parts(space).tolist() if room.area > 0]
        self.graph: nx.Graph[int] = nx.Graph()
        self.hubs: set[int] = set()
        self._numbers = count()

    def add(self, at: XY, clear: float = 0.0, fixed: bool = False, elevator: str = "", place: str = "") -> int:
        """A new node, its clearance the radius unless given."""
        number = next(self._numbers)
        self.graph.add_node(number, at=at, clear=clear or self.radius, fixed=fixed, elevator=elevator, place=place)
        return number

    def at(self, node: int) -> XY:
        """Where a node is, m."""
        return self.graph.nodes[node]["at"]

    def clearance_m(self, node: int) -> float:
        """How far a node is from the nearest obstacle, m, about."""
        return self.graph.nodes[node]["clear"]

    def is_fixed(self, node: int) -> bool:
        """Whether a node has a reason to be just where it is."""
        return self.graph.nodes[node]["fixed"]

    def elevator(self, node: int) -> str:
        """The elevator in whose cabin a node stands, or an empty name."""
        return self.graph.nodes[node]["elevator"]

    def place(self, node: int) -> str:
        """The name of a node that was on the map before, or an empty name."""
        return self.graph.nodes[node]["place"]

    def length(self, a: int, b: int) -> float:
        """Distance of two nodes, m."""
        return math.dist(self.at(a), self.at(b))

    def lines(self) -> tuple[list[tuple[int, int]], STRtree]:
        """All edges, and their lines in the same order."""
        edges = list(self.graph.edges)
        ends = np.array([(self.at(a), self.at(b)) for a, b in edges]).reshape(-1, 2, 2)
        return edges, STRtree(shapely.linestrings(ends))

    def is_free(self, *points: XY) -> bool:
        """Whether the hull of some points is free."""
        return bool(shapely.covers(self.space, shapely.convex_hull(shapely.multipoints(points))))

    def can_move(self, node: int, place: XY, but: int = -1) -> bool:
        """Whether the strips that a node's edges, except the one to `but`, sweep on its way to a place are free."""
        return all(self.is_free(self.at(node), place, self.at(n)) for n in self.graph[node] if n != but)


def midpoint(a: XY, b: XY) -> XY:
    """The point halfway between two."""
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def distance_to_segment_m(points: Array, a: Array, b: Array) -> Array:
    """Distances (n,) from points (n, 2) to the segment from a to b, m."""
    along = b - a
    square = float(along @ along)
    share = np.clip((points - a) @ along / square, 0, 1) if square else np.zeros(len(points))
    return np.hypot(*(points - a - share[:, None] * along).T)
