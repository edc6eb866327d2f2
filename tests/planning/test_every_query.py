"""On every map: no path touches an obstacle, no query is refused although a path exists, and costs are the least; and
the judge that says so finds what is wrong."""

from __future__ import annotations

import math
from functools import lru_cache
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.paths import NoPath
from robocorba.map_editor.model import Building
from robocorba.map_editor.samples import SAMPLES
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import IndexedNames, Path, PathRequest, Place, PointKind, RouteMode
from testkit.buildings import buildings
from tests.planning.adversary import Adversary
from tests.planning.every_building import (
    DRAWN,
    IMPORTED,
    MAX_RATIO,
    buildings_at_random,
    grids,
    judged,
    rooms_at_random,
)
from tests.planning.judge import Judge, errors
from tests.planning.scenes import edge, node, one_way_hall, room, tower, two_rooms, wall

CASES = {**DRAWN, **IMPORTED, **grids(24), **rooms_at_random(range(4)), **buildings_at_random(range(10))}
#: Queries in each mode in each building, and in those with a roadmap between all of their places.
QUERIES, QUERIES_ON_ROADS = 10, 32
START, WAYPOINT, NODE, GOAL = PointKind.START, PointKind.WAYPOINT, PointKind.NODE, PointKind.GOAL
ENTRY, EXIT = PointKind.ELEVATOR_ENTRY, PointKind.ELEVATOR_EXIT


@lru_cache(maxsize=1)
def tried(name: str) -> tuple[Building, PathPlanner, Judge]:
    """One building at a time: its modes are tested one after the other."""
    building = CASES[name].make()
    return building, PathPlanner(building), Judge(building)


@pytest.mark.parametrize("mode", RouteMode)
@pytest.mark.parametrize("name", CASES)
def test_every_answer_is_right(name: str, mode: RouteMode) -> None:
    building, planner, judge = tried(name)
    count = QUERIES_ON_ROADS if name in (*SAMPLES, *IMPORTED) else QUERIES
    queries = Adversary(building, CASES[name].radius_m, judge.fits, seed=len(name)).queries(count)
    wrong = [
        f"{query}: {verdict}, {ratio} times as long as the shortest"
        for query, verdict, ratio in judged(CASES[name], planner, judge, mode, queries)
        if verdict.objections or (ratio and ratio > MAX_RATIO)
    ]
    assert not wrong, f"{len(wrong)} of {count} answers are wrong, such as\n" + "\n".join(wrong[:3])


coarse = st.tuples(st.integers(-2, 10), st.integers(-2, 10)).map(lambda at: (at[0] / 2, at[1] / 2))
fine = st.tuples(*[st.floats(-1.0, 9.5, allow_nan=False).map(lambda value: round(value, 3))] * 2)


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
@given(
    buildings().filter(lambda building: bool(building.floors)),
    st.lists(st.tuples(st.integers(0, 2), coarse | fine), min_size=2, max_size=6),
    st.sampled_from([0.1, 0.25, 0.4]),
)
def test_every_answer_is_right_in_any_building(
    building: Building, spots: list[tuple[int, tuple[float, float]]], radius_m: float
) -> None:
    floors = list(building.floors)
    places = [Place(floors[index % len(floors)], *at) for index, at in spots]
    planner, judge = PathPlanner(building), Judge(building)
    for start in places[::2]:
        for goal in places[1::2]:
            for mode in RouteMode:
                verdict = judge.verdict(planner, PathRequest(start, goal, radius=radius_m, mode=mode))
                assert not verdict.objections, (start, goal, radius_m, mode, verdict)


def test_an_isolated_node_in_sight_does_not_hide_a_road_map_around_the_corner() -> None:
    nodes = [node("a", 1, 1), node("b", 6, 1), node("alone", 2, 7)]
    building = room(12.0, 8.0, wall("w", 0.0, 4.0, 10.0, 4.0), *nodes, edge("a", "b"))
    request = PathRequest(Place("L1", 1.0, 7.0), Place("L1", 1.0, 2.0))
    path = PathPlanner(building).paths(request)[0]
    assert path.distance == pytest.approx(19.7, abs=0.3)
    assert errors(building, path, request) == []


def test_a_wall_cut_open_in_line_with_the_eye_hides_nothing() -> None:
    """Its pieces lie on one ray, and the search for what is visible went around their ends until its stack was full."""
    ((_, case),) = buildings_at_random(range(18, 19)).items()
    ends = Place("L1", 12.89408470192787, 2.068536469900499), Place("L1", 2.9058612285840617, 4.562941591798888)
    planner = PathPlanner(case.make())
    there, back = (
        planner.paths(PathRequest(*pair, radius=case.radius_m, mode=RouteMode.GEOMETRIC))[0].distance
        for pair in (ends, ends[::-1])
    )
    assert there == pytest.approx(back, rel=1e-6)


