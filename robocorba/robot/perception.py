"""Perception: things that a robot's own scans show, and that nothing the robot knows explains.

Ends of rays without an explanation count for the cell of a grid in which they lie, rays that pass a cell against it:
limited log-odds (A. Hornung et al., OctoMap, Autonomous Robots 34, 2013). Cells near each other are a thing. A cell
that was hit once is forgotten in a second, one that was hit often in KEPT_S: what moves leaves no trail."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.temporary_obstacles import NO_OBSTACLES, TemporaryObstacles
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.scans import PoseTrack, Scan, read_scan
from robocorba.robot.senses import Senses
from robocorba.system.repeating import Repeating

#: Interval between scans while the robot has a task, and between looks whether it has one [s].
SCAN_S, IDLE_S = 0.25, 1.0
#: Distance from the sensor up to which hits count [m]: there, a laser's rays are 9 cm apart.
RANGE_M = 5.0
#: Side of a cell; cells up to about GAP_M apart are one thing, of at most LARGEST_M [m].
CELL_M, GAP_M, LARGEST_M = 0.05, 0.25, 1.5
#: Errors of the robot's pose that are expected [m, rad].
POSE_M, POSE_RAD = 0.1, 0.02
#: Log-odds by which a hit (p = 0.6) and a ray that passes (p = 0.31) change a cell, their limit (p = 0.97), and their
#: sum from which cells are a thing: two hits.
HIT, PASSED, SURE, THING = 0.4, 0.8, 3.5, 0.8
#: Time after which a cell that was hit once is forgotten, and one that is sure, if no ray goes there [s].
BRIEF_S, KEPT_S = 0.5, 60.0
#: Age of the last look above which the robot does not drive [s].
MAX_AGE_S = 1.0
MAX_CELLS, MAX_THINGS = 4000, 30

#: Says which points (n, 2) of a floor are within some distances (n,) of what the robot knows [m]: walls, doors, objects
#: and robots that report their poses. Raises NotReachable while it does not know.
Explains = Callable[[str, Floats, Floats], npt.NDArray[np.bool_]]
#: x, y: mean of the hits [m]. seen: time of the last one [s]. thing: its number, 0 for none.
_CELL = np.dtype([("key", "i8"), ("x", "f8"), ("y", "f8"), ("odds", "f8"), ("seen", "f8"), ("thing", "i8")])


class SeenThing(NamedTuple):
    """A thing that no map has. number: stays while the thing is seen, and is never used again by this robot. outline:
    corners (n, 2) of the convex hull of the cells in which it was seen [m], often of one side only. at: its centroid.
    certainty: probability that it is there. first_seen, last_seen: by time.time [s]."""

    number: int
    floor: str
    outline: Floats
    at: XY
    certainty: float
    first_seen: float
    last_seen: float


class Perception:
    """One thread reads the robot's sensors while it is needed, and updates `things`; any thread may read them.

    senses: of the robot, None without any. floor: returns the robot's floor; may raise RoboCorbaError. is_needed:
    whether the robot does something. carried: what moves with the robot, in its frame [m]."""

    def __init__(
        self,
        senses: Callable[[], Senses | None],
        floor: Callable[[], str],
        explains: Explains,
        is_needed: Callable[[], bool] = lambda: True,
        carried: Callable[[], BaseGeometry | None] = lambda: None,
    ) -> None:
        self._senses, self._floor_of_robot, self._explains = senses, floor, explains
        self._is_needed, self._carried = is_needed, carried
        self._track = PoseTrack()
        self._reader = Repeating("perception", self._look, lambda: SCAN_S if self._is_needed() else IDLE_S)
        self._floor = ""
        #: Sorted by key.
        self._cells = np.empty(0, _CELL)
        self._last_number = 0
        #: When the last look with all sensors began [s, monotonic], and why there was none since.
        self._looked_at, self._problem = -math.inf, ""
        self._subscribers: tuple[Callable[[Sequence[SeenThing]], None], ...] = ()
        #: What is there now, the nearest MAX_THINGS; replaced, never changed.
        self.things: Sequence[SeenThing] = ()
        #: The same for paths. The same object until the next update.
        self.obstacles: TemporaryObstacles = NO_OBSTACLES

    def start(self) -> Perception:
        self._reader.start()
        return self

    def close(self) -> None:
        self._reader.close()

    def wake(self) -> None:
        """Look now: the robot begins to do something."""
        self._reader.wake()

    def check(self) -> None:
        """Raise NotReachable while the last look is older than MAX_AGE_S: then the robot must not drive."""
        age_s = time.monotonic() - self._looked_at
        if age_s > MAX_AGE_S:
            raise NotReachable(
                f"what its sensors see is unknown: {self._problem or f'the last scan is {age_s:.2f} s old'}"
            )

    def subscribe(self, receive: Callable[[Sequence[SeenThing]], None]) -> None:
        """Have `receive` called with all things after each update that changed any, in the thread that updates; it must
        not block."""
        self._subscribers = (*self._subscribers, receive)

    def observe(self, state: RobotState) -> None:
        """To be called in each control cycle."""
        self._track.observe(state)

    # ---- in the thread that updates ----

    def _look(self) -> None:
        began, senses, floor = time.monotonic(), self._senses(), self._floor
        scans: list[Scan] = []
        sensors = senses.sensors if senses and self._is_needed() else ()
        try:
            for sensor in sensors:
                assert senses
                floor = self._floor_of_robot()
                scan = read_scan(senses, sensor, self._carried())
                if (pose := self._track.at(scan.time)) and floor == self._floor_of_robot():
                    scans.append(scan.placed(pose))
            self.update(floor, scans, time.time())
            self._problem = ""
            self._looked_at = began if sensors and len(scans) == len(sensors) else self._looked_at
        except RoboCorbaError as error:
            self._problem = str(error)

    def update(self, floor: str, scans: Sequence[Scan], now: float) -> None:
        """Take in scans that were placed on a floor; without scans, forget what is old. now: time.time [s]. Raises what
        `explains` raises, and then changes nothing."""
        cells = self._cells if floor == self._floor else np.empty(0, _CELL)
        hits, within_m = _hits(scans)
        if scans:
            ends = np.concatenate([hits, _points(cells)])
            is_known = self._explains(floor, ends, np.append(within_m, np.full(len(cells), POSE_M)))
            hits, cells = hits[~is_known[: len(hits)]], cells[~is_known[len(hits) :]]
        points, is_hit = _points(cells), np.isin(cells["key"], _keys(hits, CELL_M))
        for scan in scans:
            is_passed = _passed(points, scan) & ~is_hit
            is_inside = np.hypot(*(points - scan.robot[:2]).T) < RADIUS_M
            cells["odds"] -= np.where(is_inside, SURE, PASSED * is_passed)
        cells = _with_hits(cells, hits, now)
        kept_s = BRIEF_S + (KEPT_S - BRIEF_S) * (cells["odds"] / SURE) ** 3
        cells = cells[(cells["odds"] > 0.0) & (now - cells["seen"] <= kept_s)]
        if len(cells) > MAX_CELLS:
            cells = cells[np.sort(np.argsort(cells["seen"])[-MAX_CELLS:])]
        self._floor, self._cells = floor, cells
        self._publish(tuple(self._found(scans[-1].robot[:2] if scans else (0.0, 0.0), now)))

    def _found(self, robot: XY, now: float) -> list[SeenThing]:
        cells, points = self._cells, _points(self._cells)
        if not len(cells):
            return []
        parts = _parts(points)
        order = np.argsort(parts, kind="stable")
        first, counts = np.searchsorted(parts[order], np.arange(parts.max() + 1)), np.bincount(parts)
        sums, seen = np.bincount(parts, cells["odds"]), np.maximum.reduceat(cells["seen"][order], first).tolist()
        certainties = (1.0 / (1.0 + np.exp(-sums / counts))).tolist()
        half = CELL_M / 2
        corners = points[order][:, None] + ((-half, -half), (half, -half), (half, half), (-half, half))
        outlines = shapely.convex_hull(shapely.linestrings(corners.reshape(-1, 2), indices=np.repeat(parts[order], 4)))
        centres = shapely.get_coordinates(shapely.centroid(outlines))
        nearest = np.argsort(np.hypot(*(centres - robot).T))
        first_seen = {thing.number: thing.first_seen for thing in self.things}
        taken, found = {0}, []
        for part in nearest[sums[nearest] >= THING][:MAX_THINGS].tolist():
            its = order[first[part] : first[part] + counts[part]]
            number = min(set(cells["thing"][its].tolist()) - taken, default=self._last_number + 1)
            self._last_number = max(self._last_number, number)
            taken.add(number)
            cells["thing"][its] = number
            outline, (x, y) = shapely.get_coordinates(outlines[part])[:-1], centres[part].tolist()
            times = first_seen.get(number, now), seen[part]
            found.append(SeenThing(number, self._floor, outline, (x, y), certainties[part], *times))
        return found

    def _publish(self, things: Sequence[SeenThing]) -> None:
        if not things and not self.things:
            return
        areas = tuple((thing.floor, tuple(map(tuple, thing.outline.tolist()))) for thing in things)
        self.obstacles = TemporaryObstacles(areas, names=tuple(f"seen thing {thing.number}" for thing in things))
        self.things = things
        for receive in self._subscribers:
            receive(things)


def _hits(scans: Sequence[Scan]) -> tuple[Floats, Floats]:
    """Ends (n, 2) of rays with an echo within RANGE_M, and by how much they may err (n,) [m]."""
    ends, within_m = [np.empty((0, 2))], [np.empty(0)]
    for scan in scans:
        lengths = np.hypot(*(scan.ends - scan.start).T)
        near = scan.is_hit & (lengths < RANGE_M)
        ends.append(scan.ends[near])
        within_m.append(_error_m(lengths, scan.deviations_m)[near])
    return np.concatenate(ends), np.concatenate(within_m)


def _error_m(lengths: Floats, deviations_m: Floats) -> Floats:
    """By how much the ends of rays may err [m]: by the robot's pose, and three standard deviations."""
    found: Floats = POSE_M + POSE_RAD * lengths + 3.0 * deviations_m
    return found


