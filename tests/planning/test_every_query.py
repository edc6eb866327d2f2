"""On every map: no path touches an obstacle, no query is refused although a path exists, and costs are the least."""

from __future__ import annotations

import math
from functools import lru_cache

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robocorba.errors.paths import NoPath
from robocorba.maps.model import Building
from robocorba.maps.samples import SAMPLES
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, Place, PointKind, RouteMode
from robocorba.testing.buildings import buildings
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
from tests.planning.generated import isolated_node, one_way_hall
from tests.planning.judge import Judge
from tests.planning.scenes import edge, node, random_places, room, wall

CASES = {**DRAWN, **IMPORTED, **grids(32), **rooms_at_random(range(4)), **buildings_at_random(range(10))}
#: Buildings with a roadmap between all of their places.
MAPPED = [*SAMPLES, *IMPORTED]
#: Queries in each building and mode, and random trips for costs along the roadmap.
QUERIES, TRIPS = 24, 160
#: Number of paths in a large building that are compared to its fine grid.
MAX_COMPARED_ON_GRID = 10


@lru_cache(maxsize=1)
def tried(name: str) -> tuple[Building, PathPlanner, Judge]:
    """One building at a time: its modes are tested one after the other."""
    building = CASES[name].make()
    return building, PathPlanner(building), Judge(building)


@pytest.mark.parametrize("mode", RouteMode)
@pytest.mark.parametrize("name", CASES)
def test_every_answer_is_right(name: str, mode: RouteMode) -> None:
    building, planner, judge = tried(name)
    queries = Adversary(building, CASES[name].radius_m, judge.point_is_free, seed=len(name)).queries(QUERIES)
    wrong = [
        f"{query}: {verdict}, {ratio} times as long as the shortest"
        for query, verdict, ratio in judged(CASES[name], planner, judge, mode, queries, MAX_COMPARED_ON_GRID)
        if not verdict.is_right or (mode is RouteMode.GEOMETRIC and ratio and ratio > MAX_RATIO)
    ]
    assert not wrong, f"{len(wrong)} of {QUERIES} answers are wrong, such as\n" + "\n".join(wrong[:3])


def trips(building: Building, radius_m: float, count: int, seed: int) -> list[tuple[Place, Place]]:
    places = random_places(building, radius_m, 2 * count, seed)
    return list(zip(places[::2], places[1::2], strict=True))


@pytest.mark.parametrize("best", Criterion)
@pytest.mark.parametrize("name", MAPPED)
def test_the_cost_along_the_map_is_that_of_networkx(name: str, best: Criterion) -> None:
    building, planner, judge = tried(name)
    radius_m, compared = CASES[name].radius_m, 0
    for ends in trips(building, radius_m, TRIPS, seed=1):
        request = PathRequest(*ends, radius=radius_m, speed=0.8, mode=RouteMode.TOPOLOGICAL, best=best)
        expected = judge.roadmap_cost(request)
        if expected is None:
            continue
        try:
            path = planner.paths(request)[0]
            cost = path.duration if best is Criterion.SHORTEST_TIME else path.distance
        except NoPath:
            cost = math.inf
        assert cost == pytest.approx(expected, rel=1e-9 if best is Criterion.SHORTEST_DISTANCE else 1e-6), ends
        compared += 1
    assert compared >= TRIPS // 2


@pytest.mark.parametrize("name", MAPPED)
def test_smoothing_never_lengthens(name: str) -> None:
    building, planner, judge = tried(name)
    radius_m = CASES[name].radius_m
    for ends in trips(building, radius_m, TRIPS // 4, seed=3):
        try:
            along = planner.paths(PathRequest(*ends, radius=radius_m, mode=RouteMode.TOPOLOGICAL))[0]
            smoothed = planner.paths(PathRequest(*ends, radius=radius_m))[0]
        except NoPath:
            continue
        assert smoothed.distance <= along.distance + 1e-9
        assert judge.touches(smoothed, radius_m) == judge.touches(along, radius_m) == []


coarse = st.tuples(st.integers(-2, 10), st.integers(-2, 10)).map(lambda at: (at[0] / 2, at[1] / 2))
fine = st.tuples(*[st.floats(-1.0, 9.5, allow_nan=False).map(lambda value: round(value, 3))] * 2)


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much])
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
                assert verdict.is_right, (start, goal, radius_m, mode, verdict)


def test_a_geometric_path_ignores_one_way_edges() -> None:
    start, goal = Place("L1", 18.0, 1.0), Place("L1", 2.0, 3.0)
    path = PathPlanner(one_way_hall()).paths(PathRequest(start, goal, mode=RouteMode.GEOMETRIC))[0]
    assert [point.kind for point in path.points] == [PointKind.START, PointKind.GOAL]
    assert path.distance == pytest.approx(math.dist(start[1:], goal[1:]))


@pytest.mark.parametrize("mode", RouteMode)
def test_an_isolated_node_does_not_hide_the_road_map(mode: RouteMode) -> None:
    start, goal = Place("L1", 1.0, 4.0), Place("L1", 18.8, 6.8)
    for ends in ((start, goal), (goal, start)):
        path = PathPlanner(isolated_node()).paths(PathRequest(*ends, mode=mode))[0]
        assert path.distance >= math.dist(start[1:], goal[1:]) - 1e-9
        assert Judge(isolated_node()).touches(path, 0.4) == []


def test_an_isolated_node_in_sight_does_not_hide_a_road_map_around_the_corner() -> None:
    building = room(
        12.0, 8.0, wall("w", 0.0, 4.0, 10.0, 4.0), node("a", 1, 1), node("b", 6, 1), node("alone", 2, 7), edge("a", "b")
    )
    path = PathPlanner(building).shortest(Place("L1", 1.0, 7.0), Place("L1", 1.0, 2.0))
    assert path.distance == pytest.approx(19.7, abs=0.3)
    assert Judge(building).touches(path, 0.4) == []


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
