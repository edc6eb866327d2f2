"""Roads by way of the nodes that a floor has already."""

from __future__ import annotations

import math
from itertools import combinations

import networkx as nx
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from robocorba.maps import geometry
from robocorba.maps.model import BoxShape, Building, CircleShape, PathNode, TopologicalMap, with_topology
from robocorba.maps.samples import load_sample
from robocorba.maps.topology import topological_map
from robocorba.maps.topology.roadmap import SAME_POINT_M
from robocorba.spatial.pose import XY
from tests.maps.test_topology import RADIUS, check_roads, elevator, floors, graph_of, one_floor, open_parts
from tests.maps.test_topology import places as spots


def named(*at: XY, elevator: str = "") -> tuple[PathNode, ...]:
    return tuple(PathNode(name=f"p{i}", at=place, elevator=elevator) for i, place in enumerate(at))


@settings(deadline=None, max_examples=40)
@given(building=floors(), at=st.lists(spots, min_size=1, max_size=8), radius=st.sampled_from([0.25, 0.40]))
def test_places_are_kept_and_joined_where_the_robot_gets_to_them(
    building: Building, at: list[XY], radius: float
) -> None:
    places = named(*at)
    building = with_topology(building, "L1", TopologicalMap({place.name: place for place in places}))
    parts = open_parts(building, "L1", radius)
    if not parts:
        return
    roads = topological_map(building, "L1", radius, places)
    assert {name: node for name, node in roads.nodes.items() if name.startswith("p")} == {
        place.name: place for place in places
    }
    everything = shapely.union_all([item.geometry for item in geometry.obstacles(building, "L1")])
    for edge in roads.edges.values():
        line = LineString([roads.nodes[edge.a].at, roads.nodes[edge.b].at])
        assert line.length > 0
        assert everything.is_empty or line.distance(everything) >= radius - 1e-6
    graph = graph_of(roads)
    reached = [
        place
        for i, place in enumerate(places)
        if shapely.distance(parts, Point(place.at)).min() == 0
        and all(math.dist(place.at, other.at) > SAME_POINT_M for other in (*building.elevators.values(), *places[:i]))
    ]
    homes = {name: int(shapely.distance(parts, Point(node.at)).argmin()) for name, node in roads.nodes.items()}
    graph.remove_nodes_from({place.name for place in places} - {place.name for place in reached})
    pieces = [{homes[name] for name in piece} for piece in nx.connected_components(graph)]
    assert sorted(map(tuple, pieces)) == [(i,) for i in range(len(parts))]


def test_a_floor_without_places_is_drawn_as_before() -> None:
    building = load_sample("five-floors")
    assert topological_map(building, "L1", RADIUS, ()) == topological_map(building, "L1", RADIUS)


def test_places_on_a_road_behind_a_corner_and_aside_are_joined() -> None:
    building = one_floor(walls=[((6.0, 0.0), (6.0, 6.0))], objects=[(BoxShape(size=(2.0, 2.0)), (2.0, 6.0))])
    places = named((3.0, 3.0), (11.5, 0.5), (0.5, 7.5), (6.0, 7.0))
    roads = topological_map(building, "L1", RADIUS, places)
    check_roads(building, "L1", roads, RADIUS)
    assert nx.is_connected(graph_of(roads))
    assert all(graph_of(roads)[place.name] for place in places)


def test_places_that_the_robot_does_not_get_to_keep_their_names() -> None:
    building = one_floor(objects=[(CircleShape(radius=0.5), (3.0, 3.0))])
    places = named((3.0, 3.0), (0.1, 4.0), (9.0, 4.0), (9.0, 4.0), (9.01, 4.0))
    roads = topological_map(building, "L1", RADIUS, places)
    assert [name for name in roads.nodes if name.startswith("p")] == ["p2", "p0", "p1", "p3", "p4"]
    assert [bool(graph_of(roads)[place.name]) for place in places] == [False, False, True, False, False]


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


@pytest.mark.parametrize("at", [(0.0, 0.0), (0.3, 0.1)])
def test_a_place_in_a_cabin_is_its_node(at: XY) -> None:
    lift = elevator()
    (place,) = named((lift.at[0] + at[0], lift.at[1] + at[1]), elevator="E1")
    building = one_floor(elevators=[lift])
    roads = topological_map(building, "L1", RADIUS, (place,))
    assert [node for node in roads.nodes.values() if node.elevator] == [place]
    check_roads(building, "L1", roads, RADIUS)
    assert nx.is_connected(graph_of(roads))


def test_another_place_in_a_cabin_is_joined_too() -> None:
    lift = elevator()
    places = named(lift.at, (lift.at[0] + 0.3, lift.at[1]), elevator="E1")
    roads = topological_map(one_floor(elevators=[lift]), "L1", RADIUS, places)
    assert [node for node in roads.nodes.values() if node.elevator] == list(places)
    assert nx.is_connected(graph_of(roads))


def test_places_side_by_side_stay_apart() -> None:
    places = named(*((4.0 + 0.1 * i, 4.0) for i in range(6)))
    roads = topological_map(one_floor(), "L1", RADIUS, places)
    assert all(graph_of(roads)[place.name] for place in places)
    assert all(a.at != b.at for a, b in combinations(roads.nodes.values(), 2))
