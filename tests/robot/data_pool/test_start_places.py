"""Places where robots start: free ones, one after the other."""

from __future__ import annotations

import itertools
import math

import numpy as np

from robocorba.map_editor.samples import load_sample
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.data_pool.snapshot import FloorBodies, FloorSnapshot
from robocorba.robot.data_pool.start_places import GAP_M, start_places
from robocorba.robot.data_pool.walls import Walls

RADIUS_M = 0.4
BUILDING = load_sample("five-floors")
NODES = [node.at for node in BUILDING.floors["L1"].topological.nodes.values()]
WALLS = Walls(BUILDING, "L1")


def floor_with(robots: list[XY]) -> FloorSnapshot:
    bodies = tuple(Body(row, BodyKind.ROBOT, f"R{row}", RADIUS_M, (), 127.0) for row in range(len(robots)))
    motions = np.zeros(len(robots), MOTION)
    for row, (x, y) in enumerate(robots):
        motions[row] = (row, 0.0, 0.0, 0.0, x, y, 0.0)
    return FloorSnapshot("L1", WALLS, 1, bodies=FloorBodies(bodies), motions=motions)


def test_a_hundred_and_fifty_robots_find_places_one_after_the_other() -> None:
    assert list(start_places([], floor_with([]), RADIUS_M)) == []
    robots: list[XY] = []
    for _ in range(150):
        robots.append(next(iter(start_places(NODES, floor_with(robots), RADIUS_M))))
    assert robots[: len(NODES)] == NODES
    for one, other in itertools.combinations(robots, 2):
        assert math.dist(one, other) > 2 * RADIUS_M
    for x, y in robots[len(NODES) :]:
        near = WALLS.nearest(x, y, {})
        assert near and near.distance_m > RADIUS_M + GAP_M
        assert 0.0 < x < 40.0 and 0.0 < y < 40.0