def objections(building: Building, request: PathRequest, path: Path | None = None) -> list[str]:
    """What the judge says of a planner that answers with one path, or with a refusal."""

    def paths(request: PathRequest) -> list[Path]:
        if path is None:
            raise NoPath("none")
        return [path]

    return list(Judge(building).verdict(SimpleNamespace(paths=paths), request).objections)  # type: ignore[arg-type]


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


@pytest.mark.parametrize(
    ("building", "points", "sentence"),
    [
        (room(), [(START, "L1", 0.399, 1.0), (GOAL, "L1", 5.0, 5.0)], "0.3990 m clearance"),
        (room(), [(START, "L1", 1.0, 1.0), (WAYPOINT, "L1", 12.0, 1.0), (GOAL, "L1", 9.0, 1.0)], "-1.0000 m clearance"),
        (room(), [(WAYPOINT, "L1", 1.0, 1.0), (GOAL, "L1", 9.0, 1.0)], "the start is"),
        (two_rooms(0.7), [(START, "L1", 1.0, 3.0), (GOAL, "L1", 9.0, 3.0)], "0.3500 m clearance"),
        (tower(), [(START, "L1", 1.0, 3.0), (GOAL, "L2", 1.0, 3.0)], "changes the floor without an elevator"),
        (
            tower(),
            [(START, "L1", 1.0, 3.0), (ENTRY, "L1", 2.0, 3.0), (EXIT, "L2", 2.0, 3.0), (GOAL, "L2", 3.0, 3.0)],
            "rides outside of the shaft",
        ),
        (
            tower(3, served=("L1", "L2")),
            [(START, "L1", 8.5, 3.0), (ENTRY, "L1", 8.5, 3.0), (EXIT, "L3", 8.5, 3.0), (GOAL, "L3", 8.5, 3.0)],
            "does not serve both floors",
        ),
        (one_way_hall(), [(START, "L1", 18.0, 1.9), (GOAL, "L1", 3.0, 2.1)], "follows the edge 2.00,2.00 - 18.00,2.00"),
        (room(), [(START, "L1", 1.0, 1.0), (WAYPOINT, "L1", 1.0, 5.0), (GOAL, "L1", 9.0, 5.0)], ""),
    ],
)
def test_errors_of_a_path_are_found(
    building: Building, points: list[tuple[PointKind, str, float, float]], sentence: str
) -> None:
    path, request = path_of(building, *points), PathRequest(Place(*points[0][1:]), Place(*points[-1][1:]))
    found = errors(building, path, request)
    assert any(sentence in fault for fault in found) if sentence else not found
    if "follows" in sentence:
        assert errors(building, path, request._replace(mode=RouteMode.GEOMETRIC)) == []


@pytest.mark.parametrize(
    ("mode", "sentence"), list(zip(RouteMode, ("by networkx", "along the roads", "straight"), strict=True))
)
def test_a_path_that_costs_too_much_is_found(mode: RouteMode, sentence: str) -> None:
    building = room(10.0, 6.0, node("a", 1, 1), node("b", 9, 1), edge("a", "b"))
    detour = path_of(building, (START, "L1", 1.0, 1.0), (WAYPOINT, "L1", 5.0, 4.0), (GOAL, "L1", 9.0, 1.0))
    request = PathRequest(Place("L1", 1.0, 1.0), Place("L1", 9.0, 1.0), mode=mode)
    assert any(sentence in text for text in objections(building, request, detour))


HALL, SERVED = one_way_hall(), tower(3, served=("L1", "L2"))


@pytest.mark.parametrize(
    ("building", "start", "goal", "modes"),
    [
        (two_rooms(0.79), Place("L1", 1.0, 1.0), Place("L1", 9.0, 5.0), ""),
        (two_rooms(0.95), Place("L1", 1.0, 1.0), Place("L1", 9.0, 5.0), "SMOOTHED TOPOLOGICAL GEOMETRIC"),
        (SERVED, Place("L1", 1.0, 1.0), Place("L2", 1.0, 5.0), "SMOOTHED TOPOLOGICAL GEOMETRIC"),
        (SERVED, Place("L1", 1.0, 1.0), Place("L3", 1.0, 5.0), ""),
        (HALL, Place("L1", 18.0, 2.0), Place("L1", 2.0, 2.0), "GEOMETRIC"),
        (HALL, Place("L1", 18.0, 1.0), Place("L1", 2.0, 3.0), "SMOOTHED GEOMETRIC"),
    ],
)
def test_a_wrong_refusal_is_found(building: Building, start: Place, goal: Place, modes: str) -> None:
    """Where a door is wide enough, an elevator serves both floors, and no one-way edge may forbid it."""
    refuted = {mode.name for mode in RouteMode if objections(building, PathRequest(start, goal, mode=mode))}
    assert refuted == set(modes.split())
