"""IDL elements for tests: one of each kind with a changed one beside it, for the building two_floors()."""

from __future__ import annotations

from typing import Any, NamedTuple

from robocorba.stubs import RoboCorba

XY = RoboCorba.XY


class Example(NamedTuple):
    """An element on `floor` that the building accepts, and a `changed` one of the same name."""

    floor: str
    value: Any
    changed: Any


def ring(*corners: tuple[float, float]) -> list[Any]:
    """An XYSeq."""
    return [XY(*corner) for corner in corners]


def wall(name: str, x: float = 0.5, height: float = 2.5) -> Any:
    """A short wall along x = `x`, far from all nodes and edges of L1 and L2."""
    return RoboCorba.Element(aWall=RoboCorba.Wall(name, XY(x, 8.5), XY(x, 9.5), height))


def examples(name: str) -> dict[str, Example]:
    """One element of each kind, all called `name`, by what the IDL calls the kind."""
    square = ring((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    corner = ring((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    doors = [RoboCorba.ElevatorDoor(floor, RoboCorba.LEFT, 1.0, 0.25) for floor in ("L1", "L2")]
    element, shape = RoboCorba.Element, RoboCorba.Shape
    return {
        "FLOOR_ELEMENT": Example(
            "",
            element(aFloor=RoboCorba.Floor(name, 7, 20.0, 3.0, [])),
            element(aFloor=RoboCorba.Floor(name, 8, 24.5, 2.5, square)),
        ),
        "WALL_ELEMENT": Example("L2", wall(name), wall(name, 0.75, 1.5)),
        "OBJECT_ELEMENT": Example(
            "L2",
            element(anObject=RoboCorba.MapObject(name, shape(radius=0.5), XY(3.0, 3.0), 0.0, 1.0, False)),
            element(anObject=RoboCorba.MapObject(name, shape(points=corner), XY(3.0, 3.0), 0.5, 0.75, True)),
        ),
        "DOOR_ELEMENT": Example(
            "L2",
            element(aDoor=RoboCorba.Door(name, XY(5.0, 0.0), XY(6.0, 0.0), RoboCorba.SLIDING, True)),
            element(aDoor=RoboCorba.Door(name, XY(5.0, 0.0), XY(6.5, 0.0), RoboCorba.DOUBLE_HINGED, False)),
        ),
        "AREA_ELEMENT": Example(
            "L2",
            element(anArea=RoboCorba.Area(name, square, "")),
            element(anArea=RoboCorba.Area(name, corner, "サブネット")),
        ),
        "NODE_ELEMENT": Example(
            "L2",
            element(aNode=RoboCorba.PathNode(name, XY(8.0, 8.0), "")),
            element(aNode=RoboCorba.PathNode(name, XY(18.5, 5.0), "E1")),
        ),
        "EDGE_ELEMENT": Example(
            "L2",
            element(anEdge=RoboCorba.PathEdge(name, "top", "lift2", True, 0.5, 0.45, ["g", "ナビ"])),
            element(anEdge=RoboCorba.PathEdge(name, "lift2", "top", False, 0.0, 0.0, [])),
        ),
        "ELEVATOR_ELEMENT": Example(
            "",
            element(anElevator=RoboCorba.Elevator(name, XY(30.0, 30.0), 0.5, XY(2.0, 2.5), doors, 1.5, 2.0)),
            element(anElevator=RoboCorba.Elevator(name, XY(33.0, 30.0), 0.0, XY(2.0, 2.5), doors[:1], 1.0, 4.0)),
        ),
    }


def id_of(floor: str, value: Any) -> Any:
    """The ElementId of an element on `floor`."""
    return RoboCorba.ElementId(value._d, floor, value._v.name)


def all_elements(editor: Any) -> dict[tuple[str, str, str], str]:
    """Every element of a building as text, by kind, floor and name."""
    found = {}
    for kind in RoboCorba.ElementKind._items:
        of_whole = kind in (RoboCorba.FLOOR_ELEMENT, RoboCorba.ELEVATOR_ELEMENT)
        for floor in [""] if of_whole else editor.floors():
            for record in editor.elements(kind, floor):
                found[str(kind), record.onFloor, record.value._v.name] = repr(record.value)
    return found


def replay(before: dict[tuple[str, str, str], str], changes: list[Any]) -> dict[tuple[str, str, str], str]:
    """What changes make of the elements that were there before them; fails where a change does not fit."""
    after = dict(before)
    for change in changes:
        key = str(change.value._d), change.onFloor, change.value._v.name
        assert (key in after) == (change.kind != RoboCorba.CREATED), f"{change.kind} of {key} at {change.changedTo}"
        if change.kind == RoboCorba.REMOVED:
            assert after.pop(key) == repr(change.value)
        else:
            after[key] = repr(change.value)
    return after
