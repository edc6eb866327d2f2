"""Maps of the ROS map_server: a YAML file and a picture, one floor each.

Occupied cells become walls along their contours, solid blocks without a hole become
polygon objects as well, and so do unknown pockets inside the known space; the outline is
the border of the known space.
"""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from PIL import Image
from scipy import ndimage

from robocorba.maps.formats.grid import (
    FREE,
    MOST_CELLS,
    MOST_SIDES,
    OCCUPIED,
    UNKNOWN,
    Contour,
    area,
    contours,
    count_sides,
    simplified,
)
from robocorba.maps.formats.losses import Imported, Losses, settle
from robocorba.maps.formats.yaml_item import Item
from robocorba.maps.model import (
    XY,
    Building,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    PolygonShape,
    Wall,
)
from robocorba.maps.yaml_file import YamlFile

FORMAT = "ros"
#: Thresholds of a file that names none: those of ROS 1, whose grey of 205 is neither free nor occupied.
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
#: Blocks narrower than this in cells are walls, not objects.
_SOLID_CELLS = 3
_ROWS_AT_ONCE = 256
#: What Pillow raises for damaged files.
_IMAGE_ERRORS = (OSError, SyntaxError, ValueError, EOFError, IndexError, struct.error, zlib.error)


@dataclass(frozen=True)
class _Settings:
    resolution: float
    origin: XY
    yaw: float
    negate: bool
    occupied_above: float
    free_below: float
    mode: str

    def place(self, points: np.ndarray) -> tuple[XY, ...]:
        """Points in cells from the lower left corner, in metres of the map's frame."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y = (points * self.resolution).T
        placed = np.column_stack([self.origin[0] + cos * x - sin * y, self.origin[1] + sin * x + cos * y])
        return tuple((x, y) for x, y in placed.tolist())


def is_ros_map(data: Any) -> bool:
    """Whether parsed YAML looks like a map_server file."""
    return isinstance(data, dict) and "image" in data and "resolution" in data


def read(file: YamlFile) -> Imported:
    """The building of one floor that a map_server file and its picture show. Raises MapFileError with line and key."""
    root = Item(file, "$", file.data)
    settings = _settings(root)
    cells = _cells(_picture(root.need("image"), Path(file.name).parent), settings)
    for kind, region in (("occupied", cells == OCCUPIED), ("known", cells != UNKNOWN)):
        if count_sides(region) > MOST_SIDES:
            raise root.need("image").error(f"the {kind} cells are scattered: more than {MOST_SIDES} sides to follow")
    losses = Losses()
    name = "".join(letter if letter.isprintable() and letter not in ":/" else "_" for letter in Path(file.name).stem)
    floor = _floor(cells, settings, name[:80] or "map", losses)
    building = Building(floor.floor.name, {floor.floor.name: floor})
    return Imported(settle(building, losses, file), FORMAT, losses.sentences())


def _settings(root: Item) -> _Settings:
    origin = root.need("origin").items()
    if len(origin) not in (2, 3):
        raise root.need("origin").error("expected [x, y, yaw]")
    occupied, free = root.get("occupied_thresh"), root.get("free_thresh")
    occupied_above = occupied.number() if occupied else OCCUPIED_ABOVE
    free_below = free.number() if free else FREE_BELOW
    if not 0 <= free_below < occupied_above <= 1:
        raise (free or occupied or root).error("expected 0 <= free_thresh < occupied_thresh <= 1")
    resolution = root.need("resolution").positive()
    if not 1e-3 <= resolution <= 10:
        raise root.need("resolution").error("expected metres a cell, from 0.001 to 10")
    negate, mode = root.get("negate"), root.get("mode")
    if negate and negate.value not in (0, 1):
        raise negate.error("expected 0 or 1")
    if mode and mode.value not in ("trinary", "scale", "raw"):
        raise mode.error("expected trinary, scale or raw")
    return _Settings(
        resolution=resolution,
        origin=(origin[0].number(), origin[1].number()),
        yaw=origin[2].number() if len(origin) == 3 else 0.0,
        negate=bool(negate and negate.value),
        occupied_above=occupied_above,
        free_below=free_below,
        mode=mode.value if mode else "trinary",
    )


def _picture(item: Item, folder: Path) -> np.ndarray:
    """The picture as rows x columns x channels of 8 or 16 bits; opacity, if it has any, is the last channel."""
    if not isinstance(item.value, str) or not item.value:
        raise item.error("expected the name of a picture")
    named = Path(item.text())
    if ".." in named.parts:
        raise item.error("the picture must lie in the folder of the file, or be named absolutely")
    path = folder / named
    try:
        if not path.is_file():
            raise item.error("there is no picture of that name")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path, formats=("PPM", "PNG", "BMP")) as picture:
                columns, rows = picture.size
                if columns * rows > MOST_CELLS:
                    raise item.error(f"{columns} x {rows} cells are too many, {MOST_CELLS} are read")
                return _channels(picture)
    except Image.DecompressionBombError:
        raise item.error(f"too many cells, {MOST_CELLS} are read") from None
    except _IMAGE_ERRORS as wrong:
        reason = wrong.strerror if isinstance(wrong, OSError) else str(wrong)
        raise item.error(f"no picture that can be read: {reason or 'unknown kind or damaged'}") from None


def _channels(picture: Image.Image) -> np.ndarray:
    if picture.mode in ("I", "I;16", "I;16B"):
        return np.asarray(picture).astype(np.uint16)[:, :, None]
    values = np.asarray(picture.convert({"1": "L", "P": "RGBA", "CMYK": "RGB"}.get(picture.mode, picture.mode)))
    if values.dtype != np.uint8:
        raise ValueError(f"pictures of mode {picture.mode} are not read")
    return values.reshape(*values.shape[:2], -1)


def _cells(picture: np.ndarray, settings: _Settings) -> np.ndarray:
    """FREE, OCCUPIED or UNKNOWN for each cell, as the map_server tells them apart in each mode."""
    found = np.full(picture.shape[:2], UNKNOWN, np.uint8)
    for row in range(0, len(picture), _ROWS_AT_ONCE):
        block = picture[row : row + _ROWS_AT_ONCE].astype(np.float32) / np.iinfo(picture.dtype).max
        opaque = np.ones(block.shape[:2], bool)
        if settings.mode != "trinary" and block.shape[2] in (2, 4):
            opaque, block = block[:, :, -1] == 1, block[:, :, :-1]
        shade = block.mean(axis=2)
        if settings.mode == "raw":
            chance = np.round(shade * 255) / 100
            opaque = chance <= 1
        else:
            chance = shade if settings.negate else 1 - shade
        part = found[row : row + _ROWS_AT_ONCE]
        part[opaque & (chance < settings.free_below)] = FREE
        part[opaque & (chance > settings.occupied_above)] = OCCUPIED
    return found


def _floor(cells: np.ndarray, settings: _Settings, name: str, losses: Losses) -> FloorMap:
    known = contours(cells != UNKNOWN)
    borders = sorted((line for line in known if not line.is_hole), key=lambda line: -_enclosed(line))
    if not borders:
        losses.add("the picture shows no known space: the floor is empty and without bounds")
        return FloorMap(Floor(name=name, level=0, elevation=0.0))
    border = area(borders[0])
    if len(borders) > 1:
        losses.add(f"known space: {len(borders) - 1} regions apart from the largest are left out")
    shapely.prepare(border)
    pockets = [line for line in known if line.is_hole and border.contains(shapely.Point(line.points[0]))]
    lines, blocks = _walls_and_blocks(cells == OCCUPIED)
    walls: dict[str, Wall] = {}
    for line in lines:
        if border.distance(shapely.Point(line.points[0])) <= 1:
            _add_walls(walls, settings.place(simplified(line)))
    objects = [_thing(f"block{i}", area(line), settings) for i, line in enumerate(blocks, start=1)]
    objects += [_thing(f"unknown{i}", area(line), settings) for i, line in enumerate(pockets, start=1)]
    if pockets:
        losses.add(f"unknown space: {len(pockets)} pockets inside the known space became objects that block")
    losses.add(f"shapes follow the cells of {settings.resolution:g} m to within one cell")
    losses.add("the picture has no nodes, doors, heights or names; none are made up")
    outline = settings.place(np.array(border.exterior.coords[:-1]))
    return FloorMap(
        Floor(name=name, level=0, elevation=0.0, outline=outline),
        GeometricalMap(walls=walls, objects={thing.name: thing for thing in objects}),
    )


def _walls_and_blocks(occupied: np.ndarray) -> tuple[list[Contour], list[Contour]]:
    """Contours to draw as walls, and contours of solid blocks without holes to fill.

    A block that stands alone needs no walls around it."""
    eight = np.ones((3, 3), bool)
    solid = ndimage.binary_opening(occupied, np.ones((_SOLID_CELLS, _SOLID_CELLS), bool))
    labels, _ = ndimage.label(solid, eight)
    around = contours(solid)
    with_hole = {int(labels[line.cell]) for line in around if line.is_hole}
    blocks = [line for line in around if not line.is_hole and int(labels[line.cell]) not in with_hole]
    parts, _ = ndimage.label(occupied, eight)
    sizes, solid_sizes = np.bincount(parts.ravel()), np.bincount(labels.ravel())
    alone = {int(parts[line.cell]) for line in blocks if sizes[parts[line.cell]] == solid_sizes[labels[line.cell]]}
    return [line for line in contours(occupied) if int(parts[line.cell]) not in alone], blocks


def _enclosed(line: Contour) -> float:
    return float(shapely.Polygon(line.points).area)


def _add_walls(walls: dict[str, Wall], points: tuple[XY, ...]) -> None:
    """A wall for each side of a closed line; a side that is passed in both directions is one wall."""
    passed: set[frozenset[XY]] = set()
    for a, b in pairwise(points):
        ends = frozenset((a, b))
        if len(ends) == 2 and ends not in passed:
            passed.add(ends)
            name = f"w{len(walls)}"
            walls[name] = Wall(name=name, a=a, b=b)


def _thing(name: str, polygon: shapely.Polygon, settings: _Settings) -> MapObject:
    points = settings.place(np.array(polygon.exterior.coords[:-1]))
    x, y = points[0]
    return MapObject(name=name, shape=PolygonShape(points=tuple((px - x, py - y) for px, py in points)), at=(x, y))
