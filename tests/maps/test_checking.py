"""What robots can't do in a building that can be served: each finding, and its sentence."""

from __future__ import annotations

import msgspec
import pytest

from robocorba.errors.maps import TooSlow
from robocorba.maps.checking import MapFinding, blocked, findings, summaries
from robocorba.maps.model import (
    Building,
    CabinSide,
    CircleShape,
    Element,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.maps.samples import SAMPLES, load_sample
from robocorba.maps.time_limit import TimeLimit
from robocorba.testing.buildings import grid, two_floors, with_all

APART = "nodes of L1 not connected with the rest of it for a robot of radius 0.40 m (1): "
OUTLINE = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0))


def node(name: str, x: float, y: float, elevator: str = "") -> tuple[str, Element]:
    return "L1", PathNode(name=name, at=(x, y), elevator=elevator)


def edge(a: str, b: str, one_way: bool = False, clearance: float = 0.0) -> tuple[str, Element]:
    return "L1", PathEdge(name=f"{a}-{b}", a=a, b=b, one_way=one_way, clearance=clearance)


def wall(name: str, *line: float) -> tuple[str, Element]:
    return "L1", Wall(name=name, a=line[:2], b=line[2:])


def one_floor(*elements: tuple[str, Element]) -> Building:
    """A hall of 20 m x 10 m with the road a-b-c along its lower side."""
    road = [node("a", 2, 2), node("b", 6, 2), node("c", 10, 2), edge("a", "b"), edge("b", "c")]
    return with_all(Building("b"), [("", Floor(name="L1", level=1, elevation=0.0, outline=OUTLINE)), *road, *elements])


def reported(building: Building, radius_m: float = 0.40) -> tuple[str, ...]:
    return summaries(findings(building, radius_m))


def closet(name: str, x: float, y: float) -> list[tuple[str, Element]]:
    """Four walls, 2 m long, around x, y."""
    corners = [(x - 1, y - 1), (x + 1, y - 1), (x + 1, y + 1), (x - 1, y + 1)]
    return [wall(f"{name}{i}", *corners[i - 1], *corners[i]) for i in range(4)]


@pytest.mark.parametrize("sample", SAMPLES)
def test_there_is_nothing_to_say_of_the_samples(sample: str) -> None:
    assert findings(load_sample(sample)) == []


def test_there_is_nothing_to_say_of_buildings_without_roads() -> None:
    assert findings(Building("empty")) == []
    assert findings(one_floor()) == []
    assert reported(grid(5, 4, floors=1, doors=2)) == ()


def test_blocked_edges_and_nodes_and_what_blocks_them() -> None:
    thing = MapObject(name="box", shape=CircleShape(radius=0.3), at=(6.0, 2.0), movable=True)
    building = one_floor(("L1", thing), wall("w", 8, 0, 8, 5))
    assert [(found.kind, found.name, found.where, found.reason) for found in blocked(building)] == [
        (ElementKind.NODE, "b", ("L1", 6.0, 2.0), "blocked: it stands inside object 'box'"),
        (
            *(ElementKind.EDGE, "a-b", ("L1", pytest.approx(5.7), 2.0)),
            "blocked: it leads through object 'box' near 5.7, 2",
        ),
        (
            *(ElementKind.EDGE, "b-c", ("L1", pytest.approx(6.3), 2.0)),
            "blocked: it leads through object 'box' near 6.3, 2; it leads through wall 'w' near 8, 2",
        ),
    ]
    assert summaries(blocked(building)) == (
        "blocked nodes of L1 (1): b (object 'box' near 6, 2)",
        "blocked edges of L1 (2): a-b (object 'box' near 5.7, 2), b-c (object 'box', wall 'w' near 6.3, 2)",
    )
    assert reported(building)[2:] == (f"{APART}c near 10, 2 (edge 'b-c' is blocked by wall 'w')",)
    assert findings(one_floor()) == []


def test_nodes_without_an_edge_and_where_the_robot_does_not_fit() -> None:
    building = one_floor(node("lone", 15, 8), node("corner", 0.3, 9))
    assert reported(building) == (
        "nodes of L1 where a robot of radius 0.40 m does not fit (1): corner (0.300 m from the outline of the floor)",
        "nodes of L1 without an edge (2): lone, corner",
    )
    assert reported(building, 0.25) == ("nodes of L1 without an edge (2): lone, corner",)
    assert findings(building)[0].reason == (
        "a robot of radius 0.40 m does not fit: 0.300 m from the outline of the floor"
    )


def test_nodes_that_are_walled_in() -> None:
    room = [*closet("w", 15, 5), node("d", 14.5, 5), node("e", 15.5, 5), edge("d", "e")]
    shut = "nodes of L1 that are walled in for a robot of radius 0.40 m (2): d, e"
    assert reported(one_floor(*room)) == (shut, "closed rooms of L1 (1): near 15, 5")
    gap = msgspec.structs.replace(room[0][1], a=(14.0, 4.8), b=(14.0, 6.0))
    assert reported(one_floor(*room, ("L1", gap))) == (f"{APART}d with 1 more near 14.5, 5 (no edge joins them)",)
    assert reported(one_floor(*room, ("L1", gap)), 0.42)[0].startswith("nodes of L1 that are walled in for a robot")


