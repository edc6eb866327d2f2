"""What robots can't do in a building that can be served, and what is wrong with its plan: each finding, its words."""

from __future__ import annotations

import msgspec
import pytest

from robocorba.errors.maps import TooSlow, UnknownElement
from robocorba.map_editor.checking import blocked, findings, floor_findings, summaries
from robocorba.map_editor.edits import Finding
from robocorba.map_editor.geometry import DOOR_REACH_M
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    Element,
    ElementKind,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    Wall,
)
from robocorba.map_editor.plan_defects import DEPTH_M, plan_defects
from robocorba.map_editor.samples import SAMPLES, load_sample
from robocorba.map_editor.time_limit import time_limit
from testkit.buildings import grid, two_floors, with_all
from tests.planning.scenes import edge, node, room, wall

APART = "nodes of L1 not connected with the rest of it for a robot of radius 0.40 m (1): "
OUTLINE = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0))


def floor(*elements: Element, is_bounded: bool = True) -> Building:
    """A floor of 20 m x 10 m with the elements."""
    building = room(20.0, 10.0, *elements)
    return building if is_bounded else building.with_element("", Floor("L1", 0, 0.0))


def one_floor(*elements: Element) -> Building:
    """The same with the road a-b-c along its lower side."""
    return floor(node("a", 2, 2), node("b", 6, 2), node("c", 10, 2), edge("a", "b"), edge("b", "c"), *elements)


def reported(building: Building, radius_m: float = 0.40) -> tuple[str, ...]:
    return summaries(findings(building, radius_m))


@pytest.mark.parametrize("building", [*map(load_sample, SAMPLES), Building("empty"), grid(5, 4, floors=1, doors=2)])
def test_there_is_nothing_to_say_of_buildings_in_order(building: Building) -> None:
    assert findings(building) == []


def test_blocked_edges_and_nodes_and_what_blocks_them() -> None:
    thing = MapObject(name="box", shape=CircleShape(radius=0.3), at=(6.0, 2.0), movable=True)
    building = one_floor(thing, wall("w", 8, 0, 8, 5))
    assert [(found.kind, found.name, found.reason) for found in blocked(building)] == [
        (ElementKind.NODE, "b", "blocked: it stands inside object 'box'"),
        (ElementKind.EDGE, "a-b", "blocked: it leads through object 'box' near 5.7, 2"),
        (
            *(ElementKind.EDGE, "b-c"),
            "blocked: it leads through object 'box' near 6.3, 2; it leads through wall 'w' near 8, 2",
        ),
    ]
    assert summaries(blocked(building)) == (
        "blocked nodes of L1 (1): b (object 'box' near 6, 2)",
        "blocked edges of L1 (2): a-b (object 'box' near 5.7, 2), b-c (object 'box', wall 'w' near 6.3, 2)",
    )
    assert reported(building)[2:] == (f"{APART}c near 10, 2 (edge 'b-c' is blocked by wall 'w')",)


def test_nodes_without_an_edge_and_where_the_robot_does_not_fit() -> None:
    building = one_floor(node("lone", 15, 8), node("corner", 0.3, 9))
    assert reported(building) == (
        "nodes of L1 where a robot of radius 0.40 m does not fit (1): corner (0.300 m from the outline of the floor)",
        "nodes of L1 without an edge (2): lone, corner",
    )
    assert reported(building, 0.25) == ("nodes of L1 without an edge (2): lone, corner",)


def test_nodes_that_are_walled_in() -> None:
    shut_in = [*ROOM, node("d", 14.5, 7), node("e", 15.5, 7), edge("d", "e")]
    shut = "nodes of L1 that are walled in for a robot of radius 0.40 m (2): d, e"
    assert reported(one_floor(*shut_in)) == (shut, "closed rooms of L1 (1): near 15, 7")
    gap = msgspec.structs.replace(shut_in[0], a=(13.8, 5.5))
    assert reported(one_floor(*shut_in, gap)) == (f"{APART}d with 1 more near 14.5, 7 (no edge joins them)",)
    assert reported(one_floor(*shut_in, gap), 0.42)[0].startswith("nodes of L1 that are walled in for a robot")


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
    lanes = [edge(*ends, one_way=True) for ends in (("c", "in"), ("in", "further"), ("out", "a"), ("aside", "further"))]
    assert reported(one_floor(*into, *out, *lanes)) == (
        "nodes of L1 that can be entered but not left (2): in, further",
        "nodes of L1 that can be left but not entered (1): out",
        "nodes of L1 that can be neither entered from the rest of the roadmap nor left for it (1): aside",
    )
    assert reported(one_floor(*into, *lanes[:2], edge("further", "b", one_way=True))) == ()


