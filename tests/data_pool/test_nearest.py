"""What is nearest to a place, against shapely asked of everything there is."""

from __future__ import annotations

import math

import pytest
import shapely
import shapely.affinity
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Point
from shapely.geometry.base import BaseGeometry

from robocorba.data_pool.pool import DataPool
from robocorba.errors.paths import InvalidPoint, InvalidRequest
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building, Floor, FloorMap, Wall
from robocorba.maps.movable import landing_doors, object_outline
from robocorba.simulation.registry import Description, Pose
from robocorba.spatial.elevator_state import Doors
from tests.data_pool.places import Place
from tests.simulation.places import robot


def crowd(floor: str = "L2") -> Place:
    """Robots of several sizes beside the furniture."""
    place = Place()
    for number, (x, y, radius_m) in enumerate([(7.0, 2.0, 0.4), (8.0, 4.0, 0.25), (2.2, 4.6, 0.1), (5.0, 5.0, 0.3)]):
        place.world.add(Description(f"R{number}", Pose(floor, x, y, 1.0), radius_m))
    place.world.refresh()
    return place


def everything(place: Place, floor: str, oneself: str) -> dict[str, list[tuple[BaseGeometry, float]]]:
    """All that stands and moves, by name: shapes, and how far it goes beyond them, m."""
    building, physics = place.world.building, place.world.floors[floor]
    movable = {thing.name for thing, _ in place.world.objects.values()}
    found: dict[str, list[tuple[BaseGeometry, float]]] = {}
    for item in obstacles(building, floor):
        if item.kind != "object" or item.name not in movable:
            found.setdefault(item.name, []).append((item.geometry, 0.0))
    for name, moment in place.world.elevator_states_on(floor).items():
        if moment.floor != floor or moment.doors is not Doors.OPEN:
            found.setdefault(name, []).append((landing_doors(building, name, floor), 0.0))
    for name, (thing, on) in place.world.objects.items():
        if on == floor:
            x, y, heading = physics.pose(f"object/{name}")
            turned = shapely.affinity.rotate(object_outline(thing), heading, (0, 0), use_radians=True)
            found.setdefault(name, []).append((shapely.affinity.translate(turned, x, y), 0.0))
    for one in place.world.robots.values():
        if one.floor == floor and one.name != oneself:
            at = place.world.pose(one.name)
            found.setdefault(one.name, []).append((Point(at.x, at.y), one.description.radius_m))
    return found


def check(place: Place, pool: DataPool, x: float, y: float, oneself: str) -> None:
    """The pool's answer is the least distance of all, and its point is there, on what it names."""
    shapes = everything(place, pool.floor, oneself)
    here = Point(x, y)
    away = {
        name: max(0.0, min(shape.distance(here) - rim_m for shape, rim_m in parts)) for name, parts in shapes.items()
    }
    near = pool.nearest_obstacle(x, y)
    assert near is not None
    assert near.distance_m == pytest.approx(min(away.values()), abs=1e-9)
    assert away[near.name] == pytest.approx(near.distance_m, abs=1e-9)
    assert math.dist((near.x, near.y), (x, y)) == pytest.approx(near.distance_m, abs=1e-9)
    there = Point(near.x, near.y)
    assert min(shape.distance(there) - rim_m for shape, rim_m in shapes[near.name]) <= 1e-9


coordinates = st.floats(-2.0, 12.0)


@settings(max_examples=150, deadline=None)
@given(coordinates, coordinates, st.sampled_from(["", "R0", "R2"]), st.integers(0, 3))
def test_the_nearest_is_what_shapely_says(x: float, y: float, oneself: str, moved: int) -> None:
    place = SCENES[moved]
    pool = place.pool("L2", oneself)
    pool.follow()
    check(place, pool, x, y, oneself)


def _scenes() -> list[Place]:
    """As it begins, while robots push things about, and with the elevator's doors open."""
    scenes = [crowd() for _ in range(4)]
    for number, place in enumerate(scenes[1:3], 1):
        place.world.add(Description("pusher", Pose("L2", 0.9, 4.0, 0.0), 0.2))
        for one in place.world.robots.values():
            one.command(0.3, 0.1 * number, 0.3, 5.0)
        place.run(2.0 * number)
        assert place.world.floors["L2"].pose("object/plate")[0] > 2.1
    scenes[3].world.add(robot("caller", "L2", 5.0, 2.0))
    scenes[3].world.call_elevator("caller", "E1", "L1")
    while scenes[3].world.moments["E1"].doors is not Doors.OPEN:
        scenes[3].run(0.1)
    return scenes


