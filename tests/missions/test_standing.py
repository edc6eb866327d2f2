"""What robots that gather drive around."""

from __future__ import annotations

import pytest
from shapely import Point, Polygon

from robocorba.missions.standing import standing
from tests.data_pool.places import Place
from tests.simulation.places import robot


def test_robots_that_stand_and_objects_where_they_are() -> None:
    place = Place()
    place.world.refresh()
    for name, y in (("A", 1.0), ("B", 3.0), ("C", 9.0)):
        place.world.add(robot(name, y=y))
    place.world.robots["C"].command(1.0, 0.0, 0.0, 5.0)
    place.run(1.0)
    pool = place.pool(oneself="A")
    pool.follow()
    found = [Polygon(corners) for floor, corners in standing(pool.snapshot(), "A") if floor == "L1"]
    disc, table = found
    assert disc.centroid.distance(Point(7.0, 3.0)) < 0.001
    assert disc.area == pytest.approx(Point(0.0, 0.0).buffer(0.4).area, rel=0.15)
    assert (table.centroid.x, table.centroid.y, table.area) == pytest.approx((2.0, 2.0, 0.6))
    assert standing(pool.snapshot(), "nobody") == []