def test_floors_and_elevators_out_of_reach() -> None:
    # A one-way edge leads to the elevator of L1, and none away from it.
    assert reported(two_floors()) == ("nodes of L1 that can be left but not entered (2): west, east",)
    both = msgspec.structs.replace(two_floors().floors["L1"].topological.edges["in"], one_way=False)
    assert reported(two_floors().with_element("L1", both)) == ()
    building = two_floors().with_element("", Floor(name="roof", level=3, elevation=8.0))
    doors = tuple(ElevatorDoor(floor=floor, side=CabinSide.LEFT, width=0.7) for floor in ("L1", "L2"))
    building = building.with_element("", Elevator(name="E2", at=(17.0, 2.0), size=(2.0, 2.0), doors=doors))
    assert reported(building)[1:] == (
        "floors without an elevator to other floors (1): roof",
        "elevators that a robot of radius 0.40 m can't enter (1): E2 (its widest door is 0.70 m wide, 0.80 m needed)",
    )
    assert reported(building, 0.35)[2:] == (
        "elevators that a robot of radius 0.35 m can't enter (1): E2 (no path node stands in its cabin)",
    )
    building = building.with_element("L1", node("cabin", 17.0, 2.0, "E2"))
    assert reported(building, 0.35)[-1].endswith("E2 (no edge into its cabin is free and wide enough)")
    building = with_all(building, [("L1", node("east", 13.0, 2.0)), ("L1", edge("east", "cabin"))])
    assert not any("enter (" in line for line in reported(building, 0.35))


def test_a_floor_whose_road_map_no_elevator_connects() -> None:
    building = two_floors().without(ElementKind.EDGE, "L2", "lift2-top")
    building = with_all(building, [("L2", node("far", 10.0, 5.0)), ("L2", edge("top", "far"))])
    (found,) = (one for one in findings(building) if one.kind is ElementKind.FLOOR)
    assert (found.floor, found.name, found.where) == ("", "L2", ("L2", 14.5, 5.0))
    assert found.reason == "no elevator connects its roadmap with other floors for a robot of radius 0.40 m"
    (sentence,) = summaries([found])
    assert sentence == "floors that no elevator connects with the others for a robot of radius 0.40 m (1): L2"


@pytest.mark.parametrize(
    ("scale", "sentence"),
    [
        (1000.0, "very large floors (1): L1 (200 km² large: is it drawn in millimetres instead of metres?)"),
        (100.0, "very large floors (1): L1 (2 km² large: is it drawn in centimetres instead of metres?)"),
        (50.0, ""),
    ],
)
def test_a_floor_that_is_larger_than_any_building(scale: float, sentence: str) -> None:
    assert reported(room(20.0 * scale, 10.0 * scale)) == ((sentence,) if sentence else ())


def test_a_check_ends_at_its_time_limit() -> None:
    now = iter(range(1000))
    with pytest.raises(TooSlow, match="the check takes longer than 3 s"):
        findings(load_sample("five-floors"), check_time=time_limit("the check", 3.0, lambda: float(next(now))))
    assert next(now) == 5


#: Four walls around (15, 7), 4 m x 3 m.
ROOM = [
    *(wall("south", 13.0, 5.5, 17.0, 5.5), wall("east", 17.0, 5.5, 17.0, 8.5)),
    *(wall("north", 17.0, 8.5, 13.0, 8.5), wall("west", 13.0, 8.5, 13.0, 5.5)),
]
ROAD = [node("a", 2, 2), node("b", 6, 2), edge("a", "b")]


def defects(building: Building) -> list[tuple[ElementKind, str, str]]:
    return [(found.kind, found.name, found.reason) for found in plan_defects(building, "L1")]


@pytest.mark.parametrize("movable", [True, False])
def test_a_wall_through_an_object_is_found_where_it_goes_through(movable: bool) -> None:
    table = MapObject("table", BoxShape((2.0, 1.0)), (5.0, 5.0), movable=movable)
    (found,) = plan_defects(floor(table, Wall("w", (0.0, 5.2), (9.0, 5.2))), "L1")
    assert (found.kind, found.name, found.reason) == (ElementKind.WALL, "w", "it goes through object 'table'")
    assert found.where == ("L1", pytest.approx(5.0), pytest.approx(5.2))


@pytest.mark.parametrize(
    ("walls", "is_found"),
    [
        ([], True),
        ([wall("beside", 5.0, 5.0 + DOOR_REACH_M + 0.01, 8.0, 5.0 + DOOR_REACH_M + 0.01)], True),
        ([wall("across", 6.5, 4.0, 6.5, 6.0)], True),
        ([wall("on one side", 6.0, 5.0, 6.0, 8.0)], True),
        ([wall("along", 5.0, 5.1, 8.0, 5.1)], False),
        ([wall("left", 3.0, 5.0, 6.0, 5.0), wall("right", 7.0, 5.0, 9.0, 5.0)], False),
        ([wall("left", 6.0, 0.0, 6.0, 8.0), wall("right", 7.0, 0.0, 7.0, 8.0)], False),
    ],
)
@pytest.mark.parametrize("locked", [True, False])
def test_a_door_beside_all_walls_is_found(walls: list[Wall], is_found: bool, locked: bool) -> None:
    found = plan_defects(floor(*walls, Door("d", (6.0, 5.0), (7.0, 5.0), locked=locked)), "L1")
    expected = (ElementKind.DOOR, "d", ("L1", 6.5, 5.0), "it lies neither on a wall nor between two walls")
    assert [(each.kind, each.name, each.where, each.reason) for each in found] == [expected] * is_found


