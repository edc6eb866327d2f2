"""Reads maps of the ROS map_server: a YAML file and a picture of one floor.

The outline is the rectangle around the known space. Its occupied and unknown cells become
solid polygon objects.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robocorba.errors.maps import MapFileError
from robocorba.maps.formats.grid import MAX_SIDES, OCCUPIED, count_sides
from robocorba.maps.formats.ros_picture import MapServerSettings, read_cells, read_settings
from robocorba.maps.formats.ros_space import SPECKS, FloorCells, crop_to_floor, remove_specks
from robocorba.maps.formats.solids import solids
from robocorba.maps.formats.yaml_item import Item
from robocorba.maps.losses import Imported, Losses, remove_invalid_elements
from robocorba.maps.model import Building, Floor, FloorMap, GeometricalMap, MapObject, PolygonShape
from robocorba.maps.yaml_file import YamlFile

FORMAT = "ros"
#: Interpretations of unknown cells.
UNKNOWN_AS = ("blocked", "free")
#: Height of objects from a picture [m]: that of a wall, since a picture has no heights.
_HEIGHT_M = 2.5


class RosOptions(NamedTuple):
    """Options for reading pictures: `unknown` is one of UNKNOWN_AS, `specks` one of SPECKS."""

    unknown: str = "blocked"
    specks: str = "walls"

    def check(self, path: str) -> None:
        """Raise MapFileError if a value is not supported."""
        for name, value, allowed in (("unknown", self.unknown, UNKNOWN_AS), ("specks", self.specks, SPECKS)):
            if value not in allowed:
                raise MapFileError(path, 0, name, f"{value!r} is not supported; {', '.join(allowed)} are")


def is_ros_map(data: Any) -> bool:
    """Whether parsed YAML looks like a map_server file."""
    return isinstance(data, dict) and "image" in data and "resolution" in data


def read(file: YamlFile, options: RosOptions) -> Imported:
    """The building of one floor that a map_server file and its picture show. Raises MapFileError with line and key."""
    losses = Losses()
    root = Item(file, "$", file.data)
    settings = read_settings(root)
    cells = read_cells(root, settings, options.unknown == "free", losses)
    name = "".join(letter if letter.isprintable() and letter not in ":/" else "_" for letter in Path(file.name).stem)
    floor = Floor(name=name[:80] or "map", level=0, elevation=0.0)
    entry = floor_map(floor, cells, settings, options, root.need("image"), losses)
    building = Building(floor.name, {floor.name: entry})
    return Imported(remove_invalid_elements(building, losses, file), FORMAT, losses.sentences())


def floor_map(
    floor: Floor, cells: np.ndarray, settings: MapServerSettings, options: RosOptions, image: Item, losses: Losses
) -> FloorMap:
    """The floor with the outline and the solid objects that its cells show. Raises MapFileError at `image`."""
    cells = remove_specks(cells, settings, options.specks, losses)
    space = crop_to_floor(cells, settings, losses)
    if count_sides(space.blocked) > MAX_SIDES:
        raise image.error(f"the cells are scattered: their contours have more than {MAX_SIDES} sides")
    rows, columns = space.blocked.shape
    corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) + space.corner
    losses.add(f"shapes follow the cells of {settings.resolution:g} m and exceed them by at most half a cell")
    losses.add("a picture has no nodes, doors, heights or names, so none are imported")
    return FloorMap(
        Floor(
            name=floor.name,
            level=floor.level,
            elevation=floor.elevation,
            height=floor.height,
            outline=settings.to_map_frame(corners),
        ),
        GeometricalMap(objects=_objects(space, settings)),
    )


def _objects(space: FloorCells, settings: MapServerSettings) -> dict[str, MapObject]:
    """The blocked regions as objects: `block1`... with occupied cells, `unknown1`... with unknown cells only."""
    found, regions = solids(space.blocked)
    occupied = set(np.unique(regions[space.blocked & (space.cells == OCCUPIED)]).tolist())
    counts = {"block": 0, "unknown": 0}
    objects: dict[str, MapObject] = {}
    for solid in found:
        kind = "block" if solid.region in occupied else "unknown"
        counts[kind] += 1
        points = settings.to_map_frame(solid.points + space.corner)
        x, y = points[0]
        shape = PolygonShape(points=tuple((px - x, py - y) for px, py in points))
        name = f"{kind}{counts[kind]}"
        objects[name] = MapObject(name=name, shape=shape, at=(x, y), height=_HEIGHT_M)
    return objects
