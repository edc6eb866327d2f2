"""Buildings for the planner's tests, drawn and random, places in any building, and random requests. Whatever is random
is reproducible by its seed."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import shapely
from shapely import LineString, Point, Polygon, STRtree

from robocorba.map_editor.geometry import bounds, obstacles, shaft_polygon
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
    PathEdge,
    PathNode,
    PolygonShape,
    SegmentShape,
    Shape,
    Wall,
)
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.validation import problems
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from testkit.buildings import with_all
from tests.planning.adversary import Query

#: Clearance of nodes from obstacles [m]: far less than a robot needs.
NODE_CLEARANCE_M = 0.02
#: Maximum distance of connected nodes [m], with few exceptions.
MAX_EDGE_M = 7.0


def room(width: float = 10.0, depth: float = 6.0, *elements: Element, name: str = "L1", level: int = 0) -> Building:
    """A building of one floor."""
    outline = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    floor = Floor(name=name, level=level, elevation=4.0 * level, outline=outline)
    return with_all(Building("test"), [("", floor), *((name, element) for element in elements)])


def wall(name: str, ax: float, ay: float, bx: float, by: float) -> Wall:
    return Wall(name=name, a=(ax, ay), b=(bx, by))


def node(name: str, x: float, y: float, elevator: str = "") -> PathNode:
    return PathNode(name=name, at=(float(x), float(y)), elevator=elevator)  # kernels compile anew for integers


def edge(a: str, b: str, **kind: object) -> PathEdge:
    return PathEdge(name=f"{a}-{b}", a=a, b=b, **kind)  # type: ignore[arg-type]


def two_rooms(door_width: float) -> Building:
    """Two rooms of 5 x 6 m with a doorway of that width between, a node in each and one in the doorway."""
    door = Door(name="door", a=(5.0, 3.0 - door_width / 2), b=(5.0, 3.0 + door_width / 2))
    nodes = [node("west", 2.5, 3.0), node("middle", 5.0, 3.0), node("east", 7.5, 3.0)]
    edges = [edge("west", "middle"), edge("middle", "east")]
    return room(10.0, 6.0, wall("between", 5.0, 0.0, 5.0, 6.0), door, *nodes, *edges)


def tower(floors: int = 3, served: tuple[str, ...] | None = None) -> Building:
    """Floors of 10 x 6 m, one above the other, an elevator E1 in the east with its door to the west."""
    names = [f"L{i + 1}" for i in range(floors)]
    building = Building("tower")
    for level, name in enumerate(names):
        roads = [node("west", 2.0, 3.0), node("landing", 6.0, 3.0), edge("west", "landing")]
        if served is None or name in served:
            roads += [node("cabin", 8.5, 3.0, "E1"), edge("landing", "cabin")]
        floor = room(10.0, 6.0, name=name, level=level).floors[name].floor
        building = with_all(building, [("", floor), *((name, element) for element in roads)])
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


def two_halls() -> Building:
    """Two halls with one gap between them; the roadmap covers only one."""
    walls = [wall("west", 0.0, 4.0, 2.0, 4.0), wall("east", 4.0, 4.0, 12.0, 4.0)]
    return room(12.0, 8.0, *walls, node("c1", 6.0, 2.0), node("c2", 11.0, 2.0), edge("c1", "c2"))


def one_way_hall() -> Building:
    """An empty hall with a one-way edge along its middle."""
    return room(20.0, 4.0, node("a", 2.0, 2.0), node("b", 18.0, 2.0), edge("a", "b", one_way=True))


def isolated_node() -> Building:
    """Two rooms with a roadmap through the doorway, and a node in the second room that no edge reaches."""
    walls = [wall("south", 10.0, 0.0, 10.0, 3.0), wall("north", 10.0, 5.0, 10.0, 8.0)]
    nodes = [node("a", 2.0, 4.0), node("b", 10.0, 4.0), node("c", 11.0, 4.0), node("alone", 19.0, 7.0)]
    return room(20.0, 8.0, *walls, *nodes, edge("a", "b"), edge("b", "c"))


def random_building(seed: int) -> Building:
    """One to three floors with random walls, doors, objects, elevators and a roadmap in several parts."""
    rng = np.random.default_rng(seed)
    building = Building(f"random {seed}")
    width, depth = float(rng.integers(10, 19)), float(rng.integers(8, 14))
    count = int(rng.choice([1, 1, 2, 3]))
    for level in range(count):
        outline = _outline(width, depth, rng) if count > 1 or rng.random() < 0.85 else ()
        floor = Floor(name=f"L{level + 1}", level=level, elevation=4.0 * level, outline=outline)
        building = building.with_element("", floor)
    if count > 1:
        for i, at in enumerate([(2.5, 2.5), (width - 3.0, depth - 3.0)][: int(rng.integers(1, 3))]):
            building = building.with_element("", _elevator(f"E{i + 1}", at, list(building.floors), rng))
    for floor_name in building.floors:
        for element in [*_walls(building, width, depth, rng), *_objects(width, depth, rng)]:
            building = building.with_element(floor_name, element)
    return with_random_roads(building, int(rng.integers(0, 16)), int(rng.integers(2**31)))


def _outline(width: float, depth: float, rng: np.random.Generator) -> tuple[XY, ...]:
    if rng.random() < 0.3:  # a corner is missing
        x, y = round(width * rng.uniform(0.5, 0.8), 1), round(depth * rng.uniform(0.2, 0.5), 1)
        return (0.0, 0.0), (x, 0.0), (x, y), (width, y), (width, depth), (0.0, depth)
    return (0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)


def _elevator(name: str, at: XY, floors: list[str], rng: np.random.Generator) -> Elevator:
    served = floors if rng.random() < 0.6 else [floors[i] for i in sorted(rng.choice(len(floors), 2, replace=False))]
    sides = list(CabinSide)
    doors = tuple(
        ElevatorDoor(floor=floor, side=sides[int(rng.integers(4))], width=float(rng.choice([0.9, 1.2, 1.6])))
        for floor in served
    )
    return Elevator(name=name, at=at, size=(2.0, 2.2), heading=float(rng.choice([0.0, math.pi / 2, 0.3])), doors=doors)


def _spot(width: float, depth: float, rng: np.random.Generator) -> XY:
    """A random place on the floor; half of them on a grid of half metres, so that elements line up."""
    x, y = float(rng.uniform(0.0, width)), float(rng.uniform(0.0, depth))
    return (round(2 * x) / 2, round(2 * y) / 2) if rng.random() < 0.5 else (x, y)


def _walls(building: Building, width: float, depth: float, rng: np.random.Generator) -> list[Element]:
    found: list[Element] = []
    shafts = [shaft_polygon(elevator).buffer(0.6) for elevator in building.elevators.values()]
    for i in range(int(rng.integers(0, 8))):
        a, b = _spot(width, depth, rng), _spot(width, depth, rng)
        kind = rng.random()
        if kind < 0.35:
            b = (b[0], a[1])
        elif kind < 0.7:
            b = (a[0], b[1])
        if kind < 0.25:  # right across the floor
            a = (0.0, a[1])
            b = (width, a[1])
        line = LineString([a, b])
        if line.length < 0.2 or (rng.random() < 0.9 and any(line.intersects(shaft) for shaft in shafts)):
            continue
        found.append(Wall(name=f"w{i}", a=a, b=b))
        if rng.random() < 0.5 and line.length > 2.0:
            start = float(rng.uniform(0.2, line.length - 1.6))
            ends = [line.interpolate(at) for at in (start, start + float(rng.choice([0.7, 0.9, 1.3])))]
            (ax, ay), (bx, by) = ((point.x, point.y) for point in ends)
            found.append(Door(name=f"d{i}", a=(ax, ay), b=(bx, by), locked=bool(rng.random() < 0.15)))
    return found


def _objects(width: float, depth: float, rng: np.random.Generator) -> list[Element]:
    found: list[Element] = []
    for i in range(int(rng.integers(0, 6))):
        size = rng.uniform(0.2, 1.6, 2).tolist()
        shapes: list[Shape] = [
            BoxShape(size=(size[0], size[1])),
            CircleShape(radius=size[0] / 2),
            SegmentShape(length=size[0]),
            PolygonShape(points=((0.0, 0.0), (size[0], 0.0), (size[0], size[1]), (size[0] / 2, size[1] / 4))),
        ]
        heading = float(rng.choice([0.0, math.pi / 2, rng.uniform(-3.0, 3.0)]))
        shape = shapes[int(rng.integers(len(shapes)))]
        found.append(MapObject(name=f"o{i}", shape=shape, at=_spot(width, depth, rng), heading=heading))
    return found


def with_random_roads(building: Building, nodes: int, seed: int) -> Building:
    """The building with about this number of nodes a floor, also in cabins, and edges between some that see each other.

    Some nodes stay isolated, some edges are one-way, or only for small robots."""
    rng = np.random.default_rng(seed)
    for floor, entry in building.floors.items():
        tree = STRtree([item.geometry for item in obstacles(building, floor)])
        outline = Polygon(entry.floor.outline) if entry.floor.outline else shapely.box(*bounds(building, floor))
        x0, y0, x1, y1 = outline.bounds
        places = [(f"n{i}", (x + x0, y + y0), "") for i in range(nodes) for x, y in [_spot(x1 - x0, y1 - y0, rng)]]
        for elevator in building.elevators.values():
            if floor in elevator.floors() and rng.random() < 0.7:
                places.append((f"cabin-{elevator.name}", elevator.at, elevator.name))
        kept: list[PathNode] = []
        for name, at, lift in places:
            point = Point(at)
            if outline.contains(point) and not len(tree.query(point, "dwithin", NODE_CLEARANCE_M)):
                kept.append(PathNode(name=name, at=at, elevator=lift))
        for found in kept:
            building = building.with_element(floor, found)
        for i, a in enumerate(kept):
            for b in kept[i + 1 :]:
                chance = 0.35 if math.dist(a.at, b.at) <= MAX_EDGE_M else 0.02
                far_enough = math.dist(a.at, b.at) > 0.01
                if far_enough and rng.random() < chance and not len(tree.query(LineString([a.at, b.at]), "intersects")):
                    building = building.with_element(floor, _edge(a.name, b.name, rng))
    assert problems(building) == []
    return building


def _edge(a: str, b: str, rng: np.random.Generator) -> PathEdge:
    if rng.random() < 0.5:
        a, b = b, a
    clearance = float(rng.choice([0.2, 0.3])) if rng.random() < 0.1 else 0.0
    limit = 0.5 if rng.random() < 0.1 else 0.0
    return edge(a, b, one_way=bool(rng.random() < 0.15), clearance=clearance, speed_limit=limit)


def ruled_building(seed: int) -> Building:
    """A random building with areas, navigation graphs, more rules of edges, movable objects, and nodes at different
    places of cabins."""
    return with_rules(random_building(seed), np.random.default_rng([seed, 1]))


def with_rules(building: Building, rng: np.random.Generator) -> Building:
    """The building with more rules."""
    changes: list = []
    for floor, entry in building.floors.items():
        for node in entry.topological.nodes.values():
            if node.elevator and rng.random() < 0.5:
                shift = rng.uniform(-0.35, 0.35, 2)
                at = (node.at[0] + float(shift[0]), node.at[1] + float(shift[1]))
                changes.append((ElementKind.NODE, floor, node.name, msgspec.structs.replace(node, at=at)))
        for edge in entry.topological.edges.values():
            rules = {
                "one_way": bool(rng.random() < 0.25),
                "clearance": float(rng.choice([0.0, 0.0, 0.0, 0.0, 0.3])),
                "speed_limit": float(rng.choice([0.0, 0.0, 0.2, 0.7])),
                "graphs": ((), (), ("g0",), ("g1",), ("g0", "g1"))[int(rng.integers(5))],
            }
            changes.append((ElementKind.EDGE, floor, edge.name, msgspec.structs.replace(edge, **rules)))
        for item in entry.geometrical.objects.values():
            if not isinstance(item.shape, SegmentShape) and rng.random() < 0.5:
                changes.append((ElementKind.OBJECT, floor, item.name, msgspec.structs.replace(item, movable=True)))
        for i in range(int(rng.integers(0, 3))):
            area = Area(name=f"area {i}", polygon=_polygon(rng))
            changes.append((ElementKind.AREA, floor, area.name, area))
    for change in changes:  # one by one: a moved node may break a rule of the building
        changed = building.with_changes([change])
        building = changed if not problems(changed, limit=1) else building
    return building


def _polygon(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    x, y = (float(value) for value in rng.uniform(1.0, 12.0, 2))
    width, depth = (float(value) for value in rng.uniform(0.5, 4.0, 2))
    turn = float(rng.uniform(0.0, math.pi / 2))
    cos, sin = math.cos(turn), math.sin(turn)
    corners = ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    return tuple((x + cos * a - sin * b, y + sin * a + cos * b) for a, b in corners)


def request_for(building: Building, query: Query, rng: np.random.Generator) -> PathRequest:
    """A request with random options for a query's places."""
    floors, lifts = list(building.floors), list(building.elevators)
    areas = [(floor, area) for floor, entry in building.floors.items() for area in entry.geometrical.areas]
    graphs = {
        name for entry in building.floors.values() for edge in entry.topological.edges.values() for name in edge.graphs
    }
    start, goal = query.start, query.goal
    return PathRequest(
        Place(start.floor, float(start.x), float(start.y)),
        Place(goal.floor, float(goal.x), float(goal.y)),
        radius=float(rng.choice([0.2, 0.25, 0.4])),
        speed=float(rng.choice([0.5, 1.0])),
        mode=list(RouteMode)[int(rng.integers(3))],
        best=list(Criterion)[int(rng.integers(2))],
        avoid_elevators=frozenset(name for name in lifts if rng.random() < 0.15),
        avoid_areas=tuple(area for area in areas if rng.random() < 0.2),
        forbidden_areas=tuple(
            (floors[int(rng.integers(len(floors)))], _polygon(rng)) for _ in range(int(rng.choice([0, 0, 0, 1, 2])))
        ),
        without_movables=tuple(floor for floor in floors if rng.random() < 0.2),
        graph=str(rng.choice(sorted(graphs))) if graphs and rng.random() < 0.4 else "",
        alternatives=int(rng.choice([0, 0, 0, 1, 3])),
    )
