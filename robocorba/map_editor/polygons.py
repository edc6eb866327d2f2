"""Polygons in requests, and their validation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import shapely

from robocorba.errors.places import metres
from robocorba.map_editor.spatial.pose import XY

#: Maximum number of corners.
MAX_CORNERS = 1000
#: Maximum absolute value of a coordinate [m].
MAX_COORDINATE_M = 1e6

#: A floor, and the corners of a polygon on it [m].
FloorArea = tuple[str, tuple[XY, ...]]


def check_polygon(field: str, polygon: Sequence[XY], make_error: Callable[[str, str], Exception]) -> None:
    """Raise `make_error(field, reason)` unless `polygon` (corners in m) is a simple polygon within the limits."""
    if not 3 <= len(polygon) <= MAX_CORNERS:
        raise make_error(field, f"{len(polygon)} corners are not between 3 and {MAX_CORNERS}")
    for i, corner in enumerate(polygon):
        if not all(math.isfinite(value) and abs(value) <= MAX_COORDINATE_M for value in corner):
            raise make_error(f"{field}[{i}]", f"{corner} is not a point within {metres(MAX_COORDINATE_M)} m")
    shape = shapely.Polygon(polygon)
    if not shape.is_valid or shape.area == 0:
        raise make_error(field, f"not a simple polygon: {shapely.is_valid_reason(shape)}")
