"""Small buildings for the planner's tests, and random places in any building."""

from __future__ import annotations

import numpy as np
import shapely

from robocorba.maps.geometry import free_space
from robocorba.maps.model import (
    BoxShape,
    Building,
    Door,
    Element,
    Elevator,
    ElevatorDoor,
    Floor,
    MapObject,
    PathEdge,
    PathNode,
    Wall,
)
from robocorba.planning.request import Place


def room(width: float = 10.0, depth: float = 6.0, *elements: Element, name: str = "L1", level: int = 0) -> Building:
    """A building of one floor."""
    outline = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    building = Building("test").with_element("", Floor(name=name, level=level, elevation=4.0 * level, outline=outline))
    for element in elements:
        building = building.with_element(name, element)
    return building


def wall(name: str, ax: float, ay: float, bx: float, by: float) -> Wall:
    return Wall(name=name, a=(ax, ay), b=(bx, by))


def node(name: str, x: float, y: float, elevator: str = "") -> PathNode:
    return PathNode(name=name, at=(float(x), float(y)), elevator=elevator)  # kernels compile anew for integers


def edge(a: str, b: str, **kind: object) -> PathEdge:
    return PathEdge(name=f"{a}-{b}", a=a, b=b, **kind)  # type: ignore[arg-type]


def two_rooms(door_width: float) -> Building:
    """Two rooms of 5 x 6 m with a doorway of that width between, a node in each and one in the doorway."""
    low, high = 3.0 - door_width / 2, 3.0 + door_width / 2
    return room(
        10.0,
        6.0,
        wall("between", 5.0, 0.0, 5.0, 6.0),
        Door(name="door", a=(5.0, low), b=(5.0, high)),
        node("west", 2.5, 3.0),
        node("middle", 5.0, 3.0),
        node("east", 7.5, 3.0),
        edge("west", "middle"),
        edge("middle", "east"),
    )


def tower(floors: int = 3, served: tuple[str, ...] | None = None) -> Building:
    """Floors of 10 x 6 m, one above the other, an elevator E1 in the east with its door to the west."""
    names = [f"L{i + 1}" for i in range(floors)]
    building = Building("tower")
    for level, name in enumerate(names):
        outline = ((0.0, 0.0), (10.0, 0.0), (10.0, 6.0), (0.0, 6.0))
        building = building.with_element("", Floor(name=name, level=level, elevation=4.0 * level, outline=outline))
        for element in (
            node("west", 2.0, 3.0),
            node("landing", 6.0, 3.0),
            node("cabin", 8.5, 3.0, "E1"),
            edge("west", "landing"),
            edge("landing", "cabin"),
        ):
            if served is None or name in served or element.name not in ("cabin", "landing-cabin"):
                building = building.with_element(name, element)
    doors = tuple(ElevatorDoor(floor=name, width=1.4) for name in (served or names))
    shaft = Elevator(name="E1", at=(8.5, 3.0), heading=-1.5707963267948966, size=(2.0, 2.0), doors=doors)
    return building.with_element("", shaft)


def random_room(seed: int, things: int = 6) -> Building:
    """A room of 12 x 9 m with boxes and walls anywhere in it."""
    rng = np.random.default_rng(seed)
    building = room(12.0, 9.0)
    for i in range(things):
        x, y, turn = rng.uniform(2, 10), rng.uniform(2, 7), rng.uniform(0, 3.14)
        size = (float(rng.uniform(0.3, 1.8)), float(rng.uniform(0.3, 1.8)))
        box = MapObject(name=f"box{i}", shape=BoxShape(size=size), at=(float(x), float(y)), heading=float(turn))
        building = building.with_element("L1", box)
    for i in range(things // 2):
        ax, ay = rng.uniform(1, 11), rng.uniform(1, 8)
        bx, by = np.clip(np.array([ax, ay]) + rng.uniform(-3, 3, 2), 0.5, [11.5, 8.5])
        line = shapely.LineString([(ax, ay), (bx, by)])
        if line.length > 0.2:
            building = building.with_element("L1", wall(f"wall{i}", float(ax), float(ay), float(bx), float(by)))
    return building


def random_places(building: Building, radius: float, count: int, seed: int) -> list[Place]:
    """Free places all over a building."""
    rng = np.random.default_rng(seed)
    spaces = {floor: free_space(building, floor, radius) for floor in building.floors}
    weights = np.array([space.area for space in spaces.values()])
    names = list(spaces)
    found: list[Place] = []
    while len(found) < count:
        floor = names[rng.choice(len(names), p=weights / weights.sum())]
        x0, y0, x1, y1 = spaces[floor].bounds
        points = rng.uniform((x0, y0), (x1, y1), (50, 2))
        inside = shapely.contains_xy(spaces[floor], points)
        found += [Place(floor, float(x), float(y)) for x, y in points[inside][:1]]
    return found
