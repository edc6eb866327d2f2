"""What a robot sees of others in its data pool: their positions now, and obstacles that are not on the map."""

from __future__ import annotations

import pytest
from shapely import Point, Polygon

from robocorba.errors.services import NotReachable
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.base import PATH_CLEARANCES_M
from robocorba.robot.collision_avoidance.neighbours import PoolNearby
from robocorba.robot.collision_avoidance.policy import GivingWayPolicy
from robocorba.robot.collision_avoidance.temporary_obstacles import (
    CLEARANCE_M,
    MIN_CLEARANCE_M,
    movable_objects,
    parked_robots,
    temporary_obstacles,
)
from robocorba.robot.data_pool.pool import STALE_S
from robocorba.robot.data_pool.snapshot import FloorSnapshot
from robocorba.robot.kinematics.smartpal import RADIUS_M
from tests.robot.data_pool.places import Place
from tests.simulation.places import robot


def seen_by_a(*others_y: float) -> FloorSnapshot:
    """By A at (7, 1); C drives."""
    place = Place()
    place.world.refresh()
    place.world.add(robot("A", y=1.0))
    for number, y in enumerate(others_y):
        place.world.add(robot(f"B{number}", y=y))
    place.world.add(robot("C", y=9.0))
    place.world.occupants.robots["C"].command(1.0, 0.0, 0.0, 5.0)
    place.run(1.0)
    pool = place.pool(own_name="A")
    pool.follow()
    return pool.snapshot()


def test_stationary_robots_and_present_poses_of_objects() -> None:
    seen = seen_by_a(3.0)
    found = temporary_obstacles(seen, "A")
    assert found.without_movables == ("L1",)
    disc, table = (Polygon(corners) for floor, corners in found.forbidden_areas if floor == "L1")
    assert disc.centroid.distance(Point(7.0, 3.0)) < 0.001
    assert disc.contains(Point(7.0, 3.0).buffer(RADIUS_M + CLEARANCE_M - 0.001))
    assert disc.area == pytest.approx(Point(0.0, 0.0).buffer(RADIUS_M + CLEARANCE_M).area, rel=0.05)
    assert (table.centroid.x, table.centroid.y, table.area) == pytest.approx((2.0, 2.0, 0.6))
    assert temporary_obstacles(seen, "nobody") == TemporaryObstacles()
    assert len(temporary_obstacles(seen, "A", also="C").forbidden_areas) == 3


def test_movable_objects_without_the_held_one() -> None:
    seen = seen_by_a(3.0)
    found = movable_objects(seen, "A")
    both = temporary_obstacles(seen, "A")
    assert found == both._replace(forbidden_areas=both.forbidden_areas[1:], names=("T1",))
    assert both.names == ("B0", "T1")
    (held,) = [thing.name for thing in seen.objects() if thing.is_movable]
    assert movable_objects(seen, "A", held) == TemporaryObstacles((), ("L1",))
    assert movable_objects(seen, "nobody") == TemporaryObstacles()


def test_parked_robots_in_full_size() -> None:
    found = parked_robots(seen_by_a(1.83), "A")
    assert found.names == ("B0",)
    disc = Polygon(found.forbidden_areas[0][1])
    assert disc.area == pytest.approx(Point(0.0, 0.0).buffer(RADIUS_M).area, rel=0.05)


def test_the_robot_is_outside_the_area_of_a_near_robot() -> None:
    near, *_ = (Polygon(corners) for _, corners in temporary_obstacles(seen_by_a(1.83), "A").forbidden_areas)
    assert near.distance(Point(7.0, 1.0)) >= RADIUS_M + MIN_CLEARANCE_M - 1e-6


def test_the_goal_is_outside_the_area_of_a_near_robot() -> None:
    near, *_ = (
        Polygon(corners) for _, corners in temporary_obstacles(seen_by_a(4.0), "A", goal=(7.0, 4.85)).forbidden_areas
    )
    assert near.distance(Point(7.0, 4.85)) >= RADIUS_M + MIN_CLEARANCE_M - 1e-6
    assert near.contains(Point(7.0, 4.0).buffer(0.42 - PATH_CLEARANCES_M[0]))  # the clearance of paths


def test_too_many_objects_are_left_to_the_map() -> None:
    found = temporary_obstacles(seen_by_a(3.0), "A", policy=GivingWayPolicy(max_objects=0))
    assert (len(found.forbidden_areas), found.without_movables) == (1, ())


def test_positions_are_extrapolated() -> None:
    place = Place()
    for name, y in (("A", 1.0), ("B", 3.0), ("far", 9.0)):
        place.world.add(robot(name, y=y))
    place.world.occupants.robots["B"].command(0.5, 0.0, 0.0, 5.0)
    place.run(1.0)
    pool = place.pool(own_name="A")
    nearby = PoolNearby(pool, "A")
    with pytest.raises(NotReachable, match="has not been requested yet"):
        nearby.others(7.0, 1.0)
    pool.follow()
    (now,) = nearby.others(7.0, 1.0)
    assert (now.name, now.vx, now.radius_m) == ("B", pytest.approx(0.5), RADIUS_M)
    place.clock.now += 0.2
    (later,) = nearby.others(7.0, 1.0)
    assert (later.x - now.x, later.y) == (pytest.approx(0.1), pytest.approx(3.0))
    assert later.radius_m == pytest.approx(RADIUS_M + 0.02)
    place.clock.now += STALE_S
    with pytest.raises(NotReachable, match="lags"):
        nearby.others(7.0, 1.0)


def test_clearance_ignores_robots() -> None:
    place = Place()
    place.world.add(robot("B", x=7.0, y=2.0))
    pool = place.pool(own_name="A")
    pool.follow()
    assert PoolNearby(pool, "A").clearance_m(7.0, 1.0) == pytest.approx(1.0)  # the bounds of the floor, not B
