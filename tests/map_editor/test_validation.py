"""Each rule, by a change that breaks it; that the check of an edit agrees with that of everything; and what an edit
changes beside its elements, so that the building stays valid."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.maps import InvalidElement
from robocorba.map_editor import changes
from robocorba.map_editor.changes import Change, ElementKey
from robocorba.map_editor.collisions import blockages
from robocorba.map_editor.consequences import Outcome, with_consequences
from robocorba.map_editor.element_json import as_json, from_json
from robocorba.map_editor.model import (
    COLLECTION_OF,
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
    PathEdge,
    PathNode,
    PolygonShape,
    SegmentShape,
    Wall,
)
from robocorba.map_editor.validation import check_change, check_element, problems
from testkit.buildings import buildings, grid, is_refused, placed, two_floors, with_all
from tests.map_editor.formats.hostile import at, changed, places

NAN, INF = math.nan, math.inf
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
BOWTIE = ((0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0))
HOSTILE = [NAN, INF, -INF, 1e308, -1e308, 1.0000001e6]


def wall(**values: Any) -> Wall:
    return Wall(**{"name": "x", "a": (1.0, 1.0), "b": (2.0, 1.0), **values})


def thing(shape: Any, **values: Any) -> MapObject:
    return MapObject(**{"name": "x", "shape": shape, "at": (2.0, 2.0), **values})


def node(x: float, y: float, name: str = "x", **values: Any) -> PathNode:
    return PathNode(name=name, at=(x, y), **values)


def edge(a: str, b: str, **values: Any) -> PathEdge:
    return PathEdge(**{"name": "x", "a": a, "b": b, **values})


def lift(*doors: ElevatorDoor, **values: Any) -> Elevator:
    return Elevator(**{"name": "x", "at": (100.0, 100.0), "size": (2.0, 1.0), "doors": doors, **values})


FRONT = ElevatorDoor(floor="L1")


def test_problems_of_a_building(building: Building) -> None:
    assert problems(building) == problems(Building("empty")) == problems(grid(5, 4, floors=2, doors=2)) == []
    many = with_all(building, [("L1", wall(name=f"w{i}", height=NAN)) for i in range(30)])
    assert (len(problems(many)), len(problems(many, limit=3))) == (30, 3)


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        (wall(name=""), "the name is empty"),
        (wall(name="x" * 201), "the name has 201 characters, at most 200"),
        (wall(name=" A"), "the name ' A' begins or ends with a blank; write 'A'"),
        (wall(name="e\u0301"), "is not in Unicode's normal form NFC"),
        (PathNode(name="n", at=(1.0, 1.0), elevator="E "), "elevator 'E ' begins or ends with a blank"),
        (wall(name="a\nb"), "unprintable character U+000A"),
        (Floor(name="L:1", level=9, elevation=9.0), "must not hold ':'"),
        (Floor(name="L/1", level=9, elevation=9.0), "must not hold '/'"),
        (Floor(name="L", level=10**5000, elevation=9.0), "level must be from"),
        (Floor(name="L", level=1, elevation=9.0, height=0.0), "height must be from 0.001"),
        (Floor(name="L", level=1, elevation=9.0, outline=SQUARE[:2]), "outline has 2 points"),
        (wall(b=(1.0, 1.0005)), "it has no length"),
        (Door(name="x", a=(1.0, 1.0), b=(1.0, 1.0)), "it has no length"),
        (thing(SegmentShape(length=0.0)), "length must be"),
        (thing(SegmentShape(length=1.0), movable=True), "no mass, so it can't be movable; make it a box or a polygon"),
        (thing(BoxShape(size=(1.0, 0.0))), "size y must be"),
        (thing(CircleShape(radius=-1.0)), "radius must be"),
        (thing(PolygonShape(points=BOWTIE)), "the polygon crosses or touches itself near 1, 1"),
        (Area(name="x", polygon=((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))), "encloses no area"),
        (Area(name="x", polygon=((0.0, 0.0),) * 10_001), "has 10001 points, at most 10000"),
        (Area(name="x", polygon=(*SQUARE[:3], (NAN, 1.0))), "point 4 x is not a finite number"),
        (Area(name="x", polygon=SQUARE, subnet="\0"), "subnet holds the unprintable"),
        (edge("a", "a"), "from a node to the same node"),
        (edge("a", "b", speed_limit=1e-300), "speed_limit must be from 0.001"),
        (edge("a", "b", clearance=-0.1), "clearance must be from 0"),
        (edge("a", "b", graphs=("",)), "the name of a graph is empty"),
        (edge("a", "b", graphs=("g",) * 101), "at most 100"),
        (lift(), "it serves no floor"),
        (lift(FRONT, speed=0.0), "speed must be"),
        (lift(FRONT, door_time=-1.0), "door_time must be from 0"),
        (lift(ElevatorDoor(floor="L1", width=2.1)), "front door on 'L1' is 2.1 m wide, the side 2 m"),
        (
            lift(ElevatorDoor(floor="L1", width=1.1, side=CabinSide.LEFT)),
            "left door on 'L1' is 1.1 m wide, the side 1 m",
        ),
        (lift(ElevatorDoor(floor="L1", width=1.0, offset=0.6)), "reaches beyond the side"),
        (
            lift(ElevatorDoor(floor="L1", width=0.8), ElevatorDoor(floor="L1", width=0.8, offset=0.5)),
            "doors on 'L1' ov",
        ),
        (lift(*[FRONT] * 1001), "has 1001 doors"),
    ],
)
def test_an_element_by_itself(element: Element, reason: str) -> None:
    with pytest.raises(InvalidElement) as wrong:
        check_element("L1", element)
    assert reason in str(wrong.value)
    assert wrong.value.name == element.name
    assert len(str(wrong.value)) < 500


HALVES = [ElevatorDoor(floor="L1", width=1.0, offset=offset) for offset in (-0.5, 0.5)]
SOUND = [
    Floor(name="x", level=1, elevation=0.0, outline=SQUARE),
    *(wall(), Door(name="x", a=(0.0, 0.0), b=(0.0, 1.0)), Area(name="x", polygon=SQUARE), node(1.0, 0.0)),
    *(thing(SegmentShape(length=1.0)), thing(BoxShape(size=(1.0, 1.0)))),
    *(thing(CircleShape(radius=1.0)), thing(PolygonShape(points=SQUARE))),
    *(
        edge("a", "b"),
        lift(*HALVES, ElevatorDoor(floor="L1", side=CabinSide.BACK)),
        lift(ElevatorDoor("L1", width=2.0)),
    ),
]


@pytest.mark.parametrize("value", HOSTILE)
@pytest.mark.parametrize("sound", SOUND)
def test_hostile_numbers(sound: Element, value: float) -> None:
    """In the place of each number of an element."""
    check_element("L1", sound)
    kind, members = changes.key_of("L1", sound).kind, as_json(sound)
    numbers = [place for place in places(members) if isinstance(at(members, place), float)]
    assert numbers
    for place in numbers:
        element = from_json(kind, "L1", changed(members, place, value))
        with pytest.raises(InvalidElement):
            check_element("L1", element)
        assert problems(two_floors().with_element("L1", element))


@pytest.mark.parametrize(
    ("floor", "edit", "blamed", "reason"),
    [
        ("L1", (ElementKind.NODE, "west"), "west-east", "node 'west' does not exist"),
        ("", (ElementKind.ELEVATOR, "E1"), "lift1", "elevator 'E1', which does not exist"),
        ("", (ElementKind.FLOOR, "L2"), "E1", "serves floor 'L2', which does not exist"),
        ("L1", node(5.0, 8.0), "x", "stands inside object 'table'"),
        ("L1", node(10.0009, 2.0), "x", "stands on wall 'w'"),
        ("L1", node(20.5, 5.0), "x", "outside the outline"),
        ("L1", node(18.0, 4.0), "x", "stands on the shaft of elevator 'E1'"),
        ("L1", node(18.0, 5.0, elevator="E9"), "x", "elevator 'E9', which does not exist"),
        ("L1", node(2.0, 5.0, elevator="E1"), "x", "stands outside its shaft"),
        ("L1", node(15.0, 1.0, name="east"), "west-east", "leads through wall 'w' near 10,"),
        ("L1", node(15.0, 5.0, name="west"), "west-east", "its nodes stand at the same place"),
        ("L1", edge("west", "nowhere"), "x", "node 'nowhere' does not exist"),
        ("L1", edge("west", "corner"), "x", "leads through object 'table' near"),
        ("", lift(FRONT, name="E1", at=(18.0, 5.0), size=(2.0, 2.0)), "in", "through the shaft of elevator 'E1'"),
        ("", lift(FRONT, at=(18.5, 6.4)), "x", "its shaft overlaps that of elevator 'E1'"),
        ("", lift(ElevatorDoor(floor="L9")), "x", "it serves floor 'L9', which does not exist"),
        ("", lift(FRONT, at=(7.0, 5.0)), "west-east", "through the shaft of elevator 'x'"),
        ("", Floor(name="L3", level=2, elevation=9.0), "L3", "level 2 is that of floor 'L2'"),
        ("", Floor(name="L3", level=3, elevation=4.0), "L3", "elevation 4 m at level 3 does not fit floor 'L2': 4 m"),
        ("", Floor(name="L0", level=0, elevation=0.0), "L0", "elevation 0 m at level 0 does not fit floor 'L1': 0 m"),
        ("", Floor("L1", 1, 0.0, outline=tuple((9 * x, 9 * y) for x, y in SQUARE)), "east", "outside"),
    ],
)
def test_elements_together(building: Building, floor: str, edit: Any, blamed: str, reason: str) -> None:
    building = building.with_element("L1", node(5.0, 9.0, name="corner"))
    if isinstance(edit, tuple):
        key = ElementKey(edit[0], floor, edit[1])
        after = building.without(*key)
    else:
        key = changes.key_of(floor, edit)
        after = building.with_element(floor, edit)
    with pytest.raises(InvalidElement) as wrong:
        check_change(after, [key], building)
    assert (wrong.value.name, reason in wrong.value.reason) == (blamed, True), wrong.value
    assert_found(wrong.value, after)


def assert_found(wrong: InvalidElement, building: Building) -> None:
    """The full check finds the same; where two floors or shafts clash it may name the other one."""
    found = problems(building, limit=10_000) + [
        collision.error() for floor in building.floors for collision in blockages(building, floor)
    ]
    if "level" in wrong.reason or "overlaps" in wrong.reason:
        assert any(word in other.reason for other in found for word in ("level", "overlaps"))
    else:
        assert str(wrong) in map(str, found)


@pytest.mark.parametrize(
    ("element", "blocked", "reason"),
    [
        (wall(a=(7.0, 4.0), b=(7.0, 6.0)), "west-east", "leads through wall 'x' near 7, 5"),
        (wall(a=(15.0, 5.0), b=(15.0, 6.0)), "east", "stands on wall 'x'"),
        (thing(CircleShape(radius=0.5), at=(7.0, 5.0)), "west-east", "leads through object 'x' near 6.5, 5"),
        (thing(CircleShape(radius=0.5), at=(5.0, 5.0), movable=True), "west", "stands inside object 'x'"),
        (thing(SegmentShape(length=1.0), at=(7.0, 5.0), heading=1.0), "west-east", "leads through object 'x'"),
        (Door(name="d", a=(10.0, 6.0), b=(10.0, 8.0)), "west-east", "leads through wall 'w' near 10, 5"),
        (Door(name="d", a=(10.0, 4.0), b=(10.0, 6.0), locked=True), "west-east", "through locked door 'd' near 10, 5"),
        (Door(name="x", a=(7.0, 4.0), b=(7.0, 6.0), locked=True), "west-east", "through locked door 'x' near 7, 5"),
    ],
)
def test_what_is_put_on_a_path_blocks_it(building: Building, element: Element, blocked: str, reason: str) -> None:
    key = changes.key_of("L1", element)
    after = building.with_element("L1", element)
    found = {item.element.name: item.reason for item in check_change(after, [key], building)}
    assert reason in found[blocked]
    assert problems(after) == []
    assert {item.element.name: item.reason for item in blockages(after, "L1")} == found
    assert check_change(after, [key], after) == []  # what was blocked before is no news
    assert check_change(building, [key], after) == []


@settings(deadline=None, max_examples=30)
@given(buildings(), st.lists(st.tuples(placed, st.booleans()), min_size=1, max_size=4))
def test_the_check_of_an_edit_agrees_with_the_check_of_everything(
    before: Building, edits: list[tuple[tuple[str, Element], bool]]
) -> None:
    after = before
    touched: set[changes.ElementKey] = set()
    for (floor, element), remove in edits:
        key = changes.key_of(floor, element)
        if key.kind in COLLECTION_OF and floor not in after.floors:
            continue
        if not remove:
            after = after.with_element(floor, element)
            touched.add(key)
        elif after.find(*key) is not None:
            if key.kind is ElementKind.FLOOR:
                touched |= {other for other, _ in changes.elements_of(after) if other.floor == key.name}
            after = after.without(*key)
            touched.add(key)
    if not is_refused(before, after):
        assert {(found.floor, *found.pair) for found in check_change(after, touched, before)} == blocked(
            after
        ) - blocked(before)
        return
    with pytest.raises(InvalidElement) as raised:
        check_change(after, touched, before)
    assert_found(raised.value, after)


def blocked(building: Building) -> set[tuple[Any, ...]]:
    return {(floor, *found.pair) for floor in building.floors for found in blockages(building, floor)}


@settings(deadline=None, max_examples=30)
@given(buildings(), buildings())
def test_the_difference_of_two_buildings_leads_from_one_to_the_other(before: Building, after: Building) -> None:
    difference = changes.difference(before, after)
    steps = changes.ordered(Change(2, key, before.find(*key), element) for key, element in difference.items())
    assert changes.apply(before, steps) == after
    assert changes.apply(after, changes.inverse(steps, 3)) == before
    one_by_one = before
    for step in steps:
        one_by_one = changes.apply(one_by_one, [step])
    assert one_by_one == after
    if not is_refused(before, after):
        check_change(after, difference, before)


LIFT = ElementKey(ElementKind.ELEVATOR, "", "E1")


def node_key(floor: str, name: str) -> ElementKey:
    return ElementKey(ElementKind.NODE, floor, name)


def edge_key(floor: str, name: str) -> ElementKey:
    return ElementKey(ElementKind.EDGE, floor, name)


def test_a_node_in_a_cabin_is_not_removed_by_itself() -> None:
    with pytest.raises(InvalidElement, match="elevator 'E1' stops at it"):
        with_consequences(two_floors(), {node_key("L1", "lift1"): None})


E1 = two_floors().elevators["E1"]
E2 = Elevator("E2", (3.0, 3.0), (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")))
LIFT1 = two_floors().floors["L1"].topological.nodes["lift1"]
LED = PathEdge(name="in", a="west", b="lift1", one_way=True)


@pytest.mark.parametrize(
    ("wanted", "consequences"),
    [
        pytest.param(
            {node_key("L1", "east"): None, edge_key("L1", "in"): LED},
            {edge_key("L1", "west-east"): None},
            id="an edge that is led to another node stays",
        ),
        pytest.param(
            {ElementKey(ElementKind.ELEVATOR, "", "E2"): E2},
            {
                node_key("L1", "cabin-E2-2"): PathNode("cabin-E2-2", (3.0, 3.0), "E2"),
                node_key("L2", "cabin-E2"): PathNode("cabin-E2", (3.0, 3.0), "E2"),
            },
            id="a new elevator gets a node on each floor",
        ),
        pytest.param(
            {
                ElementKey(ElementKind.ELEVATOR, "", "E2"): msgspec.structs.replace(E2, doors=E2.doors[1:]),
                node_key("L2", "mine"): PathNode("mine", (3.2, 3.0), "E2"),
            },
            {},
            id="a node that comes with its elevator is not made twice",
        ),
        pytest.param(
            {LIFT: msgspec.structs.replace(E1, doors=E1.doors[:1])},
            {node_key("L2", "lift2"): None, edge_key("L2", "lift2-top"): None, node_key("L1", "lift1"): LIFT1},
            id="a floor that it serves no more loses its node",
        ),
        pytest.param(
            {LIFT: None},
            dict.fromkeys(
                [node_key("L1", "lift1"), node_key("L2", "lift2"), edge_key("L1", "in"), edge_key("L2", "lift2-top")]
            ),
            id="nodes in the cabin and their edges go with an elevator",
        ),
        pytest.param(
            {ElementKey(ElementKind.FLOOR, "", "L2"): None},
            {
                ElementKey(ElementKind.ELEVATOR, "", "E3"): None,
                LIFT: msgspec.structs.replace(E1, doors=E1.doors[:1]),
                node_key("L1", "lift1"): LIFT1,
            },
            id="elevators serve a floor no more that is removed, and go with their last one",
        ),
    ],
)
def test_what_follows_from_a_change(wanted: Outcome, consequences: Outcome) -> None:
    only_upstairs = Elevator("E3", (8.0, 8.0), (2.0, 2.0), (ElevatorDoor("L2"),))
    building = with_all(two_floors(), [("L1", PathNode("cabin-E2", (1.0, 1.0))), ("", only_upstairs)])
    outcome = with_consequences(building, wanted)
    assert outcome == {**wanted, **consequences}
    assert problems(building.with_changes((*key, element) for key, element in outcome.items())) == []


def test_the_nodes_in_a_cabin_follow_their_elevator() -> None:
    building = two_floors()
    aside = building.with_element("L2", PathNode("lift2", (18.5, 5.0), "E1"))
    lift = msgspec.structs.replace(building.elevators["E1"], at=(16.0, 3.0), heading=math.pi)
    outcome = with_consequences(aside, {LIFT: lift})
    moved = outcome[node_key("L1", "lift1")], outcome[node_key("L2", "lift2")]
    assert [each.at for each in moved if isinstance(each, PathNode)] == [(16.0, 3.0), pytest.approx((16.0, 3.5))]
    without = aside.without(ElementKind.EDGE, "L1", "in").without(ElementKind.NODE, "L1", "lift1")
    assert node_key("L1", "cabin-E1") not in with_consequences(without, {LIFT: lift})
