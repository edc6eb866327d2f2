"""Reads several maps of the ROS map_server as one building: a YAML file lists floors and elevators.

Elevators are given as in the native map file. Their shafts and landings are cleared in the
pictures, which show a shaft's walls, and its doors in the state during mapping.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np
import shapely

from robocorba.map_editor import native
from robocorba.map_editor.formats import ros_map
from robocorba.map_editor.formats.grid import FREE, Canvas
from robocorba.map_editor.formats.map_format import MapFormat, ReadOptions
from robocorba.map_editor.formats.ros_picture import MapServerSettings, named_file, read_cells, read_settings
from robocorba.map_editor.formats.yaml_item import STOREY_M, Item
from robocorba.map_editor.geometry import LANDING_REACH_M, landing_line, shaft_polygon
from robocorba.map_editor.losses import Imported, Losses
from robocorba.map_editor.model import Building, Elevator, Floor, FloorMap
from robocorba.map_editor.yaml_file import YamlFile, read_yaml
from robocorba.system.extras import require_extra


class _FloorEntry(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    map: str
    level: int | None = None
    elevation: float | None = None
    height: float = 3.0


class _ListFile(msgspec.Struct, forbid_unknown_fields=True):
    ros_maps: int
    name: str
    floors: tuple[_FloorEntry, ...]
    elevators: tuple[Elevator, ...] = ()


def _read(file: YamlFile, options: ReadOptions) -> Imported:
    """The building that a list of map_server files describes. Raises MapFileError with file, line and key;
    ServiceError without the extra maps."""
    require_extra("maps", "ROS maps")
    version = file.data["ros_maps"]
    if type(version) is not int or version != 1:
        raise file.error("$.ros_maps", f"this release reads version 1, not {version!r}")
    content = file.convert(_ListFile)
    if not content.floors:
        raise file.error("$.floors", "no floor is listed")
    floors = _floors(file, content.floors)
    elevators = _by_name(file, content.elevators)
    # Checked before the pictures are opened, since these rules need no picture.
    native.check_rules(file, Building(content.name, {floor.name: FloorMap(floor) for floor in floors}, elevators))
    losses = Losses()
    entries = {floor.name: _floor_map(file, i, floor, elevators, options, losses) for i, floor in enumerate(floors)}
    ordered = dict(sorted(entries.items(), key=lambda item: item[1].floor.level))
    building = Building(content.name, ordered, elevators)
    native.check_rules(file, building)
    return Imported(building, FORMAT.name, losses.sentences())


def _floors(file: YamlFile, entries: tuple[_FloorEntry, ...]) -> list[Floor]:
    """The floors in the order of the file. Levels that the file omits follow from elevations, and vice versa."""
    for key in ("level", "elevation"):
        given = [getattr(entry, key) is not None for entry in entries]
        if any(given) and not all(given):
            raise file.error(f"$.floors[{given.index(False)}]", f"the key {key!r} is missing; other floors give one")
    if entries[0].level is None and entries[0].elevation is None:
        raise file.error("$.floors[0]", "the key 'level' or 'elevation' is missing")
    rising = sorted(entry.elevation for entry in entries if entry.elevation is not None)
    below_ground = sum(elevation < 0 for elevation in rising)
    found = []
    for entry in entries:
        level, elevation = entry.level, entry.elevation
        if level is None and elevation is not None:
            level = rising.index(elevation) - below_ground
        if elevation is None and level is not None:
            elevation = level * STOREY_M
        assert level is not None and elevation is not None
        found.append(Floor(name=entry.name, level=level, elevation=elevation, height=entry.height))
    names = [floor.name for floor in found]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise file.error(f"$.floors[{i}].name", f"there is a floor {name!r} already")
    return found


def _by_name(file: YamlFile, elevators: Iterable[Elevator]) -> dict[str, Elevator]:
    found: dict[str, Elevator] = {}
    for i, elevator in enumerate(elevators):
        if elevator.name in found:
            raise file.error(f"$.elevators[{i}].name", f"there is an elevator {elevator.name!r} already")
        found[elevator.name] = elevator
    return found


def _floor_map(
    file: YamlFile, index: int, floor: Floor, elevators: dict[str, Elevator], options: ReadOptions, losses: Losses
) -> FloorMap:
    """The floor at `index` of the list, from its map_server file."""
    named = Item(file, f"$.floors[{index}].map", file.data["floors"][index]["map"])
    path = named_file(named, "a map_server file", options.absolute_paths)
    if not path.is_file():
        raise named.error("there is no file of that name")
    map_file = read_yaml(path)
    if not ros_map.is_ros_map(map_file.data):
        raise named.error("not a map_server file: it has no image: and resolution:")
    root = Item(map_file, "$", map_file.data)
    floor_losses = Losses()
    settings = read_settings(root)
    cells = read_cells(root, settings, options.unknown == "free", options.absolute_paths, floor_losses)
    for i, elevator in enumerate(elevators.values()):
        if floor.name in elevator.floors():
            _clear_shaft(
                Item(file, f"$.elevators[{i}]", elevator.name), elevator, floor.name, cells, settings, floor_losses
            )
    found = ros_map.floor_map(floor, cells, settings, options, root.need("image"), floor_losses)
    for sentence in floor_losses.sentences():
        losses.add(f"{floor.name}: {sentence}")
    return found


def _clear_shaft(
    item: Item, elevator: Elevator, floor: str, cells: np.ndarray, settings: MapServerSettings, losses: Losses
) -> None:
    """Mark the cells in the shaft of an elevator as free, and those before and behind its doors on a floor."""
    from scipy import ndimage

    shaft = shapely.transform(shaft_polygon(elevator), settings.to_cells)
    if not shapely.box(0, 0, cells.shape[1], cells.shape[0]).covers(shaft):
        raise item.error(f"its shaft reaches beyond the picture of floor {floor!r}; move it or enlarge the picture")
    inside, landing = Canvas((0.0, 0.0), 1.0, *cells.shape), Canvas((0.0, 0.0), 1.0, *cells.shape)
    inside.fill(shaft, FREE)
    for door in elevator.doors:
        if door.floor == floor:
            line = shapely.transform(landing_line(elevator, door), settings.to_cells)
            landing.fill(line.buffer(LANDING_REACH_M / settings.resolution, cap_style="flat"), FREE)
    cleared = (inside.cells == FREE) | (landing.cells == FREE)
    if count := int(np.count_nonzero(cleared & (cells != FREE))):
        losses.add(
            f"elevator {elevator.name!r}: {settings.area_m2(count):.3g} m2 of its shaft and landings "
            f"are not free in the picture and were cleared"
        )
    cells[cleared] = FREE
    before_door = ndimage.binary_dilation((landing.cells == FREE) & (inside.cells != FREE)) & ~cleared
    if not (cells[before_door] == FREE).any():
        losses.add(f"elevator {elevator.name!r}: no free cell in front of its doors; check its position and their side")


FORMAT = MapFormat(
    name="ros",
    title="ROS maps of several floors (.yaml)",
    files="a YAML file that lists floors, each with its ROS map, and elevators",
    has_cells=True,
    mark="a list of ROS maps (ros_maps: 1)",
    recognises=lambda data: isinstance(data, dict) and "ros_maps" in data,
    read=_read,
)
