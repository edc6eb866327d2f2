"""Rays per second on one core: floors of 300 and of 6,000 walls, compared with queries of pymunk and shapely.

python -m bench.simulation.rays
"""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pymunk
import shapely
from shapely import LineString

from bench.common.harness import run
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.visible_obstacles import VisibleObstacles
from testkit.report import at_least, at_most, bars, summarize

FULL = Fan(-math.pi, 2 * math.pi / 360, 360, 30.0)
#: Number of walls, side of the floor [m], required rays per second.
FLOORS = ((300, 60.0, 8e6), (6000, 250.0, 6.6e6))
SCANS, ROUNDS = 500, 7
#: Slow peers get fewer scans.
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


def by_shapely(walls: list[shapely.Geometry], places: Floats) -> Callable[[], Floats]:
    """Scans with an STRtree of shapely and vectorized intersections."""
    tree = shapely.STRtree(walls)
    lines = np.array(walls, object)

    def scan() -> Floats:
        found = np.full((len(places), FULL.count), FULL.range_m)
        for row, (x, y, heading) in zip(found, places.tolist(), strict=True):
            angles = FULL.angles + heading
            ends = np.column_stack([x + FULL.range_m * np.cos(angles), y + FULL.range_m * np.sin(angles)])
            starts = np.broadcast_to((x, y), ends.shape)
            rays = shapely.linestrings(np.stack([starts, ends], axis=1))
            which, wall = tree.query(rays, predicate="intersects")
            met = shapely.intersection(rays[which], lines[wall])
            np.minimum.at(row, which, shapely.distance(met, shapely.Point(x, y)))
        return found

    return scan


def main() -> bool:
    rows: list[dict[str, Any]] = []
    marks = []
    for walls, side, least in FLOORS:
        obstacles, places = floor(walls, side), poses(SCANS, side)
        scene, few = VisibleObstacles(obstacles), places[:FEW]
        methods: dict[str, tuple[Callable[[], Floats], int]] = {
            "ours": (lambda scene=scene, places=places: scene.scan(places, FULL), SCANS),  # type: ignore[misc]
            "pymunk": (by_pymunk(obstacles, few), FEW),
            "shapely": (by_shapely(obstacles, few), FEW),
        }
        expected = scene.scan(few, FULL)
        worst = max(float(np.abs(methods[peer][0]() - expected).max()) for peer in ("pymunk", "shapely"))
        rates: dict[str, list[float]] = {peer: [] for peer in methods}
        for _ in range(ROUNDS):
            for peer, (scan, scans) in methods.items():
                began = time.perf_counter()
                scan()
                rates[peer].append(scans * FULL.count / (time.perf_counter() - began))
        for peer, found in rates.items():
            median = statistics.median(found)
            rows.append({"walls": walls, "by": peer, "M rays/s": median / 1e6, "worst round": min(found) / 1e6})
        marks.append(at_least(f"{walls} walls, rays a second", statistics.median(rates["ours"]), least))
        marks.append(at_most(f"{walls} walls, largest difference from the peers, m", worst, 1e-6))
    rates_of = {f"{row['by']}, {row['walls']} walls": row["M rays/s"] for row in rows}
    title = f"{FULL.count} rays of {FULL.range_m:g} m, one core"
    return summarize("rays", title, rows, marks, bars(rates_of, "million rays a second", "log"))


if __name__ == "__main__":
    run(main)
