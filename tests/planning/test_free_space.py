"""The compiled free space of a floor, its triangulation, and the shortest drives through it agree with shapely."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import LineString

from robocorba.errors.paths import PlanningTimeout
from robocorba.map_editor.changes import key_of
from robocorba.map_editor.model import Element, MapObject
from robocorba.map_editor.spatial.grids import build_grid
from robocorba.planning.floor_mesh import FloorMesh
from robocorba.planning.space import FloorSpace, line_clearance, line_free
from robocorba.planning.tangent_graph import TangentGraph
from robocorba.planning.triangulation import FRAME_CORNERS, Mesh, side
from robocorba.planning.turns import Turn
from robocorba.planning.visible_region import make_scratch, seen_from
from testkit.buildings import on_a_floor
from testkit.fine_grid import FloorGeometry
from testkit.generated_buildings import random_places
from tests.planning.scenes import random_room
from tests.planning.visibility import VisibilityGraph

coordinate = st.floats(-30, 30).map(lambda value: round(value, 3))
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)


@settings(deadline=None, max_examples=100)
@given(st.lists(segment, min_size=1, max_size=30), segment, st.floats(0, 3))
def test_clearance_is_the_distance(segments: list[tuple[float, ...]], line: tuple[float, ...], reach: float) -> None:
    grid = build_grid(np.array(segments))
    expected = min(_line(line).distance(_line(each)) for each in segments)
    found, index = line_clearance(grid, *line, reach)
    assert found == pytest.approx(min(expected, reach), abs=1e-7)
    assert (index >= 0) == (expected < reach) or abs(expected - reach) < 1e-7
    if abs(expected - reach) > 1e-7 and expected > 1e-7:
        assert line_free(grid, *line, reach) == (expected >= reach)


@pytest.mark.parametrize("seed", range(3))
def test_where_a_robot_can_stand(seed: int) -> None:
    building = random_room(seed)
    space = FloorSpace(building, "L1")
    solid = shapely.union_all([item.geometry for item in space.owners])
    rng = np.random.default_rng(seed)
    for x, y in rng.uniform((-1, -1), (13, 10), (300, 2)):
        distance = solid.distance(shapely.Point(x, y))
        if abs(distance - 0.4) < 1e-6 or (distance < 1e-9 and not 0 < x < 12):
            continue
        expected = 0 < x < 12 and 0 < y < 9 and distance >= 0.4
        assert space.point_is_free(x, y, 0.4) == expected, (x, y, distance)


blocking = st.one_of(*on_a_floor[:3]).filter(lambda it: isinstance(it, MapObject) or math.dist(it.a, it.b) > 0)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 7), st.lists(st.tuples(blocking, st.booleans()), min_size=1, max_size=20))
def test_an_edited_floor_is_as_if_made_anew(seed: int, edits: list[tuple[Element, bool]]) -> None:
    rng, building = np.random.default_rng(seed), random_room(seed)
    space = FloorSpace(building, "L1")
    for element, is_removed in edits:
        key = key_of("L1", element)
        if not is_removed:
            building = building.with_element("L1", element)
        elif building.find(*key):
            building = building.without(*key)
        space, rebuilt = FloorSpace(building, "L1", space), FloorSpace(building, "L1")
        assert sorted(map(tuple, space.grid.segments.tolist())) == sorted(map(tuple, rebuilt.grid.segments.tolist()))
        assert sorted(item[:2] for item in space.owners) == sorted(item[:2] for item in rebuilt.owners)
        for x, y in rng.uniform((-0.5, -0.5), (12.5, 9.5), (40, 2)):
            assert space.is_ground(x, y) == rebuilt.is_ground(x, y)
            assert space.nearest(x, y, 1.0)[0] == rebuilt.nearest(x, y, 1.0)[0]


def _line(points: tuple[float, ...]) -> shapely.Geometry:
    return LineString([points[:2], points[2:]]) if points[:2] != points[2:] else shapely.Point(points[:2])


#: On a coarse grid walls meet, cross, overlap and lie on one line as often as they can.
coarse = st.integers(0, 6).map(float)
fine = st.floats(0, 6).map(lambda value: round(value, 4))  # the least length of a wall is 1 mm
ends = st.tuples(coarse, coarse, coarse, coarse) | st.tuples(fine, fine, fine, fine)
walls = st.lists(ends.filter(lambda wall: math.dist(wall[:2], wall[2:]) > 1e-3), min_size=1, max_size=14)


def is_whole(mesh: Mesh) -> bool:
    """Every triangle is counter-clockwise, neighbours know each other and agree on walls, and together they fill the
    frame without a gap."""
    corners = mesh.corner
    if any(side(mesh.at, *corner) <= 0 for corner in corners.tolist()):
        return False
    for t, beyond in enumerate(mesh.across.tolist()):
        for k, n in enumerate(beyond):
            if n < 0:
                continue
            back = mesh.across[n].tolist().index(t)
            same = (corners[n, back], corners[n, (back + 1) % 3]) == (corners[t, (k + 1) % 3], corners[t, k])
            if not same or mesh.wall[n, back] != mesh.wall[t, k]:
                return False
    area = shapely.area(shapely.polygons(mesh.at[corners].astype(float))).sum()
    return bool(np.isclose(area, float(np.ptp(mesh.at[:, 0])) * float(np.ptp(mesh.at[:, 1]))))


@settings(deadline=None, max_examples=60)
@given(walls)
def test_walls_become_edges(found: list[tuple[float, ...]]) -> None:
    mesh = FloorMesh(build_grid(np.array(found)), True)
    assert is_whole(mesh.mesh)
    edges = [
        LineString([mesh.xy[corner[k]], mesh.xy[corner[(k + 1) % 3]]])
        for corner, wall in zip(mesh.mesh.corner, mesh.mesh.wall, strict=True)
        for k in range(3)
        if wall[k]
    ]
    drawn = shapely.union_all([LineString([wall[:2], wall[2:]]) for wall in found])
    assert shapely.union_all(edges).hausdorff_distance(drawn) < 1e-6


@settings(deadline=None, max_examples=50)
@given(walls, st.tuples(fine, fine))
def test_what_is_visible_is_seen(found: list[tuple[float, ...]], eye: tuple[float, float]) -> None:
    mesh = FloorMesh(build_grid(np.array(found)), True, [eye])
    scratch = make_scratch(mesh.mesh)
    lines = [LineString([wall[:2], wall[2:]]) for wall in found]
    blocked = shapely.union_all(lines)
    shapely.prepare(blocked)
    assume(blocked.distance(shapely.Point(eye)) > 1e-4)  # a robot never looks from within a wall
    from_point = {-1: eye, **{v: tuple(mesh.xy[v].tolist()) for v in range(FRAME_CORNERS, len(mesh.xy))}}
    for vertex, at in list(from_point.items())[:6]:
        count, _ = seen_from(mesh.mesh, mesh.xy, vertex, *at, scratch)
        seen = set(scratch.seen[:count].tolist())
        assert len(seen) == count
        for other in range(FRAME_CORNERS, len(mesh.xy)):
            there = mesh.xy[other]
            ray = LineString([at, there])
            if other == vertex or ray.length < 1e-3:
                continue
            ends_here = shapely.points([at, there])  # walls that meet at an end of the ray do not hide the other end
            between = [line for line in lines if (shapely.distance(line, ends_here) > 1e-9).all()]
            if not between or shapely.distance(ray, between).min() > 1e-5:
                assert other in seen, (vertex, at, there)


def test_nothing_in_the_way() -> None:
    grid = build_grid(np.empty((0, 4)))
    assert line_free(grid, -1e5, 0.0, 1e5, 0.0, 3.0)
    mesh = FloorMesh(grid, False, [(3.0, 4.0)])
    assert is_whole(mesh.mesh)
    assert mesh.covers([(3.0, 4.0)])


#: Sides of a quarter of an arc, and the error of the reference, which is too long [m].
ARC_SIDES, ERROR_M = 64, 1e-4


@pytest.mark.parametrize(("seed", "radius"), [(1, 0.3), (2, 0.25), (3, 0.1)])
def test_no_drive_is_shorter(seed: int, radius: float) -> None:
    building = random_room(seed, 4)
    graph, exact = TangentGraph(FloorSpace(building, "L1"), radius), VisibilityGraph(building, radius, ARC_SIDES)
    places = random_places(building, radius, 16, seed)
    for start, goal in zip(places[::2], places[1::2], strict=True):
        (leg,) = graph.legs(start[1:], [goal[1:]])
        expected, corners = exact.length(start, goal), [(x, y) for x, y in leg.points.tolist()]
        assert expected - ERROR_M <= leg.length <= expected + 1e-6 or leg.length == expected == math.inf
        assert not FloorGeometry(building, "L1").touches(list(pairwise(corners)), radius)
        assert graph.legs(goal[1:], [start[1:]])[0].length == pytest.approx(leg.length, abs=1e-9)
        if math.isfinite(leg.length):  # drives longer than the limit are not found
            found = [graph.legs(start[1:], [goal[1:]], max_length_m=leg.length + d)[0] for d in (1e-6, -1e-6)]
            assert [math.isfinite(each.length) for each in found] == [True, False]
        if corners:
            driven = sum(math.dist(a, b) for a, b in pairwise(corners))
            assert leg.length - 1e-9 <= driven <= 1.0034 * leg.length


def test_several_targets_get_what_each_gets_alone() -> None:
    building = random_room(5, 8)
    graph = TangentGraph(FloorSpace(building, "L1"), 0.3)
    origin, *targets = (place[1:] for place in random_places(building, 0.3, 25, 2))
    together = graph.legs(origin, targets)
    assert [leg.length for leg in together] == pytest.approx([graph.legs(origin, [t])[0].length for t in targets])
    nearest = sorted(leg.length for leg in together)[:3]
    assert sorted(leg.length for leg in graph.legs(origin, targets, enough=3))[:3] == pytest.approx(nearest)


def test_a_search_ends_at_its_deadline() -> None:
    graph = TangentGraph(FloorSpace(random_room(1, 8), "L1"), 0.4)
    with graph._lock, pytest.raises(PlanningTimeout):  # another search is under way
        graph.legs((1.0, 1.0), [(11.0, 8.0)], turn=Turn(time.monotonic() + 0.05))
    assert len(graph.legs((1.0, 1.0), [(11.0, 8.0)])[0].points)


def test_threads_share_a_graph() -> None:
    building = random_room(2, 8)
    space = FloorSpace(building, "L1")
    graph, alone = TangentGraph(space, 0.3), TangentGraph(space, 0.3)
    trips = list(pairwise(place[1:] for place in random_places(building, 0.3, 40, 4)))
    expected = [alone.legs(a, [b])[0].length for a, b in trips]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: [graph.legs(a, [b])[0].length for a, b in trips], range(4)))
    assert all(lengths == pytest.approx(expected) for lengths in found)
