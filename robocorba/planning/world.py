"""All floors and the roadmap of a building as arrays for the compiled search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.planning.packing import Packed, pack
from robocorba.planning.road_rules import LANE_COLUMNS, RoadRules
from robocorba.planning.roads import MEASURES, RoadmapArrays
from robocorba.planning.space import FloorSpace, point_is_free
from robocorba.system.kernels import inner_kernel, kernel


class Ground(NamedTuple):
    """Grids and rings of all floors, concatenated.

    Floor f has frames[f], start[first_cell[f]:first_cell[f + 1]], borders[first_border[f]:first_border[f + 1]],
    rings[first_ring[f]:first_ring[f + 1]], and the nodes first_node[f]:first_node[f + 1]. See FloorSpace for their
    meaning."""

    segments: Floats
    start: Longs
    items: Longs
    frames: Floats
    first_cell: Longs
    borders: Floats
    first_border: Longs
    rings: Floats
    first_ring: Longs
    inside: Longs
    elevations: Floats
    first_node: Longs


def pack_world(
    spaces: Sequence[FloorSpace], lanes: Sequence[Floats], elevations: Floats, roads: RoadmapArrays
) -> Packed:
    """Pack the spaces of the floors, their lanes (n, LANE_COLUMNS) and elevations [m] in floor order, and the
    roadmap."""
    grids = [space.grid for space in spaces]
    first_segment = _firsts([grid.segments for grid in grids])
    first_item = _firsts([grid.items for grid in grids])
    floats = [
        _joined([grid.segments for grid in grids]),
        _joined([grid.frame for grid in grids]),
        _joined([space.borders for space in spaces]),
        _joined(lanes),
        roads.xy,
        roads.measures,
        elevations,
        _joined([space.rings for space in spaces]),
    ]
    longs = [
        _joined([grid.start + first for grid, first in zip(grids, first_item, strict=False)]),
        _joined([grid.items + first for grid, first in zip(grids, first_segment, strict=False)]),
        _firsts([grid.start for grid in grids]),
        _firsts([space.borders for space in spaces]),
        np.array([space.inside for space in spaces]),
        _firsts(lanes),
        *(roads.floor, roads.first, roads.to, roads.elevator, roads.fixed),
        np.searchsorted(roads.floor, np.arange(len(spaces) + 1)),
        _firsts([space.rings for space in spaces]),
    ]
    return pack(floats, longs)


def _joined(parts: Sequence[Any]) -> Any:
    return np.concatenate([np.empty(0), *(part.ravel() for part in parts)])


def _firsts(parts: Sequence[Any]) -> Longs:
    return np.concatenate([np.zeros(1, np.int64), np.cumsum([len(part) for part in parts], dtype=np.int64)])


@kernel
def unpack(world: Packed) -> tuple[Ground, RoadmapArrays]:
    """The parts of a packed world, as views."""
    n, f = world
    ground = Ground(
        f[n[0] : n[1]].reshape((n[1] - n[0]) // 4, 4),
        n[n[9] : n[10]],
        n[n[10] : n[11]],
        f[n[1] : n[2]].reshape((n[2] - n[1]) // 5, 5),
        n[n[11] : n[12]],
        f[n[2] : n[3]].reshape((n[3] - n[2]) // 4, 4),
        n[n[12] : n[13]],
        f[n[7] : n[8]].reshape((n[8] - n[7]) // 6, 6),
        n[n[21] : n[22]],
        n[n[13] : n[14]],
        f[n[6] : n[7]],
        n[n[20] : n[21]],
    )
    roads = RoadmapArrays(
        f[n[4] : n[5]].reshape((n[5] - n[4]) // 2, 2),
        n[n[15] : n[16]],
        n[n[16] : n[17]],
        n[n[17] : n[18]],
        n[n[18] : n[19]],
        f[n[5] : n[6]].reshape((n[6] - n[5]) // MEASURES, MEASURES),
        n[n[19] : n[20]],
    )
    return ground, roads


@inner_kernel
def packed_rules(world: Packed) -> RoadRules:
    """The rules of a packed world."""
    n, f = world
    lanes = f[n[3] : n[4]].reshape((n[4] - n[3]) // LANE_COLUMNS, LANE_COLUMNS)
    return RoadRules(lanes, n[n[14] : n[15]])


@kernel
def floor_grid(ground: Ground, floor: int) -> Grid:
    """The grid of one floor."""
    cells = ground.start[ground.first_cell[floor] : ground.first_cell[floor + 1]]
    return Grid(ground.segments, cells, ground.items, ground.frames[floor])


@inner_kernel
def floor_point_is_free(ground: Ground, floor: int, x: float, y: float, radius: float) -> bool:
    """Whether a robot of this radius [m] fits at a point of a floor."""
    borders = ground.borders[ground.first_border[floor] : ground.first_border[floor + 1]]
    rings = ground.rings[ground.first_ring[floor] : ground.first_ring[floor + 1]]
    return point_is_free(floor_grid(ground, floor), borders, rings, ground.inside[floor], x, y, radius)
