"""The nearest obstacles, against distances that shapely computes of every obstacle."""

from __future__ import annotations

import math

import pytest
import shapely
import shapely.affinity
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Point
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import InvalidPoint, InvalidRequest
from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building, Floor, FloorMap, Wall
from robocorba.map_editor.movable import landing_doors, object_outline
from robocorba.map_editor.spatial.elevator_state import Doors
from robocorba.robot.data_pool.pool import DataPool
from robocorba.simulation.registry import Description, Pose
from tests.robot.data_pool.places import Place
from tests.simulation.places import robot


def crowd(floor: str = "L2") -> Place:
    """Robots of several sizes beside the furniture."""
    place = Place()
    for number, (x, y, radius_m) in enumerate([(7.0, 2.0, 0.4), (8.0, 4.0, 0.25), (2.2, 4.6, 0.1), (5.0, 3.5, 0.3)]):
        place.world.add(Description(f"R{number}", Pose(floor, x, y, 1.0), radius_m))
    place.world.refresh()
    return place


def all_obstacles(place: Place, floor: str) -> dict[str, list[BaseGeometry]]:
    """Shapes of all obstacles except robots, by name."""
    building, physics = place.world.building, place.world.occupants.floors[floor]
    movable = {item.map_object.name for item in place.world.occupants.objects.values()}
    found: dict[str, list[BaseGeometry]] = {}
    for item in obstacles(building, floor):
        if item.kind != "object" or item.name not in movable:
            found.setdefault(item.name, []).append(item.geometry)
    for name, state in place.world.elevators.states_on(floor).items():
        if state.floor != floor or state.doors is not Doors.OPEN:
            found.setdefault(name, []).append(landing_doors(building, name, floor))
    for name, item in place.world.occupants.objects.items():
        if item.floor == floor:
            x, y, heading = physics.pose(item.body)
            turned = shapely.affinity.rotate(object_outline(item.map_object), heading, (0, 0), use_radians=True)
            found.setdefault(name, []).append(shapely.affinity.translate(turned, x, y))
    return found


def check(place: Place, pool: DataPool, x: float, y: float) -> None:
    """The pool's answer is the smallest distance of all, and its point lies on the obstacle that it names."""
    shapes = all_obstacles(place, pool.floor)
    away = {name: min(shape.distance(Point(x, y)) for shape in parts) for name, parts in shapes.items()}
    near = pool.snapshot().nearest_non_robot(x, y)
    assert near is not None
    assert near.distance_m == pytest.approx(min(away.values()), abs=1e-9)
    assert away[near.name] == pytest.approx(near.distance_m, abs=1e-9)
    assert math.dist((near.x, near.y), (x, y)) == pytest.approx(near.distance_m, abs=1e-9)
    assert min(shape.distance(Point(near.x, near.y)) for shape in shapes[near.name]) <= 1e-9


coordinates = st.floats(-2.0, 12.0)


@settings(max_examples=60, deadline=None)
@given(coordinates, coordinates, st.integers(0, 3))
def test_the_nearest_obstacle_agrees_with_shapely(x: float, y: float, moved: int) -> None:
    place = SCENES[moved]
    pool = place.loaded_pool("L2")
    check(place, pool, x, y)


def _scenes() -> list[Place]:
    """Before any motion, while robots push objects, and with the elevator's doors open."""
    scenes = [crowd() for _ in range(4)]
    for number, place in enumerate(scenes[1:3], 1):
        place.world.add(Description("pusher", Pose("L2", 0.9, 4.0, 0.0), 0.2))
        for one in place.world.occupants.robots.values():
            one.command(0.3, 0.1 * number, 0.3, 5.0)
        place.run(2.0 * number)
        assert place.world.occupants.object_pose("plate").x > 2.1
    scenes[3].world.add(robot("caller", "L2", 5.0, 2.0))
    scenes[3].world.elevators.call("caller", "E1", "L1")
    while scenes[3].world.elevators.states["E1"].doors is not Doors.OPEN:
        scenes[3].run(0.1)
    return scenes


SCENES = _scenes()


def test_an_empty_floor_has_no_obstacles_and_a_wall_far_away_is_found() -> None:
    empty = Building("plain", {"L1": FloorMap(Floor("L1", 1, 0.0))})
    pool = Place(empty).loaded_pool()
    assert pool.snapshot().nearest_non_robot(1.0, 2.0) is None
    assert pool.snapshot().robots_near(1.0, 2.0, 1e9) == []
    pool = Place(empty.with_element("L1", Wall("W", (0, 0), (1, 0)))).loaded_pool()
    assert pool.snapshot().nearest_non_robot(1e6, 0.0) == (1e6 - 1.0, 1.0, 0.0, "W")


@settings(max_examples=40, deadline=None)
@given(coordinates, coordinates, st.floats(0.0, 8.0), st.sampled_from(["", "R1"]))
def test_robots_near(x: float, y: float, range_m: float, own_name: str) -> None:
    place = SCENES[1]
    pool = place.loaded_pool("L2", own_name)
    beside = {}
    for one in place.world.occupants.robots.values():
        at = place.world.occupants.pose(one.name)
        if one.name != own_name:
            beside[one.name] = math.dist((x, y), (at.x, at.y)) - one.description.radius_m
    assume(all(abs(away - range_m) > 1e-9 for away in beside.values()))
    found = pool.snapshot().robots_near(x, y, range_m)
    assert {other.name for _, other in found} == {name for name, away in beside.items() if away <= range_m}
    for distance_m, other in found:
        assert distance_m == pytest.approx(max(0.0, beside[other.name]), abs=1e-9)
    assert [distance_m for distance_m, _ in found] == sorted(distance_m for distance_m, _ in found)


def test_invalid_points_are_refused() -> None:
    pool = SCENES[0].loaded_pool("L2")
    for x, y, field in ((math.nan, 0.0, "x"), (0.0, math.inf, "y")):
        with pytest.raises(InvalidPoint) as invalid:
            pool.snapshot().nearest_non_robot(x, y)
        assert invalid.value.field == field
        with pytest.raises(InvalidPoint):
            pool.snapshot().robots_near(x, y, 1.0)
    for range_m in (-1.0, math.nan):
        with pytest.raises(InvalidRequest, match="range_m"):
            pool.snapshot().robots_near(0.0, 0.0, range_m)
