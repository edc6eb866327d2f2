"""Reads Open-RMF's building.yaml.

The format describes the drawing of a traffic editor: vertices of each level, and walls,
lanes, doors and floors that refer to them. Lifts are listed beside the levels.
docs/formats.md describes the conversion and its losses.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TypeVar

import msgspec

from robocorba.errors.places import xy
from robocorba.map_editor.formats import openrmf_export
from robocorba.map_editor.formats.map_format import MapFormat, ReadOptions
from robocorba.map_editor.formats.openrmf_alignment import Alignment, align_levels, metres, reference_level
from robocorba.map_editor.formats.openrmf_file import Level, flag, params, read_level
from robocorba.map_editor.formats.openrmf_lanes import lanes_of, unique_names
from robocorba.map_editor.formats.openrmf_lifts import read_lifts
from robocorba.map_editor.formats.openrmf_outline import FloorOutline, floor_outline
from robocorba.map_editor.formats.yaml_item import STOREY_M, Item
from robocorba.map_editor.losses import Exported, Imported, Losses, remove_invalid_elements
from robocorba.map_editor.model import Building, Door, DoorKind, Floor, FloorMap, GeometricalMap, Wall
from robocorba.map_editor.yaml_file import YamlFile

T = TypeVar("T", Wall, Door)
_DOOR_KINDS = {
    **{kind.value: kind for kind in DoorKind},
    "telescope": DoorKind.SLIDING,
    "double_telescope": DoorKind.DOUBLE_SLIDING,
}
#: Known keys of a level and of the file; all others are reported.
_LEVEL_KEYS = {
    *("elevation", "vertices", "walls", "lanes", "doors", "measurements", "fiducials", "floors", "holes", "models"),
    *("flattened_x_offset", "flattened_y_offset", "x_meters", "y_meters"),
}
_FILE_KEYS = {
    *("name", "building_name", "coordinate_system", "parameters", "graphs", "levels", "lifts", "reference_level_name")
}


def read(file: YamlFile, options: ReadOptions) -> Imported:
    """The building that a building.yaml describes. Raises MapFileError with line and key."""
    root = Item(file, "$", file.data)
    losses = Losses()
    levels = [
        read_level(Item(file, item.key, name).level_name(), item, losses)
        for name, item in root.need("levels").members()
    ]
    if not levels:
        raise root.need("levels").error("no level")
    if len({level.name for level in levels}) < len(levels):
        raise root.need("levels").error("two levels of one name")
    reference = reference_level(levels, root)
    alignments = _alignments(root, levels, reference, losses)
    graphs = _graph_names(root.get("graphs"), losses)

    empty = _empty_floors(levels, _elevations(levels, losses))
    listed = root.get("lifts")
    lifts = read_lifts(listed, levels, reference, alignments, losses)
    # Invalid lifts are removed first: they must neither extend an outline nor cost a lane.
    lifts = remove_invalid_elements(Building("lifts", empty, lifts), losses, file).elevators
    left_out = {name for name, _ in listed.members() if name not in lifts}
    by_name = {level.name: level for level in levels}
    floors: dict[str, FloorMap] = {}
    for name, entry in empty.items():
        level = by_name[name].placed(alignments[name])
        shafts = [lift for lift in lifts.values() if name in lift.floors()]
        outline = floor_outline(level, shafts, losses)
        _report_dropped(level, losses)
        floors[name] = FloorMap(
            msgspec.structs.replace(entry.floor, outline=outline.points),
            GeometricalMap(
                walls=_within_outline(_walls(level, losses), outline, name, losses),
                objects=outline.voids,
                doors=_within_outline(_doors(level, losses), outline, name, losses),
            ),
            lanes_of(level, lifts, left_out, graphs, losses),
        )
    for name in root.mapping():
        if name not in _FILE_KEYS:
            losses.add("parts of the file that are not kept: {names}", Item(file, f"$.{name}", name).text())
    building = Building(root.get("name", "building_name").text() or "building", floors, lifts)
    return Imported(remove_invalid_elements(building, losses, file), FORMAT.name, losses.sentences())


def _alignments(root: Item, levels: list[Level], reference: Level, losses: Losses) -> dict[str, Alignment]:
    system = root.get("coordinate_system")
    kind = system.text()
    if system.value is None or kind == "reference_image":
        return align_levels(levels, reference, losses)
    if kind != "cartesian_meters":
        raise system.error(f"{kind!r} is not supported; reference_image and cartesian_meters are")
    given = params(root.get("parameters"))
    offset = tuple(given[key].number() if key in given else 0.0 for key in ("offset_x", "offset_y"))
    if any(offset):
        losses.add(f"coordinates: the file's offset {xy(*offset)} was subtracted")
    return {level.name: metres((offset[0], offset[1])) for level in levels}


def _elevations(levels: list[Level], losses: Losses) -> dict[str, float]:
    """Elevation by level [m]. A level that is not above the previous one is put a storey above it."""
    found: dict[str, float] = {}
    for level in sorted(levels, key=lambda level: level.elevation):
        below = max(found.values(), default=-math.inf)
        found[level.name] = level.elevation if level.elevation > below else below + STOREY_M
        if found[level.name] != level.elevation:
            losses.add(f"elevation: levels of equal elevation are placed {STOREY_M:g} m apart: {{names}}", level.name)
    return found


def _empty_floors(levels: list[Level], elevations: dict[str, float]) -> dict[str, FloorMap]:
    """The floors without content, the lowest first. The lowest floor at or above 0 m is level 0."""
    below_ground = sum(elevation < 0 for elevation in elevations.values())
    names = sorted((level.name for level in levels), key=lambda name: elevations[name])
    return {
        name: FloorMap(Floor(name=name, level=i - below_ground, elevation=elevations[name]))
        for i, name in enumerate(names)
    }


def _graph_names(graphs: Item, losses: Losses) -> dict[int, str]:
    """Names of the navigation graphs by index."""
    found: dict[int, str] = {}
    for label, item in graphs.members():
        index = Item(item.file, item.key, label).integer()
        name = item.get("name").text()
        if name and name in found.values():
            losses.add("graphs: duplicate names, the index is used instead: {names}", f"{name} ({index})")
        elif name:
            found[index] = name
    return found


def _walls(level: Level, losses: Losses) -> dict[str, Wall]:
    name_of = unique_names(losses, f"wall of {level.name}", [link.text("name") for link in level.links["walls"]])
    found: dict[str, Wall] = {}
    for i, link in enumerate(level.links["walls"]):
        if link.a == link.b:
            losses.add("walls without length: {n} left out: {names}", f"{level.name} wall {i}")
            continue
        name = name_of(link.text("name"), f"w{i}")
        height = link.params["texture_height"].positive() if "texture_height" in link.params else 2.5
        a, b = level.points((link.a, link.b))
        found[name] = Wall(name=name, a=a, b=b, height=height)
        if flag(link.params, "transparent") or "texture_name" in link.params:
            losses.add("textures of walls, floors and doors are not kept")
    return found


def _doors(level: Level, losses: Losses) -> dict[str, Door]:
    name_of = unique_names(losses, f"door of {level.name}", [link.text("name") for link in level.links["doors"]])
    found: dict[str, Door] = {}
    for i, link in enumerate(level.links["doors"]):
        name = name_of(link.text("name"), f"d{i}")
        written = link.text("type")
        kind = _DOOR_KINDS.get(written, DoorKind.HINGED)
        if written != kind.value:
            losses.add(f"doors of type {written!r}: {{n}} became {kind.value}: {{names}}", f"{level.name} {name}")
        if "motion_axis" in link.params or "motion_degrees" in link.params:
            losses.add("doors: hinge side and opening angle are not kept: {names}", f"{level.name} {name}")
        a, b = level.points((link.a, link.b))
        found[name] = Door(name=name, a=a, b=b, kind=kind)
    return found


def _within_outline(found: dict[str, T], outline: FloorOutline, floor: str, losses: Losses) -> dict[str, T]:
    """The walls or doors outside the parts of the floor that are left out."""
    kept: dict[str, T] = {}
    for name, element in found.items():
        if outline.leaves_out(element.a, element.b):
            losses.add("walls and doors in parts of the floor that are left out: {n}: {names}", f"{floor} {name}")
        else:
            kept[name] = element
    return kept


def _report_dropped(level: Level, losses: Losses) -> None:
    """Report the data of a level that a building can't hold."""
    if level.links["measurements"]:
        losses.add("measurements: used for the scale, not kept: {names}", level.name)
    if level.fiducials:
        losses.add("fiducials: used to align the levels, not kept: {names}", level.name)
    for model in level.item.get("models").items():
        kind = model.get("model_name", "name").text()
        losses.add("models: {n} left out, the file gives no sizes: {names}", kind)
    for key, value in level.item.members():
        if key not in _LEVEL_KEYS and value.value:
            losses.add(f"{key}: not kept: {{names}}", level.name)


def _write(building: Building, path: Path, resolution_m: float, image: str) -> Exported:
    text, losses = openrmf_export.dumps(building)
    return Exported({path: text.encode()}, losses)


FORMAT = MapFormat(
    name="openrmf",
    title="Open-RMF (.building.yaml)",
    files="one `building.yaml`",
    mark="an Open-RMF building (levels:)",
    recognises=lambda data: isinstance(data, dict) and "levels" in data,
    read=read,
    suffix=".building.yaml",
    write=_write,
)
