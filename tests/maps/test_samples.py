"""The sample buildings keep every rule, and robots have room in them. test_checking proves that they get everywhere."""

from __future__ import annotations

import pytest
import shapely
from shapely import LineString, Point

from robocorba.errors.maps import MapFileError
from robocorba.maps import geometry, native, validation
from robocorba.maps.samples import SAMPLES, load_sample, sample_path

CLEARANCE_M = 0.45


@pytest.mark.parametrize("name", SAMPLES)
def test_no_rule_is_broken_and_the_file_survives_a_rewrite(name: str) -> None:
    building = load_sample(name)
    assert building.name == name
    assert validation.problems(building) == []
    assert native.loads(native.dumps(building)) == building


@pytest.mark.parametrize("name", SAMPLES)
def test_edges_have_room(name: str) -> None:
    building = load_sample(name)
    for floor, entry in building.floors.items():
        roads = entry.topological
        everything = shapely.union_all([item.geometry for item in geometry.obstacles(building, floor)])
        for edge in roads.edges.values():
            line = LineString([roads.nodes[edge.a].at, roads.nodes[edge.b].at])
            assert line.distance(everything) >= CLEARANCE_M, f"{floor} {edge.name}"


def test_five_floors_is_what_it_says() -> None:
    building = load_sample("five-floors")
    assert list(building.floors) == ["L1", "L2", "L3", "L4", "L5"]
    stops = {name: elevator.floors() for name, elevator in building.elevators.items()}
    assert stops == {"E1": ("L1", "L2", "L3", "L4", "L5"), "E2": ("L1", "L2", "L3"), "E3": ("L3", "L4", "L5")}
    for floor, entry in building.floors.items():
        assert 20 <= len(entry.topological.nodes) <= 40
        cabins = {node.elevator: Point(node.at) for node in entry.topological.nodes.values() if node.elevator}
        assert set(cabins) == {name for name, served in stops.items() if floor in served}
        for name, place in cabins.items():
            assert geometry.shaft_polygon(building.elevators[name]).contains(place)
    edges = [edge for entry in building.floors.values() for edge in entry.topological.edges.values()]
    assert any(edge.one_way for edge in edges) and any(edge.speed_limit for edge in edges)


def test_the_scene_has_the_table_and_two_subnets() -> None:
    plan = load_sample("paper-scene").floors["L1"].geometrical
    assert plan.objects["table"].movable
    assert {area.name: area.subnet for area in plan.areas.values()} == {
        "room-1": "lab",
        "room-2": "hall",
        "corridor": "hall",
    }


@pytest.mark.parametrize("name", ["", "six-floors", "../five-floors", "five-floors.yaml"])
def test_an_unknown_sample_names_those_there_are(name: str) -> None:
    with pytest.raises(MapFileError, match="five-floors, paper-scene"):
        sample_path(name)
