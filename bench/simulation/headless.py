"""Speed of the simulation relative to real time, without servers but with the calls that servants make.

Each robot has a laser or proximity sensors, and is commanded by its scans ten times a simulated second. As in the real
system, the simulation runs in one process, sensors and clients in another.

python -m bench.simulation.headless [--rounds N] [--profile ROBOTS]
"""

from __future__ import annotations

import argparse
import contextlib
import cProfile
import gc
import math
import multiprocessing
import pstats
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from bench import RESULTS
from bench.simulation.building import RADIUS_M, office, robots
from bench.simulation.headless_clients import PARTS, WandererProcess
from robocorba.maps.model import Building
from robocorba.sensing.fan import PROXIMITY, Fan
from robocorba.sensing.virtual_sensor import ScanSpec
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S, warm_up
from robocorba.simulation.store import SimulationStore
from robocorba.spatial.floor_update import WHOLE, FloorUpdate
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, summarize

NAME = "simulation_headless"
#: Interval between scans and commands of a robot, in simulated time [s].
PERIOD_S = 0.1
STEPS = round(PERIOD_S / STEP_S)
#: Parts of a period in the simulation's process.
OURS = ("steps", "database", "waiting", "telling", "commands")
VALID_S = 0.5
WARM_UP_S = 3.0
LASER = ScanSpec(Fan(-math.pi / 2, math.pi / 179, 180, 8.0))
RING = ScanSpec(PROXIMITY, RADIUS_M)


class Case(NamedTuple):
    """seconds: simulated time of a lap. one_by_one: one scan call for each robot, as by its own reference; else one for
    each floor. least: required speed relative to real time; None: no requirement."""

    robots: int
    sensor: str
    spec: ScanSpec
    seconds: float
    one_by_one: bool = False
    least: float | None = None


CASES = (
    Case(100, "laser, 180 rays", LASER, 60.0, least=60.0),
    Case(100, "laser, one by one", LASER, 60.0, one_by_one=True),
    Case(500, "8 proximity", RING, 20.0),
    Case(1000, "8 proximity", RING, 20.0, least=20.0),
    Case(2000, "8 proximity", RING, 10.0),
)
ROUNDS = 5
#: Crowds compared for growth, and the largest ratio of their times per robot.
FEWEST, MOST, MAX_GROWTH = 500, 2000, 1.3


class Lap(NamedTuple):
    """factor: speed relative to real time. cores: busy cores of both processes. parts: time of the simulation's process
    (OURS) and of the sensors' process (PARTS) [s]."""

    factor: float
    cores: float
    parts: dict[str, float]
    collisions: int


class Crowd:
    """Robots in a building, each with a client that lets it wander by its scans."""

    def __init__(self, building: Building, case: Case, store: SimulationStore, clients: WandererProcess) -> None:
        self.agent = ManagementAgent(building, 1, store)
        self.agent.configure(limit=case.robots)
        self.sessions = [self.agent.register(about) for about in robots(building, case.robots)]
        self._clients, self._versions = clients, dict.fromkeys(building.floors, WHOLE)
        self.parts = dict.fromkeys(OURS, 0.0)
        self._at = 0.0
        clients.send(self._changes())

    def lap(self, seconds: float) -> Lap:
        """Simulate a time span [s], and measure it."""
        self.parts = dict.fromkeys(self.parts, 0.0)
        collided, worked = self.agent.collisions, time.process_time()
        began = self._at = time.perf_counter()
        periods = round(seconds / PERIOD_S)
        for _ in range(periods):
            self.period()
        took, worked = time.perf_counter() - began, time.process_time() - worked
        theirs = self._clients.work()
        cores = (worked + theirs.cpu_s) / took
        parts = self.parts | theirs.parts
        return Lap(periods * PERIOD_S / took, cores, parts, self.agent.collisions - collided)

    def period(self) -> None:
        """Simulate PERIOD_S. The commands at its end are based on the state at its begin."""
        for _ in range(STEPS):
            self.agent.step()
        self._end_of("steps")
        updates = self._changes()
        self._end_of("database")
        self._clients.send(updates)  # before receiving, so that the sensors' process never idles
        self._end_of("telling")
        commands = self._clients.commands()
        self._end_of("waiting")
        for session, (ahead, turn) in zip(self.sessions, commands, strict=True):
            session.command(ahead, 0.0, turn, VALID_S)
        self._end_of("commands")

    def _changes(self) -> list[FloorUpdate]:
        """Changes of all floors since the last call."""
        updates = [self.agent.database.changes(floor, since) for floor, since in self._versions.items()]
        self._versions = {update.floor: update.version for update in updates}
        return updates

    def _end_of(self, part: str) -> None:
        now = time.perf_counter()
        self.parts[part] += now - self._at
        self._at = now


@contextlib.contextmanager
def crowd(building: Building, case: Case) -> Iterator[Crowd]:
    """A crowd after its warm-up."""
    names = [about.name for about in robots(building, case.robots)]
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulationStore(Path(folder) / "simulation.sqlite") as store,
        contextlib.closing(WandererProcess(building, names, case.spec, case.one_by_one)) as clients,
    ):
        found = Crowd(building, case, store, clients)
        found.lap(WARM_UP_S)
        yield found


