"""Automatic topological maps: clear of everything, connected like the free space, and readable; also by way of the
nodes that a floor has already."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from robocorba.errors.maps import InvalidElement, TooSlow, UnknownElement
from robocorba.map_editor import geometry, validation
from robocorba.map_editor.collisions import blockages
from robocorba.map_editor.formats import read_map
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    MapObject,
    PathNode,
    Shape,
    TopologicalMap,
    Wall,
    with_topology,
)
from robocorba.map_editor.samples import SAMPLES, load_sample
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.time_limit import time_limit
from robocorba.map_editor.topology import topological_map
from robocorba.map_editor.topology.roadmap import SAME_POINT_M
from robocorba.map_editor.topology.sites import sites_of
from testkit.buildings import with_all
from tests.map_editor.formats.rmf_files import real_file

RADIUS = 0.40


def one_floor(
    width: float = 12.0,
    depth: float = 8.0,
    walls: Sequence[tuple[XY, XY]] = (),
    doors: Sequence[tuple[XY, XY]] = (),
    objects: Sequence[tuple[Shape, XY]] = (),
    elevators: Sequence[Elevator] = (),
    bounded: bool = True,
) -> Building:
    outline = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)) if bounded else ()
    on_it: list[Element] = [Wall(name=f"w{i}", a=a, b=b) for i, (a, b) in enumerate(walls)]
    on_it += [Door(name=f"d{i}", a=a, b=b) for i, (a, b) in enumerate(doors)]
    on_it += [MapObject(name=f"o{i}", shape=shape, at=at) for i, (shape, at) in enumerate(objects)]
    whole = [Floor("L1", 1, 0.0, outline=outline), Floor("L2", 2, 3.0), *elevators]
    return with_all(Building("test"), [*(("", element) for element in whole), *(("L1", element) for element in on_it)])


def graph_of(roads: TopologicalMap) -> nx.Graph[str]:
    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(roads.nodes)
    graph.add_edges_from((edge.a, edge.b) for edge in roads.edges.values())
    return graph


def open_parts(building: Building, floor: str, radius: float) -> list[Polygon]:
    """The parts of the free space, without shafts that don't open to this floor."""
    space = geometry.free_space(building, floor, radius)
    for elevator in building.elevators.values():
        if floor not in elevator.floors():
            space = space.difference(geometry.shaft_polygon(elevator))
    return list(shapely.get_parts(space))


def check_roads(
    building: Building, floor: str, roads: TopologicalMap, radius: float, left_out: Collection[str] = ()
) -> None:
    """Every edge is clear, and the graph's pieces, without some nodes, are the free space's parts, one for one."""
    everything = shapely.union_all([item.geometry for item in geometry.obstacles(building, floor)])
    for edge in roads.edges.values():
        line = LineString([roads.nodes[edge.a].at, roads.nodes[edge.b].at])
        assert line.length > 0
        assert everything.is_empty or line.distance(everything) >= radius - 1e-6, edge.name
    parts, graph = open_parts(building, floor, radius), graph_of(roads)
    graph.remove_nodes_from(left_out)
    reached: list[int] = []
    for piece in nx.connected_components(graph):
        distances = shapely.distance(parts, shapely.points([roads.nodes[name].at for name in piece])[:, None])
        homes = set(distances.argmin(axis=1).tolist())
        assert distances.min(axis=1).max() < 1e-6, f"a node of {sorted(piece)} is not free"
        assert len(homes) == 1, f"{sorted(piece)} spans several parts"
        reached += homes
    assert sorted(reached) == list(range(len(parts)))


metres = st.floats(0.5, 14.0).map(lambda value: round(value, 2))
spots = st.tuples(metres, metres)


@st.composite
def floors(draw: st.DrawFn) -> Building:
    """A room of up to 15 m by 15 m with walls, some with doors, and boxes and circles, and maybe an elevator."""
    width, depth = draw(st.floats(6, 15)), draw(st.floats(6, 15))
    walls, doors = [], []
    for _ in range(draw(st.integers(0, 6))):
        (x, y), length = draw(spots), draw(st.floats(1.5, 8))
        turn = draw(st.sampled_from([0.0, math.pi / 2]) | st.floats(0, 6))
        ux, uy = math.cos(turn), math.sin(turn)
        walls.append(((x, y), (x + length * ux, y + length * uy)))
        opening = draw(st.sampled_from([0.0, 0.79, 0.81, 1.2]))
        if opening:
            at = draw(st.floats(0, length - opening))
            doors.append(((x + at * ux, y + at * uy), (x + (at + opening) * ux, y + (at + opening) * uy)))
    sizes = st.floats(0.2, 2.5)
    shapes = st.builds(BoxShape, size=st.tuples(sizes, sizes)) | st.builds(CircleShape, radius=st.floats(0.1, 1.2))
    objects = draw(st.lists(st.tuples(shapes, spots), max_size=5))
    elevators = []
    if draw(st.booleans()):
        door = ElevatorDoor(floor="L1", side=draw(st.sampled_from(list(CabinSide))), width=draw(st.floats(0.6, 1.1)))
        size = (draw(st.floats(1.2, 2.4)), draw(st.floats(1.2, 2.4)))
        elevators.append(Elevator(name="E1", at=draw(spots), size=size, doors=(door,), heading=draw(st.floats(0, 6))))
    return one_floor(width, depth, walls, doors, objects, elevators, bounded=draw(st.booleans()))


