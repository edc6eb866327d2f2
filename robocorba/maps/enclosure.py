"""Whether obstacles enclose a point, so that a robot of a given radius can't leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from robocorba.maps.collisions import TOUCH_M
from robocorba.maps.geometry import Obstacle
from robocorba.spatial.pose import XY

#: Half side of the window around a point [m]. A robot that reaches its border counts as not enclosed. A larger
#: window finds larger enclosures; its cost grows with its square.
WINDOW_M = 30.0


class Enclosures:
    """The enclosed regions of a floor for a robot of `radius_m`. A region that contains one of the `anchors`
    (n, 2) is not enclosed."""

    def __init__(self, found: Sequence[Obstacle], radius_m: float, anchors: NDArray[np.float64]) -> None:
        self._tree = STRtree([item.geometry for item in found])
        self._growth_m = max(radius_m - TOUCH_M, 0.0)
        self._anchors = anchors
        self._known: list[tuple[Polygon, bool]] = []

    def is_enclosed(self, place: XY) -> bool:
        """Whether a robot at `place` reaches neither an anchor nor the border of the window."""
        for part, is_enclosed in self._known:
            if shapely.intersects_xy(part, *place):
                return is_enclosed
        window = shapely.box(*(at - WINDOW_M for at in place), *(at + WINDOW_M for at in place))
        near = self._tree.query(window, predicate="dwithin", distance=self._growth_m)
        # Chords within the arcs approximate round corners, so a gap appears up to 1 % wider.
        space = window.difference(shapely.union_all(shapely.buffer(self._tree.geometries[near], self._growth_m)))
        parts = shapely.get_parts(space)
        local = parts[shapely.dwithin(parts, shapely.Point(place), TOUCH_M)]
        if not len(local):
            return True
        part = local[0]
        shapely.prepare(part)
        is_open = shapely.dwithin(part, window.exterior, TOUCH_M) or shapely.intersects_xy(part, self._anchors).any()
        self._known.append((part, not is_open))
        return not is_open
