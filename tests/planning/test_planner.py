"""The path planning agent: kinds and times of points, criteria, errors that name the obstacle."""

from __future__ import annotations

import math
import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.paths import (
    InvalidPoint,
    InvalidRequest,
    NoPath,
    NotFree,
    PathError,
    PlanningTimeout,
    UnknownFloor,
)
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    Door,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
)
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from robocorba.planning.roads import BLOCKED, CLEARANCE
from robocorba.planning.route import waypoints
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from testkit.buildings import with_all
from tests.planning.judge import Judge, errors
from tests.planning.scenes import edge, node, room, tower, two_rooms, wall

#: Nodes in the corners of a room of 10 x 6 m.
RING = [node("a", 1, 1), node("b", 9, 1), node("c", 9, 5), node("d", 1, 5)]
WEST, EAST = Place("L1", 1.0, 1.0), Place("L1", 9.0, 5.0)


def bent_ring() -> Building:
    """A ring of nodes a, m, b, c, d; a post hides a and b from each other."""
    edges = [edge("a", "m"), edge("m", "b"), edge("b", "c"), edge("c", "d"), edge("d", "a")]
    walls = [wall("post", 5.0, 0.0, 5.0, 0.7), wall("w", 4.0, 1.8, 6.0, 1.8)]
    return room(10.0, 6.0, *walls, *RING, node("m", 5, 1.2), *edges)


def through_cabin(shelf_on: str = "") -> Building:
    """An elevator of 6 x 3 m, entered from the west on L1 and left to the east on L2, with nodes at its doors. With
    `shelf_on`, a shelf on that floor keeps robots from driving in the cabin there."""
    building = room(20.0, 10.0, node("a", 3, 4.2), node("in", 9, 4.2, "E1"), edge("in", "a"))
    outline = building.floors["L1"].floor.outline
    building = building.with_element("", Floor(name="L2", level=1, elevation=4.0, outline=outline))
    for element in (node("b", 17, 5.8), node("out", 13, 5.8, "E1"), edge("out", "b")):
        building = building.with_element("L2", element)
    if shelf_on:
        shelf = MapObject("shelf", BoxShape((0.5, 2.9)), (11.0, 5.0))
        building = building.with_element(shelf_on, shelf)
    doors = (
        ElevatorDoor(floor="L1", side=CabinSide.LEFT, width=1.2, offset=-0.8),
        ElevatorDoor(floor="L2", side=CabinSide.RIGHT, width=1.2, offset=0.8),
    )
    return building.with_element("", Elevator(name="E1", at=(11.0, 5.0), size=(6.0, 3.0), doors=doors))


@pytest.mark.parametrize("best", Criterion)
@pytest.mark.parametrize("mode", RouteMode)
@pytest.mark.parametrize("shelf_on", ("", "L1", "L2"))
def test_the_drive_in_a_cabin_is_part_of_the_path(mode: RouteMode, best: Criterion, shelf_on: str) -> None:
    """It comes after the ride, or before it where an object is in the way on the other floor."""
    building = through_cabin(shelf_on)
    there = PathRequest(Place("L1", 3.0, 4.2), Place("L2", 17.0, 5.8), speed=0.5, mode=mode, best=best)
    for request in (there, there._replace(start=there.goal, goal=there.start)):
        path = PathPlanner(building).paths(request)[0]
        entry, leave = (point for point in path.points if point.elevator)
        assert (entry.x, entry.y) == (leave.x, leave.y)
        assert (entry.floor, leave.floor) == (request.start.floor, request.goal.floor)
        driven = path.distance - 4.0
        along_roads = 6.0 + math.hypot(4.0, 1.6) + 4.0
        assert driven == pytest.approx(along_roads, abs=0.15 if mode is RouteMode.GEOMETRIC else 1e-9)
        assert path.duration == pytest.approx(driven / 0.5 + (2.5 + 3.0) + (3.0 + 5.0 + 3.0))
        assert Judge(building).verdict(PathPlanner(building), request)[:2] == ("found", ())


def test_an_elevator_whose_cabin_cannot_be_crossed_is_no_way() -> None:
    building = through_cabin("L1").with_element("L2", MapObject("shelf", BoxShape((0.5, 2.9)), (11.0, 5.0)))
    for mode in RouteMode:
        with pytest.raises(NoPath):
            PathPlanner(building).paths(PathRequest(Place("L1", 3.0, 4.2), Place("L2", 17.0, 5.8), mode=mode))


UPSTAIRS = PathRequest(WEST, Place("L3", 1.0, 1.0))
ACROSS = PathRequest(WEST, EAST)
LOCKED = Door(name="door", a=(5.0, 2.4), b=(5.0, 3.6), locked=True)
CLOSED = two_rooms(1.2).without(ElementKind.DOOR, "L1", "door")
CORNER = ("L1", ((3.0, 5.0), (4.0, 5.0), (4.0, 6.0), (3.0, 6.0)))


