"""Fixed obstacles and movable objects of a floor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import shapely
import shapely.affinity
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import landing_line, object_geometry, obstacles
from robocorba.map_editor.model import Building, MapObject, SegmentShape


def fixed_obstacles(building: Building, floor: str) -> list[BaseGeometry]:
    """The obstacles of a floor that do not move, without the landing doors of elevators."""
    map_objects = building.floors[floor].geometrical.objects
    return [
        item.geometry
        for item in obstacles(building, floor)
        if item.kind != "object" or not _is_movable(map_objects[item.name])
    ]


def movables(building: Building) -> dict[str, tuple[MapObject, str]]:
    """Objects that can be pushed and carried, with their floor on the map, by a unique name: the name on the map,
    or FLOOR/NAME if several floors have an object of this name."""
    found = {
        full_name(floor, map_object.name): (map_object, floor)
        for floor, entry in building.floors.items()
        for map_object in entry.geometrical.objects.values()
        if _is_movable(map_object)
    }
    many = Counter(map_object.name for map_object, _ in found.values())
    return {
        # A name may look like the full name of another object.
        (item.name if many[item.name] == 1 and item.name not in found else full): (item, floor)
        for full, (item, floor) in found.items()
    }


def full_name(floor: str, name: str) -> str:
    """FLOOR/NAME: names an object by its floor on the map. Floors have no slash in their names."""
    return f"{floor}/{name}"


def ambiguity(name: str, known: Iterable[str]) -> str:
    """What to write instead of a name that several movable objects have; empty if they have not. known: the names of
    `movables`."""
    alternatives = sorted(each for each in known if each.endswith(f"/{name}"))
    if len(alternatives) < 2:
        return ""
    return f"several floors have an object {name[:80]!r}: write {' or '.join(alternatives[:40])}"


def not_found(name: str, known: Iterable[str]) -> str:
    """Why there is no movable object of a name. known: the names of `movables`."""
    if why := ambiguity(name, known):
        return why
    listed = sorted(known)[:40]
    more = ", ..." if len(listed) == 40 else ""
    return f"there is no object {name[:80]!r} that can be carried; there are {', '.join(listed) or 'none'}{more}"


def object_outline(map_object: MapObject) -> Polygon:
    """The footprint of an object in its own frame."""
    turned = shapely.affinity.translate(object_geometry(map_object), -map_object.at[0], -map_object.at[1])
    return shapely.affinity.rotate(turned, -map_object.heading, (0, 0), use_radians=True)


def landing_doors(building: Building, elevator: str, floor: str) -> BaseGeometry:
    """The lines of an elevator's closed doors on a floor."""
    shape = building.elevators[elevator]
    return shapely.multilinestrings([landing_line(shape, door) for door in shape.doors if door.floor == floor])


def _is_movable(map_object: MapObject) -> bool:
    return map_object.movable and not isinstance(map_object.shape, SegmentShape)  # in maps of release 0.1
