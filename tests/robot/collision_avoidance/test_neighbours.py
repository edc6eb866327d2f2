"""What a robot sees of others in its data pool: their positions now, and obstacles that are not on the map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from shapely import Point, Polygon

from robocorba.errors.services import NotReachable
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from robocorba.robot.base import PATH_CLEARANCES_M
from robocorba.robot.collision_avoidance.neighbours import CLEARANCE_M, MIN_CLEARANCE_M, Nearby
from robocorba.robot.collision_avoidance.policy import DEFAULT_POLICY, GivingWayPolicy
from robocorba.robot.data_pool.pool import STALE_S
from robocorba.robot.kinematics.smartpal import RADIUS_M
from tests.robot.data_pool.places import Place
from tests.simulation.places import robot


def seen_by_a(other_y: float, name: str = "A", policy: GivingWayPolicy = DEFAULT_POLICY, **more: Any) -> Nearby:
    """By A at (7, 1); B stands at (7, other_y), C drives."""
    place = Place()
    place.world.refresh()
    for who, y in (("A", 1.0), ("B", other_y), ("C", 9.0)):
        place.world.add(robot(who, y=y))
    place.world.occupants.robots["C"].command(1.0, 0.0, 0.0, 5.0)
    place.run(1.0)
    pool = place.loaded_pool(own_name="A")
    return Nearby(pool, name, policy, **more)


def areas(found: TemporaryObstacles) -> list[Polygon]:
    assert {floor for floor, _ in found.forbidden_areas} == {"L1"}
    return [Polygon(corners) for _, corners in found.forbidden_areas]


def test_robots_and_goals_are_outside_the_area_of_a_near_robot_whose_full_size_is_known() -> None:
    seen = seen_by_a(1.83)
    near, *_ = areas(seen.temporary_obstacles())
    assert near.distance(Point(7.0, 1.0)) >= RADIUS_M + MIN_CLEARANCE_M - 1e-6
    (parked,) = areas(seen.parked_robots())
    assert seen.parked_robots().names == ("B",)
    assert parked.area == pytest.approx(Point(0.0, 0.0).buffer(RADIUS_M).area, rel=0.05)
    near, *_ = areas(seen_by_a(4.0).temporary_obstacles(goal=(7.0, 4.85)))
    assert near.distance(Point(7.0, 4.85)) >= RADIUS_M + MIN_CLEARANCE_M - 1e-6
    assert near.contains(Point(7.0, 4.0).buffer(0.42 - PATH_CLEARANCES_M[0]))  # the clearance of paths


def test_stationary_robots_and_objects_without_the_held_one_and_too_many_are_left_to_the_map() -> None:
    seen = seen_by_a(3.0)
    found = seen.temporary_obstacles()
    disc, table = areas(found)
    assert (found.without_movables, found.names) == (("L1",), ("B", "T1"))
    assert disc.centroid.distance(Point(7.0, 3.0)) < 0.001
    assert disc.contains(Point(7.0, 3.0).buffer(RADIUS_M + CLEARANCE_M - 0.001))
    assert disc.area == pytest.approx(Point(0.0, 0.0).buffer(RADIUS_M + CLEARANCE_M).area, rel=0.05)
    assert (table.centroid.x, table.centroid.y, table.area) == pytest.approx((2.0, 2.0, 0.6))
    assert len(areas(seen.temporary_obstacles(also="C"))) == 3
    assert seen.movable_objects() == found._replace(forbidden_areas=found.forbidden_areas[1:], names=("T1",))
    assert seen.movable_objects("T1") == TemporaryObstacles((), ("L1",))
    nobody = seen_by_a(3.0, "nobody")
    assert nobody.temporary_obstacles() == nobody.movable_objects() == TemporaryObstacles()
    found = seen_by_a(3.0, policy=GivingWayPolicy(max_objects=0)).temporary_obstacles()
    assert (len(found.forbidden_areas), found.without_movables) == (1, ())


def test_positions_are_extrapolated_and_robots_are_no_obstacles_on_the_map() -> None:
    place = Place()
    for name, y in (("A", 1.0), ("B", 3.0), ("far", 9.0)):
        place.world.add(robot(name, y=y))
    place.world.occupants.robots["B"].command(0.5, 0.0, 0.0, 5.0)
    place.run(1.0)
    pool = place.pool(own_name="A")
    nearby = Nearby(pool, "A")
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
    assert nearby.clearance_m(7.0, 2.0) == pytest.approx(2.0)  # to the bounds of the floor, not to B


def test_what_a_robot_carries_is_the_object_and_those_who_hold_it_too() -> None:
    place = Place()
    place.world.refresh()
    # The table, 1.0 x 0.6 m at (2, 2), between A and B; C stands by with its back to it.
    for who, x, y, heading in (("A", 2.0, 1.0, 0.5), ("B", 2.0, 3.0, -0.5), ("C", 0.9, 2.0, 1.0)):
        place.world.add(robot(who, x=x, y=y, heading=heading * math.pi))
    place.run(0.1)
    pool = place.loaded_pool(own_name="A")
    nearby = Nearby(pool, "A")
    carried = nearby.carried("T1")
    assert carried is not None
    table, other, by_itself = Point(1.0, 0.0), Point(2.3, 0.0), Point(1.0, 1.1)
    assert [carried.contains(point) for point in (table, other, by_itself)] == [True, True, False]
    assert not carried.contains(Point(0.4, 0.0))
    assert nearby.carried("") is nearby.carried("nothing") is None


def test_a_robot_that_reports_nothing_is_only_what_is_seen_of_it() -> None:
    outline = ((6.7, 1.6), (7.3, 1.6), (7.3, 2.0))
    thing = TemporaryObstacles((("L1", outline), ("L2", outline)), names=("seen thing 1", "seen thing 2"))
    near = seen_by_a(1.9, seen=lambda: thing, reports={"C"}.__contains__)
    assert [other.name for other in near.others(7.0, 5.0)] == ["C"]
    assert near.robot_at(7.0, 1.6) is None
    assert near.parked_robots().names == ()
    assert near.temporary_obstacles().names == ("T1",)
    assert near.clearance_m(7.0, 1.0) == pytest.approx(0.6)
    assert near.seen_around(7.0, 1.0).min(axis=0) == pytest.approx((-0.3, 0.6))
    assert near.seen_on([(5.0, 1.25), (9.0, 1.25)], 0.4) == "seen thing 1"
    assert near.seen_on([(5.0, 1.15), (9.0, 1.15)], 0.4) == ""
    found = near.with_seen(near.movable_objects(), (7.0, 1.0))
    assert found.names[0] == "T1"
    assert set(found.names[1:]) == {"seen thing 1", "seen thing 2"}
    (around, *_) = (Polygon(corners) for floor, corners in found.forbidden_areas[1:] if floor == "L1")
    assert around.contains(Polygon(outline).buffer(0.04))
    assert around.distance(Point(7.0, 1.0)) >= RADIUS_M + MIN_CLEARANCE_M - 0.01  # never where it is itself


def test_what_is_known_explains_echoes() -> None:
    near, silent = seen_by_a(3.0), seen_by_a(3.0, reports=lambda name: False)
    #: Beside the table, at its border, at a robot.
    echoes = np.array([(2.0, 3.0), (2.0, 1.75), (7.0, 2.6)])
    assert near.explains("L1", echoes, np.full(3, 0.1)).tolist() == [False, True, True]
    assert silent.explains("L1", echoes, np.full(3, 0.1)).tolist() == [False, True, False]
    assert near.explains("L1", echoes, np.full(3, 2.0)).all()
    assert near.explains("L1", np.empty((0, 2)), np.empty(0)).shape == (0,)
    with pytest.raises(NotReachable, match="not on floor L2"):
        near.explains("L2", echoes, np.full(3, 0.1))