@pytest.mark.parametrize("mode", RouteMode)
@pytest.mark.parametrize(
    ("building", "request_", "kind", "name", "reason"),
    [
        (two_rooms(0.7), ACROSS, "door", "door", "0.70 m wide, 0.80 m needed"),
        (two_rooms(1.2).with_element("L1", LOCKED), ACROSS, "door", "door", "is locked"),
        (CLOSED, ACROSS, "floor", "L1", "not connected|its walls leave no passage"),
        (CLOSED, ACROSS._replace(forbidden_areas=(CORNER,)), "floor", "L1", "not connected|its walls leave no passage"),
        (tower(3, ("L1", "L2")), UPSTAIRS, "floor", "L3", ""),
        (tower(), UPSTAIRS._replace(avoid_elevators=frozenset({"E1"})), "elevator", "E1", ""),
    ],
)
def test_what_blocks_every_path_is_named(
    mode: RouteMode, building: Building, request_: PathRequest, kind: str, name: str, reason: str
) -> None:
    with pytest.raises(NoPath) as refusal:
        PathPlanner(building).paths(request_._replace(mode=mode))
    (blocker,) = refusal.value.blockers
    assert (blocker.kind, blocker.name) == (kind, name)
    assert re.search(reason, blocker.reason)


def test_alternatives_are_other_paths() -> None:
    ends = Place("L1", 1.0, 1.0), Place("L1", 9.0, 1.0)
    paths = PathPlanner(bent_ring()).paths(PathRequest(*ends, mode=RouteMode.TOPOLOGICAL, alternatives=3))
    assert [path.distance for path in paths] == pytest.approx([2 * math.hypot(4.0, 0.2), 16.0])
    doors = tuple(ElevatorDoor(floor=floor, width=1.4) for floor in ("L1", "L2", "L3"))
    planner = PathPlanner(tower().with_element("", Elevator("E2", (5.0, 4.5), (2.0, 2.0), doors)))
    paths = planner.paths(UPSTAIRS._replace(mode=RouteMode.GEOMETRIC, alternatives=1))
    assert [{point.elevator for point in path.points} - {""} for path in paths] == [{"E2"}, {"E1"}]


def test_headings_point_to_the_next_point() -> None:
    path = PathPlanner(two_rooms(1.2)).shortest(WEST, EAST)
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        assert a.heading == pytest.approx(math.atan2(b.y - a.y, b.x - a.x))
    assert path.points[-1].heading == path.points[-2].heading


def test_an_edge_under_an_object_is_blocked() -> None:
    """Its distance to the border of a large object does not count as clearance."""
    box = MapObject("box", BoxShape((6.0, 3.0)), (5.0, 2.5))
    building = room(10.0, 6.0, box, node("a", 4.0, 2.5), node("b", 6.0, 2.5), edge("a", "b"))
    across = building.with_element("L1", node("c", 9.5, 2.5)).with_element("L1", edge("b", "c"))
    roads = PathPlanner(across)._snapshot.roads.roads
    assert (roads.measures[:, CLEARANCE] == BLOCKED).all()


def test_a_path_nearer_than_the_radius_is_withheld() -> None:
    snapshot = PathPlanner(two_rooms(1.2))._snapshot
    through_the_wall = waypoints(0.0, np.array([WEST[1:], (9.0, 1.0)]))
    with pytest.raises(NoPath, match=r"comes nearer than 0\.4 m"):
        snapshot.path(through_the_wall, PathRequest(WEST, EAST))


def test_roads_are_left_where_they_are_a_long_detour() -> None:
    """The roadmap leads once around a long wall; through free space the path is a few metres around its near end."""
    loop = [node("a", 2, 2), node("b", 38, 2), node("c", 38, 6), node("d", 2, 6)]
    roads = [edge("a", "b"), edge("b", "c"), edge("c", "d")]
    building = room(40.0, 8.0, wall("long", 1.0, 4.0, 37.0, 4.0), *loop, *roads)
    start, goal = Place("L1", 2.5, 2.5), Place("L1", 2.5, 5.5)
    planner = PathPlanner(building)
    shortest = planner.paths(PathRequest(start, goal, mode=RouteMode.GEOMETRIC))[0].distance
    assert planner.shortest(start, goal).distance == pytest.approx(shortest)
    assert planner.paths(PathRequest(start, goal, mode=RouteMode.TOPOLOGICAL))[0].distance > 60.0
    graphed = with_all(building, [("L1", edge(each.a, each.b, graphs=("g",))) for each in roads])
    assert PathPlanner(graphed).paths(PathRequest(start, goal, graph="g"))[0].distance > 60.0


