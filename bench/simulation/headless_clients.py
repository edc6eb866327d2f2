"""The clients of a crowd of robots, and the virtual sensor that they ask, in a process of their own: they are told what
changed on the floors, scan, and answer with a command for each robot."""

from __future__ import annotations

import gc
import multiprocessing
import time
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np

from bench.simulation.building import RADIUS_M
from robocorba.maps.model import Building
from robocorba.sensing.virtual_sensor import Mount, ScanSpec, VirtualSensor
from robocorba.spatial import floor_format
from robocorba.spatial.floor_update import BodyKind, FloorUpdate
from robocorba.spatial.grids import Floats, Longs

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
        #: Robots on each floor: their rows in `names`, and in what the sensor knows of the floor.
        self._rows: dict[str, tuple[Longs, Longs]] = {}
        self.distances: Floats = np.empty((len(names), spec.fan.count))
        self._parts = dict.fromkeys(PARTS, 0.0)
        self._at, self._worked = time.perf_counter(), time.process_time()

    def follow(self, updates: list[FloorUpdate]) -> None:
        """Take over what changed."""
        self._at = time.perf_counter()
        for update in updates:
            self._sensor.follow(update, time.monotonic())
            if update.came or update.went:
                self._sort(update.floor)
        self._end_of("following")

    def scan(self) -> None:
        """Let all sensors see: `distances` (robots, rays), m."""
        for floor, (rows, places) in self._rows.items():
            here = self._sensor.view(floor).motions[places]
            poses = np.column_stack([here["x"], here["y"], here["heading"]])
            if self._one_by_one:
                for row, pose in zip(rows.tolist(), poses, strict=True):
                    found = self._sensor.scan(floor, pose[np.newaxis], Mount(), self._spec, self._names[row])
                    self.distances[row] = found.distances
            else:
                self.distances[rows] = self._sensor.scan(floor, poses, Mount(), self._spec).distances
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

    def _sort(self, floor: str) -> None:
        """Bodies came or went."""
        row_of = {name: row for row, name in enumerate(self._names)}
        bodies = self._sensor.view(floor).bodies.values()
        found = [(row_of[body.name], place) for place, body in enumerate(bodies) if body.kind is BodyKind.ROBOT]
        rows, places = np.array(found, np.int64).reshape(-1, 2).T
        self._rows[floor] = rows, places

    def _end_of(self, part: str) -> None:
        now = time.perf_counter()
        self._parts[part] += now - self._at
        self._at = now


class WandererProcess:
    """Wanderers in a process of their own. What they say is of the floors as they were told the time before."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        processes = multiprocessing.get_context("spawn")
        self._ours, theirs = processes.Pipe()
        self._process = processes.Process(target=_answer, args=(theirs, building, names, spec, one_by_one), daemon=True)
        self._process.start()
        theirs.close()
        self._shape = len(names), 2
        #: Commands that came before they were asked for.
        self._early = b""

    def tell(self, updates: list[FloorUpdate]) -> None:
        """What changed since the last time; they answer later."""
        self._ours.send([floor_format.dumps(update) for update in updates])

    def commands(self) -> list[list[float]]:
        """Of each robot, once each time after `tell`: ahead, m/s, and turn, rad/s."""
        packed, self._early = self._early or self._ours.recv_bytes(), b""
        found: list[list[float]] = np.frombuffer(packed).reshape(self._shape).tolist()
        return found

    def work(self) -> Work:
        """As that of Wanderers; between `tell` and `commands`."""
        self._ours.send(None)
        self._early = self._ours.recv_bytes()
        found: Work = self._ours.recv()
        return found

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
        clients.follow([floor_format.loads(update) for update in updates])
        clients.scan()
        connection.send_bytes(clients.wander().tobytes())
