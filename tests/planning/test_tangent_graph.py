"""Shortest drives through free space have the lengths that a visibility graph by shapely finds."""

from __future__ import annotations

import math
import threading
import time
from itertools import pairwise

import pytest

from robocorba.errors.paths import PlanningTimeout
from robocorba.maps.model import Building
from robocorba.planning.request import Place
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_graph import DriveLeg, TangentGraph
from robocorba.planning.turns import Turn
from robocorba.spatial.pose import XY
from robocorba.testing.fine_grid import FloorGeometry
from tests.planning.scenes import random_places, random_room, room, wall
from tests.planning.visibility import VisibilityGraph

#: Sides of a quarter of an arc, and the error of the reference, which is too long [m].
ARC_SIDES, ERROR_M = 96, 1e-4


def check(leg: DriveLeg, building: Building, radius: float, start: Place, goal: Place, exact: VisibilityGraph) -> None:
    """The drive has the length of the reference, and its corners keep the radius from all obstacles."""
    expected = exact.length(start, goal)
    assert expected - ERROR_M <= leg.length <= expected + 1e-6 or leg.length == expected == math.inf
    assert not FloorGeometry(building, "L1").touches(drives(leg), radius)


def drives(leg: DriveLeg) -> list[tuple[XY, XY]]:
    """The straight drives between the corners."""
    return list(pairwise((x, y) for x, y in leg.points.tolist()))


@pytest.mark.parametrize("seed", range(6))
def test_no_drive_is_shorter(seed: int) -> None:
    building, radius = random_room(seed, 4), 0.4
    graph, exact = TangentGraph(FloorSpace(building, "L1"), radius), VisibilityGraph(building, radius, ARC_SIDES)
    places = random_places(building, radius, 16, seed)
    for start, goal in zip(places[::2], places[1::2], strict=True):
        (leg,) = graph.legs(start[1:], [goal[1:]])
        check(leg, building, radius, start, goal, exact)
        if len(leg.points):
            driven = sum(math.dist(a, b) for a, b in drives(leg))
            assert leg.length - 1e-9 <= driven <= 1.0034 * leg.length


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.7])
def test_one_triangulation_serves_all_radii(radius: float) -> None:
    building = random_room(3, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), radius)
    back_and_forth = random_places(building, max(radius, 0.05), 30, 8)
    for start, goal in zip(back_and_forth[::2], back_and_forth[1::2], strict=True):
        there, back = graph.legs(start[1:], [goal[1:]])[0], graph.legs(goal[1:], [start[1:]])[0]
        assert there.length == pytest.approx(back.length, abs=1e-9)
        assert not FloorGeometry(building, "L1").touches(drives(there), radius)


def test_several_targets_get_what_each_gets_alone() -> None:
    building = random_room(5, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), 0.3)
    origin, *targets = (place[1:] for place in random_places(building, 0.3, 25, 2))
    together = graph.legs(origin, targets)
    assert [leg.length for leg in together] == pytest.approx([graph.legs(origin, [t])[0].length for t in targets])
    nearest = sorted(leg.length for leg in together)[:3]
    assert sorted(leg.length for leg in graph.legs(origin, targets, enough=3))[:3] == pytest.approx(nearest)


def test_drives_longer_than_the_limit_are_not_found() -> None:
    graph = TangentGraph(FloorSpace(room(10.0, 6.0, wall("w", 5.0, 0.0, 5.0, 5.0)), "L1"), 0.4)
    (leg,) = graph.legs((4.0, 1.0), [(6.0, 1.0)])
    assert math.isfinite(graph.legs((4.0, 1.0), [(6.0, 1.0)], max_length_m=leg.length + 1e-6)[0].length)
    assert math.isinf(graph.legs((4.0, 1.0), [(6.0, 1.0)], max_length_m=leg.length - 1e-6)[0].length)


def test_walls_that_cross_block() -> None:
    """Where walls cross there is no vertex of the map."""
    crossed = [wall("a", 0.0, 2.0, 9.0, 4.0), wall("b", 0.0, 4.0, 9.0, 2.0), wall("c", 6.0, 0.0, 6.0, 5.0)]
    building = room(10.0, 6.0, *crossed)
    graph, exact = TangentGraph(FloorSpace(building, "L1"), 0.3), VisibilityGraph(building, 0.3, ARC_SIDES)
    start = Place("L1", 0.6, 3.0)
    for goal in (Place("L1", 9.5, 3.0), Place("L1", 3.0, 1.0), Place("L1", 3.0, 5.0), Place("L1", 7.0, 4.5)):
        check(graph.legs(start[1:], [goal[1:]])[0], building, 0.3, start, goal, exact)


def test_a_search_ends_at_its_deadline() -> None:
    graph = TangentGraph(FloorSpace(random_room(1, 8), "L1"), 0.4)
    with graph._lock:  # another search is under way
        began = time.monotonic()
        with pytest.raises(PlanningTimeout):
            graph.legs((1.0, 1.0), [(11.0, 8.0)], turn=Turn(began + 0.05))
    assert len(graph.legs((1.0, 1.0), [(11.0, 8.0)])[0].points)


def test_threads_share_a_graph() -> None:
    building = random_room(2, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), 0.3)
    places = [place[1:] for place in random_places(building, 0.3, 40, 4)]
    alone = TangentGraph(graph.space, 0.3)
    expected = [alone.legs(a, [b])[0].length for a, b in pairwise(places)]
    found: dict[int, list[float]] = {}

    def ask(number: int) -> None:
        found[number] = [graph.legs(a, [b])[0].length for a, b in pairwise(places)]

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(found[i] == pytest.approx(expected) for i in range(4))