@contextlib.contextmanager
def in_own_process(case: Case) -> Iterator[Callable[[], Lap]]:
    """Runs laps of a crowd in a process of its own, as a simulation server does; crowds in one process would compete
    for the processor's caches."""
    processes = multiprocessing.get_context("spawn")
    ours, theirs = processes.Pipe()
    process = processes.Process(target=_make_laps, args=(case, theirs))
    process.start()
    theirs.close()
    ours.recv()

    def lap() -> Lap:
        ours.send(None)
        found: Lap = ours.recv()
        return found

    try:
        yield lap
    finally:
        ours.close()
        process.join()


def _make_laps(case: Case, connection: Connection) -> None:
    """Run a lap for each request, until the connection closes."""
    with crowd(office(), case) as found, contextlib.suppress(EOFError):
        gc.collect()
        gc.freeze()  # as servers do
        connection.send(None)
        while True:
            connection.recv()
            connection.send(found.lap(case.seconds))


def row_of(case: Case, laps: list[Lap]) -> dict[str, Any]:
    """Medians over the laps of a case."""
    factors = [lap.factor for lap in laps]
    median = statistics.median(factors)
    minutes = case.robots * len(laps) * case.seconds / 60
    return {
        "robots": case.robots,
        "sensor": case.sensor,
        "x real time": median,
        "worst": min(factors),
        "best": max(factors),
        "cores": statistics.median(lap.cores for lap in laps),
        "us a robot and s": 1e6 / (median * case.robots),
        "hits a robot and min": sum(lap.collisions for lap in laps) / minutes,
    }


def parts_of(case: Case, laps: list[Lap]) -> dict[str, Any]:
    """Time of each part [us per robot and period], medians over laps; "all" sums the simulation's process."""
    periods = case.robots * case.seconds / PERIOD_S
    parts = {part: 1e6 * statistics.median(lap.parts[part] for lap in laps) / periods for part in laps[0].parts}
    ours = {part: parts.pop(part) for part in OURS}
    return {"robots": case.robots, "sensor": case.sensor, **ours, "all": sum(ours.values()), **parts}


def marks_of(rows: list[dict[str, Any]], cases: tuple[Case, ...] = CASES) -> list[Mark]:
    """Required results."""
    marks = [
        at_least(f"{case.robots} robots, {case.sensor}: x real time", row["x real time"], case.least)
        for case, row in zip(cases, rows, strict=True)
        if case.least is not None
    ]
    cost = {row["robots"]: row["us a robot and s"] for row in rows}
    growth = cost[MOST] / cost[FEWEST]
    return [*marks, at_most(f"time a robot, {MOST} robots to {FEWEST}", growth, MAX_GROWTH)]


def profile(count: int) -> None:
    """Profile the simulation's process in a case, and print the time by function."""
    case = next(case for case in CASES if case.robots == count)
    with crowd(office(), case) as found:
        profiler = cProfile.Profile()
        profiler.runcall(found.lap, case.seconds / 2)
    pstats.Stats(profiler).sort_stats("tottime").print_stats(30)


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of all cases in turn (default: %(default)s)")
    parser.add_argument(
        "--profile", type=int, metavar="ROBOTS", help="only profile the case with this number of robots"
    )
    options = parser.parse_args()
    warm_up()  # compile missing kernels once, before several processes start
    if options.profile:
        profile(options.profile)
        return 0
    laps: list[list[Lap]] = [[] for _ in CASES]
    with contextlib.ExitStack() as stack:
        with PROGRESS.status("logging robots on"):
            crowds = [stack.enter_context(in_own_process(case)) for case in CASES]
        for round_ in range(options.rounds):
            for case, lap, case_laps in zip(CASES, crowds, laps, strict=True):
                with PROGRESS.status(f"round {round_ + 1} of {options.rounds}: {case.robots} robots, {case.sensor}"):
                    case_laps.append(lap())
    rows = [row_of(case, case_laps) for case, case_laps in zip(CASES, laps, strict=True)]
    parts = [parts_of(case, case_laps) for case, case_laps in zip(CASES, laps, strict=True)]
    title = f"office of 4 floors, two processes, medians of {options.rounds} rounds"
    summarize(
        RESULTS / f"{NAME}_parts",
        f"{title}: us for a robot in {PERIOD_S} s",
        parts,
        [],
        lambda axes: _draw_parts(axes, parts),
    )
    return 0 if summarize(RESULTS / NAME, title, rows, marks_of(rows), lambda axes: _draw(axes, rows)) else 1


def _draw(axes: Axes, rows: list[dict[str, Any]]) -> None:
    axes.barh(_labels(rows), [row["x real time"] for row in rows])
    axes.set(xscale="log", xlabel="times real time")


def _draw_parts(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """Two bars each: the simulation's process above, the sensors' below."""
    for side, parts in ((0.2, OURS), (-0.2, PARTS)):
        left, places = np.zeros(len(rows)), np.arange(len(rows)) + side
        for part in parts:
            widths = [row[part] for row in rows]
            axes.barh(places, widths, 0.38, left=left, label=part)
            left += widths
    axes.set_yticks(np.arange(len(rows)), _labels(rows))
    axes.set(xlabel=f"microseconds for a robot in {PERIOD_S} s")
    axes.legend()


def _labels(rows: list[dict[str, Any]]) -> list[str]:
    return [f"{row['robots']} robots,\n{row['sensor']}" for row in rows]


if __name__ == "__main__":
    sys.exit(main())