def check_whole(building: Building, floor: str, roads: TopologicalMap, radius: float) -> None:
    """The same, and the building with these roads keeps the rules: nothing blocks them, and elevators have cabins."""
    check_roads(building, floor, roads, radius)
    building = with_topology(building, floor, roads)
    assert validation.problems(building) == blockages(building, floor) == []
    served = {elevator.name for elevator in building.elevators.values() if floor in elevator.floors()}
    assert {node.elevator for node in roads.nodes.values()} - {""} == served


SAMPLE_FLOORS = [(name, floor) for name in SAMPLES for floor in load_sample(name).floors]


@pytest.mark.parametrize(("sample", "floor"), SAMPLE_FLOORS)
def test_sample_floors(sample: str, floor: str) -> None:
    building = load_sample(sample)
    roads = topological_map(building, floor, RADIUS)
    check_whole(building, floor, roads, RADIUS)
    assert len(roads.nodes) <= 100

    space = shapely.union_all(open_parts(building, floor, RADIUS))
    slack = space.buffer(1e-7)
    shapely.prepare(slack)
    random = np.random.default_rng(1)
    x0, y0, x1, y1 = space.bounds
    points = np.column_stack([random.uniform(x0, x1, 900), random.uniform(y0, y1, 900)])
    points = points[shapely.contains_xy(space, points)][:250]
    nodes = np.array([node.at for node in roads.nodes.values()])
    lines = np.stack(np.broadcast_arrays(points[:, None, :], nodes[None, :, :]), axis=2)
    sees = shapely.covers(slack, shapely.linestrings(lines)).any(axis=1)
    assert sees.mean() >= 0.95

    for door in building.floors[floor].geometrical.doors.values():
        if not door.locked:
            middle = Point((door.a[0] + door.b[0]) / 2, (door.a[1] + door.b[1]) / 2)
            assert min(middle.distance(Point(node.at)) for node in roads.nodes.values()) < 0.5, door.name
    for area in building.floors[floor].geometrical.areas.values():
        inner = Polygon(area.polygon).buffer(-0.1)
        assert any(inner.contains(Point(node.at)) for node in roads.nodes.values()), area.name


@pytest.mark.parametrize("name", ["hotel", "office"])
def test_real_buildings(name: str) -> None:
    building = read_map(real_file(name)).building
    for floor in building.floors:
        check_whole(building, floor, topological_map(building, floor, 0.25), 0.25)


def test_few_nodes_and_a_ring_around_a_block() -> None:
    (node,) = topological_map(one_floor(6, 6), "L1").nodes.values()
    assert node.at == pytest.approx((3, 3), abs=0.8)
    roads = topological_map(one_floor(12, 12, objects=[(BoxShape(size=(4.0, 4.0)), (6.0, 6.0))]), "L1")
    (ring,) = nx.cycle_basis(graph_of(roads))
    assert Polygon([roads.nodes[name].at for name in ring]).contains(Point(6, 6))


@pytest.mark.parametrize("radius", [0.0, -1.0, 1e-9, 0.01, 1e9, math.nan, math.inf])
def test_a_radius_must_be_positive_and_the_floor_be_there(radius: float) -> None:
    with pytest.raises(InvalidElement, match="radius"):
        topological_map(one_floor(), "L1", radius)
    with pytest.raises(UnknownElement):
        topological_map(one_floor(), "L9")


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_dead_end_corridor_has_a_node_near_its_end_but_corners_have_none(turn: float) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    corners = [(0, 0), (6, 0), (6, 2), (20, 2), (20, 4), (6, 4), (6, 6), (0, 6)]
    outline = tuple((cos * x - sin * y, sin * x + cos * y) for x, y in corners)
    floor = Floor(name="L1", level=1, elevation=0.0, outline=outline)
    roads = topological_map(Building("test", {"L1": FloorMap(floor)}), "L1")
    end = (cos * 19 - sin * 3, sin * 19 + cos * 3)
    assert min(math.dist(end, node.at) for node in roads.nodes.values()) < 2
    assert len(roads.nodes) <= 4


def elevator(width: float = 1.1, size: tuple[float, float] = (2.0, 2.2), offset: float = 0.0) -> Elevator:
    doors = (ElevatorDoor(floor="L1", width=width, offset=offset), ElevatorDoor(floor="L2", width=width))
    return Elevator(name="E1", at=(6.0, 6.9), size=size, doors=doors)


def test_a_cabin_is_entered_straight_from_a_node_in_front() -> None:
    roads = topological_map(one_floor(elevators=[elevator()]), "L1")
    cabin = roads.nodes["cabin-E1"]
    assert (cabin.elevator, cabin.at) == ("E1", (6.0, 6.9))
    (front,) = graph_of(roads)["cabin-E1"]
    assert roads.nodes[front].at == pytest.approx((6.0, 4.8), abs=0.02)
    assert nx.is_connected(graph_of(roads))


