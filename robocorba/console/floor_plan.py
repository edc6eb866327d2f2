"""The map of a floor as plain data that a browser draws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import shapely

from robocorba.map_editor import geometry
from robocorba.map_editor.model import Building, Elevator, MapObject
from robocorba.map_editor.spatial.pose import XY

Points = list[list[float]]
Lines = list[Points]
#: Decimals of coordinates sent to a browser: 0.1 mm.
DECIMALS = 4


def floor_plan(building: Building, floor: str) -> dict[str, Any]:
    """The geometrical and the topological map of a floor, in m and rad of its frame.

    Each element has its `name` and the members that a drawing needs; `walls` also have `pieces`, what their doors leave
    of them. Elevators whose shafts pass the floor without a stop have no `doors`. Raises KeyError for an unknown
    floor."""
    entry = building.floors[floor]
    plan, roads = entry.geometrical, entry.topological
    pieces = _pieces(building, floor)
    return {
        "name": floor,
        "elevation": entry.floor.elevation,
        "height": entry.floor.height,
        "outline": _points(entry.floor.outline),
        "bounds": list(geometry.bounds(building, floor)),
        "walls": [
            {"name": wall.name, "a": wall.a, "b": wall.b, "height": wall.height, "pieces": pieces.get(wall.name, [])}
            for wall in plan.walls.values()
        ],
        "objects": [_object(map_object) for map_object in plan.objects.values()],
        "doors": [
            {"name": door.name, "a": door.a, "b": door.b, "kind": door.kind.value, "locked": door.locked}
            for door in plan.doors.values()
        ],
        "areas": [{"name": area.name, "polygon": _points(area.polygon)} for area in plan.areas.values()],
        "nodes": [{"name": node.name, "at": node.at, "elevator": node.elevator} for node in roads.nodes.values()],
        "edges": [{"a": roads.nodes[edge.a].at, "b": roads.nodes[edge.b].at} for edge in roads.edges.values()],
        "elevators": [_elevator(elevator, floor) for elevator in building.elevators_through(floor)],
    }


def _pieces(building: Building, floor: str) -> dict[str, Lines]:
    """What doors leave of each wall, as lines."""
    return {
        obstacle.name: [_points(line.coords) for line in shapely.get_parts(obstacle.geometry) if not line.is_empty]
        for obstacle in geometry.obstacles(building, floor)
        if obstacle.kind == "wall"
    }


def _object(map_object: MapObject) -> dict[str, Any]:
    shape = geometry.object_geometry(map_object)
    is_line = shape.geom_type == "LineString"
    return {
        "name": map_object.name,
        "at": map_object.at,
        "heading": map_object.heading,
        "height": map_object.height,
        "movable": map_object.movable,
        "polygon": _points(shape.coords if is_line else shape.exterior.coords[:-1]),
    }


def _elevator(elevator: Elevator, floor: str) -> dict[str, Any]:
    return {
        "name": elevator.name,
        "at": elevator.at,
        "floors": list(elevator.floors()),
        "polygon": _points(geometry.shaft_polygon(elevator).exterior.coords[:-1]),
        "doors": [
            _points(geometry.landing_line(elevator, door).coords) for door in elevator.doors if door.floor == floor
        ],
    }


def _points(points: Iterable[Sequence[float] | XY]) -> Points:
    return [[round(point[0], DECIMALS), round(point[1], DECIMALS)] for point in points]
