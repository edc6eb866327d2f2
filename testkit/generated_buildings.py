"""Generated buildings, reproducible by their seed, and random free places in them."""

from __future__ import annotations

import math

import numpy as np

from robocorba.map_editor.geometry import bounds
from robocorba.map_editor.model import (
    BoxShape,
    Building,
    CircleShape,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    PathEdge,
    PathNode,
    Shape,
    TopologicalMap,
    Wall,
)
from robocorba.map_editor.spatial.pose import Pose
from robocorba.planning.request import Place
from robocorba.planning.space import FloorSpace
from robocorba.simulation.registry import Description


def random_places(building: Building, radius_m: float, count: int, seed: int) -> list[Place]:
    """`count` places, on each floor in turn, that are free for a robot of this radius and outside elevator cabins."""
    rng = np.random.default_rng(seed)
    names = list(building.floors)
    spaces = {name: FloorSpace(building, name) for name in names}
    boxes = {name: bounds(building, name, 0.0) for name in names}
    found: list[Place] = []
    while len(found) < count:
        floor = names[len(found) % len(names)]
        x0, y0, x1, y1 = boxes[floor]
        x, y = float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1))
        if spaces[floor].point_is_free(x, y, radius_m) and not _in_shaft(building, x, y):
            found.append(Place(floor, x, y))
    return found


def random_trips(building: Building, radius_m: float, count: int, seed: int) -> list[tuple[Place, Place]]:
    """`count` random pairs of such places: start and goal, on the same or different floors."""
    places = random_places(building, radius_m, 2 * count, seed)
    order = np.random.default_rng(seed).permutation(len(places))
    return [(places[a], places[b]) for a, b in zip(order[::2], order[1::2], strict=True)]


def _in_shaft(building: Building, x: float, y: float) -> bool:
    return any(
        abs(x - lift.at[0]) + abs(y - lift.at[1]) < lift.size[0] + lift.size[1] for lift in building.elevators.values()
    )


# ---- a large building for the planner ----


#: Fractions of a grid's edges that are one-way, and that have a speed limit.
ONE_WAY, LIMITED = 0.01, 0.02


def grid_building(floors: int = 10, side: int = 100, elevators: int = 6, seed: int = 1) -> Building:
    """Floors with side x side nodes about 2 m apart, displaced randomly; a fifth of the edges is missing.

    A wall blocks a quarter of the missing edges. Elevators on the diagonal serve every floor. Every tenth row and both
    outer columns are complete and two-way, so that nearly all nodes are connected."""
    rng = np.random.default_rng(seed)
    pitch = 2.0
    size = pitch * (side + 1)
    spots = [((k + 1) * side // (elevators + 1)) for k in range(elevators)]
    built = {}
    for level in range(floors):
        jitter = rng.uniform(-0.4, 0.4, (side, side, 2))
        nodes: dict[str, PathNode] = {}
        for i in range(side):
            for j in range(side):
                x, y = pitch * (j + 1) + jitter[i, j, 0], pitch * (i + 1) + jitter[i, j, 1]
                cabin = f"E{spots.index(i) + 1}" if i == j and i in spots else ""
                if cabin:
                    x, y = pitch * (j + 1), pitch * (i + 1)
                nodes[f"n{i}-{j}"] = PathNode(name=f"n{i}-{j}", at=(float(x), float(y)), elevator=cabin)
        edges: dict[str, PathEdge] = {}
        walls: dict[str, Wall] = {}
        missing = rng.random((side, side, 2)) < 0.2
        walled = rng.random((side, side, 2)) < 0.25
        limited = rng.random((side, side, 2)) < LIMITED
        directed = rng.random((side, side, 2)) < ONE_WAY
        backwards = rng.random((side, side, 2)) < 0.5
        for i in range(side):
            for j in range(side):
                for axis, (i2, j2) in enumerate(((i, j + 1), (i + 1, j))):
                    if i2 >= side or j2 >= side:
                        continue
                    a, b = nodes[f"n{i}-{j}"], nodes[f"n{i2}-{j2}"]
                    at_lift = a.elevator or b.elevator
                    if at_lift and not (axis == 0 and a.elevator):
                        continue  # robots enter and leave a cabin on its right side
                    keep = (axis == 0 and i % 10 == 5) or j in (0, side - 1)
                    if missing[i, j, axis] and not keep and not at_lift:
                        if walled[i, j, axis]:
                            mx, my = (a.at[0] + b.at[0]) / 2, (a.at[1] + b.at[1]) / 2
                            turn = math.atan2(b.at[1] - a.at[1], b.at[0] - a.at[0]) + math.pi / 2
                            dx, dy = 0.2 * math.cos(turn), 0.2 * math.sin(turn)
                            name = f"w{i}-{j}-{axis}"
                            walls[name] = Wall(name=name, a=(mx - dx, my - dy), b=(mx + dx, my + dy))
                        continue
                    one_way = bool(directed[i, j, axis]) and not keep and not at_lift
                    if one_way and backwards[i, j, axis]:
                        a, b = b, a
                    edges[f"{a.name}:{b.name}"] = PathEdge(
                        name=f"{a.name}:{b.name}",
                        a=a.name,
                        b=b.name,
                        one_way=one_way,
                        speed_limit=0.5 if limited[i, j, axis] else 0.0,
                    )
        name = f"L{level + 1}"
        outline = ((0.0, 0.0), (size, 0.0), (size, size), (0.0, size))
        built[name] = FloorMap(
            Floor(name=name, level=level, elevation=4.0 * level, outline=outline),
            GeometricalMap(walls=walls),
            TopologicalMap(nodes=nodes, edges=edges),
        )
    shafts = {
        f"E{k + 1}": Elevator(
            name=f"E{k + 1}",
            at=(pitch * (spot + 1), pitch * (spot + 1)),
            heading=math.pi / 2,
            size=(1.8, 1.8),
            doors=tuple(ElevatorDoor(floor=name, width=1.4) for name in built),
        )
        for k, spot in enumerate(spots)
    }
    return Building(f"grid {floors} x {side} x {side}", built, shafts)


# ---- an office for the simulation ----


FLOORS = 4
#: Rooms along each side of a floor.
ROOMS = 5
#: Side of a room, and width of a doorway [m].
ROOM_M, DOORWAY_M = 12.0, 2.0
#: Share of the walls between rooms that are left out.
MISSING = 0.07
RADIUS_M = 0.4


def office(seed: int = 1, levels: int = FLOORS) -> Building:
    """Floors of 60 x 60 m, about 75 walls each: rooms with a doorway to each of their neighbours, two tables, a
    column and a box that can be pushed. The elevator in the middle serves every floor."""
    chance = np.random.default_rng(seed)
    side = ROOMS * ROOM_M
    outline = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side))
    names = [f"L{level}" for level in range(1, levels + 1)]
    floors = {
        name: FloorMap(
            Floor(name, level, 4.0 * level, outline=outline), GeometricalMap(_walls(chance), _furniture(chance))
        )
        for level, name in enumerate(names)
    }
    lift = Elevator("E1", (side / 2, side / 2), (2.0, 2.0), tuple(ElevatorDoor(name) for name in names))
    return Building("office", floors, {lift.name: lift})


