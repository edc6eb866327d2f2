"""Covers regions of cells, with or without holes, by few simple polygons."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from robocorba.maps.formats.rings import Ring, rings

#: Maximum number of points of a polygon. The rules allow ten times as many, but queries near a place
#: process all points of each polygon that they find.
MAX_RING_POINTS = 1000
#: Connectivity of cells: those that share a side or a corner.
EIGHT_NEIGHBOURS = np.ones((3, 3), bool)


class Solid(NamedTuple):
    """A simple polygon (n, 2) in cells from the lower left corner, and the number of its region."""

    points: np.ndarray
    region: int


def solids(blocked: np.ndarray) -> tuple[list[Solid], np.ndarray]:
    """Simple polygons whose union covers the blocked cells, and the region of each cell (0: none).

    A region with holes is cut along rows or columns through all holes. Pieces overlap by
    one row or column, so that there is no gap between them."""
    labels, _ = ndimage.label(blocked, EIGHT_NEIGHBOURS)
    whole: list[Solid] = []
    to_cut: set[int] = set()
    for ring in rings(blocked):
        region = int(labels[ring.cell])
        if ring.is_hole or len(ring.points) > MAX_RING_POINTS:
            to_cut.add(region)
        whole.append(Solid(ring.points, region))
    found = [solid for solid in whole if solid.region not in to_cut]
    places = ndimage.find_objects(labels) if to_cut else []
    for region in sorted(to_cut):
        rows, columns = places[region - 1]
        corner = np.array([columns.start, blocked.shape[0] - rows.stop])
        found += [Solid(points + corner, region) for points in _pieces(labels[rows, columns] == region)]
    return found, labels


def _pieces(region: np.ndarray) -> Iterator[np.ndarray]:
    """Simple polygons of a region. Parts of a cut region are cut further, one by one."""
    borders = rings(region)
    holes = [ring for ring in borders if ring.is_hole]
    if not holes and all(len(ring.points) <= MAX_RING_POINTS for ring in borders):
        yield from (ring.points for ring in borders)
        return
    axis, cuts = _cuts(region.shape, holes)
    edges = [0, *cuts, region.shape[axis] - 1]
    for low, high in pairwise(edges):
        part = region[low : high + 1] if axis == 0 else region[:, low : high + 1]
        corner = np.array([0, region.shape[0] - 1 - high] if axis == 0 else [low, 0])
        for solid in solids(part)[0]:
            yield solid.points + corner


def _cuts(shape: tuple[int, ...], holes: list[Ring]) -> tuple[int, list[int]]:
    """The axis (0: rows), and the rows or columns to cut: through each hole, or through the middle without holes."""
    if not holes:
        axis = 0 if shape[0] >= shape[1] else 1
        return axis, [shape[axis] // 2]
    ranges = []
    for ring in holes:
        (x0, y0), (x1, y1) = np.floor(ring.points.min(axis=0)), np.ceil(ring.points.max(axis=0))
        ranges.append(((shape[0] - y1, shape[0] - y0 - 1), (x0, x1 - 1)))
    by_axis = [_stabbing([span[axis] for span in ranges]) for axis in (0, 1)]
    axis = 0 if len(by_axis[0]) <= len(by_axis[1]) else 1
    return axis, by_axis[axis]


def _stabbing(spans: list[tuple[float, float]]) -> list[int]:
    """The smallest set of whole numbers with one in each span (first, last)."""
    found: list[int] = []
    for first, last in sorted(spans, key=lambda span: span[1]):
        if not found or found[-1] < first:
            found.append(int(last))
    return found
