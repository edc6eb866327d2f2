"""Where a robot waits for an elevator."""

from __future__ import annotations

import math

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point

from robocorba.control.base import DOOR_GAP_M, ELEVATOR_CALL_DISTANCE_M, call_point
from robocorba.kinematics.smartpal import RADIUS_M

CLEAR_M = RADIUS_M + DOOR_GAP_M


def test_small_cabins_are_called_from_afar() -> None:
    assert call_point((-5.0, 0.0), (0.0, 0.0), None) == pytest.approx((-ELEVATOR_CALL_DISTANCE_M, 0.0))
    assert call_point((-5.0, 0.0), (0.0, 0.0), shapely.box(-1, -1, 1, 1)) == pytest.approx((-2.0, 0.0))


def test_a_robot_waits_clear_of_the_doors_of_a_large_cabin() -> None:
    assert call_point((-5.0, 0.0), (0.0, 0.0), shapely.box(-1.6, -1.6, 1.6, 1.6)) == pytest.approx((-1.6 - CLEAR_M, 0))
    x, _ = call_point((-3.2, 1.3), (0.0, 0.0), shapely.box(-1.6, -1.6, 1.6, 1.6))  # once stuck at these doors
    assert x == pytest.approx(-1.6 - CLEAR_M, abs=1e-3)


def test_a_robot_that_is_nearer_stays() -> None:
    assert call_point((-1.5, 0.0), (0.0, 0.0), None) == pytest.approx((-1.5, 0.0))
    assert call_point((-1.9, 0.0), (0.0, 0.0), shapely.box(-1.6, -1.6, 1.6, 1.6)) == pytest.approx((-1.9, 0.0))
    assert call_point((0.0, 0.0), (0.0, 0.0), shapely.box(-1.6, -1.6, 1.6, 1.6)) == pytest.approx((0.0, 0.0))


@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.5, 3.0), st.floats(0.5, 3.0))
@settings(deadline=None)
def test_the_point_is_on_the_way_and_clear(x: float, y: float, half_x: float, half_y: float) -> None:
    shaft = shapely.box(-half_x, -half_y, half_x, half_y)
    at = call_point((x, y), (0.0, 0.0), shaft)
    assert math.hypot(*at) <= math.hypot(x, y) + 1e-9
    assert abs(at[0] * y - at[1] * x) < 1e-6
    clear_m = min(CLEAR_M, shaft.distance(Point(x, y)))
    assert shaft.distance(Point(at)) >= clear_m - 0.01  # corners of the buffer are polygons
