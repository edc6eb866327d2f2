"""Writes an Open-RMF building.yaml in coordinate system cartesian_meters: metres, y up.

Names of walls and lanes, and the clearance of lanes, are written as additional parameters;
readers of the format ignore unknown parameters. Walls are cut at doors and landings.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import shapely
import yaml

from robocorba.map_editor.geometry import bounds, obstacles
from robocorba.map_editor.losses import Losses
from robocorba.map_editor.model import Building, CabinSide, Door, DoorKind, Elevator, FloorMap, MapObject, PolygonShape
from robocorba.map_editor.spatial.pose import XY


def dumps(building: Building) -> tuple[str, tuple[str, ...]]:
    """The text of a building.yaml, and a sentence for each kind of loss."""
    losses = Losses()
    graphs = _graph_indices(building, losses)
    levels = {name: _level(building, entry, graphs, losses) for name, entry in building.floors.items()}
    _report_levels(building, losses)
    content = {
        "name": building.name,
        "coordinate_system": "cartesian_meters",
        "graphs": {index: {"name": name} for name, index in graphs.items() if name != str(index)},
        "levels": levels,
        "lifts": {name: _lift(building, elevator, losses) for name, elevator in building.elevators.items()},
    }
    if building.floors:
        content["reference_level_name"] = next(iter(building.floors))
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=2**20)
    return text, losses.sentences()


#: A row of the file: a vertex, or two vertices by index and parameters.
_Row = tuple[Any, ...]


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


# A tuple is a row, which is written on one line.
_Dumper.add_representer(
    tuple, lambda dumper, row: dumper.represent_sequence("tag:yaml.org,2002:seq", row, flow_style=True)
)


class _Vertices:
    """The vertex list of a level: nodes first, then corners without duplicates."""

    def __init__(self) -> None:
        self.rows: list[_Row] = []
        self._corners: dict[XY, int] = {}

    def node(self, name: str, at: XY, params: dict[str, Any]) -> int:
        """Add a vertex with a name; its index."""
        self.rows.append((float(at[0]), float(at[1]), 0.0, name, params))
        return len(self.rows) - 1

    def corner(self, at: XY) -> int:
        """Index of the unnamed vertex at a position, added if it is new."""
        if at not in self._corners:
            self._corners[at] = self.node("", at, {})
        return self._corners[at]


def _level(building: Building, entry: FloorMap, graphs: dict[str, int], losses: Losses) -> dict[str, Any]:
    floor, vertices = entry.floor, _Vertices()
    nodes = {
        node.name: vertices.node(node.name, node.at, {"lift_cabin": [1, node.elevator]} if node.elevator else {})
        for node in entry.topological.nodes.values()
    }
    x0, y0, x1, y1 = bounds(building, floor.name)
    level: dict[str, Any] = {
        "elevation": float(floor.elevation),
        "x_meters": float(math.ceil(x1 - x0)),
        "y_meters": float(math.ceil(y1 - y0)),
        "vertices": vertices.rows,
        "walls": _walls(building, entry, vertices, losses),
        "doors": _doors(entry, vertices, losses),
        "lanes": _lanes(entry, nodes, graphs),
        "measurements": [],
        "floors": [],
        "models": [],
    }
    if floor.outline:
        ring = [vertices.corner(at) for at in floor.outline]
        level["floors"].append({"vertices": tuple(ring), "parameters": {}})
    solid_blocks, others = _split(entry.geometrical.objects.values(), "block|unknown")
    holes, others = _split(others, "void")
    if holes and floor.outline:
        level["holes"] = [{"vertices": tuple(vertices.corner(at) for at in _ring(hole))} for hole in holes]
    else:
        others = holes + others
    for map_object in solid_blocks:
        corners = [vertices.corner(at) for at in _ring(map_object)]
        height = [3, float(map_object.height)]
        level["walls"] += [(a, b, {"texture_height": height}) for a, b in pairwise([*corners, corners[0]])]
        losses.add("solid blocks became walls along their outlines: {names}", f"{floor.name} {map_object.name}")
    for map_object in others:
        losses.add(
            "objects: {n} left out, the format has models but no shapes: {names}", f"{floor.name} {map_object.name}"
        )
    for name in entry.geometrical.areas:
        losses.add("areas: {n} left out: {names}", f"{floor.name} {name}")
    if floor.height != 3.0:  # what a reader assumes
        losses.add("height of floors: not kept: {names}", floor.name)
    return level


def _walls(building: Building, entry: FloorMap, vertices: _Vertices, losses: Losses) -> list[_Row]:
    """Walls, cut at doors and landings. The second piece of a wall has the suffix _2, and so on."""
    remaining = {item.name: item.geometry for item in obstacles(building, entry.floor.name) if item.kind == "wall"}
    rows: list[_Row] = []
    for wall in entry.geometrical.walls.values():
        whole = shapely.LineString([wall.a, wall.b])
        left = remaining.get(wall.name, shapely.LineString())
        pieces = [(wall.a, wall.b)]
        if not left.equals(whole):
            losses.add("walls were cut at doors and landings: {names}", f"{entry.floor.name} {wall.name}")
            pieces = [(part.coords[0], part.coords[-1]) for part in shapely.get_parts(left)]
        for n, (a, b) in enumerate(pieces, start=1):
            name = wall.name if n == 1 else f"{wall.name}_{n}"
            name_param = {} if name == f"w{len(rows)}" else {"name": [1, name]}
            params = {"texture_height": [3, float(wall.height)], **name_param}
            rows.append((vertices.corner(a), vertices.corner(b), params))
    return rows


def _doors(entry: FloorMap, vertices: _Vertices, losses: Losses) -> list[_Row]:
    rows = []
    for door in entry.geometrical.doors.values():
        where = f"{entry.floor.name} {door.name}"
        if door.kind is DoorKind.OPENING:
            losses.add("doors without a leaf became gaps in the walls: {names}", where)
            continue
        losses.add(
            "doors: hinge side and opening angle are unknown, first end and 90 degrees are written: {names}", where
        )
        if door.locked:
            losses.add("doors: their lock is not kept: {names}", where)
        rows.append((vertices.corner(door.a), vertices.corner(door.b), _door_params(door)))
    return rows


def _door_params(door: Door) -> dict[str, Any]:
    degrees = 90.0 if door.kind in (DoorKind.HINGED, DoorKind.DOUBLE_HINGED) else 0.0
    return {
        "name": [1, door.name],
        "type": [1, door.kind.value],
        "motion_axis": [1, "start"],
        "motion_degrees": [3, degrees],
        "motion_direction": [2, 1],
        "plugin": [1, "normal"],
        "right_left_ratio": [3, 1.0],
    }


def _graph_indices(building: Building, losses: Losses) -> dict[str, int]:
    """An index for each graph: its name if that is a number, else the next free index."""
    edges = [edge for entry in building.floors.values() for edge in entry.topological.edges.values()]
    names = list(dict.fromkeys(name for edge in edges for name in edge.graphs))
    found = {name: int(name) for name in names if re.fullmatch(r"0|[1-9]\d{0,5}", name, re.ASCII)}
    for name in names:
        if name not in found:
            found[name] = next(i for i in range(len(names) + 1) if i not in found.values())
    for name, index in found.items():
        if index > 8:
            losses.add("graphs: the format's tools support only indices 0 to 8: {names}", f"{name} ({index})")
    if any(not edge.graphs for edge in edges):
        found = found or {"0": 0}
        losses.add(f"edges without a graph are written to every graph: {', '.join(found)}")
    return found


def _lanes(entry: FloorMap, nodes: dict[str, int], graphs: dict[str, int]) -> list[_Row]:
    rows = []
    for edge in entry.topological.edges.values():
        params: dict[str, Any] = {"bidirectional": [4, not edge.one_way], "speed_limit": [3, float(edge.speed_limit)]}
        if edge.name != f"{edge.a}-{edge.b}":
            params["name"] = [1, edge.name]
        if edge.clearance:
            params["clearance"] = [3, float(edge.clearance)]
        for graph in edge.graphs or graphs:
            rows.append((nodes[edge.a], nodes[edge.b], {**params, "graph_idx": [2, graphs[graph]]}))
    return rows


def _split(map_objects: Iterable[MapObject], named: str) -> tuple[list[MapObject], list[MapObject]]:
    """Objects of an import (`named` and a number), and all others."""
    found: list[MapObject] = []
    others: list[MapObject] = []
    for map_object in map_objects:
        made = re.fullmatch(rf"({named})[1-9]\d*", map_object.name) and isinstance(map_object.shape, PolygonShape)
        (found if made and not map_object.heading else others).append(map_object)
    return found, others


def _ring(map_object: MapObject) -> list[XY]:
    assert isinstance(map_object.shape, PolygonShape)
    return [(map_object.at[0] + x, map_object.at[1] + y) for x, y in map_object.shape.points]


def _lift(building: Building, elevator: Elevator, losses: Losses) -> dict[str, Any]:
    order = [name for name in building.floors if name in elevator.floors()]
    doorways: dict[tuple[CabinSide, float, float], str] = {}
    level_doors: dict[str, list[str]] = {name: [] for name in order}
    for door in elevator.doors:
        label = doorways.setdefault((door.side, door.width, door.offset), f"{elevator.name}_door{len(doorways) + 1}")
        level_doors[door.floor].append(label)
    if (elevator.speed, elevator.door_time) != (1.0, 3.0):  # what a reader assumes
        losses.add("elevators: speed and door time are not kept: {names}", elevator.name)
    by_height = sorted(order, key=lambda name: building.floors[name].floor.elevation)
    return {
        "x": float(elevator.at[0]),
        "y": float(elevator.at[1]),
        "yaw": float(elevator.heading),
        "width": float(elevator.size[0]),
        "depth": float(elevator.size[1]),
        "reference_floor_name": order[0],
        "initial_floor_name": order[0],
        "lowest_floor": by_height[0],
        "highest_floor": by_height[-1],
        "plugins": True,
        "doors": {label: _doorway(elevator, *doorway) for doorway, label in doorways.items()},
        "level_doors": {name: tuple(labels) for name, labels in level_doors.items()},
    }


def _doorway(elevator: Elevator, side: CabinSide, width: float, offset: float) -> dict[str, Any]:
    x, y = elevator.size[0] / 2, elevator.size[1] / 2
    along_y = side in (CabinSide.LEFT, CabinSide.RIGHT)
    at = {
        CabinSide.FRONT: (offset, -y),
        CabinSide.BACK: (offset, y),
        CabinSide.LEFT: (-x, offset),
        CabinSide.RIGHT: (x, offset),
    }[side]
    return {
        "door_type": 2,
        "motion_axis_orientation": math.pi / 2 if along_y else 0.0,
        "width": float(width),
        "x": float(at[0]),
        "y": float(at[1]),
    }


def _report_levels(building: Building, losses: Losses) -> None:
    """Report floors whose level does not follow from their elevation."""
    ordered = sorted(building.floors.values(), key=lambda entry: entry.floor.elevation)
    below = sum(entry.floor.elevation < 0 for entry in ordered)
    for i, entry in enumerate(ordered):
        if entry.floor.level != i - below:
            losses.add("floors: the level is not kept, readers derive it from the elevation: {names}", entry.floor.name)
