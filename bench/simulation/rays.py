"""Rays per second on one core, on floors of 300 and of 6,000 walls: python -m bench.simulation.rays"""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import numpy as np
import shapely
from shapely import LineString

from bench.common.harness import run
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.visible_obstacles import VisibleObstacles
from testkit.report import at_least, bars, summarize

FULL = Fan(-math.pi, 2 * math.pi / 360, 360, 30.0)
#: Number of walls, side of the floor [m], required rays per second.
FLOORS = ((300, 60.0, 8e6), (6000, 250.0, 6.6e6))
SCANS, ROUNDS = 500, 7


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


def main() -> bool:
    rows: list[dict[str, Any]] = []
    marks = []
    for walls, side, least in FLOORS:
        scene, places = VisibleObstacles(floor(walls, side)), poses(SCANS, side)
        scene.scan(places, FULL)
        rates: list[float] = []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            scene.scan(places, FULL)
            rates.append(SCANS * FULL.count / (time.perf_counter() - began))
        median = statistics.median(rates)
        rows.append({"walls": walls, "M rays/s": median / 1e6, "worst round": min(rates) / 1e6})
        marks.append(at_least(f"{walls} walls, rays a second", median, least))
    rates_of = {f"{row['walls']} walls": row["M rays/s"] for row in rows}
    title = f"{FULL.count} rays of {FULL.range_m:g} m, one core"
    return summarize("rays", title, rows, marks, bars(rates_of, "million rays a second"))


if __name__ == "__main__":
    run(main)
