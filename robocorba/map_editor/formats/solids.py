"""Covers regions of cells, with or without holes, by few simple polygons.

The polygons contain all cells and exceed them by at most half a cell. Coordinates are in cells from the lower left
corner of the grid, x right, y up; row 0 is the top row, as in an image. The region is on the left of a ring: outer
borders are counter-clockwise, holes clockwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

#: Maximum number of points of a polygon. The rules allow ten times as many, but queries near a place
#: process all points of each polygon that they find.
MAX_RING_POINTS = 1000
#: Connectivity of cells: those that share a side or a corner.
EIGHT_NEIGHBOURS = np.ones((3, 3), bool)
#: Unit steps west, south, east and north, the headings 0 to 3: x right, y up.
_STEPS = np.array([(-1, 0), (0, -1), (1, 0), (0, 1)])


class Solid(NamedTuple):
    """A simple polygon (n, 2) in cells from the lower left corner, and the number of its region."""

    points: np.ndarray
    region: int


def solids(blocked: np.ndarray, max_points: int = MAX_RING_POINTS) -> tuple[list[Solid], np.ndarray]:
    """Simple polygons whose union covers the blocked cells, and the region of each cell (0: none).

    A region with holes is cut along rows or columns through all holes. Pieces overlap by
    one row or column, so that there is no gap between them. A polygon has at most `max_points` points."""
    from scipy import ndimage

    labels, _ = ndimage.label(blocked, EIGHT_NEIGHBOURS)
    whole: list[Solid] = []
    to_cut: set[int] = set()
    for ring in rings(blocked):
        region = int(labels[ring.cell])
        if ring.is_hole or len(ring.points) > max_points:
            to_cut.add(region)
        whole.append(Solid(ring.points, region))
    found = [solid for solid in whole if solid.region not in to_cut]
    boxes = ndimage.find_objects(labels) if to_cut else []
    for region in sorted(to_cut):
        rows, columns = boxes[region - 1]
        corner = np.array([columns.start, blocked.shape[0] - rows.stop])
        found += [Solid(points + corner, region) for points in _pieces(labels[rows, columns] == region, max_points)]
    return found, labels


def _pieces(region: np.ndarray, max_points: int) -> Iterator[np.ndarray]:
    """Simple polygons of a region. Parts of a cut region are cut further, one by one."""
    borders = rings(region)
    holes = [ring for ring in borders if ring.is_hole]
    if not holes and all(len(ring.points) <= max_points for ring in borders):
        yield from (ring.points for ring in borders)
        return
    axis, cuts = _cuts(region.shape, holes)
    edges = [0, *cuts, region.shape[axis] - 1]
    for low, high in pairwise(edges):
        part = region[low : high + 1] if axis == 0 else region[:, low : high + 1]
        corner = np.array([0, region.shape[0] - 1 - high] if axis == 0 else [low, 0])
        for solid in solids(part, max_points)[0]:
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


class Ring(NamedTuple):
    """A closed line that does not touch itself: `points` (n, 2), and the (row, column) of a cell of its region."""

    points: np.ndarray
    cell: tuple[int, int]

    @property
    def is_hole(self) -> bool:
        """Whether the region is outside the ring."""
        x, y = self.points.T
        return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) < 0


def rings(region: np.ndarray) -> list[Ring]:
    """The borders of a region of cells (bool, rows x columns) and of its holes.

    Regions are 8-connected. A corner between two steps of one cell is bevelled, so that a
    diagonal staircase becomes a straight line along its outer corners. A bevel of half a cell
    joins two cells that meet at a corner. A passage that is one cell wide has no bevels, so
    that it keeps its width."""
    start, heading, cell = _sides(region)
    order, ring_of, firsts = _cycles(_successors(start, heading, region.shape[1]))
    before, _ = _neighbours(ring_of)
    heading_in, heading_out = heading[order][before], heading[order]
    turns = heading_in != heading_out
    row, column = np.divmod(start[order][turns], region.shape[1] + 1)
    at = np.column_stack([column, region.shape[0] - row]).astype(float)
    points, ring_of, touching = _bevelled(region, at, heading_in[turns], heading_out[turns], ring_of[turns])
    bounds = np.searchsorted(ring_of, np.arange(len(firsts) + 1))
    columns = region.shape[1]
    found = []
    for number, first in enumerate(firsts):
        inside = divmod(int(cell[first]), columns)
        ring = points[bounds[number] : bounds[number + 1]]
        for part in _without_touch(ring) if touching[number] else [ring]:
            found.append(Ring(part, inside))
    return found


def _sides(region: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cell sides on a border: index of the grid point where each starts, heading, index of its cell."""
    columns = region.shape[1]
    padded = np.pad(region, 1)
    inside = padded[1:-1, 1:-1]
    # The headings of the sides of a cell whose neighbour above, left, below or right is open, and where they start.
    open_sides = [
        (0, inside & ~padded[:-2, 1:-1], (0, 1)),
        (1, inside & ~padded[1:-1, :-2], (0, 0)),
        (2, inside & ~padded[2:, 1:-1], (1, 0)),
        (3, inside & ~padded[1:-1, 2:], (1, 1)),
    ]
    starts, headings, cells = [], [], []
    for heading, sides, (down, right) in open_sides:
        r, c = np.nonzero(sides)
        starts.append((r + down) * (columns + 1) + c + right)
        headings.append(np.full(len(r), heading))
        cells.append(r * columns + c)
    return np.concatenate(starts), np.concatenate(headings), np.concatenate(cells)


