"""Random free places in a building."""

from __future__ import annotations

import numpy as np

from robocorba.maps.geometry import bounds
from robocorba.maps.model import Building
from robocorba.planning.request import Place
from robocorba.planning.space import FloorSpace


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
