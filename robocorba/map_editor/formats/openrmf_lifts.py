"""Elevators from the lifts of an Open-RMF file."""

from __future__ import annotations

import math
from collections.abc import Iterator

from robocorba.map_editor.formats.openrmf_alignment import Alignment
from robocorba.map_editor.formats.openrmf_file import Level
from robocorba.map_editor.formats.yaml_item import Item
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.model import CabinSide, Elevator, ElevatorDoor


def read_lifts(
    lifts: Item, levels: list[Level], reference: Level, alignments: dict[str, Alignment], losses: Losses
) -> dict[str, Elevator]:
    """Elevators by name, without lifts that open on no level. Raises MapFileError."""
    found = {}
    for name, lift in lifts.members():
        named = lift.get("reference_floor_name")
        to_building = alignments.get(named.level_name() or reference.name)
        if to_building is None:
            raise named.error(f"there is no level {named.text()!r}")
        width, depth = lift.need("width").positive(), lift.need("depth").positive()
        doors, unused = _doors(lift, name, width, depth, levels, losses)
        if not doors:
            losses.add("lifts that open on no level: {n} left out: {names}", name)
            continue
        for door in unused:
            losses.add("lift doors that open on no level: {n} left out: {names}", f"{name} {door}")
        found[name] = Elevator(
            name=name,
            at=to_building((lift.need("x").number(), lift.need("y").number())),
            size=(width, depth),
            heading=lift.get("yaw").number(0.0) + to_building.rotation,
            doors=tuple(doors),
        )
    return found


def _doors(
    lift: Item, name: str, width: float, depth: float, levels: list[Level], losses: Losses
) -> tuple[list[ElevatorDoor], list[str]]:
    """A door for each level and doorway, in order of elevation, and the doorways that open on no level."""
    doorways = {
        label: _doorway(item, f"{name} {label}", width, depth, losses) for label, item in lift.get("doors").members()
    }
    opens: dict[str, list[str]] = {level.name: [] for level in levels}
    for level_name, door, item in _level_doors(lift.get("level_doors"), list(doorways)):
        if level_name not in opens:
            raise item.error(f"there is no level {level_name!r}")
        if door not in doorways:
            raise item.error(f"there is no door {door!r}")
        opens[level_name].append(door)
    lowest, highest = _range(lift, levels)
    found = []
    for level in sorted(levels, key=lambda level: level.elevation):
        if opens[level.name] and not lowest <= level.elevation <= highest:
            losses.add(
                "lift doors outside lowest_floor to highest_floor are left out: {names}", f"{name} at {level.name}"
            )
            continue
        for door in dict.fromkeys(opens[level.name]):
            side, span, offset = doorways[door]
            found.append(ElevatorDoor(floor=level.name, side=side, width=span, offset=offset))
    return found, [door for door in doorways if not any(door in names for names in opens.values())]


def _level_doors(item: Item, doors: list[str]) -> Iterator[tuple[str, str, Item]]:
    """(level, door, item in the file) from {level: [doors]}, [{level: doors}], [[level, door...]] or [level]."""
    if isinstance(item.value, dict):
        for label, named in item.members():
            level = Item(item.file, named.key, label).level_name()
            for door in named.items() if isinstance(named.value, list) else [named]:
                yield level, door.text(), named
        return
    for entry in item.items():
        if isinstance(entry.value, dict):
            yield from _level_doors(entry, doors)
        elif isinstance(entry.value, list):
            row = entry.items()
            for door in row[1:]:
                yield row[0].level_name(), door.text(), entry
        else:
            for name in doors:
                yield entry.level_name(), name, entry


def _range(lift: Item, levels: list[Level]) -> tuple[float, float]:
    """Elevation of the lowest and of the highest served level [m], infinite if the lift does not name it."""
    heights = {level.name: level.elevation for level in levels}
    bounds = [-math.inf, math.inf]
    for i, key in enumerate(("lowest_floor", "highest_floor")):
        named = lift.get(key)
        if named.level_name():
            if named.level_name() not in heights:
                raise named.error(f"there is no level {named.text()!r}")
            bounds[i] = heights[named.level_name()]
    return bounds[0], bounds[1]


def _doorway(item: Item, name: str, width: float, depth: float, losses: Losses) -> tuple[CabinSide, float, float]:
    """Side, width [m] and offset [m] of a door that the file gives by its middle in the cabin's frame."""
    x, y, span = item.need("x").number(), item.need("y").number(), item.need("width").positive()
    slides_along_y = abs(math.sin(item.get("motion_axis_orientation").number(0.0))) > math.sqrt(0.5)
    from_x, from_y = abs(abs(x) - width / 2), abs(abs(y) - depth / 2)
    is_in_corner = abs(from_x - from_y) < 0.25
    on_x_side = slides_along_y if is_in_corner else from_x < from_y
    if on_x_side:
        side, offset, length = (CabinSide.RIGHT if x > 0 else CabinSide.LEFT), y, depth
    else:
        side, offset, length = (CabinSide.BACK if y > 0 else CabinSide.FRONT), x, width
    fitting = min(span, length)
    room = (length - fitting) / 2
    kept = min(max(offset, -room), room)
    if fitting != span or abs(kept - offset) > 1e-9:
        losses.add("lift doors wider than their cabin side or beyond its end were fitted to the side: {names}", name)
        offset = kept
    return side, fitting, offset
