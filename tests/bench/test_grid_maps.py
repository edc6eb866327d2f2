"""The grid maps of the benches: connected, the same for the same seed, and walls where cells differ."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from robocorba.maps.validation import problems
from robocorba.testing.grid_maps import FLOOR, KINDS, OctileGraph, building_of, maze, place_of, random_cells, rooms


@pytest.mark.parametrize("kind", KINDS)
def test_maps_are_the_same_for_the_same_seed_and_mostly_connected(kind: str) -> None:
    cells = KINDS[kind](200, 1)
    assert cells.shape == (200, 200) and cells.dtype == np.bool_
    assert (cells == KINDS[kind](200, 1)).all()
    assert (cells != KINDS[kind](200, 2)).any()
    reached = np.isfinite(OctileGraph(cells, 1.0).lengths_from(random_cells(cells, 1, 0)[0]))
    assert reached.sum() > 0.75 * cells.sum()


@pytest.mark.parametrize("cells", [rooms(60, 8, 1), maze(61, 3, 1)], ids=["rooms", "maze"])
def test_every_room_and_corridor_can_be_reached(cells: np.ndarray) -> None:
    reached = np.isfinite(OctileGraph(cells, 1.0).lengths_from((0, 0)))
    assert (reached == cells).all()


def test_walls_are_the_borders_of_the_free_cells() -> None:
    cells = KINDS["laser"](80, 3)
    building = building_of(cells, 0.5)
    assert problems(building) == []
    walls = shapely.union_all(
        [shapely.LineString([w.a, w.b]) for w in building.floors[FLOOR].geometrical.walls.values()]
    )
    rows, columns = np.nonzero(cells)
    free = shapely.union_all(shapely.box(columns * 0.5, rows * 0.5, columns * 0.5 + 0.5, rows * 0.5 + 0.5))
    outline = shapely.box(0.0, 0.0, 40.0, 40.0).exterior
    assert walls.symmetric_difference(free.boundary.difference(outline)).length == pytest.approx(0.0)


def test_runs_are_maximal() -> None:
    cells = np.ones((4, 5), np.bool_)
    cells[1:3, 1:4] = False
    assert len(building_of(cells, 1.0).floors[FLOOR].geometrical.walls) == 4


def test_octile_lengths_do_not_cut_corners() -> None:
    cells = np.ones((3, 3), np.bool_)
    cells[1, 1] = False
    lengths = OctileGraph(cells, 2.0).lengths_from((0, 0))
    assert lengths[2, 2] == 8.0 and np.isinf(lengths[1, 1])
    assert OctileGraph(np.ones((3, 3), np.bool_), 2.0).lengths_from((0, 0))[2, 2] == pytest.approx(4.0 * 2**0.5)


def test_places_are_centres_of_cells() -> None:
    assert place_of((2, 0), 0.5)[1:] == (0.25, 1.25)
