"""Clients of a crowd of robots with their virtual sensor, for a process of their own: they receive floor updates, scan,
and answer with a command for each robot."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence

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


class Stopwatch:
    """Wall time of each part of the work of this process, and its CPU time [s]."""

    def __init__(self, parts: Sequence[str]) -> None:
        self.parts = dict.fromkeys(parts, 0.0)
        self._at, self._worked = time.perf_counter(), time.process_time()

    def end(self, part: str = "") -> None:
        """End a part, which began when the last one ended; without a name it counts for none."""
        now = time.perf_counter()
        if part:
            self.parts[part] += now - self._at
        self._at = now

    def take(self) -> tuple[dict[str, float], float]:
        """The times of the parts and the CPU time since the last call."""
        parts, before = self.parts, self._worked
        self.parts, self._worked = dict.fromkeys(parts, 0.0), time.process_time()
        return parts, self._worked - before


class Wanderers:
    """Clients that let the named robots wander by their scans. one_by_one: one scan call for each robot, as through the
    robots' own references; else one call for each floor."""

    def __init__(self, building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> None:
        self._sensor = VirtualSensor()
        self._sensor.know(building)
        self._sensor.warm_up()
        self._names, self._spec, self._one_by_one = names, spec, one_by_one
        self._front = np.flatnonzero(np.cos(spec.fan.angles) > FRONT)
        self._near_m = NEAR_M + (0.0 if spec.rim_m else RADIUS_M)
        self._chance = np.random.default_rng(5)
        self._side = self._chance.choice((-1.0, 1.0), len(names))
        #: Robots on each floor: their rows in `names`, and their rows in the sensor's copy of the floor.
        self._rows: dict[str, tuple[Longs, Longs]] = {}
        self.distances: Floats = np.empty((len(names), spec.fan.count))
        self._watch = Stopwatch(PARTS)
        self.take = self._watch.take

    def commands(self, updates: list[bytes]) -> bytes:
        """Apply encoded updates, scan, and return the encoded commands."""
        self._watch.end()
        self.follow([floor_format.loads(update) for update in updates])
        self.scan()
        return self.wander().tobytes()

    def follow(self, updates: list[FloorUpdate]) -> None:
        """Apply updates."""
        for update in updates:
            self._sensor.follow(update, time.monotonic())
            if update.came or update.went:
                self._sort(update.floor)
        self._watch.end("following")

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
        self._watch.end("scans")

    def wander(self) -> Floats:
        """Commands (robots, 2): speed ahead [m/s] and turn [rad/s], along a bend, or on the spot near an obstacle."""
        is_near = self.distances[:, self._front].min(axis=1) < self._near_m
        self._side[self._chance.random(len(is_near)) < 0.02] *= -1.0
        ahead, turn = np.where(is_near, 0.1, AHEAD_M_S), self._side * np.where(is_near, 1.5, 0.2)
        self._watch.end("wandering")
        return np.column_stack([ahead, turn])

    def _sort(self, floor: str) -> None:
        """Rebuild the rows after bodies came or went."""
        row_of = {name: row for row, name in enumerate(self._names)}
        bodies = self._sensor.view(floor).bodies.values()
        found = [(row_of[body.name], place) for place, body in enumerate(bodies) if body.kind is BodyKind.ROBOT]
        rows, places = np.array(found, np.int64).reshape(-1, 2).T
        self._rows[floor] = rows, places


@contextlib.contextmanager
def wanderers(building: Building, names: list[str], spec: ScanSpec, one_by_one: bool) -> Iterator[Wanderers]:
    yield Wanderers(building, names, spec, one_by_one)
