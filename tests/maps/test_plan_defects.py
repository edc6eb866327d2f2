"""Walls through objects, doors beside all walls and rooms without a door are found, and nothing else."""

from __future__ import annotations

import msgspec
import pytest

from robocorba.errors.maps import UnknownElement
from robocorba.maps.checking import findings, floor_findings, summaries
from robocorba.maps.geometry import DOOR_REACH_M
from robocorba.maps.model import (
    Area,
    BoxShape,
    Building,
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
    Wall,
)
from robocorba.maps.plan_defects import DEPTH_M, plan_defects
from robocorba.testing.buildings import with_all

OUTLINE = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0))
#: Four walls around (15, 7), 4 m x 3 m.
ROOM = [
    Wall("south", (13.0, 5.5), (17.0, 5.5)),
    Wall("east", (17.0, 5.5), (17.0, 8.5)),
    Wall("north", (17.0, 8.5), (13.0, 8.5)),
    Wall("west", (13.0, 8.5), (13.0, 5.5)),
]
ROAD = [PathNode("a", (2.0, 2.0)), PathNode("b", (6.0, 2.0)), PathEdge(name="a-b", a="a", b="b")]


def floor(*elements: Element, is_bounded: bool = True) -> Building:
    """A floor of 20 m x 10 m with the elements."""
    storey = Floor("L1", 1, 0.0, outline=OUTLINE if is_bounded else ())
    return with_all(Building("b"), [("", storey), *(("L1", element) for element in elements)])


def defects(building: Building) -> list[tuple[ElementKind, str, str]]:
    return [(found.kind, found.name, found.reason) for found in plan_defects(building, "L1")]


# ---- walls through objects ----


@pytest.mark.parametrize("movable", [True, False])
def test_a_wall_through_an_object_is_found_where_it_goes_through(movable: bool) -> None:
    table = MapObject("table", BoxShape((2.0, 1.0)), (5.0, 5.0), movable=movable)
    (found,) = plan_defects(floor(table, Wall("w", (0.0, 5.2), (9.0, 5.2))), "L1")
    assert (found.kind, found.name, found.reason) == (ElementKind.WALL, "w", "it goes through object 'table'")
    assert found.at == pytest.approx((5.0, 5.2))


def test_an_object_at_a_wall_or_in_a_doorway_is_in_order() -> None:
    sunk = MapObject("shelf", BoxShape((2.0, 1.0)), (5.0, 5.5 + DEPTH_M / 2))
    standing = MapObject("cart", CircleShape(0.4), (8.0, 5.0), movable=True)
    wall, door = Wall("w", (0.0, 5.0), (20.0, 5.0)), Door("d", (7.0, 5.0), (9.0, 5.0))
    assert defects(floor(wall, door, sunk, standing)) == []


# ---- doors ----


@pytest.mark.parametrize(
    "walls",
    [
        [],
        [Wall("beside", (5.0, 5.0 + DOOR_REACH_M + 0.01), (8.0, 5.0 + DOOR_REACH_M + 0.01))],
        [Wall("across", (6.5, 4.0), (6.5, 6.0))],
        [Wall("on one side", (6.0, 5.0), (6.0, 8.0))],
    ],
)
def test_a_door_beside_all_walls_is_found(walls: list[Wall]) -> None:
    (found,) = plan_defects(floor(*walls, Door("d", (6.0, 5.0), (7.0, 5.0))), "L1")
    assert (found.kind, found.name, found.at) == (ElementKind.DOOR, "d", (6.5, 5.0))
    assert found.reason == "it lies neither on a wall nor between two walls"


@pytest.mark.parametrize(
    "walls",
    [
        [Wall("along", (5.0, 5.1), (8.0, 5.1))],
        [Wall("left", (3.0, 5.0), (6.0, 5.0)), Wall("right", (7.0, 5.0), (9.0, 5.0))],
        [Wall("left", (6.0, 0.0), (6.0, 8.0)), Wall("right", (7.0, 0.0), (7.0, 8.0))],
    ],
)
@pytest.mark.parametrize("locked", [True, False])
def test_a_door_on_a_wall_or_between_two_is_in_order(walls: list[Wall], locked: bool) -> None:
    assert defects(floor(*walls, Door("d", (6.0, 5.0), (7.0, 5.0), locked=locked))) == []


# ---- rooms ----


