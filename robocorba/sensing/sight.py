"""A floor as its sensors see it: walls, objects, robots."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from shapely.geometry.base import BaseGeometry

from robocorba.grids import Floats, Grid, Longs, build_grid, frame_over, segments_of, sort_boxes
from robocorba.kernels import kernel
from robocorba.sensing.casting import Scene, cast
from robocorba.sensing.fan import Fan

#: Segments that a cell holds on average, and bounds of its side, m.
SEGMENTS_A_CELL = 4.0
SMALLEST_CELL_M, LARGEST_CELL_M = 1.0, 8.0
#: How far beyond the walls things may move before all is sorted anew, m.
MARGIN_M = 5.0
NOBODY = -1
NO_DISCS = np.empty((0, 4))


class Sight:
    """What stands on a floor, as lines and polygons, and what moves there.

    Both change by replacing what was there; a scan that has begun sees what there was."""

    #: What a scan sees now.
    scene: Scene

    def __init__(self, obstacles: Sequence[BaseGeometry] = ()) -> None:
        self._standing = self._moving = np.empty((0, 4))
        self._discs = NO_DISCS
        self.stand(obstacles)

    def stand(self, obstacles: Sequence[BaseGeometry]) -> None:
        """Replace what stands."""
        self._standing = lines_of(obstacles)
        self._sort()

    def move(self, discs: Floats, segments: Floats | None = None) -> None:
        """Replace the robots, discs (n, 4) of x, y, radius in m and a number; and what else comes and goes, segments
        (n, 4) of x, y, x, y in m, None for no change."""
        self._discs = np.ascontiguousarray(discs, float).reshape(-1, 4)
        if segments is not None:
            self._moving = np.ascontiguousarray(segments, float).reshape(-1, 4)
        if self._is_covered():
            self.scene = self._scene_of(self.scene.standing, segments is None)
        else:
            self._sort()

    def scan(self, poses: Floats, fan: Fan, owners: Sequence[int] | Longs | None = None) -> Floats:
        """Distances (poses, rays) in m, at most the fan's range; exact, without noise.

        poses: (m, 3) of the sensors, x and y in m, heading in rad. owners: numbers of the robots that carry them, which
        they don't see."""
        carriers = np.full(len(poses), NOBODY) if owners is None else np.asarray(owners, np.int64)
        places = np.ascontiguousarray(poses, float).reshape(-1, 3)
        rays = fan.rays
        return cast(self.scene, places, carriers, *rays, fan.first_rad, fan.step_rad, fan.range_m)

    def _sort(self) -> None:
        """Into a grid that covers all there is."""
        corners = [self._standing, self._moving, self._boxes()]
        everything = np.concatenate([part for part in corners if len(part)] or [np.zeros((1, 4))])
        low, high = everything.reshape(-1, 2).min(axis=0), everything.reshape(-1, 2).max(axis=0)
        frame = frame_over(np.array([[*(low - MARGIN_M), *(high + MARGIN_M)]]), self._cell_m(high - low))
        self.scene = self._scene_of(build_grid(self._standing, frame), False)

    def _scene_of(self, standing: Grid, same_objects: bool) -> Scene:
        frame = standing.frame
        moving = self.scene.moving if same_objects else build_grid(self._moving, frame)
        return Scene(standing, moving, self._discs, *sort_boxes(self._boxes(), frame))

    def _cell_m(self, extent: Floats) -> float:
        width, depth = np.maximum(extent, 1.0)
        side = math.sqrt(SEGMENTS_A_CELL * width * depth / max(1, len(self._standing)))
        return min(max(side, SMALLEST_CELL_M), LARGEST_CELL_M)

    def _boxes(self) -> Floats:
        return boxes_around(self._discs)

    def _is_covered(self) -> bool:
        return is_covered(self.scene.standing.frame, self._boxes()) and is_covered(
            self.scene.standing.frame, self._moving
        )


@kernel
def boxes_around(discs: Floats) -> Floats:
    """The rectangles (n, 4) around discs (n, 4) of x, y, radius and anything."""
    boxes = np.empty((len(discs), 4))
    for row in range(len(discs)):
        x, y, radius, _ = discs[row]
        boxes[row] = (x - radius, y - radius, x + radius, y + radius)
    return boxes


@kernel
def is_covered(frame: Floats, segments: Floats) -> bool:
    """Whether a grid's frame holds all ends of segments (n, 4)."""
    x0, y0 = frame[0], frame[1]
    x1, y1 = x0 + frame[3] * frame[2], y0 + frame[4] * frame[2]
    for row in range(len(segments)):
        ax, ay, bx, by = segments[row]
        if min(ax, bx) < x0 or max(ax, bx) >= x1 or min(ay, by) < y0 or max(ay, by) >= y1:
            return False
    return True


def lines_of(shapes: Sequence[BaseGeometry]) -> Floats:
    """The sides of shapes as segments (n, 4) of x, y, x, y."""
    kept = [shape for shape in shapes if not shape.is_empty]
    return np.ascontiguousarray(segments_of(np.array(kept, object))[0]) if kept else np.empty((0, 4))
