"""Shortest ways through the free space of one floor, for one robot radius.

A shortest way of a round robot is made of straight lines and of arcs around the ends of walls and the corners of
objects. So the graph has a circle for each of these vertices, and lines that touch two circles. Nothing of it is
made in advance: the lines from a vertex are found when a search first comes to it, among the vertices that can be
seen from there, and kept until an edit touches the floor. Why not a navigation mesh: it would have to be built for
each radius from the grown obstacles, which takes longer than most searches; here one triangulation of the walls
serves all radii. What sees what with a radius is a part of what sees what without one, so no way is missed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robocorba.errors.paths import PlanningTimeout
from robocorba.planning.dead_ends import DeadEnds, near_core
from robocorba.planning.floor_mesh import FloorMesh
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_search import (
    DONE,
    NO_ROOM,
    UNKNOWN,
    Arcs,
    Labels,
    Lines,
    Radii,
    reach_m,
    search,
)
from robocorba.planning.visible_region import make_scratch
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import XY

#: Robots turn at least this far from a vertex, m: without any distance, a wall would have no corner to turn at.
LEAST_TURN_M = 0.01
#: Lines that a graph keeps [lines, 41 bytes each]: more are forgotten before the next search.
MOST_LINES = 4_000_000
#: Lines that there is room for at first.
FIRST_LINES = 4_096
#: Work of a search between two looks at the clock [visited triangles]: about a tenth of a second.
BUDGET = 1_000_000
NO_LANES: Floats = np.empty((0, 4))


class Leg(NamedTuple):
    """A drive on one floor: its length in m (inf where there is none) and its corners (k, 2), ends included."""

    length: float
    points: Floats


class TangentGraph:
    """The shortest legs between any points of a floor for one radius. Safe from any thread, one search at a time."""

    def __init__(self, space: FloorSpace, radius_m: float) -> None:
        self.space, self.radius = space, radius_m
        self._lock = threading.Lock()
        self._mesh: FloorMesh | None = None

    def _prepare(self, points: Sequence[XY]) -> None:
        """Have a mesh that covers these points. With the lock held."""
        if self._mesh is not None and self._mesh.covers(points):
            return
        self._mesh = self.space.mesh(points)
        vertices = len(self._mesh.xy)
        turn = max(self.radius, LEAST_TURN_M) + self._mesh.merged_m
        same = max(2 * self._mesh.merged_m, 2 * float(self._mesh.mesh.frame[2]))
        self._radii = Radii(self.radius, turn, same)
        self._scratch = make_scratch(self._mesh.mesh)
        way_out = self._mesh.way_out
        near = near_core(self._mesh.mesh, self._mesh.xy, way_out, reach_m(self._radii))
        self._dead_ends = DeadEnds(way_out, near, np.zeros(vertices, np.int64))
        self._arcs = Arcs(
            self._mesh.low,
            self._mesh.span,
            np.zeros((vertices, 4)),
            np.full(vertices, UNKNOWN, np.int8),
            np.zeros(vertices, np.bool_),
        )
        self._make_room(FIRST_LINES)

    def _make_room(self, room: int) -> None:
        """Forget all lines and make room for so many."""
        circles = 2 * len(self._arcs.low)
        self._lines = Lines(
            np.zeros(circles, np.int64),
            np.full(circles, -1, np.int64),
            np.empty(room, np.int64),
            np.empty(room),
            np.empty(room),
            np.empty(room),
            np.zeros(room, np.int8),
            np.zeros(1, np.int64),
        )
        self._labels = Labels(
            np.empty(room),
            np.zeros(room, np.int64),
            np.empty(circles),
            np.empty(circles),
            np.zeros(circles, np.int64),
            np.empty(circles, np.int64),
            np.zeros(circles, np.int64),
            np.zeros(1, np.int64),
        )

    def _more_room(self) -> None:
        """Make twice the room, keeping the lines."""
        old, room = self._lines, 2 * len(self._lines.to)
        grown = {
            name: np.concatenate([array, np.zeros_like(array)])
            for name, array in old._asdict().items()
            if name in ("to", "leave", "arrive", "length", "state")
        }
        self._lines = old._replace(**grown)
        labels = self._labels
        self._labels = labels._replace(cost=np.empty(room), cost_epoch=np.zeros(room, np.int64))

    def legs(
        self,
        origin: XY,
        targets: Sequence[XY],
        *,
        enough: int = 0,
        longest_m: float = math.inf,
        lanes: Floats = NO_LANES,
        outbound: bool = True,
        deadline: float = math.inf,
    ) -> list[Leg]:
        """The shortest leg from `origin` to each target; all must be free for the radius.

        With `enough`, only so many of the shortest are sure to be found, with `longest_m` none longer. `lanes` (n, 4)
        are one-way edges that legs must not be driven against: from the origin or, where not `outbound`, to it.
        Raises PlanningTimeout where it is not done by `deadline` (time.monotonic, s)."""
        if not targets:
            return []
        goals = np.array(targets, float).reshape(-1, 2)
        most = min(enough or len(goals), len(goals))
        budget = BUDGET
        while True:
            left = deadline - time.monotonic()
            if not self._lock.acquire(timeout=min(max(left, 0.0), threading.TIMEOUT_MAX)):
                raise PlanningTimeout(self.space.floor)
            try:
                self._prepare([origin, *targets])
                assert self._mesh is not None
                if self._lines.used[0] > MOST_LINES:
                    self._make_room(FIRST_LINES)
                status, lengths, first, corners = search(
                    self._mesh.mesh,
                    self._mesh.xy,
                    self.space.grid,
                    self._lines,
                    self._arcs,
                    self._labels,
                    self._scratch,
                    self._dead_ends,
                    *origin,
                    goals,
                    most,
                    longest_m,
                    lanes,
                    outbound,
                    self._radii,
                    budget,
                )
                if status == NO_ROOM:
                    self._more_room()
            finally:
                self._lock.release()
            if status == DONE:
                return [Leg(length, corners[first[i] : first[i + 1]]) for i, length in enumerate(lengths.tolist())]
            if time.monotonic() > deadline:
                raise PlanningTimeout(self.space.floor)
            if status != NO_ROOM:
                budget *= 2
