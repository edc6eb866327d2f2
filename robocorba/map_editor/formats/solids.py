"""Covers regions of cells, with or without holes, by few simple polygons.

The polygons contain all cells and exceed them by at most half a cell. Coordinates are in cells from the lower left
corner of the grid, x right, y up; row 0 is the top row, as in an image. Borders are counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import shapely

#: Maximum number of points of a polygon. The rules allow ten times as many, but queries near a place
#: process all points of each polygon that they find.
MAX_RING_POINTS = 1000
#: Connectivity of cells: those that share a side or a corner.
EIGHT_NEIGHBOURS = np.ones((3, 3), bool)


class Solid(NamedTuple):
    """A simple polygon (n, 2) in cells from the lower left corner, and the number of its region."""

    points: np.ndarray
    region: int


def solids(blocked: np.ndarray, max_points: int = MAX_RING_POINTS) -> tuple[list[Solid], np.ndarray]:
    """Simple polygons whose union covers the blocked cells, and the region of each cell (0: none).

    A polygon with holes is cut along columns or rows through them. Pieces overlap by one column or row, so that there
    is no gap between them. A polygon has at most `max_points` points."""
    from scipy import ndimage

    labels, _ = ndimage.label(blocked, EIGHT_NEIGHBOURS)
    found = []
    for polygon in _polygons(shapely.union_all(np.concatenate([_runs(blocked), _bevels(blocked)]))):
        x, y = min(polygon.exterior.coords, key=lambda point: point[::-1])  # the lower left corner of a cell
        region = int(labels[len(labels) - 1 - int(y), int(x)])
        found += [Solid(points, region) for points in _pieces(polygon, max_points)]
    return found, labels


def _runs(blocked: np.ndarray) -> np.ndarray:
    """The rectangles (n,) of consecutive blocked cells of a row."""
    sides = np.diff(np.pad(blocked.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(sides == 1)
    _, end = np.nonzero(sides == -1)
    y = len(blocked) - row
    return np.asarray(shapely.box(first, y - 1, end, y))


def _bevels(blocked: np.ndarray) -> np.ndarray:
    """Triangles (n,) in the open cells at concave corners. Between two sides of one cell, so that a diagonal staircase
    becomes a straight line along its outer corners; of half a cell where two cells meet at a corner, which joins them.
    A passage that is one cell wide has none, so that it keeps its width."""
    padded = np.pad(blocked, 1, constant_values=True)
    rows, columns = blocked.shape

    def is_blocked(right: int, up: int) -> np.ndarray:
        """Whether the neighbour of each cell is blocked, as all cells beyond the grid are."""
        return np.asarray(padded[1 - up : 1 - up + rows, 1 + right : 1 + right + columns])

    triangles = []
    for right, up in product((-1, 1), (-1, 1)):  # away from the corner
        corner = is_blocked(-right, 0) & is_blocked(0, -up)
        wide = corner & ~(blocked | is_blocked(right, 0) | is_blocked(0, up) | is_blocked(right, up))
        step = wide & ~is_blocked(-right, up) & ~is_blocked(right, -up)
        meeting = wide & ~step & ~is_blocked(-right, -up)
        for cells, size in ((step, 1.0), (meeting, 0.5)):
            row, column = np.nonzero(cells)
            x, y = column + (right < 0), rows - row - (up > 0)
            points = np.stack([(x, y), (x + size * right, y), (x, y + size * up)]).transpose(2, 0, 1)
            triangles.append(np.asarray(shapely.polygons(points)))
    return np.concatenate(triangles)


def _pieces(polygon: shapely.Polygon, max_points: int) -> Iterator[np.ndarray]:
    """Simple polygons (n, 2) of at most `max_points` points that cover a polygon."""
    points = shapely.get_coordinates(polygon.exterior)[:-1]
    if not polygon.interiors and len(points) <= max_points:
        yield points
        return
    low, high = np.reshape(polygon.bounds, (2, 2))
    axis, cuts = _cuts(low, high, np.array([hole.bounds for hole in polygon.interiors]))
    overlap = float(high[axis] - low[axis] > 2.0)
    for begin, end in pairwise([low[axis], *cuts, high[axis]]):
        first, last = low.copy(), high.copy()
        first[axis], last[axis] = begin, min(end + overlap, high[axis])
        for part in _polygons(polygon.intersection(shapely.box(*first, *last))):
            yield from _pieces(part, max_points)


def _cuts(low: np.ndarray, high: np.ndarray, holes: np.ndarray) -> tuple[int, list[float]]:
    """The axis along which to cut (0: x) and where: through each hole (n, 4), or through the middle without holes."""
    if not len(holes):
        axis = int(np.argmax(high - low))
        return axis, [np.floor((low[axis] + high[axis]) / 2)]
    by_axis = [_stabbing(np.floor(holes[:, axis]), np.ceil(holes[:, axis + 2]) - 1.0) for axis in (0, 1)]
    axis = 0 if len(by_axis[0]) <= len(by_axis[1]) else 1
    return axis, by_axis[axis]


def _stabbing(firsts: np.ndarray, lasts: np.ndarray) -> list[float]:
    """The smallest set of numbers with one in each range."""
    found: list[float] = []
    for number in np.argsort(lasts):
        if not found or found[-1] < firsts[number]:
            found.append(lasts[number])
    return found


def _polygons(shape: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """The polygons of a shape, without points on straight lines."""
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            # A ring begins at its lowest point, which is a corner.
            yield shapely.simplify(shapely.orient_polygons(shapely.normalize(part)), 0.0, preserve_topology=False)
