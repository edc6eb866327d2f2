"""The judge finds what is wrong, and its two references for lengths agree with each other and with known lengths."""

from __future__ import annotations

import math

import pytest

from robocorba.maps.model import Building
from robocorba.maps.validation import problems
from robocorba.planning.request import IndexedNames, Path, PathRequest, Place, PointKind, RouteMode
from tests.planning.adversary import Adversary
from tests.planning.generated import one_way_hall, random_building, two_halls
from tests.planning.judge import Judge, errors
from tests.planning.scenes import random_room, room, tower, two_rooms

START, WAYPOINT, ENTRY, EXIT, GOAL = (
    PointKind.START,
    PointKind.WAYPOINT,
    PointKind.ELEVATOR_ENTRY,
    PointKind.ELEVATOR_EXIT,
    PointKind.GOAL,
)


def path_of(building: Building, *points: tuple[PointKind, str, float, float]) -> Path:
    """A path at 1 m/s through points of kind, floor, x, y; rides are in the first elevator."""
    names = IndexedNames([*building.floors, ""], [""], [*building.elevators, ""])
    heights = {name: entry.floor.elevation for name, entry in building.floors.items()}
    rows, driven = [], 0.0
    for i, (kind, floor, x, y) in enumerate(points):
        if i:
            before = points[i - 1]
            driven += math.dist(before[2:], (x, y)) + abs(heights[before[1]] - heights[floor])
        lift = 0 if kind in (ENTRY, EXIT) else -1
        rows.append([kind.value, -1, names.floors.index(floor), x, y, 0.0, driven, driven, lift])
    return Path(rows, names, 1)


def wrong(building: Building, *points: tuple[PointKind, str, float, float], **kind: object) -> list[str]:
    path = path_of(building, *points)
    request = PathRequest(Place(*points[0][1:]), Place(*points[-1][1:]), **kind)  # type: ignore[arg-type]
    return errors(building, path, request)


def test_a_path_that_just_keeps_the_radius_is_right() -> None:
    assert wrong(room(), (START, "L1", 0.4, 0.4), (WAYPOINT, "L1", 9.6, 0.4), (GOAL, "L1", 9.6, 5.6)) == []


@pytest.mark.parametrize(
    ("building", "points", "sentence"),
    [
        (room(), [(START, "L1", 0.399, 1.0), (GOAL, "L1", 5.0, 5.0)], "0.3990 m to floor L1, 0.4 m needed"),
        (room(), [(START, "L1", 1.0, 1.0), (WAYPOINT, "L1", 12.0, 1.0), (GOAL, "L1", 9.0, 1.0)], "leaves the outline"),
        (two_rooms(0.7), [(START, "L1", 1.0, 3.0), (GOAL, "L1", 9.0, 3.0)], "0.3500 m to wall between"),
        (tower(), [(START, "L1", 1.0, 3.0), (GOAL, "L2", 1.0, 3.0)], "changes the floor without an elevator"),
        (
            tower(),
            [(START, "L1", 1.0, 3.0), (ENTRY, "L1", 2.0, 3.0), (EXIT, "L2", 2.0, 3.0), (GOAL, "L2", 3.0, 3.0)],
            "begins or ends outside the shaft",
        ),
        (
            tower(3, served=("L1", "L2")),
            [(START, "L1", 8.5, 3.0), (ENTRY, "L1", 8.5, 3.0), (EXIT, "L3", 8.5, 3.0), (GOAL, "L3", 8.5, 3.0)],
            "does not serve both floors",
        ),
        (one_way_hall(), [(START, "L1", 18.0, 1.9), (GOAL, "L1", 3.0, 2.1)], "against a one-way edge"),
    ],
)
def test_errors_are_found(building: Building, points: list[tuple[PointKind, str, float, float]], sentence: str) -> None:
    assert any(sentence in fault for fault in wrong(building, *points))


def test_geometric_paths_ignore_one_way_edges() -> None:
    points = [(START, "L1", 18.0, 1.9), (GOAL, "L1", 3.0, 2.1)]
    assert wrong(one_way_hall(), *points, mode=RouteMode.GEOMETRIC) == []


def test_a_path_exists_through_a_door_that_is_wide_enough() -> None:
    west, east = Place("L1", 1.0, 1.0), Place("L1", 9.0, 5.0)
    for width, exists in ((0.79, False), (0.95, True)):
        for mode in RouteMode:
            assert Judge(two_rooms(width)).path_exists(PathRequest(west, east, mode=mode)) is exists


def test_elevators_connect_the_floors_that_they_serve() -> None:
    judge = Judge(tower(3, served=("L1", "L2")))
    for mode in RouteMode:
        for floor, exists in (("L2", True), ("L3", False)):
            request = PathRequest(Place("L1", 1.0, 1.0), Place(floor, 1.0, 5.0), mode=mode)
            assert judge.path_exists(request) is exists


def test_a_one_way_edge_may_forbid_a_smoothed_path() -> None:
    judge = Judge(one_way_hall())
    across = PathRequest(Place("L1", 18.0, 1.0), Place("L1", 2.0, 3.0))
    assert judge.path_exists(across._replace(mode=RouteMode.GEOMETRIC))
    assert judge.path_exists(across)  # around the ends of the edge
    assert not judge.path_exists(across._replace(start=Place("L1", 18.0, 2.0), goal=Place("L1", 2.0, 2.0)))


def test_known_lengths() -> None:
    request = PathRequest(Place("L1", 11.0, 7.0), Place("L1", 11.0, 2.0), mode=RouteMode.GEOMETRIC)
    judge = Judge(two_halls())
    assert judge.exact_length(request) == pytest.approx(15.91, rel=0.005)
    assert judge.exact_length(request) <= judge.octile_length(request) <= 1.09 * 15.91


@pytest.mark.parametrize("building", [random_room(1), random_building(1), tower()], ids=lambda found: found.name)
def test_the_references_for_lengths_agree(building: Building) -> None:
    judge = Judge(building)
    compared = 0
    for query in Adversary(building, 0.25, judge.point_is_free).queries(60):
        request = PathRequest(query.start, query.goal, radius=0.25, mode=RouteMode.GEOMETRIC)
        exact, octile = judge.exact_length(request), judge.octile_length(request)
        if exact > 0.5 and math.isfinite(octile):
            assert exact <= 1.001 * octile
            assert octile <= 1.1 * exact + 0.3
            compared += 1
    assert compared > 10


@pytest.mark.parametrize("seed", range(4))
def test_generated_buildings_and_queries_are_the_same_for_the_same_seed(seed: int) -> None:
    building = random_building(seed)
    assert problems(building) == []
    assert building == random_building(seed)
    judge = Judge(building)
    asked = [list(Adversary(building, 0.25, judge.point_is_free, seed).queries(50)) for _ in range(2)]
    assert asked[0] == asked[1]
    assert len({query.kind.split()[0] for query in asked[0]}) > 4
