"""The map of a floor as browsers get it."""

from __future__ import annotations

import itertools
import json
import math

import pytest

from robocorba.console.floor_plan import floor_plan
from robocorba.maps.model import ElementKind, Wall
from robocorba.testing.buildings import two_floors


def test_every_floor_is_json_with_finite_numbers() -> None:
    building = two_floors()
    for floor in building.floors:
        plan = json.loads(json.dumps(floor_plan(building, floor), allow_nan=False))
        assert plan["name"] == floor
        entry = building.floors[floor]
        assert {wall["name"] for wall in plan["walls"]} == set(entry.geometrical.walls)
        assert {node["name"] for node in plan["nodes"]} == set(entry.topological.nodes)
        assert {edge["name"] for edge in plan["edges"]} == set(entry.topological.edges)
        assert {one["name"] for one in plan["elevators"]} <= set(building.elevators)
        x_min, y_min, x_max, y_max = plan["bounds"]
        assert x_min < x_max and y_min < y_max


def test_walls_have_gaps_where_doors_are() -> None:
    building = two_floors()
    gaps = 0.0
    for floor in building.floors:
        for wall in floor_plan(building, floor)["walls"]:
            drawn = sum(math.dist(a, b) for piece in wall["pieces"] for a, b in itertools.pairwise(piece))
            assert drawn <= math.dist(wall["a"], wall["b"]) + 1e-3
            gaps += math.dist(wall["a"], wall["b"]) - drawn
    doors = sum(
        math.dist(door["a"], door["b"]) for floor in building.floors for door in floor_plan(building, floor)["doors"]
    )
    assert doors > 0.1
    assert gaps == pytest.approx(doors, abs=1e-3)


def test_names_stay_what_they_are() -> None:
    building, name = two_floors(), "<script>alert(1)</script>\u202e'\"&"
    renamed = building.with_changes([(ElementKind.WALL, "L1", name, Wall(name, (1.0, 1.0), (2.0, 1.0)))])
    walls = json.loads(json.dumps(floor_plan(renamed, "L1")))["walls"]
    assert name in [wall["name"] for wall in walls]


def test_an_unknown_floor() -> None:
    with pytest.raises(KeyError):
        floor_plan(two_floors(), "L9")
