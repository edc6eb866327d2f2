"""Regions of cells become few simple polygons that cover them and exceed them by half a cell at most."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis.extra.numpy import array_shapes, arrays

from robocorba.maps.formats.solids import MAX_RING_POINTS, rings, solids

REGIONS = arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=11))


def _squares(region: np.ndarray) -> shapely.Geometry:
    """The cells of a region as squares."""
    row, column = np.nonzero(region)
    up = len(region) - 1 - row
    return shapely.union_all(shapely.box(column, up, column + 1, up + 1))


def _polygons(region: np.ndarray, max_points: int = MAX_RING_POINTS) -> list[shapely.Polygon]:
    return [shapely.Polygon(solid.points) for solid in solids(region, max_points)[0]]


def _check(region: np.ndarray, max_points: int = MAX_RING_POINTS) -> None:
    polygons, cells = _polygons(region, max_points), _squares(region)
    assert all(polygon.is_valid and polygon.area > 0 for polygon in polygons)
    union = shapely.union_all(polygons)
    assert cells.difference(union).area < 1e-9
    assert union.difference(cells.buffer(0.5 + 1e-9)).area < 1e-9


@settings(max_examples=300, deadline=None)
@given(REGIONS)
def test_any_region_is_covered_by_simple_polygons(region: np.ndarray) -> None:
    _check(region)


@settings(max_examples=60, deadline=None)
@given(REGIONS)
def test_large_polygons_are_cut(region: np.ndarray) -> None:
    _check(region, max_points=8)
    assert all(len(solid.points) <= 8 for solid in solids(region, 8)[0])


def test_a_solid_with_a_hole_is_two_pieces() -> None:
    region = np.ones((9, 9), bool)
    region[3:6, 3:6] = False
    assert shapely.union_all(_polygons(region)).area == 81 - 9
    assert len(_polygons(region)) == 2


def test_a_grid_of_rooms_is_a_few_combs() -> None:
    region = np.ones((81, 81), bool)
    for row in range(8):
        for column in range(8):
            region[row * 10 + 1 : row * 10 + 10, column * 10 + 1 : column * 10 + 10] = False
    polygons = _polygons(region)
    assert len(polygons) == 9
    assert shapely.union_all(polygons).equals(_squares(region))


def test_a_diagonal_staircase_is_a_straight_line() -> None:
    row, column = np.indices((40, 40))
    (ring,) = rings((row > column) & (row < 38) & (column > 1))
    assert len(ring.points) <= 6


def test_a_diagonal_row_of_cells_is_one_solid() -> None:
    (polygon,) = _polygons(np.pad(np.eye(20, dtype=bool), 2))
    assert polygon.area == pytest.approx(20 + 19)
    assert len(polygon.exterior.coords) == 7


def test_a_diagonal_passage_of_one_cell_keeps_its_width() -> None:
    """A robot that fits through the cells fits between the polygons."""
    region = np.ones((16, 16), bool)
    for i in range(15):
        region[i, i] = region[i, i + 1] = False
    free = shapely.box(0, 0, 16, 16).difference(shapely.union_all(_polygons(region)))
    assert free.equals(_squares(~region))
