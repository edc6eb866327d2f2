"""Speed of the simulation relative to real time, without servers but with the calls that servants make.

Each robot has a laser or proximity sensors, and is commanded by its scans ten times a simulated second. As in the real
system, the simulation runs in one process, sensors and clients in another.

python -m bench.simulation.headless [--rounds N]
"""

from __future__ import annotations

import contextlib
import math
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.common.harness import progress, run
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial import floor_format
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.floor_update import WHOLE, BodyKind, FloorUpdate
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.physics import STEP_S, warm_up
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import PROXIMITY, Mount, ScanSpec
from robocorba.simulation.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation.store import SimulationStore
from testkit.generated_buildings import RADIUS_M, office, robots
from testkit.json_process import ObjectProcess
from testkit.report import Mark, at_least, at_most, summarize

# ---- clients of a crowd of robots with their virtual sensor, in a process of their own ----


#: Distance from its rim below which a robot turns away from an obstacle ahead [m].
NEAR_M = 0.35
#: Speed of a robot with free space ahead [m/s].
AHEAD_M_S = 0.8
#: Cosine of half the angle that counts as ahead.
FRONT = 0.7


class Wanderers:
    """Clients that let the named robots wander by their scans, in one call for each floor."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec) -> None:
        self._sensor = VirtualSensor()
        self._sensor.set_map(building)
        self._sensor.warm_up()
        self._names, self._spec = names, spec
        self._front = np.flatnonzero(np.cos(spec.fan.angles) > FRONT)
        self._near_m = NEAR_M + (0.0 if spec.rim_m else RADIUS_M)
        self._chance = np.random.default_rng(5)
        self._side = self._chance.choice((-1.0, 1.0), len(names))
        #: Robots on each floor: their rows in `names`, and their rows in the sensor's copy of the floor.
        self._rows: dict[str, tuple[Longs, Longs]] = {}
        self._distances: Floats = np.empty((len(names), spec.fan.count))

    def commands(self, updates: list[bytes]) -> bytes:
        """Apply encoded updates, scan, and return the encoded commands (robots, 2): speed ahead [m/s] and turn [rad/s],
        along a bend, or on the spot near an obstacle."""
        for update in map(floor_format.loads, updates):
            self._sensor.follow(update, time.monotonic())
            if update.came or update.went:
                self._sort(update.floor)
        for floor, (rows, places) in self._rows.items():
            here = self._sensor.view(floor).motions[places]
            poses = np.column_stack([here["x"], here["y"], here["heading"]])
            self._distances[rows] = self._sensor.scan(floor, poses, Mount(), self._spec).distances
        is_near = self._distances[:, self._front].min(axis=1) < self._near_m
        self._side[self._chance.random(len(is_near)) < 0.02] *= -1.0
        ahead, turn = np.where(is_near, 0.1, AHEAD_M_S), self._side * np.where(is_near, 1.5, 0.2)
        return np.column_stack([ahead, turn]).tobytes()

    def _sort(self, floor: str) -> None:
        """Rebuild the rows after bodies came or went."""
        row_of = {name: row for row, name in enumerate(self._names)}
        bodies = self._sensor.view(floor).bodies.values()
        found = [(row_of[body.name], place) for place, body in enumerate(bodies) if body.kind is BodyKind.ROBOT]
        rows, places = np.array(found, np.int64).reshape(-1, 2).T
        self._rows[floor] = rows, places


@contextlib.contextmanager
def wanderers(building: Building, names: list[str], spec: ScanSpec) -> Iterator[Wanderers]:
    yield Wanderers(building, names, spec)


# ---- the simulation ----


#: Interval between scans and commands of a robot, in simulated time [s].
PERIOD_S = 0.1
STEPS = round(PERIOD_S / STEP_S)
VALID_S = 0.5
WARM_UP_S = 3.0
LASER = ScanSpec(Fan(-math.pi / 2, math.pi / 179, 180, 8.0))
RING = ScanSpec(PROXIMITY, RADIUS_M)


class Case(NamedTuple):
    """seconds: simulated time of a lap. least: required speed relative to real time; None: no requirement."""

    robots: int
    sensor: str
    spec: ScanSpec
    seconds: float
    least: float | None = None


CASES = (
    Case(100, "laser, 180 rays", LASER, 60.0, least=60.0),
    Case(500, "8 proximity", RING, 20.0),
    Case(1000, "8 proximity", RING, 20.0, least=20.0),
    Case(2000, "8 proximity", RING, 10.0),
)
#: Crowds compared for growth, and the largest ratio of their times per robot.
FEWEST, MOST, MAX_GROWTH = 500, 2000, 1.3


class Crowd:
    """Robots in a building, each with a client that lets it wander by its scans. The commands at the end of a period
    are based on the state at its begin."""

    def __init__(self, building: Building, case: Case, store: SimulationStore, clients: ObjectProcess) -> None:
        self.agent = ManagementAgent(building, 1, store)
        self.agent.configure(limit=case.robots)
        self.sessions = [self.agent.register(about) for about in robots(building, case.robots)]
        self._clients, self._versions = clients, dict.fromkeys(building.floors, WHOLE)
        self._send(self._changes())

    def lap(self, seconds: float) -> float:
        """Simulate a time span [s]; returns the speed relative to real time."""
        began, periods = time.perf_counter(), round(seconds / PERIOD_S)
        for _ in range(periods):
            self._period()
        return periods * PERIOD_S / (time.perf_counter() - began)

    def _period(self) -> None:
        for _ in range(STEPS):
            self.agent.step()
        self._send(self._changes())  # before receiving, so that the sensors' process never idles
        commands = np.frombuffer(self._clients.receive()).reshape(-1, 2).tolist()
        for session, (ahead, turn) in zip(self.sessions, commands, strict=True):
            session.command(ahead, 0.0, turn, VALID_S)

    def _changes(self) -> list[FloorUpdate]:
        """Changes of all floors since the last call."""
        updates = [self.agent.database.changes(floor, since) for floor, since in self._versions.items()]
        self._versions = {update.floor: update.version for update in updates}
        return updates

    def _send(self, updates: list[FloorUpdate]) -> None:
        self._clients.send("commands", [floor_format.dumps(update) for update in updates])


@contextlib.contextmanager
def crowd(building: Building, case: Case) -> Iterator[Crowd]:
    """A crowd after its warm-up."""
    names = [about.name for about in robots(building, case.robots)]
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulationStore(Path(folder) / "simulation.sqlite") as store,
        ObjectProcess(wanderers, building, names, case.spec) as clients,
    ):
        found = Crowd(building, case, store, clients)
        found.lap(WARM_UP_S)
        yield found


def row_of(case: Case, factors: list[float]) -> dict[str, Any]:
    """Medians over the laps of a case."""
    median = statistics.median(factors)
    return {
        "robots": case.robots,
        "sensor": case.sensor,
        "x real time": median,
        "worst": min(factors),
        "best": max(factors),
        "us a robot and s": 1e6 / (median * case.robots),
    }


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


def main(rounds: int = 5) -> bool:
    """Each crowd is in a process of its own, as in a simulation server: in one they would compete for its caches."""
    warm_up()  # compile missing kernels once, before several processes start
    laps: list[list[float]] = [[] for _ in CASES]
    with contextlib.ExitStack() as stack:
        remotes = [stack.enter_context(ObjectProcess(crowd, office(), case)) for case in progress(CASES, "logging on")]
        for _ in progress(range(rounds), "rounds"):
            for case, remote, case_laps in zip(CASES, remotes, laps, strict=True):
                case_laps.append(remote.call("lap", case.seconds))
    rows = [row_of(case, case_laps) for case, case_laps in zip(CASES, laps, strict=True)]
    speeds = {f"{case.robots} robots": case_laps for case, case_laps in zip(CASES, laps, strict=True)}
    title = f"office of 4 floors, two processes, medians of {rounds} rounds"
    return summarize("simulation_headless", title, rows, marks_of(rows), speeds, "x real time")


if __name__ == "__main__":
    run(main, rounds="of all cases in turn")
