"""Paths cost what a reference finds and touch nothing, on every building at hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from robocorba.errors.paths import NoPath
from robocorba.maps.formats import read_map
from robocorba.maps.model import Building
from robocorba.maps.samples import SAMPLES, load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from tests.planning.path_check import faults
from tests.planning.reference import Reference, random_places

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "rmf"
QUERIES = 1000

#: Robots of the buildings from elsewhere are smaller than SmartPal.
BUILDINGS = {**dict.fromkeys(SAMPLES, 0.40), "hotel.building.yaml": 0.25, "office.building.yaml": 0.25}


@pytest.fixture(scope="module", params=BUILDINGS)
def building_and_radius(request: pytest.FixtureRequest) -> tuple[Building, float]:
    name = request.param
    if name in SAMPLES:
        return load_sample(name), BUILDINGS[name]
    if not (REAL / name).exists():
        pytest.skip("the real buildings are not here")
    return read_map(REAL / name).building, BUILDINGS[name]


def trips(building: Building, radius: float, seed: int, count: int = QUERIES) -> list[tuple[Place, Place]]:
    places = random_places(building, radius, 2 * count, seed)
    return list(zip(places[::2], places[1::2], strict=True))


@pytest.mark.parametrize("best", Criterion)
def test_the_cost_along_the_map_is_that_of_networkx(
    building_and_radius: tuple[Building, float], best: Criterion
) -> None:
    building, radius = building_and_radius
    planner = PathPlanner(building)
    reference = Reference(building, radius, speed=0.8 if best is Criterion.SHORTEST_TIME else None)
    compared = 0
    for start, goal in trips(building, radius, seed=1):
        expected = reference.cost(start, goal)
        if expected is None:
            continue
        wanted = PathRequest(start, goal, radius=radius, speed=0.8, mode=RouteMode.TOPOLOGICAL, best=best)
        try:
            path = planner.paths(wanted)[0]
            cost = path.duration if best is Criterion.SHORTEST_TIME else path.distance
        except NoPath:
            cost = math.inf
        assert cost == pytest.approx(expected, rel=1e-9), (start, goal)
        compared += 1
    assert compared >= QUERIES // 2


@pytest.mark.parametrize("mode", RouteMode)
def test_no_path_touches_anything(building_and_radius: tuple[Building, float], mode: RouteMode) -> None:
    building, radius = building_and_radius
    planner = PathPlanner(building)
    found = 0
    for start, goal in trips(building, radius, seed=2, count=QUERIES if mode is RouteMode.SMOOTHED else 200):
        try:
            path = planner.paths(PathRequest(start, goal, radius=radius, mode=mode))[0]
        except NoPath:
            continue
        assert faults(building, path, radius) == []
        found += 1
    assert found > 0


def test_smoothing_never_lengthens(building_and_radius: tuple[Building, float]) -> None:
    building, radius = building_and_radius
    planner = PathPlanner(building)
    for start, goal in trips(building, radius, seed=3, count=200):
        try:
            along = planner.paths(PathRequest(start, goal, radius=radius, mode=RouteMode.TOPOLOGICAL))[0]
            smoothed = planner.paths(PathRequest(start, goal, radius=radius))[0]
        except NoPath:
            continue
        assert smoothed.distance <= along.distance + 1e-9
