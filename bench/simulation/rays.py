"""Rays per second on one core: floors of 300 and of 6,000 walls, compared with queries of pymunk.

python -m bench.simulation.rays
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pymunk
import shapely
from shapely import LineString

from bench.common.harness import alternately, run
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.visible_obstacles import VisibleObstacles
from testkit.report import at_least, at_most, summarize, summary

FULL = Fan(-math.pi, 2 * math.pi / 360, 360, 30.0)
#: Number of walls, side of the floor [m], required million rays per second.
FLOORS = ((300, 60.0, 8.0), (6000, 250.0, 6.6))
SCANS, ROUNDS = 500, 7
#: The slow peer gets fewer scans.
FEW = 10


def floor(walls: int, side: float, seed: int = 1) -> list[shapely.Geometry]:
    """Walls of 2 to 6 m along the axes at random places, within an outer wall."""
    chance = np.random.default_rng(seed)
    found: list[shapely.Geometry] = [shapely.box(0, 0, side, side).exterior]
    for x, y, length, turned in zip(
        *chance.uniform(1, side - 7, (2, walls)), *chance.uniform(0, 1, (2, walls)), strict=True
    ):
        reach = 2 + 4 * length
        found.append(LineString([(x, y), (x + reach, y) if turned < 0.5 else (x, y + reach)]))
    return found


def poses(count: int, side: float) -> Floats:
    chance = np.random.default_rng(2)
    return np.column_stack([chance.uniform(1, side - 1, (count, 2)), chance.uniform(-math.pi, math.pi, count)])


def by_pymunk(walls: list[shapely.Geometry], places: Floats) -> Callable[[], Floats]:
    """Scans with one pymunk query for each ray."""
    space = pymunk.Space()
    for wall in walls:
        points = list(wall.coords)
        space.add(*(pymunk.Segment(space.static_body, a, b, 0.0) for a, b in itertools.pairwise(points)))
    everything = pymunk.ShapeFilter()

    def scan() -> Floats:
        found = np.full((len(places), FULL.count), FULL.range_m)
        for row, (x, y, heading) in zip(found, places.tolist(), strict=True):
            for k, angle in enumerate((FULL.angles + heading).tolist()):
                end = (x + FULL.range_m * math.cos(angle), y + FULL.range_m * math.sin(angle))
                met = space.segment_query_first((x, y), end, 0.0, everything)
                if met:
                    row[k] = met.alpha * FULL.range_m
        return found

    return scan


def main() -> bool:
    rows: list[dict[str, Any]] = []
    marks, samples = [], {}
    for walls, side, least in FLOORS:
        obstacles, places = floor(walls, side), poses(SCANS, side)
        scene, few = VisibleObstacles(obstacles), places[:FEW]
        peer = by_pymunk(obstacles, few)
        worst = float(np.abs(peer() - scene.scan(few, FULL)).max())
        ms = alternately([{"ours": partial(scene.scan, places, FULL), "pymunk": peer}] * ROUNDS)
        for by, scans in (("ours", SCANS), ("pymunk", FEW)):
            rates = [scans * FULL.count / took_ms / 1e3 for took_ms in ms[by]]
            samples[f"{by}, {walls} walls"] = rates
            rows.append({"walls": walls, "by": by, **summary(rates, "M rays/s"), "worst round": min(rates)})
        marks.append(at_least(f"{walls} walls, million rays a second", rows[-2]["M rays/s"], least))
        marks.append(at_most(f"{walls} walls, largest difference from pymunk, m", worst, 1e-6))
    title = f"{FULL.count} rays of {FULL.range_m:g} m, one core"
    return summarize("rays", title, rows, marks, samples, "million rays a second")


if __name__ == "__main__":
    run(main)
