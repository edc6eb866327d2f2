"""The obstacles of a floor that sensors see: walls, doors, objects and robots."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import build_grid, cell_starts, column_of, frame_over, row_of, segments_of
from robocorba.simulation.sensing.casting import ObstacleGrids, cast
from robocorba.simulation.sensing.fan import Fan
from robocorba.system.kernels import inner_kernel, kernel

#: Number in place of a robot's for a sensor that is not mounted on a robot.
NO_ROBOT = -1


class VisibleObstacles:
    """What sensors see on a floor: static obstacles, robots (discs), movable objects and doors (segments).

    An update replaces `grids` as a whole; a running scan continues with the previous ones."""

    grids: ObstacleGrids

    def __init__(self, obstacles: Sequence[BaseGeometry] = ()) -> None:
        self._static = self._moving = self._discs = np.empty((0, 4))
        self.set_static(obstacles)

    def set_static(self, obstacles: Sequence[BaseGeometry]) -> None:
        """Replace the static obstacles: lines and polygons."""
        self._static = border_segments(obstacles)
        self._rebuild()

    def set_moving(self, discs: Floats, segments: Floats | None = None) -> None:
        """Replace the robots, discs (n, 4) of x, y, radius [m] and number, and the moving segments (n, 4) of x, y, x, y
        [m], which stay unchanged for None."""
        self._discs = np.ascontiguousarray(discs, float).reshape(-1, 4)
        if segments is not None:
            self._moving = np.ascontiguousarray(segments, float).reshape(-1, 4)
        static, moving = self.grids.static, self.grids.moving
        is_covered, start, items = discs_by_cell(self._discs, static.frame)
        if segments is not None:
            low, cell_m, cells = static.frame[:2], static.frame[2], static.frame[3:]
            ends = self._moving.reshape(-1, 2)
            is_covered = is_covered and bool(((ends >= low) & (ends < low + cells * cell_m)).all())
            moving = build_grid(self._moving, static.frame)
        if is_covered:
            self.grids = ObstacleGrids(static, moving, self._discs, start, items)
        else:
            self._rebuild()

    def scan(self, poses: Floats, fan: Fan, own_robots: Sequence[int] | Longs | None = None) -> Floats:
        """Distances without noise [m], shape (sensors, rays), at most the fan's range.

        poses: (sensors, 3) of x, y [m], heading [rad]. own_robots: numbers of the robots that the sensors are mounted
        on, which the scans ignore."""
        numbers = np.full(len(poses), NO_ROBOT) if own_robots is None else np.asarray(own_robots, np.int64)
        sensors = np.ascontiguousarray(poses, float).reshape(-1, 3)
        rays = fan.rays
        return cast(self.grids, sensors, numbers, *rays, fan.first_rad, fan.step_rad, fan.range_m)

    def _rebuild(self) -> None:
        """Rebuild the grid around all obstacles."""
        x, y, radius, _ = self._discs.T
        boxes = np.column_stack([x - radius, y - radius, x + radius, y + radius])
        corners = [self._static, self._moving, boxes]
        everything = np.concatenate([part for part in corners if len(part)] or [np.zeros((1, 4))])
        low, high = everything.reshape(-1, 2).min(axis=0), everything.reshape(-1, 2).max(axis=0)
        margin_m = 5.0  # around all obstacles: the grid is rebuilt only for a body that moves beyond it
        frame = frame_over(np.array([[*(low - margin_m), *(high + margin_m)]]), self._cell_m(high - low))
        _, start, items = discs_by_cell(self._discs, frame)
        static, moving = build_grid(self._static, frame), build_grid(self._moving, frame)
        self.grids = ObstacleGrids(static, moving, self._discs, start, items)

    def _cell_m(self, extent: Floats) -> float:
        """The side of a cell [m], 1 to 8, so that it has 4 static segments on average."""
        width, depth = np.maximum(extent, 1.0)
        return min(max(math.sqrt(4.0 * width * depth / max(1, len(self._static))), 1.0), 8.0)


@kernel
def discs_by_cell(discs: Floats, frame: Floats) -> tuple[bool, Longs, Longs]:
    """Whether a frame covers all discs (n, 4) of x, y, radius, number; start and items of a grid over them."""
    count = np.zeros(int(frame[3]) * int(frame[4]), np.int64)
    x1, y1 = frame[0] + frame[3] * frame[2], frame[1] + frame[4] * frame[2]
    is_covered = True
    for disc in range(len(discs)):
        x, y, radius, _ = discs[disc]
        if x - radius < frame[0] or x + radius >= x1 or y - radius < frame[1] or y + radius >= y1:
            is_covered = False
    _fill_discs(discs, frame, count, np.empty(0, np.int64))
    start = cell_starts(count)
    items = np.empty(start[-1], np.int64)
    _fill_discs(discs, frame, start[:-1].copy(), items)
    return is_covered, start, items


@inner_kernel
def _fill_discs(discs: Floats, frame: Floats, position: Longs, items: Longs) -> None:
    """Count the discs of each cell (items empty), or write them from `position` on."""
    columns = int(frame[3])
    for disc in range(len(discs)):
        x, y, radius, _ = discs[disc]
        for row in range(row_of(frame, y - radius), row_of(frame, y + radius) + 1):
            for column in range(column_of(frame, x - radius), column_of(frame, x + radius) + 1):
                cell = row * columns + column
                if items.shape[0]:
                    items[position[cell]] = disc
                position[cell] += 1


def border_segments(shapes: Sequence[BaseGeometry]) -> Floats:
    """Lines and polygon borders as segments (n, 4) of x, y, x, y [m]; skips empty shapes."""
    kept = [shape for shape in shapes if not shape.is_empty]
    return np.ascontiguousarray(segments_of(np.array(kept, object))[0]) if kept else np.empty((0, 4))