def test_components_of_the_topological_map_are_named() -> None:
    """Each of two rooms without a door between them has a component of its own."""
    nodes = [node("a", 1, 1), node("b", 4, 1), node("c", 6, 5), node("d", 9, 5), node("e", 9, 1)]
    building = room(10.0, 6.0, wall("w", 5.0, 0.0, 5.0, 6.0), *nodes, edge("a", "b"), edge("c", "d"), edge("d", "e"))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(building).paths(PathRequest(WEST, EAST, mode=RouteMode.TOPOLOGICAL))
    (blocker,) = refusal.value.blockers
    assert "the start reaches 2 nodes (a, b), the goal 3 nodes (c, d, e)" in blocker.reason
    with pytest.raises(NoPath) as refusal:
        PathPlanner(room()).paths(PathRequest(WEST, EAST, mode=RouteMode.TOPOLOGICAL))
    assert "topological map" in refusal.value.blockers[0].reason


def test_a_query_ends_at_its_time_limit() -> None:
    planner = PathPlanner(two_rooms(1.2), time_limit_s=0.0)
    with planner._snapshot.graph("L1", 0.4)._lock, pytest.raises(PlanningTimeout):
        planner.paths(PathRequest(WEST, EAST, mode=RouteMode.GEOMETRIC))


def test_lengths_that_differ_look_different() -> None:
    building = room(10.0, 6.0, wall("low", 5.0, 0.0, 5.0, 2.601), wall("high", 5.0, 3.4, 5.0, 6.0))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(building).paths(PathRequest(WEST, EAST, mode=RouteMode.GEOMETRIC))
    for blocker in refusal.value.blockers:
        found, needed = re.findall(r"[0-9.]+(?= m)", blocker.reason)
        assert found != needed