SCENES = _scenes()


def test_open_doors_are_no_obstacle() -> None:
    opening = crowd()
    opening.world.add(robot("caller", "L2", 5.0, 2.0))
    opening.world.call_elevator("caller", "E1", "L1")
    while opening.world.moments["E1"].doors is not Doors.OPENING:
        opening.run(0.02)
    for place, floor, is_open in (
        (SCENES[0], "L2", False),
        (opening, "L2", False),
        (SCENES[3], "L2", True),
        (SCENES[3], "L1", False),
    ):
        pool = place.pool(floor, "R3")
        pool.follow()
        before_door = pool.nearest_obstacle(5.0, 3.9)
        assert before_door and before_door.name == "E1"
        assert before_door.distance_m == pytest.approx(math.hypot(0.5, 0.1) if is_open else 0.1, abs=1e-5)


def test_within_something_it_is_there() -> None:
    place = crowd("L1")
    pool = place.pool("L1")
    pool.follow()
    assert pool.nearest_obstacle(7.1, 2.1) == (0.0, 7.1, 2.1, "R0")
    assert pool.nearest_obstacle(2.0, 2.0) == (0.0, 2.0, 2.0, "T1")
    assert pool.nearest_obstacle(8.0, 8.0) == (0.0, 8.0, 8.0, "S1")


def test_an_empty_floor_has_no_obstacles() -> None:
    place = Place(Building("plain", {"L1": FloorMap(Floor("L1", 1, 0.0))}))
    pool = place.pool()
    pool.follow()
    assert pool.nearest_obstacle(1.0, 2.0) is None
    assert pool.robots_near(1.0, 2.0, 1e9) == []
    place.world.add(robot("me", "L1", 1.0, 2.0))
    place.world.refresh()
    mine = place.pool("L1", "me")
    mine.follow()
    assert mine.nearest_obstacle(1.0, 2.0) is None


def test_a_wall_far_away_is_found() -> None:
    place = Place(
        Building("plain", {"L1": FloorMap(Floor("L1", 1, 0.0))}).with_element("L1", Wall("W", (0, 0), (1, 0)))
    )
    pool = place.pool()
    pool.follow()
    assert pool.nearest_obstacle(1e6, 0.0) == (1e6 - 1.0, 1.0, 0.0, "W")


@settings(max_examples=80, deadline=None)
@given(coordinates, coordinates, st.floats(0.0, 8.0), st.sampled_from(["", "R1"]))
def test_robots_near(x: float, y: float, range_m: float, oneself: str) -> None:
    place = SCENES[1]
    pool = place.pool("L2", oneself)
    pool.follow()
    beside = {}
    for one in place.world.robots.values():
        at = place.world.pose(one.name)
        if one.name != oneself:
            beside[one.name] = math.dist((x, y), (at.x, at.y)) - one.description.radius_m
    assume(all(abs(away - range_m) > 1e-9 for away in beside.values()))
    found = pool.robots_near(x, y, range_m)
    assert {near.robot.name for near in found} == {name for name, away in beside.items() if away <= range_m}
    for near in found:
        assert near.distance_m == pytest.approx(max(0.0, beside[near.robot.name]), abs=1e-9)
    assert [near.distance_m for near in found] == sorted(near.distance_m for near in found)


def test_places_that_are_none() -> None:
    pool = SCENES[0].pool("L2")
    pool.follow()
    for x, y, field in ((math.nan, 0.0, "x"), (0.0, math.inf, "y")):
        with pytest.raises(InvalidPoint) as invalid:
            pool.nearest_obstacle(x, y)
        assert invalid.value.field == field
        with pytest.raises(InvalidPoint):
            pool.robots_near(x, y, 1.0)
    for range_m in (-1.0, math.nan):
        with pytest.raises(InvalidRequest, match="range_m"):
            pool.robots_near(0.0, 0.0, range_m)