def _successors(start: np.ndarray, heading: np.ndarray, columns: int) -> np.ndarray:
    """The next side of each. Where four sides meet at a point, it turns right, which joins the two cells."""
    end = start + np.array([-1, columns + 1, 1, -(columns + 1)])[heading]
    key = start * 4 + heading
    order = np.argsort(key)
    known = key[order]
    after = np.full(len(start), -1)
    for turn in (1, 0, -1):
        wanted = end * 4 + (heading + turn) % 4
        at = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
        found = known[at] == wanted if len(known) else np.zeros(0, bool)
        after[found] = order[at[found]]
    return after


def _cycles(after: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """The cycles of a permutation: its elements, cycle after cycle; the cycle of each; the first of each cycle."""
    follow, seen = after.tolist(), bytearray(len(after))
    order: list[int] = []
    firsts: list[int] = []
    lengths: list[int] = []
    for first in range(len(follow)):
        if not seen[first]:
            before, at = len(order), first
            while not seen[at]:
                seen[at] = 1
                order.append(at)
                at = follow[at]
            firsts.append(first)
            lengths.append(len(order) - before)
    return np.array(order, int), np.repeat(np.arange(len(firsts)), lengths), firsts


def _neighbours(ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the previous and next element of each, in consecutive rings."""
    index = np.arange(len(ring))
    before, after = index - 1, index + 1
    first = np.flatnonzero(np.diff(ring, prepend=-1))
    last = np.flatnonzero(np.diff(ring, append=-1))
    before[first], after[last] = last, first
    return before, after


def _bevelled(
    region: np.ndarray, at: np.ndarray, heading_in: np.ndarray, heading_out: np.ndarray, ring: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and their rings after bevelling, and for each ring whether cells may still touch at a corner.

    at, heading_in, heading_out, ring: position (n, 2) of the corners of all rings, ring after ring, the headings before
    and after them, and the index of the ring."""
    before, after = _neighbours(ring)
    way_in, way_out = _STEPS[heading_in], _STEPS[heading_out]
    turn, left, right = (heading_out - heading_in) % 4, 1, 3
    unit_in = np.abs(at - at[before]).sum(axis=1) == 1
    unit_out = np.abs(at[after] - at).sum(axis=1) == 1

    # The cell in the corner and the three cells beyond it; all four are open unless the passage is narrow.
    notch = at + (way_out - way_in) / 2
    wide = ~(
        _is_region(region, notch - way_in)
        | _is_region(region, notch + way_out)
        | _is_region(region, notch - way_in + way_out)
    )
    inner = (turn == right) & wide
    step = inner & unit_in & unit_out & (turn[before] == left) & (turn[after] == left)
    meeting = (turn == right) & ~_is_region(region, at + (way_in - way_out) / 2)
    joined = inner & meeting & ~step

    copies = np.where(step, 0, np.where(joined, 2, 1))
    which = np.repeat(np.arange(len(at)), copies)
    points, ring_of = at[which], ring[which]
    second = np.flatnonzero(np.diff(which, prepend=-1) == 0)
    points[second] += way_out[which[second]] / 2
    points[second - 1] -= way_in[which[second]] / 2

    touching = np.zeros(int(ring[-1]) + 1 if len(ring) else 0, bool)
    touching[ring[meeting & ~step & ~joined]] = True
    kept = ~_is_straight(points, ring_of)
    return points[kept], ring_of[kept], touching


def _is_region(region: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Whether the cells with these centres belong to the region, as do all cells beyond the grid."""
    rows, columns = region.shape
    column, row = np.floor(middles[:, 0]).astype(int), rows - 1 - np.floor(middles[:, 1]).astype(int)
    beyond = (row < 0) | (row >= rows) | (column < 0) | (column >= columns)
    return beyond | region[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


def _is_straight(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Which points lie on the straight line between their neighbours."""
    before, after = _neighbours(ring)
    way_in, way_out = points - points[before], points[after] - points
    return way_in[:, 0] * way_out[:, 1] == way_in[:, 1] * way_out[:, 0]


def _without_touch(points: np.ndarray) -> Iterator[np.ndarray]:
    """The parts of a ring, cut at points that it passes twice."""
    path: list[tuple[float, float]] = []
    index: dict[tuple[float, float], int] = {}
    for x, y in points.tolist():
        here = (x, y)
        if here in index:
            first = index[here]
            yield np.array(path[first:])
            for other in path[first:]:
                del index[other]
            del path[first:]
        index[here] = len(path)
        path.append(here)
    yield np.array(path)
