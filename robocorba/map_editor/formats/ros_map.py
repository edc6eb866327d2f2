"""Reads maps of the ROS map_server: a YAML file and a picture of one floor.

Specks, small free regions and the surroundings are removed. The outline is the rectangle around the known space. Its
occupied and unknown cells become solid polygon objects.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from robocorba.map_editor.formats.grid import FREE, OCCUPIED, UNKNOWN
from robocorba.map_editor.formats.map_format import MapFormat, ReadOptions
from robocorba.map_editor.formats.ros_export import export
from robocorba.map_editor.formats.ros_picture import MapServerSettings, read_cells, read_settings
from robocorba.map_editor.formats.solids import EIGHT_NEIGHBOURS, solids
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.losses import Imported, Losses, remove_invalid_elements
from robocorba.map_editor.model import Building, Floor, FloorMap, GeometricalMap, MapObject, PolygonShape
from robocorba.map_editor.yaml_file import YamlFile
from robocorba.system.extras import require_extra

#: Minimum area of a free region that is kept beside the largest one [m2]. A robot of 0.4 m radius covers 0.5 m2
#: and can turn and leave in twice that. Laser beams through windows leave thousands of smaller regions.
MIN_FREE_REGION_M2 = 1.0
#: Maximum side of a speck, an occupied or unknown region in free space [m]: one cell of most laser maps. Table legs are
#: 3 to 6 cm thick. Also the maximum gap between a wall and a speck that counts as its noise: a removed speck extends at
#: most 0.10 m from the wall.
MAX_SPECK_M = 0.05
_SLACK = 1e-9


def is_ros_map(data: Any) -> bool:
    """Whether parsed YAML looks like a map_server file."""
    return isinstance(data, dict) and "image" in data and "resolution" in data


def read(file: YamlFile, options: ReadOptions) -> Imported:
    """The building of one floor that a map_server file and its picture show. Raises MapFileError with line and key;
    ServiceError without the extra maps."""
    require_extra("maps", "ROS maps")
    losses = Losses()
    root = Item(file, "$", file.data)
    settings = read_settings(root)
    cells = read_cells(root, settings, options.unknown == "free", options.absolute_paths, losses)
    name = "".join(letter if letter.isprintable() and letter not in ":/" else "_" for letter in Path(file.name).stem)
    floor = Floor(name=name[:80] or "map", level=0, elevation=0.0)
    entry = floor_map(floor, cells, settings, options, root.need("image"), losses)
    building = Building(floor.name, {floor.name: entry})
    return Imported(remove_invalid_elements(building, losses, file), FORMAT.name, losses.sentences())


def floor_map(
    floor: Floor, cells: np.ndarray, settings: MapServerSettings, options: ReadOptions, image: Item, losses: Losses
) -> FloorMap:
    """The floor with the outline and the solid objects that its cells show. Raises MapFileError at `image`."""
    cells = _remove_specks(cells, settings, options.specks, losses)
    cells, blocked, corner = _crop_to_floor(cells, settings, losses)
    padded = np.pad(blocked, 1)
    across, down = padded[:, 1:] != padded[:, :-1], padded[1:] != padded[:-1]
    if int(np.count_nonzero(across)) + int(np.count_nonzero(down)) > 2**20:  # maps have far fewer sides, noise has more
        raise image.error(f"the cells are scattered: their contours have more than {2**20} sides")
    rows, columns = blocked.shape
    corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) + corner
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
        GeometricalMap(objects=_objects(cells, blocked, corner, settings)),
    )


def _objects(
    cells: np.ndarray, blocked: np.ndarray, corner: np.ndarray, settings: MapServerSettings
) -> dict[str, MapObject]:
    """The blocked regions as objects: `block1`... with occupied cells, `unknown1`... with unknown cells only."""
    found, regions = solids(blocked)
    occupied = set(np.unique(regions[blocked & (cells == OCCUPIED)]).tolist())
    counts = {"block": 0, "unknown": 0}
    objects: dict[str, MapObject] = {}
    for solid in found:
        kind = "block" if solid.region in occupied else "unknown"
        counts[kind] += 1
        points = settings.to_map_frame(solid.points + corner)
        x, y = points[0]
        shape = PolygonShape(points=tuple((px - x, py - y) for px, py in points))
        name = f"{kind}{counts[kind]}"
        # A picture has no heights: that of a wall.
        objects[name] = MapObject(name=name, shape=shape, at=(x, y), height=2.5)
    return objects


def _remove_specks(cells: np.ndarray, settings: MapServerSettings, specks: str, losses: Losses) -> np.ndarray:
    """The cells with specks made free: those beside larger regions, or all (`specks` as in ReadOptions)."""
    from scipy import ndimage

    largest = int(MAX_SPECK_M / settings.resolution + _SLACK)
    if specks == "keep" or largest < 1:
        return cells
    labels, count = ndimage.label(cells != FREE, EIGHT_NEIGHBOURS)
    small = np.zeros(count + 1, bool)
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        small[number] = max(rows.stop - rows.start, columns.stop - columns.start) <= largest
    removed = small
    if specks == "walls":
        larger = (labels > 0) & ~small[labels]
        beside = np.zeros(count + 1, bool)
        beside[labels[ndimage.binary_dilation(larger, EIGHT_NEIGHBOURS, iterations=largest + 1)]] = True
        removed = small & beside
    removed_cells = removed[labels]
    if removed_cells.any():
        where = " beside walls" if specks == "walls" else ""
        losses.add(
            f"specks: {np.count_nonzero(removed)} of at most {MAX_SPECK_M:g} m{where}, "
            f"{settings.area_m2(int(np.count_nonzero(removed_cells))):.3g} m2, are removed as noise; "
            f"--specks keep keeps them"
        )
    if left := int(np.count_nonzero(small & ~removed)):
        losses.add(
            f"specks: {left} of at most {MAX_SPECK_M:g} m away from walls are kept, as table legs; "
            f"--specks all removes them"
        )
    return np.where(removed_cells, np.uint8(FREE), cells)


def _crop_to_floor(
    cells: np.ndarray, settings: MapServerSettings, losses: Losses
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rectangle around the known space: its cells, which of them block, and its lower left corner in the picture.
    All cells in it block, except those of the kept free regions.

    The largest free region is kept, and each of at least MIN_FREE_REGION_M2, with the known
    cells that are connected to it."""
    from scipy import ndimage

    regions, count = ndimage.label(cells == FREE)
    sizes = np.bincount(regions.ravel(), minlength=count + 1)
    sizes[0] = 0
    kept = settings.area_m2(1) * sizes >= MIN_FREE_REGION_M2 - _SLACK
    kept[int(np.argmax(sizes))] = True
    kept[0] = False
    ground = kept[regions]
    rows, columns = _around(ground, cells)
    part, blocked = cells[rows, columns], ~ground[rows, columns]

    small = f"free space: {{n}} separate regions below {MIN_FREE_REGION_M2:g} m2 count as blocked"
    _report_regions(small, np.where(ground, 0, regions), settings, losses)
    outside = cells == OCCUPIED
    outside[rows, columns] = False
    if outside.any():
        apart, _ = ndimage.label(outside, EIGHT_NEIGHBOURS)
        _report_regions("occupied space: {n} regions outside the outline are left out", apart, settings, losses)
    if not ground.any():
        losses.add("the picture has no free cell, the whole floor is blocked; check negate and the thresholds")
    elif unknown := int(np.count_nonzero(part == UNKNOWN)):
        losses.add(f"unknown space: {settings.area_m2(unknown):.1f} m2 within the outline count as blocked")
    return part, blocked, np.array([columns.start, len(cells) - rows.stop])


