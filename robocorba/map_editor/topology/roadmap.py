"""The roadmap graph under construction, and the queries of its construction steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.time_limit import no_limit

#: A bend is straightened if its distance from the chord is below this share of its clearance. A choice of this
#: project: half leaves the robot room on both sides of the straight edge.
BEND_SHARE = 0.5
#: Distance below which even fixed nodes are merged [m].
SAME_POINT_M = 0.02

Array = NDArray[np.float64]


class RoadmapGraph:
    """The roadmap for a robot of `radius` m in `space`, the free space of its centre.

    Attributes of a node in `graph`: `at` (x, y) [m], `clear` (approximate clearance [m]),
    `fixed` (never moved or merged away), `elevator` (name, for a node in a cabin), `given_name`
    (name of a given node). Pruning keeps the fixed nodes and those in `hubs`."""

    def __init__(self, space: BaseGeometry, radius_m: float, check_time: Callable[[], None] = no_limit) -> None:
        """`check_time` raises an error if the construction takes too long."""
        self.space, self.radius, self.check_time = space, radius_m, check_time
        self.rooms: list[Polygon] = [room for room in shapely.get_parts(space).tolist() if room.area > 0]
        self.graph: nx.Graph[int] = nx.Graph()
        self.hubs: set[int] = set()
        self._numbers = count()

    def add(self, at: XY, clear: float = 0.0, fixed: bool = False, elevator: str = "", given_name: str = "") -> int:
        """Add a node and return its number. The default clearance is the radius."""
        number = next(self._numbers)
        self.graph.add_node(
            number, at=at, clear=clear or self.radius, fixed=fixed, elevator=elevator, given_name=given_name
        )
        return number

    def at(self, node: int) -> XY:
        """Position of a node [m]."""
        return self.graph.nodes[node]["at"]

    def clearance_m(self, node: int) -> float:
        """Approximate clearance of a node [m]."""
        return self.graph.nodes[node]["clear"]

    def is_fixed(self, node: int) -> bool:
        """Whether a node must keep its position."""
        return self.graph.nodes[node]["fixed"]

    def elevator(self, node: int) -> str:
        """Name of the elevator whose cabin holds the node, or an empty string."""
        return self.graph.nodes[node]["elevator"]

    def given_name(self, node: int) -> str:
        """Name of a given node, or an empty string."""
        return self.graph.nodes[node]["given_name"]

    def length(self, a: int, b: int) -> float:
        """Distance of two nodes [m]."""
        return math.dist(self.at(a), self.at(b))

    def lines(self) -> tuple[list[tuple[int, int]], STRtree]:
        """All edges, and a tree of their lines in the same order."""
        edges = list(self.graph.edges)
        ends = np.array([(self.at(a), self.at(b)) for a, b in edges]).reshape(-1, 2, 2)
        return edges, STRtree(shapely.linestrings(ends))

    def is_free(self, *points: XY) -> bool:
        """Whether the convex hull of points is free."""
        self.check_time()
        return bool(shapely.covers(self.space, shapely.convex_hull(shapely.multipoints(points))))

    def can_move(self, node: int, to: XY, but: int = -1) -> bool:
        """Whether a node can move to a point: its edges, except that to `but`, sweep free space only."""
        return all(self.is_free(self.at(node), to, self.at(n)) for n in self.graph[node] if n != but)


def midpoint(a: XY, b: XY) -> XY:
    """The midpoint of two points."""
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


def distance_to_segment_m(points: Array, a: Array, b: Array) -> Array:
    """Distances (n,) from points (n, 2) to the segment from a to b [m]."""
    along = b - a
    square = float(along @ along)
    share = np.clip((points - a) @ along / square, 0, 1) if square else np.zeros(len(points))
    return np.hypot(*(points - a - share[:, None] * along).T)
