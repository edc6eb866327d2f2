"""Additional nodes on the edges, so that nearly every free point has a node in line of sight."""

from __future__ import annotations

import math

import networkx as nx
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Point, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.topology.roadmap import SAME_POINT_M, Array, RoadmapGraph


def add_coverage_nodes(roadmap: RoadmapGraph) -> None:
    """Add nodes on the edges until 99 % of about 2,000 free points see one.

    Both figures are choices of this project, between niches out of sight and time."""
    points = _grid(roadmap.space, 2000)
    unseen = points[~_sees_any(roadmap, points, list(roadmap.graph))]
    edges, tree = roadmap.lines()
    added: dict[tuple[int, int], list[int]] = {}
    while len(unseen) > 0.01 * len(points) and edges:
        sample, unseen = unseen[0], unseen[1:]
        for i in _nearest(tree, sample):
            line = tree.geometries[i]
            foot = line.interpolate(line.project(Point(sample)))
            apart = min(math.dist((foot.x, foot.y), roadmap.at(end)) for end in edges[i])
            if apart > SAME_POINT_M and roadmap.is_free((foot.x, foot.y), tuple(sample)):
                node = roadmap.add((foot.x, foot.y))
                added.setdefault(edges[i], []).append(node)
                unseen = unseen[~_sees_any(roadmap, unseen, [node])]
                break
    for (a, b), nodes in added.items():
        roadmap.graph.remove_edge(a, b)
        nx.add_path(roadmap.graph, [a, *sorted(nodes, key=lambda node: roadmap.length(a, node)), b])


def _grid(space: BaseGeometry, most: int) -> Array:
    """Free points on a regular grid: about `most`, at most four per square metre; fewer where the space is so small a
    share of its bounding box that this would have more than 100,000 points."""
    x0, y0, x1, y1 = space.bounds
    pitch = max(0.5, math.sqrt(space.area / most), math.sqrt((x1 - x0) * (y1 - y0) / 100_000))
    x, y = np.meshgrid(np.arange(x0 + pitch / 2, x1, pitch), np.arange(y0 + pitch / 2, y1, pitch))
    points = np.column_stack([x.ravel(), y.ravel()])
    return points[shapely.contains_xy(space, points)]


def _nearest(tree: STRtree, sample: Array) -> list[int]:
    """The 12 edges nearest to a point, the nearest first: others are hardly ever in sight."""
    off = shapely.distance(tree.geometries, Point(sample))
    return np.argsort(off, kind="stable")[:12].tolist()


def _sees_any(roadmap: RoadmapGraph, points: Array, nodes: list[int]) -> NDArray[np.bool_]:
    """Which of the points (n, 2) see one of their 16 nearest nodes."""
    seen = np.zeros(len(points), dtype=bool)
    if len(points) == 0 or not nodes:
        return seen
    at = np.array([roadmap.at(node) for node in nodes])
    count = min(len(at), 16)
    _, nearest = cKDTree(at).query(points, k=[*range(1, count + 1)])
    for rank in range(count):
        todo = np.flatnonzero(~seen)
        lines = shapely.linestrings(np.stack([points[todo], at[nearest[todo, rank]]], axis=1))
        seen[todo] = shapely.covers(roadmap.space, lines)
    return seen
