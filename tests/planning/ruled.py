"""Random buildings with every kind of rule, and random requests with every option, reproducible by seed."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from robocorba.maps.model import Area, Building, ElementKind, SegmentShape
from robocorba.maps.validation import problems
from robocorba.planning.request import Criterion, PathRequest, Place, RouteMode
from tests.planning.adversary import Query
from tests.planning.generated import random_building

GRAPHS = ("g0", "g1")


def ruled_building(seed: int) -> Building:
    """A random building with areas, navigation graphs, more rules of edges, movable objects, and nodes at different
    places of cabins."""
    building = random_building(seed)
    return with_rules(building, np.random.default_rng([seed, 1]))


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
            changes.append(
                (
                    ElementKind.EDGE,
                    floor,
                    edge.name,
                    msgspec.structs.replace(
                        edge,
                        one_way=bool(rng.random() < 0.25),
                        clearance=float(rng.choice([0.0, 0.0, 0.0, 0.0, 0.3])),
                        speed_limit=float(rng.choice([0.0, 0.0, 0.2, 0.7])),
                        graphs=((), (), ("g0",), ("g1",), ("g0", "g1"))[int(rng.integers(5))],
                    ),
                )
            )
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