def test_a_room_without_a_door_is_found_and_named_by_its_area() -> None:
    (found,) = plan_defects(floor(*ROOM, *ROAD), "L1")
    assert (found.kind, found.name, found.reason) == (ElementKind.FLOOR, "L1", "the room of 12 m² here has no door")
    assert 13.0 < found.where[1] < 17.0 and 5.5 < found.where[2] < 8.5
    store = Area("store", ((13.0, 5.5), (17.0, 5.5), (17.0, 8.5), (13.0, 8.5)))
    whole = Area("whole", OUTLINE)
    assert defects(floor(*ROOM, *ROAD, whole, store)) == [(ElementKind.AREA, "store", "it has no door")]
    assert defects(floor(*ROOM)) == defects(floor(*ROOM, *ROAD)), "also without a roadmap"
    assert defects(floor(*ROOM, *ROAD, is_bounded=False)) == defects(floor(*ROOM, *ROAD))
    ((_, _, reason),) = defects(floor(*ROOM, *ROAD, Door("d", (14.0, 5.5), (14.5, 5.5))))
    assert reason.endswith("can't leave the room of 12 m² here through its doors: d of 0.50 m")
    gap = msgspec.structs.replace(ROOM[0], a=(13.5, 5.5))
    for radius_m, count in ((0.4, 1), (0.2, 0)):
        assert len(list(plan_defects(floor(gap, *ROOM[1:], *ROAD), "L1", radius_m))) == count


LIFT = Elevator("E", (15.0, 7.5), (1.8, 1.8), (ElevatorDoor("L1"), ElevatorDoor("L2")))
DOOR, LOCKED = (Door("d", (14.0, 5.5), (15.0, 5.5), locked=locked) for locked in (False, True))
INSIDE = [node("a", 14, 7), node("b", 16, 7), edge("a", "b")]


@pytest.mark.parametrize(
    "building",
    [
        floor(*ROOM, *ROAD, DOOR),
        floor(*ROOM, *ROAD, LOCKED),
        floor(*ROOM, *ROAD, DOOR, MapObject("cart in the doorway", BoxShape((0.8, 0.6)), (14.5, 5.5), movable=True)),
        floor(*ROOM, *INSIDE, is_bounded=False),
        floor(*ROOM, is_bounded=False),  # the walls of a building that is being drawn
        with_all(floor(*ROOM, *ROAD), [("", Floor("L2", 2, 4.0)), ("", LIFT)]),
        # a niche between furniture
        floor(
            *ROAD,
            MapObject("shelf", BoxShape((0.5, 3.0)), (1.2, 8.5)),
            MapObject("cupboard", BoxShape((2.0, 0.5)), (0.9, 7.0)),
        ),
        # an object at a wall, and one in a doorway
        floor(
            *(wall("w", 0.0, 5.0, 20.0, 5.0), Door("d", (7.0, 5.0), (9.0, 5.0))),
            MapObject("shelf", BoxShape((2.0, 1.0)), (5.0, 5.5 + DEPTH_M / 2)),
            MapObject("cart", CircleShape(0.4), (8.0, 5.0), movable=True),
        ),
    ],
)
def test_what_is_in_order(building: Building) -> None:
    assert defects(building) == []


def test_defects_are_findings_of_their_floor() -> None:
    table = MapObject("table", BoxShape((2.0, 1.0)), (5.0, 5.0))
    building = floor(*ROOM, *ROAD, table, Wall("w", (0.0, 5.2), (9.0, 5.2)), Door("d", (1.0, 8.0), (2.0, 8.0)))
    building = building.with_element("", Floor("L2", 2, 4.0))
    last = floor_findings(building, "L1", 0.4)[-3:]
    assert [(each.floor, each.name, each.where[0]) for each in last] == [
        *(("L1", "w", "L1"), ("L1", "d", "L1"), ("", "L1", "L1"))
    ]
    assert summaries(last) == summaries(findings(building)[-3:])
    assert summaries(last) == (
        "walls of L1 that go through objects (1): w near 5, 5.2",
        "doors of L1 on no wall (1): d near 1.5, 8",
        "closed rooms of L1 (1): near 15, 7",
    )
    assert all(found.kind is ElementKind.FLOOR for found in floor_findings(building, "L2", 0.4))
    with pytest.raises(UnknownElement):
        floor_findings(building, "L9", 0.4)


def test_movable_objects_that_no_robots_can_carry() -> None:
    """By the mass that the map gives; one that it does not give is only assumed."""

    def found(mass: float, movable: bool = True) -> list[Finding]:
        table = MapObject("T", BoxShape((4.0, 1.0)), (5.0, 5.0), 0.0, 1.0, movable, mass)
        return list(plan_defects(floor(table), "L1"))

    assert found(24.0) == found(0.0) == found(24.5, movable=False) == []
    heavy = found(24.5)
    assert heavy[0].reason == "its 24.5 kg need 7 robots of 4 kg; at most 6 carry it"
    assert summaries(heavy) == ("movable objects of L1 that are too heavy for 6 robots (1): T near 5, 5",)
