"""The clients of a crowd of robots, and the virtual sensor that they ask, in a process of their own: they are told what
changed on the floors, scan, and answer with a command for each robot."""

from __future__ import annotations

import gc
import multiprocessing
import time
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from bench.simulation_building import RADIUS_M
from robocorba.grids import Floats
from robocorba.maps.model import Building
from robocorba.sensing.virtual_sensor import Mount, ScanSpec, VirtualSensor
from robocorba.simulation.floor_update import BodyKind, FloorUpdate

PARTS = ("following", "scans", "wandering")
#: A robot turns away from what is nearer than this in front of it, m from its rim; otherwise it goes ahead, m/s.
NEAR_M, AHEAD_M_S = 0.35, 0.8
#: In front is so far to each side, as a cosine.
FRONT = 0.7


class Work(NamedTuple):
    """Since the last time it was asked for, s: for each of PARTS, and of a core in all."""

    parts: dict[str, float]
    cpu_s: float


class Wanderers:
    """Of the robots with these names, which wander about by what their sensors see. one_by_one: each scan is a call of
    its own, as by robots' own sensors; else one for all of a floor."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        self._sensor = VirtualSensor()
        self._sensor.know(building)
        self._sensor.warm_up()
        self._names, self._spec, self._one_by_one = names, spec, one_by_one
        self._front = np.flatnonzero(np.cos(spec.fan.angles) > FRONT)
        self._near_m = NEAR_M + (0.0 if spec.rim_m else RADIUS_M)
        self._chance = np.random.default_rng(5)
        self._side = self._chance.choice((-1.0, 1.0), len(names))
        #: By row of `names`: x, y, heading; a row more is for what is no robot.
        self._poses = np.zeros((len(names) + 1, 3))
        #: Row of each number that bodies have, and numbers of the robots on each floor.
        self._row_of = np.zeros(0, np.int64)
        self._on_floor: dict[str, set[int]] = {name: set() for name in building.floors}
        self._rows: dict[str, Any] = {}
        self.distances: Floats = np.empty((len(names), spec.fan.count))
        self._parts = dict.fromkeys(PARTS, 0.0)
        self._at, self._worked = time.perf_counter(), time.process_time()

    def follow(self, updates: list[FloorUpdate]) -> None:
        """Take over what changed, and with it where the robots are."""
        self._at = time.perf_counter()
        for update in updates:
            self._sensor.follow(update, time.monotonic())
            if update.came or update.went:
                self._sort(update)
            moved = update.motions
            self._poses[self._row_of[moved["number"]]] = np.column_stack([moved["x"], moved["y"], moved["heading"]])
        self._end_of("following")

    def scan(self) -> None:
        """Let all sensors see: `distances` (robots, rays), m."""
        for floor, rows in self._rows.items():
            if self._one_by_one:
                for row in rows:
                    here = self._poses[row : row + 1]
                    found = self._sensor.scan(floor, here, Mount(), self._spec, self._names[row])
                    self.distances[row] = found.distances
            else:
                self.distances[rows] = self._sensor.scan(floor, self._poses[rows], Mount(), self._spec).distances
        self._end_of("scans")

    def wander(self) -> Floats:
        """Ahead, m/s, and turn, rad/s, of each robot (robots, 2): on with a bend, or about where something is near."""
        is_near = self.distances[:, self._front].min(axis=1) < self._near_m
        change = self._chance.random(len(is_near)) < 0.02
        self._side[change] *= -1.0
        commands = np.empty((len(is_near), 2))
        commands[:, 0] = np.where(is_near, 0.1, AHEAD_M_S)
        commands[:, 1] = self._side * np.where(is_near, 1.5, 0.2)
        self._end_of("wandering")
        return commands

    def work(self) -> Work:
        """What it took since this was asked for last."""
        parts, worked = self._parts, time.process_time()
        self._parts = dict.fromkeys(PARTS, 0.0)
        cpu_s, self._worked = worked - self._worked, worked
        return Work(parts, cpu_s)

    def _sort(self, update: FloorUpdate) -> None:
        """Bodies came or went."""
        row_of = {name: row for row, name in enumerate(self._names)}
        here = self._on_floor[update.floor]
        here.difference_update(update.went)
        for body in update.came:
            if body.number >= len(self._row_of):
                more = np.full(body.number + 1 - len(self._row_of), len(self._names))
                self._row_of = np.concatenate([self._row_of, more])
            if body.kind is BodyKind.ROBOT:
                self._row_of[body.number] = row_of[body.name]
                here.add(body.number)
        rows = {floor: self._row_of[list(numbers)] for floor, numbers in self._on_floor.items()}
        self._rows = {floor: np.sort(found) for floor, found in rows.items() if len(found)}

    def _end_of(self, part: str) -> None:
        now = time.perf_counter()
        self._parts[part] += now - self._at
        self._at = now


class Elsewhere:
    """Wanderers in a process of their own. What they say is of the floors as they were told the time before."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        processes = multiprocessing.get_context("spawn")
        self._ours, theirs = processes.Pipe()
        self._process = processes.Process(target=_answer, args=(theirs, building, names, spec, one_by_one), daemon=True)
        self._process.start()
        theirs.close()
        self._shape = len(names), 2
        #: Commands that came before they were asked for.
        self._early: list[bytes] = []
        self._owed = 0

    def tell(self, updates: list[FloorUpdate]) -> None:
        """What changed since the last time; they answer later."""
        self._ours.send(updates)
        self._owed += 1

    def commands(self) -> list[list[float]]:
        """Of each robot, when it has been told once more than it was asked: ahead, m/s, and turn, rad/s."""
        packed = self._early.pop() if self._early else self._next()
        found: list[list[float]] = np.frombuffer(packed).reshape(self._shape).tolist()
        return found

    def work(self) -> Work:
        """As that of Wanderers."""
        self._ours.send(None)
        while self._owed:
            self._early.insert(0, self._next())
        found: Work = self._ours.recv()
        return found

    def _next(self) -> bytes:
        self._owed -= 1
        return self._ours.recv_bytes()

    def close(self) -> None:
        self._ours.close()
        self._process.join()


def _answer(connection: Connection, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
    clients = Wanderers(building, names, spec, one_by_one)
    gc.collect()
    gc.freeze()  # as servers do
    while True:
        try:
            updates = connection.recv()
        except EOFError:
            return
        if updates is None:
            connection.send(clients.work())
            continue
        clients.follow(updates)
        clients.scan()
        connection.send_bytes(clients.wander().tobytes())
