"""Whether walls close a place off for a robot of some size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from robocorba.maps.collisions import TOUCH_M
from robocorba.maps.geometry import Obstacle
from robocorba.spatial.pose import XY

#: How far around a place its surroundings are looked at, m: what is open as far as this is not closed off.
#: More sees larger closed halls, and costs its square in obstacles.
LOOK_AROUND_M = 30.0


class Enclosures:
    """The closed-off places of a floor for a robot of `radius_m`; those from which it gets to one of `anchors`
    (n, 2) are not closed off."""

    def __init__(self, found: Sequence[Obstacle], radius_m: float, anchors: NDArray[np.float64]) -> None:
        self._tree = STRtree([item.geometry for item in found])
        self._grown_m = max(radius_m - TOUCH_M, 0.0)
        self._anchors = anchors
        self._known: list[tuple[Polygon, bool]] = []

    def close_off(self, place: XY) -> bool:
        """Whether a robot at `place` gets neither to an anchor nor out of its surroundings."""
        for part, is_closed in self._known:
            if shapely.intersects_xy(part, *place):
                return is_closed
        window = shapely.box(*(at - LOOK_AROUND_M for at in place), *(at + LOOK_AROUND_M for at in place))
        near = self._tree.query(window, predicate="dwithin", distance=self._grown_m)
        # Round corners are drawn as chords within the arc, so a gap is taken for up to 1 % wider than it is.
        space = window.difference(shapely.union_all(shapely.buffer(self._tree.geometries[near], self._grown_m)))
        parts = shapely.get_parts(space)
        mine = parts[shapely.dwithin(parts, shapely.Point(place), TOUCH_M)]
        if not len(mine):
            return True
        part = mine[0]
        shapely.prepare(part)
        is_open = shapely.dwithin(part, window.exterior, TOUCH_M) or shapely.intersects_xy(part, self._anchors).any()
        self._known.append((part, not is_open))
        return not is_open