def _walls(chance: np.random.Generator) -> dict[str, Wall]:
    walls: list[Wall] = []
    for line in range(1, ROOMS):
        for room in range(ROOMS):
            for turned in (False, True):
                door = (room + 0.5) * ROOM_M + chance.uniform(-4.0, 4.0)
                if chance.random() < MISSING:
                    continue
                at, ends = (
                    line * ROOM_M,
                    (room * ROOM_M, door - DOORWAY_M / 2, door + DOORWAY_M / 2, (room + 1) * ROOM_M),
                )
                for a, b in (ends[:2], ends[2:]):
                    name = f"W{len(walls)}"
                    walls.append(Wall(name, (a, at), (b, at)) if turned else Wall(name, (at, a), (at, b)))
    return {wall.name: wall for wall in walls}


def _furniture(chance: np.random.Generator) -> dict[str, MapObject]:
    """One object in each quarter of every room but the middle one, which has the elevator."""
    shapes: tuple[tuple[Shape, bool], ...] = (
        (BoxShape((1.6, 0.8)), False),
        (BoxShape((1.2, 1.2)), False),
        (CircleShape(0.3), False),
        (BoxShape((0.8, 0.6)), True),
    )
    objects = []
    for room in range(ROOMS * ROOMS):
        if room == ROOMS * ROOMS // 2:
            continue
        left, below = room % ROOMS * ROOM_M, room // ROOMS * ROOM_M
        for quarter, (shape, movable) in enumerate(shapes):
            x, y = chance.uniform(2.5, 4.5, 2) + np.array([quarter % 2, quarter // 2]) * 5.0
            heading = chance.uniform(-math.pi, math.pi)
            at = (float(left + x), float(below + y))
            objects.append(MapObject(f"F{room}-{quarter}", shape, at, float(heading), movable=movable))
    return {item.name: item for item in objects}


def robots(building: Building, count: int, seed: int = 3) -> list[Description]:
    """`count` robots at free places without overlaps, spread over the floors."""
    chance = np.random.default_rng(seed)
    found: list[Description] = []
    taken: dict[str, list[complex]] = {floor: [] for floor in building.floors}
    for floor, x, y in random_places(building, RADIUS_M + 0.05, 2 * count, seed):
        if len(found) == count:
            break
        at = complex(x, y)
        if all(abs(at - other) > 2 * RADIUS_M + 0.1 for other in taken[floor]):
            taken[floor].append(at)
            heading = float(chance.uniform(-math.pi, math.pi))
            found.append(Description(f"robot-{len(found)}", Pose(floor, x, y, heading), RADIUS_M))
    return found