def test_a_hall_that_is_wider_than_the_view_is_not_walled_in() -> None:
    far = [(f"w{i}", *line) for i, line in enumerate([(50, 0, 50, 99), (50, 99, 199, 99), (199, 99, 199, 0)])]
    building = one_floor(*(wall(*line) for line in far), node("d", 100, 50), node("e", 101, 50), edge("d", "e"))
    floor = msgspec.structs.replace(building.floors["L1"].floor, outline=())
    assert reported(building.with_element("", floor)) == (f"{APART}d with 1 more near 100, 50 (no edge joins them)",)


def test_edges_that_are_too_narrow_for_the_robot() -> None:
    narrow = [wall("left", 8, 0, 8, 1.7), wall("right", 8, 2.3, 8, 10)]
    assert reported(one_floor(*narrow), 0.29) == ()
    (line,) = reported(one_floor(*narrow))
    assert line == "nodes of L1 that are walled in for a robot of radius 0.40 m (1): c"
    declared = one_floor(edge("b", "c", clearance=0.3))
    assert reported(declared, 0.3) == ()
    assert reported(declared) == (f"{APART}c near 10, 2 (edge 'b-c' is for robots of at most 0.3 m)",)
    kink = [wall("near", 7.8, 0, 7.8, 1.63), wall("far", 8.2, 2.37, 8.2, 10)]
    assert reported(one_floor(*kink, node("d", 10, 8), edge("c", "d"))) == (
        f"{APART}c with 1 more near 10, 2 (edge 'b-c' is 0.370 m from wall 'far')",
    )


def test_one_way_edges_that_lead_nowhere_back() -> None:
    into = [node(name, 10, 4 + i) for i, name in enumerate(("in", "further"))]
    out = [node("out", 2, 5), node("aside", 5, 8)]
    lanes = [edge("c", "in", True), edge("in", "further", True), edge("out", "a", True), edge("aside", "further", True)]
    assert reported(one_floor(*into, *out, *lanes)) == (
        "nodes of L1 that can be entered but not left (2): in, further",
        "nodes of L1 that can be left but not entered (1): out",
        "nodes of L1 that can be neither entered from the rest of the roadmap nor left for it (1): aside",
    )
    assert reported(one_floor(*into, *lanes[:2], edge("further", "b", True))) == ()


def test_an_elevator_leads_there_and_back() -> None:
    """In two_floors a one-way edge leads to the elevator of L1, and none away from it."""
    assert reported(two_floors()) == ("nodes of L1 that can be left but not entered (2): west, east",)
    both = msgspec.structs.replace(two_floors().floors["L1"].topological.edges["in"], one_way=False)
    assert reported(two_floors().with_element("L1", both)) == ()


def test_floors_and_elevators_out_of_reach() -> None:
    building = two_floors().with_element("", Floor(name="roof", level=3, elevation=8.0))
    narrow = Elevator(
        name="E2",
        at=(17.0, 2.0),
        size=(2.0, 2.0),
        doors=tuple(ElevatorDoor(floor=floor, side=CabinSide.LEFT, width=0.7) for floor in ("L1", "L2")),
    )
    building = building.with_element("", narrow)
    assert reported(building)[1:] == (
        "floors without an elevator to other floors (1): roof",
        "elevators that a robot of radius 0.40 m can't enter (1): E2 (its widest door is 0.70 m wide, 0.80 m needed)",
    )
    assert reported(building, 0.35)[2:] == (
        "elevators that a robot of radius 0.35 m can't enter (1): E2 (no path node stands in its cabin)",
    )
    cabin = PathNode(name="cabin", at=(17.0, 2.0), elevator="E2")
    building = building.with_element("L1", cabin)
    assert reported(building, 0.35)[-1].endswith("E2 (no edge into its cabin is free and wide enough)")
    entrance = PathEdge(name="x", a="east", b="cabin")
    building = building.with_element("L1", PathNode(name="east", at=(13.0, 2.0))).with_element("L1", entrance)
    assert not any("enter (" in line for line in reported(building, 0.35))


def test_a_floor_whose_road_map_no_elevator_connects() -> None:
    building = two_floors().without(ElementKind.EDGE, "L2", "lift2-top")
    far = [PathNode(name="far", at=(10.0, 5.0)), PathEdge(name="e", a="top", b="far")]
    building = with_all(building, [("L2", element) for element in far])
    found = [one for one in findings(building) if one.kind is ElementKind.FLOOR]
    assert found == [
        MapFinding(
            ElementKind.FLOOR,
            "",
            "L2",
            ("L2", 14.5, 5.0),
            "no elevator connects its roadmap with other floors for a robot of radius 0.40 m",
            "floors that no elevator connects with the others for a robot of radius 0.40 m ({n}): {names}",
            "L2",
        )
    ]


@pytest.mark.parametrize(
    ("scale", "sentence"),
    [
        (1000.0, "very large floors (1): L1 (200 km² large: is it drawn in millimetres instead of metres?)"),
        (100.0, "very large floors (1): L1 (2 km² large: is it drawn in centimetres instead of metres?)"),
        (50.0, ""),
    ],
)
def test_a_floor_that_is_larger_than_any_building(scale: float, sentence: str) -> None:
    outline = tuple((x * scale, y * scale) for x, y in OUTLINE)
    building = with_all(Building("b"), [("", Floor(name="L1", level=1, elevation=0.0, outline=outline))])
    assert reported(building) == ((sentence,) if sentence else ())


def test_a_check_ends_at_its_time_limit() -> None:
    now = iter(range(1000))
    with pytest.raises(TooSlow, match="the check takes longer than 3 s"):
        findings(load_sample("five-floors"), check_time=TimeLimit("the check", 3.0, lambda: float(next(now))).check)
    assert next(now) == 5
