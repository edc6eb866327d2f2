"""A floor as an occupancy grid."""

from __future__ import annotations

import math
from collections.abc import Collection

import shapely

from robocorba.errors.maps import GridTooLarge
from robocorba.map_editor.formats.grid import FREE, MAX_CELLS, OCCUPIED, Canvas
from robocorba.map_editor.geometry import bounds, obstacles
from robocorba.map_editor.model import Building

#: Default side of a cell [m].
DEFAULT_RESOLUTION_M = 0.05


def floor_grid(building: Building, floor: str, resolution_m: float, without: Collection[str] = ()) -> Canvas:
    """What is free and occupied on a floor, in cells of `resolution_m`. without: names of its objects that are left
    out. Raises GridTooLarge."""
    x0, y0, x1, y1 = bounds(building, floor)
    columns, rows = math.ceil((x1 - x0) / resolution_m), math.ceil((y1 - y0) / resolution_m)
    if columns * rows > MAX_CELLS:
        raise GridTooLarge(f"{columns} x {rows} cells are too many, at most {MAX_CELLS} are possible")
    canvas = Canvas((x0, y0), resolution_m, rows, columns)
    outline = building.floors[floor].floor.outline
    canvas.fill(shapely.Polygon(outline) if outline else shapely.box(x0, y0, x1, y1), FREE)
    for item in obstacles(building, floor):
        if item.kind == "floor" or (item.kind == "object" and item.name in without):
            continue
        if item.geometry.geom_type == "Polygon":
            canvas.fill(item.geometry, OCCUPIED)
        canvas.trace(item.geometry, OCCUPIED)
    return canvas
