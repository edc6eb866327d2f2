"""Clients of a crowd of robots with their virtual sensor, in a process of their own: they receive floor updates, scan,
and answer with a command for each robot."""

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
#: Distance from its rim below which a robot turns away from an obstacle ahead [m].
NEAR_M = 0.35
#: Speed of a robot with free space ahead [m/s].
AHEAD_M_S = 0.8
#: Cosine of half the angle that counts as ahead.
FRONT = 0.7


class Work(NamedTuple):
    """Time since the last request [s]: wall time of each of PARTS, and CPU time in total."""

    parts: dict[str, float]
    cpu_s: float


class Wanderers:
    """Clients that let the named robots wander by their scans. one_by_one: one scan call for each robot, as through the
    robots' own references; else one call for each floor."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        self._sensor = VirtualSensor()
        self._sensor.set_map(building)
        self._sensor.warm_up()
        self._names, self._spec, self._one_by_one = names, spec, one_by_one
        self._front = np.flatnonzero(np.cos(spec.fan.angles) > FRONT)
        self._near_m = NEAR_M + (0.0 if spec.rim_m else RADIUS_M)
        self._chance = np.random.default_rng(5)
        self._side = self._chance.choice((-1.0, 1.0), len(names))
        #: Robots on each floor: their rows in `names`, and their rows in the sensor's copy of the floor.
        self._rows: dict[str, tuple[Longs, Longs]] = {}
        self.distances: Floats = np.empty((len(names), spec.fan.count))
        self._parts = dict.fromkeys(PARTS, 0.0)
        self._at, self._worked = time.perf_counter(), time.process_time()

    def follow(self, updates: list[FloorUpdate]) -> None:
        """Apply updates."""
        self._at = time.perf_counter()
        for update in updates:
            self._sensor.follow(update, time.monotonic())
            if update.came or update.went:
                self._sort(update.floor)
        self._end_of("following")

    def scan(self) -> None:
        """Scan with all sensors into `distances` (robots, rays) [m]."""
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
        """Commands (robots, 2): speed ahead [m/s] and turn [rad/s], along a bend, or on the spot near an obstacle."""
        is_near = self.distances[:, self._front].min(axis=1) < self._near_m
        change = self._chance.random(len(is_near)) < 0.02
        self._side[change] *= -1.0
        commands = np.empty((len(is_near), 2))
        commands[:, 0] = np.where(is_near, 0.1, AHEAD_M_S)
        commands[:, 1] = self._side * np.where(is_near, 1.5, 0.2)
        self._end_of("wandering")
        return commands

    def work(self) -> Work:
        """Time spent since the last call."""
        parts, worked = self._parts, time.process_time()
        self._parts = dict.fromkeys(PARTS, 0.0)
        cpu_s, self._worked = worked - self._worked, worked
        return Work(parts, cpu_s)

    def _sort(self, floor: str) -> None:
        """Rebuild the rows after bodies came or went."""
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
    """Wanderers in a process of their own; their commands are based on the updates of the previous period."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        processes = multiprocessing.get_context("spawn")
        self._ours, theirs = processes.Pipe()
        self._process = processes.Process(target=_answer, args=(theirs, building, names, spec, one_by_one), daemon=True)
        self._process.start()
        theirs.close()
        self._shape = len(names), 2
        #: Commands received by `work` before `commands` was called.
        self._early = b""

    def send(self, updates: list[FloorUpdate]) -> None:
        """Send updates; the process answers later."""
        self._ours.send([floor_format.dumps(update) for update in updates])

    def commands(self) -> list[list[float]]:
        """Receive speed ahead [m/s] and turn [rad/s] of each robot, once after each `send`."""
        packed, self._early = self._early or self._ours.recv_bytes(), b""
        found: list[list[float]] = np.frombuffer(packed).reshape(self._shape).tolist()
        return found

    def work(self) -> Work:
        """Work of the process; call it between `send` and `commands`."""
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
