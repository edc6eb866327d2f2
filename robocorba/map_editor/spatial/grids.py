"""Line segments in a uniform grid: a query examines only the cells it touches.

Walls and objects become segments; planning queries distances to them, sensing casts rays at them. Robots are discs in
the same kind of grid (simulation/sensing/visible_obstacles.py).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.system.kernels import inner_kernel, kernel


class Grid(NamedTuple):
    """Segments (n, 4) of x, y, x, y [m], indexed by the cells that they touch: cell i holds the segments
    items[start[i]:start[i + 1]]. frame: x0, y0, cell size [m], columns, rows."""

    segments: Floats
    start: Longs
    items: Longs
    frame: Floats


def segments_of(shapes: NDArray[np.object_]) -> tuple[Floats, Longs]:
    """Segments (n, 4) of lines and polygon borders, multi-part or not, and the index of the shape of each segment."""
    is_polygon = np.isin(shapely.get_type_id(shapes), (shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON))
    parts, owner = shapely.get_parts(np.where(is_polygon, shapely.boundary(shapes), shapes), return_index=True)
    points, part = shapely.get_coordinates(parts, return_index=True)
    is_same_part = part[1:] == part[:-1]
    segments = np.hstack([points[:-1][is_same_part], points[1:][is_same_part]]).reshape(-1, 4)
    return segments, owner[part[:-1][is_same_part]].astype(np.int64)


def frame_over(segments: Floats, cell_m: float = 1.0) -> Floats:
    """Frame of a grid over segments (n, 4) with cells of `cell_m`, or larger so that there are about 250,000 at most,
    in 5,000 columns and rows at most."""
    if not len(segments):
        return np.array([0.0, 0.0, 1.0, 1.0, 1.0])
    xs, ys = segments[:, 0::2], segments[:, 1::2]
    x0, y0, x1, y1 = xs.min(), ys.min(), xs.max(), ys.max()
    width, depth = x1 - x0, y1 - y0
    cell = max(cell_m, math.sqrt(width * depth / 250_000), width / 5000, depth / 5000)
    return np.array([x0, y0, cell, float(int((x1 - x0) / cell) + 1), float(int((y1 - y0) / cell) + 1)])


def build_grid(segments: Floats, frame: Floats | None = None) -> Grid:
    """Grid in a frame, by default around the segments; segments beyond the frame go to the border cells."""
    frame = frame_over(segments) if frame is None else frame
    return Grid(segments, *segments_by_cell(segments, frame), frame)


@kernel
def segments_by_cell(segments: Floats, frame: Floats) -> tuple[Longs, Longs]:
    """start and items of a grid over segments, by counting sort: the first pass counts, the second fills in."""
    count = np.zeros(int(frame[3]) * int(frame[4]), np.int64)
    _fill_segments(segments, frame, count, np.empty(0, np.int64))
    start = cell_starts(count)
    items = np.empty(start[-1], np.int64)
    _fill_segments(segments, frame, start[:-1].copy(), items)
    return start, items


@kernel
def cell_starts(count: Longs) -> Longs:
    """Index of each cell's first item (cumulative counts), and the end of the last cell's items."""
    start = np.zeros(len(count) + 1, np.int64)
    for cell in range(len(count)):
        start[cell + 1] = start[cell] + count[cell]
    return start


@kernel
def column_of(frame: Floats, x: float) -> int:
    """Column of x, clamped to the grid."""
    return int(min(max((x - frame[0]) / frame[2], 0.0), frame[3] - 1.0))


@kernel
def row_of(frame: Floats, y: float) -> int:
    """Row of y, clamped to the grid."""
    return int(min(max((y - frame[1]) / frame[2], 0.0), frame[4] - 1.0))


@kernel
def span(ax: float, ay: float, bx: float, by: float, low: float, high: float) -> tuple[float, float]:
    """The x interval of the line from a to b within low <= y <= high; the line must meet that band."""
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    first, last = ax, bx
    if by > ay:
        slope = (bx - ax) / (by - ay)
        if ay < low:
            first = ax + (low - ay) * slope
        if by > high:
            last = ax + (high - ay) * slope
    return min(first, last), max(first, last)


@inner_kernel
def _fill_segments(segments: Floats, frame: Floats, position: Longs, items: Longs) -> None:
    """Count the segments of each cell (items empty), or write them from `position` on."""
    columns = int(frame[3])
    slack = 1e-9 * (1.0 + abs(frame[0]) + abs(frame[1]))
    for s in range(segments.shape[0]):
        ax, ay, bx, by = segments[s]
        for row in range(row_of(frame, min(ay, by) - slack), row_of(frame, max(ay, by) + slack) + 1):
            low = frame[1] + row * frame[2] - slack
            left, right = span(ax, ay, bx, by, low, low + frame[2] + 2 * slack)
            for column in range(column_of(frame, left - slack), column_of(frame, right + slack) + 1):
                cell = row * columns + column
                if items.shape[0]:
                    items[position[cell]] = s
                position[cell] += 1
