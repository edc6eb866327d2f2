"""Physics of a building of five floors with 1,000 robots: by one thread, and by threads side by side.

    python -m bench.simulation.floors [--rounds N] [--count ROBOTS]

Both take turns in one process and on one building, lap by lap: a busy moment hits both of them, and since their results
are the same bit for bit, both simulate the same crowd."""

from __future__ import annotations

import os
import statistics
import time

import numpy as np

from bench.common.harness import progress, run
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.floor_pool import FloorPool
from robocorba.simulation.physics import STEP_S, warm_up
from testkit.generated_buildings import office, robots
from testkit.report import at_least, bars, summarize

LEVELS, ROBOTS = 5, 1000
#: Steps of a lap, after which every robot gets a new command.
LAP_STEPS = 25
#: Required pace side by side to that of one thread.
LEAST = 1.5
ALONE, TOGETHER = "one thread", "a thread for each core"


def lap(world: SimulatedBuilding, chance: np.random.Generator) -> tuple[float, float]:
    """Let all robots drive along new bends: simulated seconds in a second, and busy cores."""
    occupants = list(world.occupants.robots.values())
    for robot, turn in zip(occupants, chance.uniform(-1.0, 1.0, len(occupants)).tolist(), strict=True):
        robot.command(0.8, 0.0, turn, 5.0)
    began, cpu = time.perf_counter(), time.process_time()
    for _ in range(LAP_STEPS):
        world.step()
    took_s = time.perf_counter() - began
    return LAP_STEPS * STEP_S / took_s, (time.process_time() - cpu) / took_s


def main(rounds: int = 200, count: int = ROBOTS) -> bool:
    warm_up()
    building = office(levels=LEVELS)
    world, chance = SimulatedBuilding(building), np.random.default_rng(1)
    for about in robots(building, count):
        world.add(about)
    cores = len(os.sched_getaffinity(0))
    pools = {ALONE: FloorPool(1), TOGETHER: FloorPool(max(2, cores))}
    laps: dict[str, list[tuple[float, float]]] = {way: [] for way in pools}
    for round_ in progress(range(-3, rounds), "rounds"):  # the first ones do not count
        for way in sorted(pools, reverse=round_ % 2 == 0):
            world.pool = pools[way]
            found = lap(world, chance)
            if round_ >= 0:
                laps[way].append(found)
    for pool in pools.values():
        pool.close()
    paces = {way: statistics.median(pace for pace, _ in found) for way, found in laps.items()}
    rows = [
        {"steps by": way, "x real time": paces[way], "cores": statistics.median(busy for _, busy in found)}
        for way, found in laps.items()
    ]
    title = f"{LEVELS} floors, {count} robots, {cores} cores, medians of {rounds} laps"
    marks = [at_least(f"{TOGETHER}: pace to that of one thread", paces[TOGETHER] / paces[ALONE], LEAST)]
    return summarize("simulation_floors", title, rows, marks, bars(paces, "x real time"))


if __name__ == "__main__":
    run(main, rounds="laps of each way", count="number of robots")
