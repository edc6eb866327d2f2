"""Polygons that somebody asks with, and what they have to be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import shapely

from robocorba.spatial.pose import XY

MOST_CORNERS = 1000
#: No coordinate is farther from 0, m.
FARTHEST_M = 1e6

#: A floor, and the corners of a polygon on it, m.
FloorArea = tuple[str, tuple[XY, ...]]


def check_polygon(field: str, polygon: Sequence[XY], refuse: Callable[[str, str], Exception]) -> None:
    """Raise what `refuse` makes of a field and a reason unless it is a simple polygon; corners in m."""
    if not 3 <= len(polygon) <= MOST_CORNERS:
        raise refuse(field, f"{len(polygon)} corners are not between 3 and {MOST_CORNERS}")
    for i, corner in enumerate(polygon):
        if not all(math.isfinite(value) and abs(value) <= FARTHEST_M for value in corner):
            raise refuse(f"{field}[{i}]", f"{corner} is not a point within {FARTHEST_M:g} m")
    shape = shapely.Polygon(polygon)
    if not shape.is_valid or shape.area == 0:
        raise refuse(field, f"not a simple polygon: {shapely.is_valid_reason(shape)}")
