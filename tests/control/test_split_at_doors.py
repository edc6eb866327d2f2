"""Where a robot waits for an elevator."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from robocorba.control.elevator_rides import DOOR_GAP_M, ELEVATOR_CALL_DISTANCE_M, split_at_doors
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.spatial.pose import XY

CLEAR_M = RADIUS_M + DOOR_GAP_M
LARGE = shapely.box(-1.6, -1.6, 1.6, 1.6)


def waits_at(start: XY, shaft: shapely.Polygon | None) -> XY:
    """Where a robot waits that drives straight to the middle of a cabin."""
    outside, inside = split_at_doors([start, (0.0, 0.0)], shaft)
    assert inside == [(0.0, 0.0)]
    (at,) = outside
    return at


def test_small_cabins_are_called_from_afar() -> None:
    assert waits_at((-5.0, 0.0), None) == pytest.approx((-ELEVATOR_CALL_DISTANCE_M, 0.0))
    assert waits_at((-5.0, 0.0), shapely.box(-1, -1, 1, 1)) == pytest.approx((-2.0, 0.0))


def test_a_robot_waits_clear_of_the_doors_of_a_large_cabin() -> None:
    assert waits_at((-5.0, 0.0), LARGE) == pytest.approx((-1.6 - CLEAR_M, 0))
    x, _ = waits_at((-3.2, 1.3), LARGE)  # once stuck at these doors
    assert x == pytest.approx(-1.6 - CLEAR_M, abs=1e-3)


def test_a_robot_that_is_nearer_stays() -> None:
    assert waits_at((-1.5, 0.0), None) == pytest.approx((-1.5, 0.0))
    assert waits_at((-1.9, 0.0), LARGE) == pytest.approx((-1.9, 0.0))
    assert waits_at((0.0, 0.0), LARGE) == pytest.approx((0.0, 0.0))


def test_a_path_that_turns_at_the_doors_ends_before_them() -> None:
    """The path around the post of a door passes the closed door more closely than its robot is wide."""
    path = [(4.0, -3.0), (4.0, -2.05), (0.66, -2.0), (0.6, -1.7), (0.0, 0.0)]
    outside, inside = split_at_doors(path, LARGE)
    assert outside == [path[1], pytest.approx((1.87, -2.02), abs=0.01)]
    assert inside == path[2:]


#: To the micrometre, beyond which lengths of almost nothing are not exact.
coordinates = st.integers(-6_000_000, 6_000_000).map(lambda micrometres: micrometres / 1e6)
points = st.tuples(coordinates, coordinates)


@given(st.lists(points, min_size=1, max_size=5), st.floats(0.5, 3.0), st.floats(0.5, 3.0))
@settings(deadline=None)
def test_the_parts_are_the_path_and_the_first_is_clear(corners: list[XY], half_x: float, half_y: float) -> None:
    path, shaft = [*corners, (0.0, 0.0)], shapely.box(-half_x, -half_y, half_x, half_y)
    outside, inside = split_at_doors(path, shaft)
    both = [path[0], *outside, *inside]
    assert sum(np.hypot(*np.subtract(*ends)) for ends in pairwise(both)) == pytest.approx(LineString(path).length)
    assert both[-1] == path[-1]
    assert all(LineString(path).distance(Point(point)) < 1e-9 for point in both)
    clear_m = min(CLEAR_M, shaft.distance(Point(path[0])))
    assert shaft.distance(Point(outside[-1])) >= clear_m - 0.01  # corners of the buffer are polygons
