"""The path planning agent: kinds and times of points, criteria, errors that name the obstacle."""

from __future__ import annotations

import math
import re
import sys

import msgspec
import numpy as np
import pytest
import shapely
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
from robocorba.maps.geometry import object_geometry
from robocorba.maps.model import (
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
from robocorba.maps.samples import load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, Place, PointKind, RouteMode
from robocorba.planning.roads import BLOCKED, CLEARANCE
from robocorba.planning.route import waypoints
from robocorba.planning.temporary_obstacles import TemporaryObstacles
from tests.planning.generated import two_halls
from tests.planning.judge import errors
from tests.planning.request_judge import objections
from tests.planning.scenes import edge, node, random_places, room, tower, two_rooms, wall

#: Length of the path around the post in `bent_ring` [m].
BENT_M = 2 * math.hypot(4.0, 0.2)
#: Nodes in the corners of a room of 10 x 6 m.
RING = [node("a", 1, 1), node("b", 9, 1), node("c", 9, 5), node("d", 1, 5)]
WEST, EAST = Place("L1", 1.0, 1.0), Place("L1", 9.0, 5.0)


def bent_ring(**south: object) -> Building:
    """A ring of nodes a, m, b, c, d; a post hides a and b from each other. `south`: attributes of a-m and m-b."""
    edges = [edge("a", "m", **south), edge("m", "b", **south), edge("b", "c"), edge("c", "d"), edge("d", "a")]
    walls = [wall("post", 5.0, 0.0, 5.0, 0.7), wall("w", 4.0, 1.8, 6.0, 1.8)]
    return room(10.0, 6.0, *walls, *RING, node("m", 5, 1.2), *edges)


def test_a_path_over_floors() -> None:
    building = tower()
    request = PathRequest(Place("L1", 1.0, 1.0), Place("L3", 1.0, 5.0))
    path = PathPlanner(building).shortest(request.start, request.goal)
    kinds = [point.kind for point in path.points]
    entry = kinds.index(PointKind.ELEVATOR_ENTRY)
    assert kinds[0] is PointKind.START and kinds[-1] is PointKind.GOAL
    assert kinds[entry + 1] is PointKind.ELEVATOR_EXIT
    before, on, off = path.points[entry - 1 : entry + 2]
    assert (on.floor, off.floor, on.elevator, on.node) == ("L1", "L3", "E1", "cabin")
    # Wait: the cabin comes from L1, L2 or L3 (0, 5 and 9 s: 4 and 8 m at 1 m/s, and 1 s to start and stop), doors open.
    assert on.time == pytest.approx(before.time + math.dist(before[3:5], on[3:5]))  # of driving only
    # Ride: doors close, 8 m and 1 s to start and stop, doors open.
    assert off.time == pytest.approx(on.time + (14.0 / 3 + 3.0) + (3.0 + 9.0 + 3.0))  # waits, then rides
    assert off.distance == pytest.approx(on.distance + 8.0)
    assert errors(building, path, request) == []


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
        driven = path.distance - 4.0
        along_roads = 6.0 + math.hypot(4.0, 1.6) + 4.0
        assert driven == pytest.approx(along_roads, abs=0.15 if mode is RouteMode.GEOMETRIC else 1e-9)
        assert path.duration == pytest.approx(driven / 0.5 + (2.5 + 3.0) + (3.0 + 5.0 + 3.0))
        assert objections(building, PathPlanner(building), request) == ("found", [])


def test_an_elevator_whose_cabin_cannot_be_crossed_is_no_way() -> None:
    building = through_cabin("L1").with_element("L2", MapObject("shelf", BoxShape((0.5, 2.9)), (11.0, 5.0)))
    for mode in RouteMode:
        with pytest.raises(NoPath):
            PathPlanner(building).paths(PathRequest(Place("L1", 3.0, 4.2), Place("L2", 17.0, 5.8), mode=mode))


def test_headings_point_to_the_next_point() -> None:
    path = PathPlanner(two_rooms(1.2)).shortest(WEST, EAST)
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        assert a.heading == pytest.approx(math.atan2(b.y - a.y, b.x - a.x))
    assert path.points[-1].heading == path.points[-2].heading


def test_the_same_place_twice() -> None:
    for mode in RouteMode:
        path = PathPlanner(two_rooms(1.2)).paths(PathRequest(WEST, WEST, mode=mode))[0]
        assert path.points[0].kind is PointKind.START and path.points[-1].kind is PointKind.GOAL
        assert mode is RouteMode.TOPOLOGICAL or path.distance == 0.0


def test_a_straight_line_where_nothing_is_in_the_way() -> None:
    path = PathPlanner(room()).shortest(WEST, EAST)
    assert [point.kind for point in path.points] == [PointKind.START, PointKind.GOAL]
    assert path.distance == pytest.approx(math.dist(WEST[1:], EAST[1:]))


def test_a_place_behind_a_corner_joins_the_map_by_a_detour() -> None:
    niche = [wall("a", 1.0, 2.0, 3.0, 2.0), wall("b", 3.0, 2.0, 3.0, 1.0)]
    building = room(10.0, 6.0, *niche, node("n", 7.0, 5.0), node("m", 9.0, 5.0), edge("n", "m"))
    start, goal = Place("L1", 1.6, 1.4), Place("L1", 9.0, 1.0)
    for mode in RouteMode:
        there, back = PathRequest(start, goal, mode=mode), PathRequest(goal, start, mode=mode)
        paths = [PathPlanner(building).paths(request)[0] for request in (there, back)]
        assert errors(building, paths[0], there) == errors(building, paths[1], back) == []
        assert paths[0].distance == pytest.approx(paths[1].distance)


def test_one_way_edges_are_obeyed() -> None:
    edges = [edge("a", "b", one_way=True), edge("b", "c"), edge("c", "d", one_way=True), edge("d", "a")]
    block = [wall("south", 2.0, 2.0, 8.0, 2.0), wall("north", 2.0, 4.0, 8.0, 4.0)]
    block += [wall("west", 2.0, 2.0, 2.0, 4.0), wall("east", 8.0, 2.0, 8.0, 4.0)]
    planner = PathPlanner(room(10.0, 6.0, *block, *RING, *edges))
    there = planner.shortest(Place("L1", 3.0, 1.0), Place("L1", 7.0, 1.0))
    back = planner.shortest(Place("L1", 7.0, 1.0), Place("L1", 3.0, 1.0))
    assert there.distance == pytest.approx(4.0)
    assert back.distance > 12.0


def test_speed_limits_count_for_the_fastest_path_only() -> None:
    planner = PathPlanner(bent_ring(speed_limit=0.1))
    ends = (Place("L1", 1.0, 1.0), Place("L1", 9.0, 1.0))
    short = planner.paths(PathRequest(*ends, mode=RouteMode.TOPOLOGICAL))[0]
    fast = planner.paths(PathRequest(*ends, mode=RouteMode.TOPOLOGICAL, best=Criterion.SHORTEST_TIME))[0]
    assert (short.distance, short.duration) == pytest.approx((BENT_M, 10 * BENT_M))
    assert (fast.distance, fast.duration) == pytest.approx((16.0, 16.0))


@pytest.mark.parametrize("mode", RouteMode)
def test_a_narrow_door_is_named(mode: RouteMode) -> None:
    planner = PathPlanner(two_rooms(0.7))
    with pytest.raises(NoPath) as refusal:
        planner.paths(PathRequest(WEST, EAST, mode=mode))
    (blocker,) = refusal.value.blockers
    assert (blocker.kind, blocker.floor, blocker.name) == ("door", "L1", "door")
    assert "0.70 m wide, 0.80 m needed" in blocker.reason
    assert planner.paths(PathRequest(WEST, EAST, radius=0.3, mode=mode))


@pytest.mark.parametrize(
    ("served", "avoided", "blocker"), [(("L1", "L2"), (), ("floor", "L3")), (None, ("E1",), ("elevator", "E1"))]
)
def test_a_missing_or_avoided_elevator_is_named(
    served: tuple[str, ...] | None, avoided: tuple[str, ...], blocker: tuple[str, str]
) -> None:
    request = PathRequest(WEST, Place("L3", 1.0, 1.0), avoid_elevators=frozenset(avoided))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(tower(3, served)).paths(request)
    assert [(b.kind, b.name) for b in refusal.value.blockers] == [blocker]


def test_a_floor_without_a_map_is_crossed_through_free_space_except_in_topological_mode() -> None:
    planner = PathPlanner(room(10.0, 6.0, wall("w", 5.0, 0.0, 5.0, 5.0)))
    goal = Place("L1", 9.0, 1.0)
    assert planner.shortest(WEST, goal).distance == pytest.approx(
        planner.paths(PathRequest(WEST, goal, mode=RouteMode.GEOMETRIC))[0].distance
    )
    with pytest.raises(NoPath) as refusal:
        planner.paths(PathRequest(WEST, goal, mode=RouteMode.TOPOLOGICAL))
    assert "topological map" in refusal.value.blockers[0].reason


def test_a_closed_wall_is_no_path() -> None:
    building = two_rooms(1.2).without(ElementKind.DOOR, "L1", "door")
    for mode in RouteMode:
        with pytest.raises(NoPath) as refusal:
            PathPlanner(building).paths(PathRequest(WEST, EAST, mode=mode))
        assert refusal.value.blockers


@pytest.mark.parametrize("mode", RouteMode)
def test_a_locked_door_blocks_and_is_named(mode: RouteMode) -> None:
    locked = two_rooms(1.2).with_element("L1", Door(name="door", a=(5.0, 2.4), b=(5.0, 3.6), locked=True))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(locked).paths(PathRequest(WEST, EAST, mode=mode))
    assert [(b.kind, b.name, b.reason) for b in refusal.value.blockers] == [("door", "door", "is locked")]


def test_an_edge_under_an_object_is_blocked() -> None:
    """Its distance to the border of a large object does not count as clearance."""
    box = MapObject("box", BoxShape((6.0, 3.0)), (5.0, 2.5))
    building = room(10.0, 6.0, box, node("a", 4.0, 2.5), node("b", 6.0, 2.5), edge("a", "b"))
    across = building.with_element("L1", node("c", 9.5, 2.5)).with_element("L1", edge("b", "c"))
    roads = PathPlanner(across)._snapshot.roads.roads
    assert (roads.measures[:, CLEARANCE] == BLOCKED).all()


@pytest.mark.parametrize(
    ("start", "goal"),
    [((11.0, 7.0), (11.0, 2.0)), ((11.0, 2.0), (11.0, 7.0)), ((11.0, 7.0), (6.0, 2.0)), ((6.0, 2.0), (11.0, 7.0))],
)
@pytest.mark.parametrize("mode", RouteMode)
def test_a_path_that_begins_on_a_node_does_not_lead_through_the_wall(
    mode: RouteMode, start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """One end is exactly on a node and the other sees none: the corners between them were lost, the answer was 5 m."""
    request = PathRequest(Place("L1", *start), Place("L1", *goal), mode=mode)
    path = PathPlanner(two_halls()).paths(request)[0]
    assert errors(two_halls(), path, request) == []
    assert path.distance == pytest.approx(15.90 if 11 == start[0] == goal[0] else 11.27, abs=0.01)


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
    assert planner.paths(PathRequest(start, goal))[0].distance == pytest.approx(shortest)
    assert planner.paths(PathRequest(start, goal, mode=RouteMode.TOPOLOGICAL))[0].distance > 60.0
    graphed = room(40.0, 8.0, wall("long", 1.0, 4.0, 37.0, 4.0), *loop, *(edge(e.a, e.b, graphs=("g",)) for e in roads))
    assert PathPlanner(graphed).paths(PathRequest(start, goal, graph="g"))[0].distance > 60.0


def test_components_of_the_topological_map_are_named() -> None:
    """Each of two rooms without a door between them has a component of its own."""
    nodes = [node("a", 1, 1), node("b", 4, 1), node("c", 6, 5), node("d", 9, 5), node("e", 9, 1)]
    building = room(10.0, 6.0, wall("w", 5.0, 0.0, 5.0, 6.0), *nodes, edge("a", "b"), edge("c", "d"), edge("d", "e"))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(building).paths(PathRequest(WEST, EAST, mode=RouteMode.TOPOLOGICAL))
    (blocker,) = refusal.value.blockers
    assert "the start reaches 2 nodes (a, b), the goal 3 nodes (c, d, e)" in blocker.reason


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


def test_areas_are_avoided() -> None:
    edges = [edge("a", "b"), edge("b", "c"), edge("c", "d"), edge("d", "a")]
    polygon = ((4.0, 0.0), (6.0, 0.0), (6.0, 3.0), (4.0, 3.0))
    planner = PathPlanner(room(10.0, 6.0, *RING, *edges, Area(name="kitchen", polygon=polygon)))
    ends = (Place("L1", 1.0, 1.0), Place("L1", 9.0, 1.0))
    for mode in RouteMode:
        free = planner.paths(PathRequest(*ends, mode=mode))[0]
        avoiding = planner.paths(PathRequest(*ends, mode=mode, avoid_areas=(("L1", "kitchen"),)))[0]
        forbidden = planner.paths(PathRequest(*ends, mode=mode, forbidden_areas=(("L1", polygon),)))[0]
        assert free.distance == pytest.approx(8.0)
        assert avoiding.distance == pytest.approx(forbidden.distance)
        assert avoiding.distance > 8.5
    with pytest.raises(NotFree) as refusal:
        planner.paths(PathRequest(ends[0], Place("L1", 5.0, 1.0), avoid_areas=(("L1", "kitchen"),)))
    assert refusal.value.obstacle == "area kitchen, which is avoided by the request"


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


def test_walls_are_named_where_avoided_areas_are_not_the_cause() -> None:
    building = two_rooms(1.2).without(ElementKind.DOOR, "L1", "door")
    polygon = ((3.0, 5.0), (4.0, 5.0), (4.0, 6.0), (3.0, 6.0))
    with pytest.raises(NoPath) as refusal:
        PathPlanner(building).paths(PathRequest(WEST, EAST, forbidden_areas=(("L1", polygon),)))
    assert "its walls leave no passage" in str(refusal.value)


def test_places_in_messages_keep_millimetres_far_from_the_origin() -> None:
    with pytest.raises(NotFree, match=r"goal L1:368742\.123,912345\.679 is not free"):
        PathPlanner(room()).shortest(WEST, Place("L1", 368742.1234, 912345.6789))


def test_edges_that_forbid_a_connection_to_the_map_are_named() -> None:
    nodes = [node("a", 2, 5), node("b", 18, 5), node("c", 18, 9)]
    edges = [edge("a", "b", graphs=("g",)), edge("b", "c", graphs=("h",))]
    planner = PathPlanner(room(20.0, 5.9, wall("w", 0.0, 4.1, 17.0, 4.1), *nodes, *edges))
    with pytest.raises(NoPath, match="'a-b' on L1: is not of graph h"):
        planner.paths(PathRequest(Place("L1", 10.0, 5.0), Place("L1", 18.0, 3.0), graph="h"))


@settings(deadline=None, max_examples=15)
@given(
    st.tuples(st.floats(1.0, 9.0), st.floats(1.0, 5.0), st.floats(-math.pi, math.pi)),
    st.sampled_from(RouteMode),
)
def test_a_moved_object_blocks_its_present_place_and_not_that_on_the_map(
    moved: tuple[float, float, float], mode: RouteMode
) -> None:
    """The answer is the same as in a building in which the chest was moved."""
    x, y, heading = moved
    chest = MapObject("chest", BoxShape((1.0, 0.8)), (5.0, 3.0), movable=True)
    nodes = [node(f"{column}{row}", column, row) for column in (1, 5, 9) for row in (1, 3, 5)]
    edges = [edge(a.name, b.name) for a in nodes for b in nodes if a.name < b.name and math.dist(a.at, b.at) <= 4.0]
    fixed = MapObject("shelf", BoxShape((0.4, 0.4)), (3.0, 3.0))
    on_map = room(10.0, 6.0, chest, fixed, *nodes, *edges)
    actual = on_map.with_element("L1", msgspec.structs.replace(chest, at=(x, y), heading=heading))
    corners = shapely.get_coordinates(object_geometry(actual.floors["L1"].geometrical.objects["chest"]))[:-1]
    area = tuple((float(a), float(b)) for a, b in corners)
    request = PathRequest(WEST, EAST, mode=mode)
    informed = request._replace(forbidden_areas=(("L1", area),), without_movables=("L1",))
    assert answer(PathPlanner(on_map), informed) == pytest.approx(answer(PathPlanner(actual), request))


def answer(planner: PathPlanner, request: PathRequest) -> list[float]:
    """The distances of the points; none where there is no path."""
    try:
        return [point.distance for point in planner.paths(request)[0].points]
    except (NotFree, NoPath):
        return []


def test_without_movables_on_an_unknown_floor_is_refused() -> None:
    with pytest.raises(UnknownFloor) as refusal:
        _TOWER.paths(PathRequest(WEST, WEST, without_movables=("L1", "cellar")))
    assert (refusal.value.which, refusal.value.floor) == ("withoutMovables", "cellar")


def test_alternatives_differ_and_come_in_order() -> None:
    building = load_sample("five-floors")
    start, goal = random_places(building, 0.4, 2, seed=5)
    for mode in RouteMode:
        request = PathRequest(start, goal, mode=mode, alternatives=3)
        paths = PathPlanner(building).paths(request)
        assert [path.distance for path in paths] == sorted(path.distance for path in paths)
        assert len({tuple(point[1:5] for point in path.points) for path in paths}) == len(paths)
        assert all(errors(building, path, request) == [] for path in paths)
    best = PathPlanner(building).shortest(start, goal)
    assert best.distance == pytest.approx(
        PathPlanner(building).paths(PathRequest(start, goal, alternatives=2))[0].distance, rel=0.05
    )


def test_only_edges_of_the_graph() -> None:
    planner = PathPlanner(bent_ring(graphs=("small",)).with_element("L1", edge("d", "b", graphs=("x",))))
    ends = (Place("L1", 1.0, 1.0), Place("L1", 9.0, 1.0))
    assert planner.paths(PathRequest(*ends, mode=RouteMode.TOPOLOGICAL, graph="small"))[0].distance == pytest.approx(
        BENT_M
    )
    other = planner.paths(PathRequest(*ends, mode=RouteMode.TOPOLOGICAL, graph="x"))[0]
    assert other.distance == pytest.approx(4.0 + math.hypot(8.0, 4.0))
    with pytest.raises(InvalidRequest):
        planner.paths(PathRequest(*ends, graph="none"))


def test_an_edit_is_seen_by_the_next_query() -> None:
    building = two_rooms(1.2)
    planner = PathPlanner(building, 1)
    assert planner.shortest(WEST, EAST).version == 1
    planner.update(building.with_element("L1", wall("shut", 4.0, 0.0, 4.0, 6.0)), 2)
    with pytest.raises(NoPath):
        planner.shortest(WEST, EAST)
    planner.update(building, 3)
    assert planner.shortest(WEST, EAST).version == 3


def test_not_free_names_the_obstacle() -> None:
    planner = PathPlanner(two_rooms(1.2))
    with pytest.raises(NotFree) as refusal:
        planner.shortest(Place("L1", 4.9, 1.0), EAST)
    assert (refusal.value.which, refusal.value.obstacle) == ("start", "wall between")
    assert refusal.value.clearance_m == pytest.approx(0.1)
    with pytest.raises(NotFree):
        planner.shortest(WEST, Place("L1", 40.0, 1.0))


def test_an_unknown_floor_lists_the_known() -> None:
    with pytest.raises(UnknownFloor) as refusal:
        PathPlanner(tower()).shortest(WEST, Place("L9", 1.0, 1.0))
    assert (refusal.value.which, refusal.value.known) == ("goal", ("L1", "L2", "L3"))


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


def test_invalid_fields_are_named() -> None:
    with pytest.raises(InvalidPoint) as wrong:
        _TOWER.shortest(Place("L1", math.nan, 1.0), WEST)
    assert (wrong.value.which, wrong.value.field) == ("start", "x")
    for field, request in {
        "robotRadius": PathRequest(WEST, WEST, radius=-0.1),
        "robotSpeed": PathRequest(WEST, WEST, speed=0.0),
        "alternatives": PathRequest(WEST, WEST, alternatives=10),
        "forbiddenAreas[0].polygon": PathRequest(WEST, WEST, forbidden_areas=(("L1", ((0, 0), (1, 1))),)),
    }.items():
        with pytest.raises(InvalidRequest) as refusal:
            _TOWER.paths(request)
        assert refusal.value.field == field