def test_a_room_without_a_door_is_found_and_named_by_its_area() -> None:
    (found,) = plan_defects(floor(*ROOM, *ROAD), "L1")
    assert (found.kind, found.name, found.reason) == (ElementKind.FLOOR, "", "the room of 12 m² here has no door")
    assert 13.0 < found.at[0] < 17.0 and 5.5 < found.at[1] < 8.5
    store = Area("store", ((13.0, 5.5), (17.0, 5.5), (17.0, 8.5), (13.0, 8.5)))
    whole = Area("whole", OUTLINE)
    assert defects(floor(*ROOM, *ROAD, whole, store)) == [(ElementKind.AREA, "store", "it has no door")]
    assert defects(floor(*ROOM)) == defects(floor(*ROOM, *ROAD)), "also without a roadmap"
    assert defects(floor(*ROOM, *ROAD, is_bounded=False)) == defects(floor(*ROOM, *ROAD))


def test_a_room_with_a_door_is_in_order() -> None:
    door = Door("d", (14.0, 5.5), (15.0, 5.5))
    assert defects(floor(*ROOM, *ROAD, door)) == []
    assert defects(floor(*ROOM, *ROAD, Door("d", door.a, door.b, locked=True))) == []
    cart = MapObject("cart", BoxShape((0.8, 0.6)), (14.5, 5.5), movable=True)  # which stands in the doorway
    assert defects(floor(*ROOM, *ROAD, door, cart)) == []


def test_a_door_too_narrow_for_any_robot_is_named() -> None:
    ((kind, name, reason),) = defects(floor(*ROOM, *ROAD, Door("d", (14.0, 5.5), (14.5, 5.5))))
    assert (kind, name) == (ElementKind.FLOOR, "")
    assert reason.endswith("can't leave the room of 12 m² here through its doors: d of 0.50 m")


def test_the_robot_of_the_check_may_be_smaller() -> None:
    gap = msgspec.structs.replace(ROOM[0], a=(13.5, 5.5))
    assert len(defects(floor(gap, *ROOM[1:], *ROAD))) == 1
    assert list(plan_defects(floor(gap, *ROOM[1:], *ROAD), "L1", 0.2)) == []


def test_the_room_where_the_robots_are_is_in_order() -> None:
    inside = [PathNode("a", (14.0, 7.0)), PathNode("b", (16.0, 7.0)), PathEdge(name="a-b", a="a", b="b")]
    assert defects(floor(*ROOM, *inside, is_bounded=False)) == []
    assert defects(floor(*ROOM, is_bounded=False)) == [], "the walls of a building that is being drawn"


def test_a_room_with_an_elevator_is_in_order() -> None:
    lift = Elevator("E", (15.0, 7.5), (1.8, 1.8), (ElevatorDoor("L1"), ElevatorDoor("L2")))
    building = with_all(floor(*ROOM, *ROAD), [("", Floor("L2", 2, 4.0)), ("", lift)])
    assert defects(building) == []


def test_a_niche_between_furniture_is_no_room() -> None:
    shelf = MapObject("shelf", BoxShape((0.5, 3.0)), (1.2, 8.5))
    cupboard = MapObject("cupboard", BoxShape((2.0, 0.5)), (0.9, 7.0))
    assert defects(floor(*ROAD, shelf, cupboard)) == []


# ---- as findings of a map ----


def test_defects_are_findings_of_their_floor() -> None:
    table = MapObject("table", BoxShape((2.0, 1.0)), (5.0, 5.0))
    building = floor(*ROOM, *ROAD, table, Wall("w", (0.0, 5.2), (9.0, 5.2)), Door("d", (1.0, 8.0), (2.0, 8.0)))
    building = building.with_element("", Floor("L2", 2, 4.0))
    on_floor = floor_findings(building, "L1", 0.4)
    through, beside, room = on_floor[-3:]
    assert (through.floor, through.name, through.where[0]) == ("L1", "w", "L1")
    assert (beside.floor, beside.name, beside.where) == ("L1", "d", ("L1", 1.5, 8.0))
    assert (room.floor, room.name, room.where[0]) == ("", "L1", "L1")
    assert (
        summaries(on_floor[-3:])
        == summaries(findings(building)[-3:])
        == (
            "walls of L1 that go through objects (1): w near 5, 5.2",
            "doors of L1 on no wall (1): d near 1.5, 8",
            "closed rooms of L1 (1): near 15, 7",
        )
    )
    assert all(found.kind is ElementKind.FLOOR for found in floor_findings(building, "L2", 0.4))
    with pytest.raises(UnknownElement):
        floor_findings(building, "L9", 0.4)
