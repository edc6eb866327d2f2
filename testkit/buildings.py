"""Small buildings made in code, and hypothesis strategies for elements and buildings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from hypothesis import strategies as st

from robocorba.map_editor.collisions import blockages
from robocorba.map_editor.model import (
    Area,
    BoxShape,
    Building,
    CabinSide,
    CircleShape,
    Door,
    DoorKind,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    PathEdge,
    PathNode,
    PolygonShape,
    SegmentShape,
    TopologicalMap,
    Wall,
)
from robocorba.map_editor.topology import topological_map
from robocorba.map_editor.validation import problems


def with_all(building: Building, elements: Iterable[tuple[str, Element]]) -> Building:
    """The building with added elements, each with its floor."""
    for floor, element in elements:
        building = building.with_element(floor, element)
    return building


def rectangular(
    name: str, size: tuple[float, float], floors: Sequence[str], *elements: tuple[str, Element]
) -> Building:
    """Floors of one size [m] above each other, with elements, each with its floor, and a topological map."""
    width, height = size
    outline = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
    levels = [("", Floor(floor, level, 3.0 * (level - 1), outline=outline)) for level, floor in enumerate(floors, 1)]
    building = with_all(Building(name), [*levels, *elements])
    for floor, plan in building.floors.items():
        building.floors[floor] = msgspec.structs.replace(plan, topological=topological_map(building, floor))
    return building


def two_storeys(cabin_m: float = 3.0, speed: float = 1.0) -> Building:
    """Two floors of 12 m by 7 m with an elevator between them, and a box that two robots carry on the lower one."""
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, cabin_m - 0.6) for floor in ("L1", "L2"))
    east = 8.0 + cabin_m / 2, 3.5
    return rectangular(
        "two storeys",
        (12.0, 7.0),
        ["L1", "L2"],
        ("", Elevator("E1", east, (cabin_m, cabin_m), doors, heading=-math.pi / 2, speed=speed, door_time=2.0)),
        ("L1", MapObject("box", BoxShape((0.6, 0.4)), (5.4, 3.5), -0.785, height=0.8, movable=True)),
    )


def two_floors() -> Building:
    """Two floors of 20 m x 10 m, a wall with a door across the first, an elevator between them."""
    outline = ((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (0.0, 10.0))
    return with_all(
        Building("two floors"),
        [
            ("", Floor(name="L1", level=1, elevation=0.0, outline=outline)),
            ("", Floor(name="L2", level=2, elevation=4.0)),
            (
                "",
                Elevator(
                    name="E1",
                    at=(18.0, 5.0),
                    size=(2.0, 2.0),
                    heading=math.pi / 2,
                    doors=tuple(ElevatorDoor(floor=name, side=CabinSide.BACK, width=1.2) for name in ("L1", "L2")),
                ),
            ),
            ("L1", Wall(name="w", a=(10.0, 0.0), b=(10.0, 10.0))),
            ("L1", Door(name="d", a=(10.0, 4.0), b=(10.0, 6.0))),
            ("L1", MapObject(name="table", shape=BoxShape(size=(2.0, 1.0)), at=(5.0, 8.0))),
            ("L1", Area(name="room", polygon=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)), subnet="a")),
            ("L1", PathNode(name="west", at=(5.0, 5.0))),
            ("L1", PathNode(name="east", at=(15.0, 5.0))),
            ("L1", PathNode(name="lift1", at=(18.0, 5.0), elevator="E1")),
            ("L1", PathEdge(name="west-east", a="west", b="east")),
            ("L1", PathEdge(name="in", a="east", b="lift1", one_way=True, speed_limit=0.5, graphs=("g",))),
            ("L2", PathNode(name="lift2", at=(18.0, 5.0), elevator="E1")),
            ("L2", PathNode(name="top", at=(15.0, 5.0))),
            ("L2", PathEdge(name="lift2-top", a="lift2", b="top")),
        ],
    )


def grid(side: int, walls: int, floors: int = 1, doors: int = 0) -> Building:
    """`side`² nodes per floor, 1 m apart, each connected to the next four. `doors` of the `walls` walls have a door."""
    storeys = {}
    for level in range(floors):
        nodes = {
            f"n{x}.{y}": PathNode(name=f"n{x}.{y}", at=(float(x), float(y))) for x in range(side) for y in range(side)
        }
        edges = {}
        for x in range(side):
            for y in range(side):
                for to_x, to_y in ((x + 1, y), (x, y + 1), (x + 1, y + 1), (x + 1, y - 1)):
                    if f"n{to_x}.{to_y}" in nodes:
                        name = f"n{x}.{y}-n{to_x}.{to_y}"
                        edges[name] = PathEdge(name=name, a=f"n{x}.{y}", b=f"n{to_x}.{to_y}")
        lines = {f"w{i}": Wall(name=f"w{i}", a=(-5.0 - i, 0.0), b=(-5.0 - i, 9.0)) for i in range(walls)}
        openings = {f"d{i}": Door(name=f"d{i}", a=(-5.0 - i, 4.0), b=(-5.0 - i, 5.0)) for i in range(doors)}
        storeys[f"L{level}"] = FloorMap(
            Floor(name=f"L{level}", level=level, elevation=4.0 * level),
            GeometricalMap(walls=lines, doors=openings),
            TopologicalMap(nodes=nodes, edges=edges),
        )
    return Building("grid", storeys)


#: Few names and a coarse grid, so that elements touch, replace each other and collide.
names = st.sampled_from(["a", "b", "c"])
spots = st.tuples(*[st.integers(0, 8).map(lambda value: value / 2)] * 2)
floor_names = st.sampled_from(["L1", "L2", "L3"])
rings = st.sampled_from([(), ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0)), ((-1.0, -1.0), (9.0, -1.0), (4.0, 9.0))])
shapes = st.one_of(
    st.builds(SegmentShape, length=st.sampled_from([0.5, 2.0])),
    st.builds(BoxShape, size=st.sampled_from([(0.5, 0.5), (1.0, 2.0)])),
    st.builds(CircleShape, radius=st.sampled_from([0.25, 0.5])),
    st.just(PolygonShape(points=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))),
)
headings = st.sampled_from([0.0, 0.5, math.pi / 2])
elevator_doors = st.builds(
    ElevatorDoor,
    floor=floor_names,
    side=st.sampled_from(CabinSide),
    width=st.sampled_from([0.5, 0.9, 1.0]),
    offset=st.sampled_from([0.0, 0.1]),
)
floors = st.builds(
    Floor, name=floor_names, level=st.integers(-1, 3), elevation=st.sampled_from([-4.0, 0.0, 4.0, 8.0]), outline=rings
)
elevators = st.builds(
    Elevator,
    name=names,
    at=spots,
    size=st.sampled_from([(1.0, 1.0), (2.0, 1.5)]),
    heading=headings,
    doors=st.lists(elevator_doors, max_size=3).map(tuple),
)
on_a_floor: list[Any] = [
    st.builds(Wall, name=names, a=spots, b=spots),
    st.builds(MapObject, name=names, shape=shapes, at=spots, heading=headings),
    st.builds(Door, name=names, a=spots, b=spots, kind=st.sampled_from(DoorKind), locked=st.booleans()),
    st.builds(Area, name=names, polygon=rings, subnet=st.sampled_from(["", "x"])),
    st.builds(PathNode, name=names, at=spots, elevator=st.sampled_from(["", "", "", "a"])),
    st.builds(PathEdge, name=names, a=names, b=names, graphs=st.sampled_from([(), ("g", "h")])),
]
#: A floor and an element on it.
placed = st.tuples(floor_names, st.one_of(*on_a_floor, *on_a_floor, floors, elevators))


@st.composite
def buildings(draw: st.DrawFn) -> Building:
    """Valid buildings: elements that break a rule are left out."""
    building = Building("made")
    for floor, element in draw(st.lists(st.tuples(floor_names, floors), max_size=3)):
        building = _kept(building, floor, element)
    for floor, element in draw(st.lists(placed, max_size=25)):
        building = _kept(building, floor, element)
    return building


def is_refused(before: Building, after: Building) -> bool:
    """Whether an editor must reject an edit: it breaks a rule, or puts a path on a new obstacle."""
    if problems(after, limit=1):
        return True
    for floor in after.floors:
        entry = before.floors.get(floor)
        old, new = entry.topological if entry else TopologicalMap(), after.floors[floor].topological
        known = {found.pair for found in blockages(before, floor)} if entry else set()
        moved = {name for name, node in new.nodes.items() if name not in old.nodes or old.nodes[name].at != node.at}
        for found in blockages(after, floor):
            element = found.element
            if isinstance(element, PathNode):
                if element.name in moved:
                    return True
                continue
            was = old.edges.get(element.name)
            if was is None or {was.a, was.b} != {element.a, element.b}:
                return True
            if {element.a, element.b} & moved and found.pair not in known:
                return True
    return False


def _kept(building: Building, floor: str, element: Element) -> Building:
    if not isinstance(element, Floor | Elevator) and floor not in building.floors:
        return building
    candidate = building.with_element(floor, element)
    return building if problems(candidate, limit=1) else candidate
