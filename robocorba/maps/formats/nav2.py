"""nav2_route's route graph (GeoJSON), written: one file for each floor, since a map frame of nav2 holds one floor."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robocorba.maps.formats.files import floor_paths, write_file
from robocorba.maps.losses import Exported, Losses
from robocorba.maps.model import Building, FloorMap, PathEdge, PathNode

#: The frame that coordinates are given in, as nav2 names the map's.
FRAME = "map"


def write(building: Building, path: str | Path) -> Exported:
    """Write a graph for each floor that has edges; ids are unique over all of them.

    Raises MapFileError where a file can't be written."""
    losses = Losses()
    files: list[Path] = []
    ids = itertools.count()
    for floor, target in floor_paths(building, path, ".geojson").items():
        entry = building.floors[floor]
        if not entry.topological.edges:
            losses.add("floors without edges have no route graph, no file is written: {names}", floor)
            continue
        graph = {
            "type": "FeatureCollection",
            "name": floor,
            "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
            "features": list(_features(entry, ids)),
        }
        write_file(target, (json.dumps(graph, indent=1, ensure_ascii=False) + "\n").encode())
        files.append(target)
        if any(_dropped_collections(entry)):
            losses.add("walls, objects, doors and areas are not part of a route graph: {names}", floor)
    for name, elevator in building.elevators.items():
        floors = ", ".join(elevator.floors())
        losses.add(
            "elevators: no edge leads from floor to floor; nodes in a cabin name it in their metadata: {names}",
            f"{name} ({floors})",
        )
    return Exported(tuple(files), losses.sentences())


def _dropped_collections(entry: FloorMap) -> tuple[Any, ...]:
    """What of the geometrical map a route graph leaves out."""
    plan = entry.geometrical
    return plan.walls, plan.objects, plan.doors, plan.areas


def _features(entry: FloorMap, ids: Iterator[int]) -> Iterator[dict[str, Any]]:
    plan = entry.topological
    id_of = {name: next(ids) for name in plan.nodes}
    for node in plan.nodes.values():
        yield _node(node, entry.floor.name, id_of[node.name])
    for edge in plan.edges.values():
        directions = [(edge.a, edge.b)] if edge.one_way else [(edge.a, edge.b), (edge.b, edge.a)]
        for start, end in directions:
            yield _edge(edge, plan.nodes[start], plan.nodes[end], next(ids), id_of)


def _node(node: PathNode, floor: str, id_: int) -> dict[str, Any]:
    metadata = {"name": node.name, "floor": floor}
    if node.elevator:
        metadata["elevator"] = node.elevator
    return {
        "type": "Feature",
        "properties": {"id": id_, "frame": FRAME, "metadata": metadata},
        "geometry": {"type": "Point", "coordinates": [float(node.at[0]), float(node.at[1])]},
    }


def _edge(edge: PathEdge, start: PathNode, end: PathNode, id_: int, id_of: dict[str, int]) -> dict[str, Any]:
    """nav2_route reads a speed limit in m/s under abs_speed_limit; its speed_limit is a share of the largest speed."""
    metadata: dict[str, Any] = {"name": edge.name}
    if edge.speed_limit:
        metadata["abs_speed_limit"] = float(edge.speed_limit)
    if edge.clearance:
        metadata["clearance"] = float(edge.clearance)
    if edge.graphs:
        metadata["graphs"] = list(edge.graphs)
    line = [[float(x), float(y)] for x, y in (start.at, end.at)]
    return {
        "type": "Feature",
        "properties": {
            "id": id_,
            "startid": id_of[start.name],
            "endid": id_of[end.name],
            "cost": math.dist(start.at, end.at),
            "overridable": True,
            "metadata": metadata,
        },
        "geometry": {"type": "MultiLineString", "coordinates": [line]},
    }
