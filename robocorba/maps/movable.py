"""What of a floor stands, and what of it can be moved."""

from __future__ import annotations

from collections import Counter

import shapely
import shapely.affinity
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.maps.geometry import landing_line, object_geometry, obstacles
from robocorba.maps.model import Building, MapObject, SegmentShape


def standing(building: Building, floor: str) -> list[BaseGeometry]:
    """What blocks on a floor and does not move; without the landing doors of elevators."""
    things = building.floors[floor].geometrical.objects
    return [
        item.geometry
        for item in obstacles(building, floor)
        if item.kind != "object" or not _is_movable(things[item.name])
    ]


def movables(building: Building) -> dict[str, tuple[MapObject, str]]:
    """Objects that can be pushed and carried, and the floor where the map has them, by a name that is theirs alone:
    that on the map, or FLOOR/NAME where several floors have one of this name."""
    found = [
        (thing, floor)
        for floor, entry in building.floors.items()
        for thing in entry.geometrical.objects.values()
        if _is_movable(thing)
    ]
    many = Counter(thing.name for thing, _ in found)
    return {
        (thing.name if many[thing.name] == 1 else f"{floor}/{thing.name}"): (thing, floor) for thing, floor in found
    }


def outline(thing: MapObject) -> Polygon:
    """In the object's own frame."""
    turned = shapely.affinity.translate(object_geometry(thing), -thing.at[0], -thing.at[1])
    return shapely.affinity.rotate(turned, -thing.heading, (0, 0), use_radians=True)


def landing_doors(building: Building, elevator: str, floor: str) -> BaseGeometry:
    """Where the doors of an elevator stand on a floor while they are shut."""
    shape = building.elevators[elevator]
    return shapely.multilinestrings([landing_line(shape, door) for door in shape.doors if door.floor == floor])


def _is_movable(thing: MapObject) -> bool:
    return thing.movable and not isinstance(thing.shape, SegmentShape)  # a line has no mass
