"""Places on a floor where a robot can start: free path nodes first, then free places near them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from shapely import LineString

from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.data_pool.snapshot import FloorSnapshot

#: Distance of a robot's rim from walls, objects and other robots at its start [m].
GAP_M = 0.1


def start_places(nodes: Sequence[XY], floor: FloorSnapshot, radius_m: float) -> Iterator[XY]:
    """Free places (x, y) [m] for a robot of `radius_m`; nodes: the path nodes of the floor. Around each node are eight
    rings of places, the innermost of six, the others of multiples. Places near a node can be reached from it on a
    straight line."""
    spacing_m = 2.0 * (radius_m + GAP_M)
    yield from (node for node in nodes if _is_free(node, floor, radius_m, 0.0))
    for ring in range(1, 9):
        for node in nodes:
            for place in _around(node, ring * spacing_m, ring * 6):
                if _is_free(place, floor, radius_m, GAP_M) and _is_clear(node, place, floor, radius_m):
                    yield place


def _around(node: XY, distance_m: float, count: int) -> Iterator[XY]:
    for number in range(count):
        angle = math.tau * number / count
        yield node[0] + distance_m * math.cos(angle), node[1] + distance_m * math.sin(angle)


def _is_free(place: XY, floor: FloorSnapshot, radius_m: float, gap_m: float) -> bool:
    """Whether the place is free of robots, and with a gap also of everything else; a path node is free of walls."""
    if floor.robots_near(*place, radius_m + gap_m):
        return False
    near = floor.nearest_non_robot(*place)
    return not gap_m or near is None or near.distance_m > radius_m + gap_m


def _is_clear(node: XY, place: XY, floor: FloorSnapshot, radius_m: float) -> bool:
    return floor.walls is None or floor.walls.distance_m(LineString([node, place])) > radius_m
