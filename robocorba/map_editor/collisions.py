"""Collisions of path nodes and path edges with obstacles.

Walls, objects and locked doors can change: they block nodes and edges until they are removed.
Shafts and outlines are the structure of the building, which no path crosses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, STRtree

from robocorba.errors.maps import InvalidElement, describe
from robocorba.errors.places import near
from robocorba.map_editor.derived import Derived
from robocorba.map_editor.geometry import Obstacle, obstacles
from robocorba.map_editor.model import KIND_OF, Building, PathEdge, PathNode, TopologicalMap
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.vicinity import Box

#: A node closer than this to an obstacle collides with it [m].
TOUCH_M = 1e-3
#: Obstacle kinds of the building's structure.
STRUCTURAL_KINDS = ("elevator", "floor")

#: Type and name of a node or edge, kind and name of an obstacle.
Pair = tuple[type, str, str, str]


class PathArrays:
    """Nodes and edges as arrays: `at` (n, 2) and `ends` (m, 2, 2) [m]. Edges with an unknown node are omitted."""

    def __init__(self, nodes: Iterable[PathNode], edges: Iterable[PathEdge], known: dict[str, PathNode]) -> None:
        self.nodes = list(nodes)
        self.edges = [edge for edge in edges if edge.a in known and edge.b in known]
        self.at = np.array([node.at for node in self.nodes], dtype=float).reshape(-1, 2)
        ends = [(*known[edge.a].at, *known[edge.b].at) for edge in self.edges]
        self.ends = np.array(ends, dtype=float).reshape(-1, 2, 2)
        self._node_columns = np.ascontiguousarray(self.at.T)
        a, b = self.ends[:, 0].T, self.ends[:, 1].T
        self._low, self._high = np.ascontiguousarray(np.minimum(a, b)), np.ascontiguousarray(np.maximum(a, b))

    def box(self) -> Box:
        """The bounding box, grown by TOUCH_M. Requires a node or an edge."""
        points = np.concatenate([self.at, self.ends.reshape(-1, 2)])
        low, high = points.min(axis=0) - TOUCH_M, points.max(axis=0) + TOUCH_M
        return Box(float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    def within(self, box: Box) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the nodes and of the edges that can reach into `box`."""
        nodes = _overlapping(self._node_columns, self._node_columns, box)
        return nodes, _overlapping(self._low, self._high, box)


def _overlapping(low: np.ndarray, high: np.ndarray, box: Box) -> np.ndarray:
    return np.flatnonzero((high[0] >= box.x0) & (low[0] <= box.x1) & (high[1] >= box.y0) & (low[1] <= box.y1))


_ALL_PATHS: Derived[TopologicalMap, PathArrays] = Derived()


def all_paths(topology: TopologicalMap) -> PathArrays:
    """All nodes and edges of a floor. Kept as long as the map."""
    nodes, edges = topology.nodes, topology.edges
    return _ALL_PATHS.of(topology, (nodes, edges), lambda: PathArrays(nodes.values(), edges.values(), nodes))


def obstacle_label(obstacle: Obstacle) -> str:
    """The name of an obstacle in messages."""
    kind, name, _ = obstacle
    if kind == "elevator":
        return f"the shaft of {describe('elevator', '', name)}"
    if kind == "floor":
        return "the outline of the floor"
    return describe("locked door" if kind == "door" else kind, "", name)


class Collision(NamedTuple):
    """A node or an edge of `floor` that lies on an obstacle. `line` holds the ends of the edge [m]."""

    floor: str
    element: PathNode | PathEdge
    obstacle: Obstacle
    line: tuple[XY, XY] | None

    @property
    def is_structural(self) -> bool:
        """Whether it breaks a rule of the building, rather than being a temporary blockage."""
        return self.obstacle.kind in STRUCTURAL_KINDS

    @property
    def pair(self) -> Pair:
        """The identity of both sides, independent of their shapes."""
        return type(self.element), self.element.name, self.obstacle.kind, self.obstacle.name

    @property
    def cause(self) -> str:
        """The name of the obstacle in messages."""
        return obstacle_label(self.obstacle)

    def at(self) -> XY:
        """A common point of both [m]."""
        if isinstance(self.element, PathNode):
            return self.element.at
        spot = self.obstacle.geometry.intersection(LineString(self.line)).representative_point()
        return spot.x, spot.y

    @property
    def reason(self) -> str:
        """How the node or edge collides, and where."""
        if isinstance(self.element, PathNode):
            inside = self.obstacle.geometry.geom_type == "Polygon"
            return f"it stands {'inside' if inside else 'on'} {self.cause}"
        x, y = self.at()
        return f"it leads through {self.cause} {near(x, y)}"

    def error(self) -> InvalidElement:
        """The collision as a broken rule."""
        return InvalidElement(KIND_OF[type(self.element)].value, self.floor, self.element.name, self.reason)


def collisions(floor: str, paths: PathArrays, found: Sequence[Obstacle]) -> Iterator[Collision]:
    """The collisions of nodes and edges with the obstacles in `found`."""
    if not found:
        return
    tree = STRtree([item.geometry for item in found])
    x0, y0, x1, y1 = shapely.total_bounds(tree.geometries)
    nodes, edges = paths.within(Box(x0 - TOUCH_M, y0 - TOUCH_M, x1 + TOUCH_M, y1 + TOUCH_M))
    hits = tree.query(shapely.points(paths.at[nodes]), predicate="dwithin", distance=TOUCH_M)
    for index, hit in hits.T:
        yield Collision(floor, paths.nodes[nodes[index]], found[hit], None)
    hits = tree.query(shapely.linestrings(paths.ends[edges]), predicate="intersects")
    for index, hit in hits.T:
        (ax, ay), (bx, by) = paths.ends[edges[index]].tolist()
        yield Collision(floor, paths.edges[edges[index]], found[hit], ((ax, ay), (bx, by)))


def blockages(building: Building, floor: str) -> list[Collision]:
    """The nodes and edges of a floor that walls, objects and locked doors block. Raises KeyError if it is unknown."""
    found = [item for item in obstacles(building, floor) if item.kind not in STRUCTURAL_KINDS]
    return list(collisions(floor, all_paths(building.floors[floor].topological), found))
