"""What is derived from the maps of a building goes with them."""

from __future__ import annotations

import weakref

from robocorba.maps import collisions, geometry
from robocorba.maps.collisions import all_paths
from robocorba.maps.derived import Derived
from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Area, Building, Floor, GeometricalMap, PathNode, Wall
from robocorba.maps.validation import problems


def with_wall(building: Building, number: int) -> Building:
    return building.with_element("L1", Wall(f"w{number}", (number, 0.0), (number, 1.0)))


def room() -> Building:
    return with_wall(Building("room").with_element("", Floor("L1", 0, 0.0)), 0)


def test_a_result_is_derived_once_and_goes_with_its_map() -> None:
    derived: Derived[GeometricalMap, list[str]] = Derived()
    plan = room().floors["L1"].geometrical
    walls, gone = plan.walls, weakref.ref(plan)
    first = derived.of(plan, (walls,), lambda: list(walls))
    assert first == ["w0"] and derived.of(plan, (walls,), lambda: ["again"]) is first
    del plan
    assert gone() is None and not derived
    other = GeometricalMap(walls=walls)
    assert derived.of(other, (walls,), lambda: ["again"]) == ["again"]


def test_a_later_map_with_the_same_parts_keeps_the_result() -> None:
    building = room()
    later = building.with_element("L1", Area("a", "keep-out", ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))))
    found = obstacles(building, "L1")
    assert obstacles(later, "L1") is found
    del building
    assert obstacles(later, "L1") is found


def test_only_the_latest_of_many_versions_is_kept() -> None:
    building = room()
    before = len(geometry._OBSTACLES), len(collisions._ALL_PATHS)
    versions: list[weakref.ref[GeometricalMap]] = []
    for number in range(1, 20):
        building = with_wall(building, number).with_element("L1", PathNode(f"n{number}", (number + 0.5, 0.5)))
        assert not problems(building)
        assert len(obstacles(building, "L1")) == number + 1 and len(all_paths(building.floors["L1"].topological).at)
        versions.append(weakref.ref(building.floors["L1"].geometrical))
    assert [each() is not None for each in versions] == [False] * 18 + [True]
    assert len(geometry._OBSTACLES) <= before[0] + 1 and len(collisions._ALL_PATHS) <= before[1] + 1
