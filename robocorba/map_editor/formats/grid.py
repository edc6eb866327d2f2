"""Occupancy grids, and rasterisation of lines and areas. Row 0 is the top row, as in an image."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
#: Maximum number of cells of a grid that is read or written (5792 x 5792).
MAX_CELLS = 2**25


class Canvas:
    """A grid to draw on in metres. `origin` is its lower left corner."""

    def __init__(self, origin: tuple[float, float], cell_m: float, rows: int, columns: int) -> None:
        self.origin, self.cell_m = origin, cell_m
        self.cells = np.full((rows, columns), UNKNOWN, dtype=np.uint8)

    def fill(self, polygon: shapely.Polygon, value: int) -> None:
        """Set the cells whose centre is inside an area (scan line algorithm with the even-odd rule)."""
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
        """Set the cells along a line or along the border of an area."""
        for part in shapely.get_parts(line.boundary if line.geom_type == "Polygon" else line):
            n = max(2, int(np.ceil(part.length / self.cell_m * 4)) + 1)
            points = shapely.get_coordinates(part.interpolate(np.linspace(0.0, part.length, n)))
            columns, rows = np.floor(self._cells_of(points)).astype(int).T
            kept = (rows >= 0) & (rows < self.cells.shape[0]) & (columns >= 0) & (columns < self.cells.shape[1])
            self.cells[rows[kept], columns[kept]] = value

    def _cells_of(self, points: np.ndarray) -> np.ndarray:
        """Fractional columns from the left and rows from the top."""
        x = (points[:, 0] - self.origin[0]) / self.cell_m
        y = self.cells.shape[0] - (points[:, 1] - self.origin[1]) / self.cell_m
        return np.column_stack([x, y])