def kernel_versions() -> int:
    """Compiled versions of all kernels that are loaded, one for each combination of argument types."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith("robocorba.")]
    kernels = {
        id(value): value for module in modules for value in vars(module).values() if hasattr(value, "signatures")
    }
    return sum(len(kernel.signatures) for kernel in kernels.values())


def test_whole_coordinates_need_no_compiling() -> None:
    planner = PathPlanner(bent_ring())
    whole = Place("L1", 1, 1), Place("L1", 9, 5)
    expected = [planner.shortest(WEST, EAST).distance]
    expected += [planner.paths(PathRequest(WEST, EAST, mode=mode, radius=0.0))[0].distance for mode in RouteMode]
    before = kernel_versions()
    found = [planner.shortest(*whole).distance]
    found += [planner.paths(PathRequest(*whole, mode=mode, radius=0))[0].distance for mode in RouteMode]
    assert found == expected
    assert kernel_versions() == before > 0


@pytest.mark.parametrize("mode", RouteMode)
def test_areas_that_block_every_path_are_named(mode: RouteMode) -> None:
    nodes = [node("a", 1, 1), node("b", 4, 1), node("c", 9, 1)]
    across = ((4.5, -1.0), (5.5, -1.0), (5.5, 7.0), (4.5, 7.0))
    beside = ((0.0, 5.0), (2.0, 5.0), (2.0, 6.0), (0.0, 6.0))
    wet = [Area(name="wet floor", polygon=across), Area(name="rug", polygon=beside)]
    planner = PathPlanner(room(10.0, 6.0, *nodes, edge("a", "b"), edge("b", "c"), *wet))
    request = PathRequest(WEST, EAST, mode=mode)
    for areas, blocker in (
        ({"avoid_areas": (("L1", "rug"), ("L1", "wet floor"))}, ("wet floor", "is avoided by the request")),
        ({"forbidden_areas": (("L1", beside), ("L1", across))}, ("forbidden area 1", "is forbidden by the request")),
    ):
        with pytest.raises(NoPath, match="areas that the request avoids block every path") as refusal:
            planner.paths(request._replace(**areas))
        assert [(b.kind, b.floor, b.name, b.reason) for b in refusal.value.blockers] == [("area", "L1", *blocker)]
    table = TemporaryObstacles((("L1", across),), (), ("table",))
    assert [str(b) for b in table.explained(refusal.value).blockers] == [str(b) for b in refusal.value.blockers]
    with pytest.raises(NoPath) as refusal:
        planner.paths(table.added_to(request))
    named = table.explained(refusal.value)
    assert isinstance(named, NoPath)
    assert [str(b) for b in named.blockers] == ["object 'table' on L1: stands in the way now"]


def test_edges_that_forbid_a_connection_to_the_map_are_named() -> None:
    nodes = [node("a", 2, 5), node("b", 18, 5), node("c", 18, 9)]
    edges = [edge("a", "b", graphs=("g",)), edge("b", "c", graphs=("h",))]
    planner = PathPlanner(room(20.0, 5.9, wall("w", 0.0, 4.1, 17.0, 4.1), *nodes, *edges))
    with pytest.raises(NoPath, match="'a-b' on L1: is not of graph h"):
        planner.paths(PathRequest(Place("L1", 10.0, 5.0), Place("L1", 18.0, 3.0), graph="h"))


def test_an_edit_is_seen_by_the_next_query() -> None:
    building = two_rooms(1.2)
    planner = PathPlanner(building, 1)
    assert planner.shortest(WEST, EAST).version == 1
    planner.update(building.with_element("L1", wall("shut", 4.0, 0.0, 4.0, 6.0)), 2)
    with pytest.raises(NoPath):
        planner.shortest(WEST, EAST)
    planner.update(building, 3)
    assert planner.shortest(WEST, EAST).version == 3


anything = st.floats(allow_nan=True, allow_infinity=True) | st.sampled_from([1e308, -1e308, 5e-324, 0.0])
places = st.builds(Place, st.sampled_from(["L1", "L2", "L3", "", "L9", "x" * 10_000]), anything, anything)
polygons = st.lists(st.tuples(anything, anything), max_size=6).map(tuple)


@settings(deadline=None, max_examples=300)
@given(
    st.builds(
        PathRequest,
        places,
        places,
        radius=anything | st.just(0.4),
        speed=anything | st.just(1.0),
        mode=st.sampled_from(RouteMode),
        best=st.sampled_from(Criterion),
        avoid_elevators=st.frozensets(st.sampled_from(["E1", "E7", ""]), max_size=2),
        avoid_areas=st.lists(st.tuples(st.sampled_from(["L1", "?"]), st.text(max_size=3)), max_size=2).map(tuple),
        forbidden_areas=st.lists(st.tuples(st.sampled_from(["L1", "?"]), polygons), max_size=2).map(tuple),
        graph=st.sampled_from(["", "0", "y" * 1_000_000]),
        alternatives=st.integers(-1, 12),
    )
)
def test_hostile_requests_get_a_typed_error(request: PathRequest) -> None:
    try:
        paths = _TOWER.paths(request)
    except PathError as refusal:
        assert len(str(refusal)) < 2000
    else:
        assert paths and errors(tower(), paths[0], request) == []


_TOWER = PathPlanner(tower())


def stay(**options: object) -> PathRequest:
    """A request with these options to stay in the west."""
    return PathRequest(WEST, WEST)._replace(**options)


FAR = Place("L1", 368742.1234, 912345.6789)
NOT_AN_AREA = (("L1", ((0, 0), (1, 1))),)
KITCHEN = "area kitchen, which is avoided by the request"


@pytest.mark.parametrize(
    ("error", "request_", "fields"),
    [
        (InvalidPoint, stay(start=Place("L1", math.nan, 1.0)), {"which": "start", "field": "x"}),
        (InvalidRequest, stay(radius=-0.1), {"field": "robotRadius"}),
        (InvalidRequest, stay(speed=0.0), {"field": "robotSpeed"}),
        (InvalidRequest, stay(alternatives=10), {"field": "alternatives"}),
        (InvalidRequest, stay(graph="none"), {"field": "navigationGraph"}),
        (InvalidRequest, stay(forbidden_areas=NOT_AN_AREA), {"field": "forbiddenAreas[0].polygon"}),
        (UnknownFloor, stay(goal=Place("L9", 1.0, 1.0)), {"which": "goal", "known": ("L1", "L2", "L3")}),
        (UnknownFloor, stay(without_movables=("L1", "cellar")), {"which": "withoutMovables", "floor": "cellar"}),
        (NotFree, stay(start=Place("L1", 9.9, 1.0)), {"obstacle": "floor L1", "clearance_m": pytest.approx(0.1)}),
        (NotFree, stay(goal=FAR), {"which": "goal"}),
        (NotFree, stay(goal=Place("L1", 5.0, 1.0), avoid_areas=(("L1", "kitchen"),)), {"obstacle": KITCHEN}),
    ],
)
def test_what_is_refused_is_named(error: type[PathError], request_: PathRequest, fields: dict[str, object]) -> None:
    kitchen = Area(name="kitchen", polygon=((4.0, 0.0), (6.0, 0.0), (6.0, 3.0), (4.0, 3.0)))
    with pytest.raises(error) as refusal:
        PathPlanner(tower().with_element("L1", kitchen)).paths(request_)
    assert {name: getattr(refusal.value, name) for name in fields} == fields
    far = "goal L1:368742.123,912345.679 is not free"  # with millimetres, far from the origin too
    assert (far in str(refusal.value)) == (request_.goal.x > 1e5)