def test_cabins_that_a_robot_does_not_fit_into() -> None:
    behind_narrow_door = topological_map(one_floor(elevators=[elevator(width=0.7)]), "L1")
    assert not graph_of(behind_narrow_door)["cabin-E1"]
    too_small = topological_map(one_floor(elevators=[elevator(size=(0.7, 0.7))]), "L1")
    assert "cabin-E1" not in too_small.nodes


@pytest.mark.parametrize("metres", [1.0, 50.0, 1000.0])
def test_the_work_follows_the_content_of_a_floor_and_not_its_size(metres: float) -> None:
    """The sites of the Voronoi diagram are most of the work. A door of 0.9 m is found in a hall of 20 km."""
    width, depth, middle = 20.0 * metres, 10.0 * metres, 10.0 * metres
    wall, door = ((middle, 0.0), (middle, depth)), ((middle, 4.0 * metres), (middle, 4.0 * metres + 0.9))
    building = one_floor(width, depth, [wall], [door])
    sites, _ = sites_of([item.geometry for item in geometry.obstacles(building, "L1")], RADIUS)
    assert len(sites) < 3000
    roads = topological_map(building, "L1", RADIUS)
    assert len(list(nx.connected_components(graph_of(roads)))) == 1
    assert any(math.dist(node.at, (middle, 4.0 * metres + 0.45)) < 0.06 for node in roads.nodes.values())


def test_the_work_ends_at_its_time_limit() -> None:
    now = iter(np.arange(0.0, 100.0, 0.5))
    check = time_limit("the topological map of L1", 10.0, lambda: float(next(now)))
    with pytest.raises(TooSlow, match="the topological map of L1 takes longer than 10 s"):
        topological_map(load_sample("five-floors"), "L1", check_time=check)
    assert next(now) == 11.0


def named(*at: XY, elevator: str = "") -> tuple[PathNode, ...]:
    return tuple(PathNode(name=f"p{i}", at=place, elevator=elevator) for i, place in enumerate(at))


@settings(deadline=None, max_examples=20)
@given(building=floors(), at=st.lists(spots, max_size=6), radius=st.sampled_from([0.25, 0.40, 0.60]))
def test_places_are_kept_and_joined_where_the_robot_gets_to_them(
    building: Building, at: list[XY], radius: float
) -> None:
    places = named(*at)
    building = with_topology(building, "L1", TopologicalMap({place.name: place for place in places}))
    parts = open_parts(building, "L1", radius)
    if not parts:
        with pytest.raises(InvalidElement, match="no free space"):
            topological_map(building, "L1", radius)
        return
    roads = topological_map(building, "L1", radius, places)
    assert {name: node for name, node in roads.nodes.items() if name.startswith("p")} == {
        place.name: place for place in places
    }
    apart = {
        place.name
        for i, place in enumerate(places)
        if shapely.distance(parts, Point(place.at)).min() > 0
        or any(math.dist(place.at, other.at) <= SAME_POINT_M for other in (*building.elevators.values(), *places[:i]))
    }
    check_roads(building, "L1", roads, radius, apart)


def test_new_names_avoid_those_of_places() -> None:
    places = (PathNode(name="n1", at=(3.0, 3.0)), PathNode(name="cabin-E1", at=(3.0, 6.0)))
    roads = topological_map(one_floor(elevators=[elevator()]), "L1", RADIUS, places)
    assert {place.name: roads.nodes[place.name] for place in places} == {place.name: place for place in places}
    assert roads.nodes["cabin-E1-2"].elevator == "E1"
    assert all(edge.name == name for name, edge in roads.edges.items())
    assert nx.is_connected(graph_of(roads))


def test_names_of_edges_are_told_apart() -> None:
    """Where nodes are called a, a-b, b-c and c, an edge a-b-c may be two."""
    names = ("a", "a-b", "b-c", "c")
    places = tuple(PathNode(name=name, at=(2.0 + 2.0 * i, 4.0)) for i, name in enumerate(names))
    roads = topological_map(one_floor(), "L1", RADIUS, places)
    pairs = {frozenset((edge.a, edge.b)) for edge in roads.edges.values()}
    assert len(pairs) == len(roads.edges) == len(graph_of(roads).edges)


@pytest.mark.parametrize("beside", [[(0.0, 0.0)], [(0.3, 0.1)], [(0.0, 0.0), (0.3, 0.0)]])
def test_places_in_a_cabin_are_its_nodes(beside: list[XY]) -> None:
    lift = elevator()
    places = named(*((lift.at[0] + x, lift.at[1] + y) for x, y in beside), elevator="E1")
    building = one_floor(elevators=[lift])
    roads = topological_map(building, "L1", RADIUS, places)
    assert [node for node in roads.nodes.values() if node.elevator] == list(places)
    check_whole(building, "L1", roads, RADIUS)
