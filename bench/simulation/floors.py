"""Physics of a building of five floors with 1,000 robots: by one thread, and by threads side by side.

Ways take turns in one process and on one building, lap by lap: a busy moment hits all of them, and since their results
are the same bit for bit, all simulate the same crowd.

python -m bench.simulation.floors [--rounds N] [--count ROBOTS]
"""

from __future__ import annotations

import contextlib
import os
import statistics
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.common.harness import progress, run
from robocorba.simulation import bodies, physics
from robocorba.simulation.building import SimulatedBuilding
from robocorba.simulation.floor_pool import FloorPool
from robocorba.simulation.physics import STEP_S, warm_up
from testkit.generated_buildings import office, robots
from testkit.report import at_least, bars, quantile, summarize

NAME = "simulation_floors"
LEVELS, ROBOTS = 5, 1000
#: Steps of a lap, after which every robot gets a new command.
LAP_STEPS = 25
#: Pace side by side to that of one thread.
LEAST = 1.5
ALONE, TOGETHER, CHOSEN = "one thread", "a thread for each core", "as the pool chooses"


class Lap(NamedTuple):
    """steps_s: duration of each step [s]. cpu_s: CPU time of all steps [s]."""

    steps_s: list[float]
    cpu_s: float


def lap(world: SimulatedBuilding) -> Lap:
    steps_s, cpu = [], time.process_time()
    for _ in range(LAP_STEPS):
        began = time.perf_counter()
        world.step()
        steps_s.append(time.perf_counter() - began)
    return Lap(steps_s, time.process_time() - cpu)


def command(world: SimulatedBuilding, chance: np.random.Generator) -> None:
    """Let all robots drive along new bends."""
    for robot, turn in zip(
        world.occupants.robots.values(), chance.uniform(-1.0, 1.0, len(world.occupants.robots)).tolist(), strict=True
    ):
        robot.command(0.8, 0.0, turn, 5.0)


def row_of(way: str, laps: list[Lap]) -> dict[str, Any]:
    steps_s = [step for lap in laps for step in lap.steps_s]
    wall_s = sum(steps_s)
    pace = statistics.median(len(lap.steps_s) * STEP_S / sum(lap.steps_s) for lap in laps)
    return {
        "steps by": way,
        "x real time": pace,
        "us a step, median": 1e6 * statistics.median(steps_s),
        "fastest hundredth": 1e6 * quantile(steps_s, 0.01),
        "slowest tenth": 1e6 * quantile(steps_s, 0.9),
        "CPU us a step": 1e6 * sum(lap.cpu_s for lap in laps) / len(steps_s),
        "cores": sum(lap.cpu_s for lap in laps) / wall_s,
    }


class Timed:
    """A function, or the functions of a module, with the CPU time of their calls in `total` [s]."""

    total = 0.0

    def __init__(self, wrapped: Any) -> None:
        self._wrapped = wrapped

    def __getattr__(self, name: str) -> Any:
        function = getattr(self._wrapped, name)
        timed = Timed(function) if callable(function) else function
        setattr(self, name, timed)
        return timed

    def __call__(self, *arguments: Any) -> Any:
        began = time.thread_time()
        try:
            return self._wrapped(*arguments)
        finally:
            Timed.total += time.thread_time() - began


@contextlib.contextmanager
def timed() -> Iterator[None]:
    """Time everything in a step that releases the interpreter's lock: Chipmunk's functions and the kernel."""
    import pymunk.space

    places = ((pymunk.space, "lib"), (bodies, "lib"), (physics, "control"))
    before = [getattr(module, name) for module, name in places]
    for (module, name), value in zip(places, before, strict=True):
        setattr(module, name, Timed(value))
    try:
        yield
    finally:
        for (module, name), value in zip(places, before, strict=True):
            setattr(module, name, value)


def locked_share(world: SimulatedBuilding, chance: np.random.Generator, laps: int = 20) -> float:
    """Share of a step's CPU time in which its thread holds the interpreter's lock."""
    command(world, chance)
    Timed.total = 0.0
    with timed():
        cpu_s = sum(lap(world).cpu_s for _ in range(laps))
    return 1.0 - Timed.total / cpu_s


def main(rounds: int = 200, count: int = ROBOTS) -> bool:
    warm_up()
    building = office(levels=LEVELS)
    world, chance = SimulatedBuilding(building), np.random.default_rng(1)
    for about in robots(building, count):
        world.add(about)
    cores = len(os.sched_getaffinity(0))
    pools = {ALONE: FloorPool(1), TOGETHER: FloorPool(max(2, cores)), CHOSEN: FloorPool()}
    laps: dict[str, list[Lap]] = {way: [] for way in pools}
    for round_ in progress(range(-3, rounds), "rounds"):
        ways = list(pools)
        for turn in range(len(ways)):
            way = ways[(round_ + turn) % len(ways)]  # each one is as often the first
            world.pool = pools[way]
            command(world, chance)
            found = lap(world)
            if round_ >= 0:
                laps[way].append(found)
    world.pool = pools[ALONE]
    share = locked_share(world, chance)
    for pool in pools.values():
        pool.close()
    rows = [row_of(way, of_way) for way, of_way in laps.items()]
    for row in rows:
        row["to one thread"] = row["x real time"] / rows[0]["x real time"]
        row["fastest hundredth to one thread"] = rows[0]["fastest hundredth"] / row["fastest hundredth"]
    load = "load " + ", ".join(f"{value:.1f}" for value in os.getloadavg())
    title = (
        f"{LEVELS} floors, {count} robots, {cores} cores, {load}, medians of {rounds} laps; "
        f"{share:.0%} of a step holds the interpreter's lock"
    )
    marks = [at_least(f"{TOGETHER}: pace to that of one thread", rows[1]["to one thread"], LEAST)]
    return summarize(
        NAME, title, rows, marks, bars({row["steps by"]: row["x real time"] for row in rows}, "x real time")
    )


if __name__ == "__main__":
    run(main, rounds="laps of each way", count="number of robots")
