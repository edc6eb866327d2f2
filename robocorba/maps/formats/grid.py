"""Occupancy grids: which cells are what, the contours of regions of cells, and lines and areas as cells.

Row 0 is the top row, as in an image. Contours come in cells from the lower left corner
of the grid, x right, y up.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.maps.element_rules import MAX_POINTS

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
#: Cells of the largest grid that is read or written (5792 x 5792).
MOST_CELLS = 2**25
#: Sides of cells between two kinds of cells that are followed: a map has far less, noise has more.
MOST_SIDES = 2**20
#: Contours may stray from the sides of the cells by half a cell.
TOLERANCE_CELLS = 0.5

_WEST, _SOUTH, _EAST, _NORTH = range(4)


class Contour(NamedTuple):
    """A closed line around a region: the middles of the sides that it passes, region on the left.

    `cell` is the (row, column) of a cell of the region beside it, `points` (n, 2)."""

    points: np.ndarray
    cell: tuple[int, int]

    @property
    def is_hole(self) -> bool:
        """Whether the region lies outside of the line."""
        x, y = self.points.T
        return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) < 0


def count_sides(region: np.ndarray) -> int:
    """How many sides of cells the contours of a region pass."""
    padded = np.pad(region, 1)
    across, down = padded[:, 1:] != padded[:, :-1], padded[1:] != padded[:-1]
    return int(np.count_nonzero(across)) + int(np.count_nonzero(down))


def contours(region: np.ndarray) -> list[Contour]:
    """The contours of a region of cells (bool, rows x columns); cells that meet at a corner belong together."""
    rows, columns = region.shape
    padded = np.pad(region, 1)
    inside = padded[1:-1, 1:-1]
    open_sides = [
        (_WEST, inside & ~padded[:-2, 1:-1], (0, 1)),
        (_SOUTH, inside & ~padded[1:-1, :-2], (0, 0)),
        (_EAST, inside & ~padded[2:, 1:-1], (1, 0)),
        (_NORTH, inside & ~padded[1:-1, 2:], (1, 1)),
    ]
    starts, headings, cells = [], [], []
    for way, sides, (down, right) in open_sides:
        r, c = np.nonzero(sides)
        starts.append((r + down) * (columns + 1) + c + right)
        headings.append(np.full(len(r), way))
        cells.append(r * columns + c)
    start, heading, cell = np.concatenate(starts), np.concatenate(headings), np.concatenate(cells)
    step = np.array([-1, columns + 1, 1, -(columns + 1)])[heading]
    after = _successors(start, heading, start + step)
    row, column = np.divmod(start, columns + 1)
    middle_x = column + np.array([-0.5, 0.0, 0.5, 0.0])[heading]
    middle_y = rows - row + np.array([0.0, -0.5, 0.0, 0.5])[heading]
    middles = np.column_stack([middle_x, middle_y])
    return [
        Contour(middles[ring], (int(cell[ring[0]]) // columns, int(cell[ring[0]]) % columns)) for ring in _rings(after)
    ]


def _successors(start: np.ndarray, heading: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The side that follows each: where four sides meet in a corner the right turn, which joins the two cells."""
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


def _rings(after: np.ndarray) -> list[list[int]]:
    """The cycles of a permutation."""
    follow, seen, rings = after.tolist(), bytearray(len(after)), []
    for first in range(len(follow)):
        if not seen[first]:
            ring, at = [], first
            while not seen[at]:
                seen[at] = 1
                ring.append(at)
                at = follow[at]
            rings.append(ring)
    return rings


def simplified(contour: Contour) -> np.ndarray:
    """The points of a contour with straight runs and steps of half a cell taken out: a closed line, (n, 2)."""
    points = contour.points
    far = int(np.argmax(np.abs(points - points[0]).sum(axis=1)))
    halves = shapely.linestrings(points[: far + 1]), shapely.linestrings(np.vstack([points[far:], points[:1]]))
    there, back = shapely.simplify(halves, TOLERANCE_CELLS, preserve_topology=False)
    return np.array([*there.coords[:-1], *back.coords])


def area(contour: Contour) -> shapely.Polygon:
    """What a contour encloses, as a simple polygon; its sides are simplified further where it had too many points."""
    exact = shapely.Polygon(contour.points)
    found, tolerance = exact.simplify(TOLERANCE_CELLS), TOLERANCE_CELLS
    while len(found.exterior.coords) > MAX_POINTS:
        tolerance *= 2
        found = exact.simplify(tolerance)
    return found if found.is_valid and found.area > 0 else exact


class Canvas:
    """A grid to draw on in metres; `origin` is its lower left corner."""

    def __init__(self, origin: tuple[float, float], cell_m: float, rows: int, columns: int) -> None:
        self.origin, self.cell_m = origin, cell_m
        self.cells = np.full((rows, columns), UNKNOWN, dtype=np.uint8)

    def fill(self, polygon: shapely.Polygon, value: int) -> None:
        """Set the cells whose middle an area covers.

        On the line through the middles of a row, every side of the area that is passed
        switches between outside and inside."""
        rows, columns = self.cells.shape
        switches = np.zeros((rows, columns + 1), np.uint8)
        for ring in (polygon.exterior, *polygon.interiors):
            for (x0, y0), (x1, y1) in pairwise(self._cells_of(np.array(ring.coords)).tolist()):
                low, high = (max(0, math.ceil(min(y0, y1) - 0.5)), min(rows, math.ceil(max(y0, y1) - 0.5)))
                passed = np.arange(low, high)
                x = x0 + (passed + 0.5 - y0) / (y1 - y0) * (x1 - x0) if high > low else np.zeros(0)
                switches[passed, np.clip(np.ceil(x - 0.5), 0, columns).astype(int)] ^= 1
        self.cells[np.bitwise_xor.accumulate(switches, axis=1)[:, :-1] == 1] = value

    def trace(self, line: BaseGeometry, value: int) -> None:
        """Set the cells that a line, or the border of an area, passes through."""
        for part in shapely.get_parts(line.boundary if line.geom_type == "Polygon" else line):
            n = max(2, int(np.ceil(part.length / self.cell_m * 4)) + 1)
            points = shapely.get_coordinates(part.interpolate(np.linspace(0.0, part.length, n)))
            columns, rows = np.floor(self._cells_of(points)).astype(int).T
            kept = (rows >= 0) & (rows < self.cells.shape[0]) & (columns >= 0) & (columns < self.cells.shape[1])
            self.cells[rows[kept], columns[kept]] = value

    def _cells_of(self, points: np.ndarray) -> np.ndarray:
        """Columns from the left and rows from the top, with fractions."""
        x = (points[:, 0] - self.origin[0]) / self.cell_m
        y = self.cells.shape[0] - (points[:, 1] - self.origin[1]) / self.cell_m
        return np.column_stack([x, y])