def _points(cells: npt.NDArray[np.void]) -> Floats:
    return np.column_stack((cells["x"], cells["y"]))


def _keys(points: Floats, side_m: float) -> Longs:
    """The squares (n,) in which points lie, as numbers: those of its neighbours differ by 1 and 2^32."""
    columns, rows = np.floor(points / side_m).astype(np.int64).T
    keys: Longs = (columns << 32) + rows
    return keys


def _passed(points: Floats, scan: Scan) -> npt.NDArray[np.bool_]:
    """Whether the ray that is nearest to a point passes it, at most CELL_M beside it."""
    if not len(points) or not len(scan.ends):
        return np.zeros(len(points), bool)
    rays, offsets = scan.ends - scan.start, points - scan.start
    lengths, distances = np.hypot(*rays.T), np.hypot(*offsets.T)
    angles, bearings = np.arctan2(rays[:, 1], rays[:, 0]), np.arctan2(offsets[:, 1], offsets[:, 0])
    order = np.argsort(angles)
    after = np.searchsorted(angles[order], bearings)
    beside = order[np.stack([after - 1, after % len(order)])]  # (2, n) rays
    apart = np.abs(np.mod(angles[beside] - bearings + np.pi, 2.0 * np.pi) - np.pi)
    ray = np.where(apart[0] <= apart[1], *beside)
    is_near = apart.min(axis=0) * distances <= CELL_M
    passes: npt.NDArray[np.bool_] = is_near & (lengths[ray] > distances + _error_m(lengths, scan.deviations_m)[ray])
    return passes