def _around(ground: np.ndarray, cells: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns that contain the ground and all known cells connected to it; all without ground."""
    from scipy import ndimage

    known, count = ndimage.label(cells != UNKNOWN, EIGHT_NEIGHBOURS)
    reached = np.zeros(count + 1, bool)
    reached[known[ground]] = True
    inside = reached[known] if ground.any() else np.ones(cells.shape, bool)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _report_regions(sentence: str, regions: np.ndarray, settings: MapServerSettings, losses: Losses) -> None:
    """Report removed regions (0: no region): their number, their area and the positions of the five largest."""
    from scipy import ndimage

    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    lost = np.flatnonzero(sizes)
    if not len(lost):
        return
    largest = lost[np.argsort(-sizes[lost], kind="stable")][:5]
    middles = np.array(ndimage.center_of_mass(regions > 0, regions, largest))
    middles = np.column_stack([middles[:, 1] + 0.5, len(regions) - middles[:, 0] - 0.5])
    shown = [
        f"{settings.area_m2(int(sizes[region])):.2g} m2 at ({x:.2f}, {y:.2f})"
        for region, (x, y) in zip(largest, settings.to_map_frame(middles), strict=True)
    ]
    more = f" and {len(lost) - len(shown)} more" if len(lost) > len(shown) else ""
    losses.add(
        f"{sentence.replace('{n}', str(len(lost)))}, "
        f"{settings.area_m2(int(sizes.sum())):.2f} m2 in all: {', '.join(shown)}{more}"
    )


FORMAT = MapFormat(
    name="ros",
    title="ROS maps (.yaml and pictures)",
    files="a YAML file and a picture for each floor",
    has_cells=True,
    mark="a ROS map (image:)",
    recognises=is_ros_map,
    read=read,
    write=export,
)
