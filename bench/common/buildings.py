"""Large generated buildings, reproducible by their seed."""

from __future__ import annotations

import math

import numpy as np

from robocorba.maps.model import (
    Building,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    PathEdge,
    PathNode,
    TopologicalMap,
    Wall,
)

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