def _with_hits(cells: npt.NDArray[np.void], hits: Floats, now: float) -> npt.NDArray[np.void]:
    """The cells after hits (n, 2); a cell counts one at a time."""
    keys, index, counts = np.unique(_keys(hits, CELL_M), return_inverse=True, return_counts=True)
    x, y = (np.bincount(index, each, len(keys)) / counts for each in hits.T)
    at = np.minimum(np.searchsorted(cells["key"], keys), max(len(cells) - 1, 0))
    is_old = cells["key"][at] == keys if len(cells) else np.zeros(len(keys), bool)
    old = at[is_old]
    cells["x"][old] += 0.3 * (x[is_old] - cells["x"][old])
    cells["y"][old] += 0.3 * (y[is_old] - cells["y"][old])
    cells["odds"][old] = np.minimum(cells["odds"][old] + HIT, SURE)
    cells["seen"][old] = now
    new = np.zeros(int((~is_old).sum()), _CELL)
    new["key"], new["x"], new["y"], new["odds"], new["seen"] = keys[~is_old], x[~is_old], y[~is_old], HIT, now
    both = np.concatenate([cells, new])
    return both[np.argsort(both["key"])]


def _parts(points: Floats) -> Longs:
    """To which part (n,) points belong, counted from 0: those in squares of GAP_M that touch are one, but of something
    larger than LARGEST_M those in a square of that side."""
    squares, square_of = np.unique(_keys(points, GAP_M), return_inverse=True)
    left, groups = set(squares.tolist()), {}
    for square in squares.tolist():
        reached = [square] if square in left else []
        left.discard(square)
        while reached:
            one = reached.pop()
            groups[one] = square
            beside = left & {one + (column << 32) + row for column in (-1, 0, 1) for row in (-1, 0, 1)}
            left -= beside
            reached += beside
    _, group_of = np.unique([groups[square] for square in squares.tolist()], return_inverse=True)
    group_of = group_of[square_of]
    order = np.argsort(group_of, kind="stable")
    low = np.minimum.reduceat(points[order], np.searchsorted(group_of[order], np.arange(group_of.max() + 1)))
    tiles = np.minimum(((points - low[group_of]) / LARGEST_M).astype(np.int64), 999)
    parts: Longs = np.unique(group_of * 1_000_000 + tiles[:, 0] * 1000 + tiles[:, 1], return_inverse=True)[1]
    return parts
