"""An office building for the benches of the simulation, and start poses of robots."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from bench.common.places import random_places
from robocorba.maps import native
from robocorba.maps.model import (
    BoxShape,
    Building,
    CircleShape,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    Shape,
    Wall,
)
from robocorba.simulation.registry import Description
from robocorba.spatial.floor_state import Pose

FLOORS = 4
#: Rooms along each side of a floor.
ROOMS = 5
#: Side of a room, and width of a doorway [m].
ROOM_M, DOORWAY_M = 12.0, 2.0
#: Share of the walls between rooms that are left out.
MISSING = 0.07
RADIUS_M = 0.4


def office(seed: int = 1) -> Building:
    """Four floors of 60 x 60 m, about 75 walls each: rooms with a doorway to each of their neighbours, two tables, a
    column and a box that can be pushed. The elevator in the middle serves every floor."""
    chance = np.random.default_rng(seed)
    side = ROOMS * ROOM_M
    outline = ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side))
    names = [f"L{level}" for level in range(1, FLOORS + 1)]
    floors = {
        name: FloorMap(
            Floor(name, level, 4.0 * level, outline=outline), GeometricalMap(_walls(chance), _furniture(chance))
        )
        for level, name in enumerate(names)
    }
    lift = Elevator("E1", (side / 2, side / 2), (2.0, 2.0), tuple(ElevatorDoor(name) for name in names))
    return Building("office", floors, {lift.name: lift})


def saved_office(folder: Path) -> Path:
    """The file of an office in a folder."""
    native.save(office(), folder / "office.yaml")
    return folder / "office.yaml"


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
