"""Shortest drives through the free space of one floor for one robot radius.

A shortest path of a round robot consists of straight lines and of arcs around ends of walls and corners of objects. The
graph has a circle around each of these vertices, and lines that touch two circles. A search finds the lines from a
vertex when it first reaches it, among the vertices visible from there, and keeps them until an edit touches the floor.

A navigation mesh would have to be built for each radius from the grown obstacles, which takes longer than most
searches; here one triangulation of the walls serves all radii. Two vertices that a robot can drive between are also
visible from each other, so no path is missed.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robocorba.errors.paths import PlanningTimeout
from robocorba.map_editor.model import Building, Floor, Wall
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import SMARTPAL_RADIUS_M, XY
from robocorba.planning.dead_ends import DeadEnds, near_core
from robocorba.planning.floor_mesh import FloorMesh
from robocorba.planning.road_rules import NO_LANES, path_breaks_rule
from robocorba.planning.space import FloorSpace
from robocorba.planning.tangent_search import DONE, NO_ROOM, UNKNOWN, Arcs, Labels, Lines, Radii, search
from robocorba.planning.turns import ALONE, Turn
from robocorba.planning.visible_region import make_scratch

#: Number of lines of a graph (41 bytes each) beyond which it forgets them before the next search.
MAX_LINES = 4_000_000
#: Number of lines with room at first.
FIRST_LINES = 4_096


class DriveLeg(NamedTuple):
    """A drive on one floor: its length [m], inf if there is none, and its corners (k, 2) with both ends."""

    length: float
    points: Floats


class TangentGraph:
    """The shortest drives between points of a floor for one radius. Thread-safe; one search at a time."""

    def __init__(self, space: FloorSpace, radius_m: float) -> None:
        self.space, self.radius = space, radius_m
        self._lock = threading.Lock()
        self._mesh: FloorMesh | None = None

    def _prepare(self, points: Sequence[XY]) -> None:
        """Ensure that the mesh covers these points. The caller holds the lock."""
        if self._mesh is not None and self._mesh.covers(points):
            return
        self._mesh = self.space.mesh(points)
        vertices = len(self._mesh.xy)
        turn = max(self.radius, 0.01) + self._mesh.merged_m  # [m]; with radius 0 a wall would have no corner to turn at
        same = max(2 * self._mesh.merged_m, 2 * float(self._mesh.mesh.frame[2]))
        self._radii = Radii(self.radius, turn, same, 2.0 * turn + same)
        self._scratch = make_scratch(self._mesh.mesh)
        exit_triangle = self._mesh.exit_triangle
        near = near_core(self._mesh.mesh, self._mesh.xy, exit_triangle, self._radii.reach_m)
        self._dead_ends = DeadEnds(exit_triangle, near, np.zeros(vertices, np.int64))
        self._arcs = Arcs(
            self._mesh.low,
            self._mesh.span,
            np.zeros((vertices, 4)),
            np.full(vertices, UNKNOWN, np.int8),
            np.zeros(vertices, np.bool_),
        )
        self._make_room(FIRST_LINES)

    def _make_room(self, room: int) -> None:
        """Forget all lines and allocate room for `room` lines."""
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
        """Double the room, keeping the lines."""
        old, room = self._lines, 2 * len(self._lines.to)
        grown = {
            name: np.concatenate([array, np.zeros_like(array)])
            for name, array in old._asdict().items()
            if name in ("to", "leave", "arrive", "length", "state")
        }
        self._lines = old._replace(**grown)
        labels = self._labels
        self._labels = labels._replace(cost=np.empty(room), cost_epoch=np.zeros(room, np.int64))

    def _obeying(self, leg: DriveLeg, lanes: Floats, outbound: bool) -> DriveLeg:
        """The leg, or none if it breaks a rule on an arc or by lines that continue each other: the search tests each
        line alone."""
        points = leg.points if outbound else leg.points[::-1].copy()
        return DriveLeg(math.inf, np.empty((0, 2))) if path_breaks_rule(lanes, points, self.radius) else leg

    def legs(
        self,
        origin: XY,
        targets: Sequence[XY],
        *,
        enough: int = 0,
        max_length_m: float = math.inf,
        lanes: Floats = NO_LANES,
        outbound: bool = True,
        turn: Turn = ALONE,
    ) -> list[DriveLeg]:
        """The shortest drive from `origin` to each target [m]; all must be free for the radius.

        With `enough`, only that many of the shortest drives are certain to be found; none is longer than
        `max_length_m`. `lanes` (n, LANE_COLUMNS) are edges whose rules a drive must not break, from the origin or, if
        not `outbound`, to it. Raises PlanningTimeout after the deadline of `turn`."""
        if not targets:
            return []
        goals = np.array(targets, float).reshape(-1, 2)
        nearest = min(enough or len(goals), len(goals))
        budget = 1_000_000  # between two checks of the deadline: about 0.1 s
        while True:
            turn.pause(self.space.floor)
            if not self._lock.acquire(timeout=turn.left_s):
                raise PlanningTimeout(self.space.floor)
            try:
                self._prepare([origin, *targets])
                assert self._mesh is not None
                if self._lines.used[0] > MAX_LINES:
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
                    nearest,
                    max_length_m,
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
                legs = [DriveLeg(length, corners[first[i] : first[i + 1]]) for i, length in enumerate(lengths.tolist())]
                return [self._obeying(leg, lanes, outbound) for leg in legs] if len(lanes) else legs
            if status != NO_ROOM:
                budget *= 2


def warm_up() -> None:
    """Compile or load the kernels of paths through free space."""
    room = Floor("L1", 1, 0.0, outline=((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
    building = Building("warm-up").with_element("", room).with_element("L1", Wall("wall", (2.0, 0.0), (2.0, 2.0)))
    TangentGraph(FloorSpace(building, "L1"), SMARTPAL_RADIUS_M).legs((1.0, 1.0), [(3.0, 1.0)])
