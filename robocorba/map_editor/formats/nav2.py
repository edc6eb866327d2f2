"""Makes the route graph of nav2_route (GeoJSON): one file per floor, since a nav2 map frame has one floor."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robocorba.map_editor.formats.files import floor_paths
from robocorba.map_editor.formats.map_format import MapFormat
from robocorba.map_editor.losses import Exported, Losses
from robocorba.map_editor.model import Building, FloorMap, PathEdge, PathNode


def _write(building: Building, path: Path, resolution_m: float, image: str) -> Exported:
    """A graph for each floor with edges. Ids are unique across all graphs."""
    losses = Losses()
    files: dict[Path, bytes] = {}
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
        files[target] = (json.dumps(graph, indent=1, ensure_ascii=False) + "\n").encode()
        plan = entry.geometrical
        if plan.walls or plan.objects or plan.doors or plan.areas:
            losses.add("walls, objects, doors and areas are not part of a route graph: {names}", floor)
    for name, elevator in building.elevators.items():
        floors = ", ".join(elevator.floors())
        losses.add(
            "elevators: no edge connects floors; nodes in a cabin name the elevator in their metadata: {names}",
            f"{name} ({floors})",
        )
    return Exported(files, losses.sentences())


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
        "properties": {"id": id_, "frame": "map", "metadata": metadata},
        "geometry": {"type": "Point", "coordinates": [float(node.at[0]), float(node.at[1])]},
    }


def _edge(edge: PathEdge, start: PathNode, end: PathNode, id_: int, id_of: dict[str, int]) -> dict[str, Any]:
    """An edge as a feature. abs_speed_limit is in m/s; speed_limit of nav2_route is a share of the maximum speed."""
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


FORMAT = MapFormat(
    name="nav2",
    title="Nav2 route graph (.geojson)",
    files="a GeoJSON file for each floor that has edges",
    suffix=".geojson",
    write=_write,
)
