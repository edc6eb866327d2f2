"""What an edit changes beside its elements: the building stays valid."""

from __future__ import annotations

import math

import msgspec
import pytest

from robocorba.errors.maps import InvalidElement
from robocorba.maps.changes import ElementKey
from robocorba.maps.consequences import Outcome, with_consequences
from robocorba.maps.model import Building, ElementKind, Elevator, ElevatorDoor, Floor, PathNode
from robocorba.maps.validation import problems
from robocorba.testing.buildings import two_floors

LIFT = ElementKey(ElementKind.ELEVATOR, "", "E1")


def node(floor: str, name: str) -> ElementKey:
    return ElementKey(ElementKind.NODE, floor, name)


def edge(floor: str, name: str) -> ElementKey:
    return ElementKey(ElementKind.EDGE, floor, name)


def after(building: Building, outcome: Outcome) -> Building:
    return building.with_changes(
        (*key, element) for key, element in outcome.items() if element is not None or building.find(*key) is not None
    )


def test_the_edges_of_a_removed_node_go_with_it() -> None:
    outcome = with_consequences(two_floors(), {node("L1", "east"): None})
    assert outcome == {node("L1", "east"): None, edge("L1", "west-east"): None, edge("L1", "in"): None}


def test_an_edge_that_is_led_to_another_node_stays() -> None:
    building = two_floors()
    led = msgspec.structs.replace(building.floors["L1"].topological.edges["in"], a="west")
    outcome = with_consequences(building, {node("L1", "east"): None, edge("L1", "in"): led})
    assert outcome[edge("L1", "in")] == led


def test_a_node_in_a_cabin_is_not_removed_by_itself() -> None:
    with pytest.raises(InvalidElement, match="elevator 'E1' stops at it"):
        with_consequences(two_floors(), {node("L1", "lift1"): None})


def test_a_removed_elevator_takes_its_nodes_and_their_edges_along() -> None:
    building = two_floors()
    outcome = with_consequences(building, {LIFT: None})
    gone = {LIFT, node("L1", "lift1"), node("L2", "lift2"), edge("L1", "in"), edge("L2", "lift2-top")}
    assert outcome == dict.fromkeys(gone)
    assert problems(after(building, outcome)) == []


def test_the_nodes_in_a_cabin_follow_their_elevator() -> None:
    building = two_floors()
    aside = building.with_element("L2", PathNode("lift2", (18.5, 5.0), "E1"))
    lift = msgspec.structs.replace(building.elevators["E1"], at=(16.0, 3.0), heading=math.pi)
    outcome = with_consequences(aside, {LIFT: lift})
    moved = outcome[node("L1", "lift1")], outcome[node("L2", "lift2")]
    assert [each.at for each in moved if isinstance(each, PathNode)] == [(16.0, 3.0), pytest.approx((16.0, 3.5))]


def test_a_new_elevator_gets_a_node_on_each_floor() -> None:
    building = two_floors().with_element("L1", PathNode("cabin-E2", (1.0, 1.0)))
    lift = Elevator("E2", (3.0, 3.0), (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")))
    outcome = with_consequences(building, {ElementKey(ElementKind.ELEVATOR, "", "E2"): lift})
    assert outcome[node("L1", "cabin-E2-2")] == PathNode("cabin-E2-2", (3.0, 3.0), "E2")
    assert outcome[node("L2", "cabin-E2")] == PathNode("cabin-E2", (3.0, 3.0), "E2")
    assert problems(after(building, outcome)) == []


def test_a_node_that_comes_with_its_elevator_is_not_made_twice() -> None:
    lift = Elevator("E2", (3.0, 3.0), (2.0, 2.0), (ElevatorDoor("L2"),))
    own = PathNode("mine", (3.2, 3.0), "E2")
    wanted: Outcome = {ElementKey(ElementKind.ELEVATOR, "", "E2"): lift, node("L2", "mine"): own}
    assert with_consequences(two_floors(), wanted) == wanted


def test_a_floor_that_an_elevator_serves_no_more_loses_its_node() -> None:
    building = two_floors()
    lift = msgspec.structs.replace(building.elevators["E1"], doors=building.elevators["E1"].doors[:1])
    outcome = with_consequences(building, {LIFT: lift})
    assert outcome[node("L2", "lift2")] is None
    assert problems(after(building, outcome)) == []


def test_a_removed_floor_takes_the_doors_of_elevators_along() -> None:
    building = two_floors().with_element("", Floor("L3", 3, 8.0))
    building = building.with_element("", Elevator("E3", (3.0, 3.0), (2.0, 2.0), (ElevatorDoor("L2"),)))
    outcome = with_consequences(building, {ElementKey(ElementKind.FLOOR, "", "L2"): None})
    lift = outcome[LIFT]
    assert isinstance(lift, Elevator)
    assert lift.floors() == ("L1",)
    assert outcome[ElementKey(ElementKind.ELEVATOR, "", "E3")] is None
    assert not [key for key in outcome if key.floor == "L2"]
    assert problems(after(building, outcome)) == []


def test_two_floors_of_an_elevator_are_removed_together() -> None:
    building = two_floors().with_element("", Floor("L3", 3, 8.0))
    lift = building.elevators["E1"]
    building = building.with_element("", msgspec.structs.replace(lift, doors=(*lift.doors, ElevatorDoor("L3"))))
    outcome = with_consequences(building, {ElementKey(ElementKind.FLOOR, "", name): None for name in ("L2", "L3")})
    changed = outcome[LIFT]
    assert isinstance(changed, Elevator)
    assert changed.floors() == ("L1",)
    outcome = with_consequences(building, {ElementKey(ElementKind.FLOOR, "", name): None for name in building.floors})
    assert outcome[LIFT] is None
    assert not [key for key in outcome if key.floor]
