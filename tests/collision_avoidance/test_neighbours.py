"""Positions of other robots, extrapolated from a data pool that lags."""

from __future__ import annotations

import pytest

from robocorba.collision_avoidance.neighbours import PoolNearby
from robocorba.data_pool.pool import STALE_S
from robocorba.errors.services import NotReachable
from robocorba.kinematics.smartpal import RADIUS_M
from tests.data_pool.places import Place
from tests.simulation.places import robot


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
