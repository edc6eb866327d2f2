"""Geometric paths on grid maps of 512 x 512 cells: the first one, a typical one, the first one after an edit.

Each map is measured in its own process, which is killed at a time limit. Lengths are compared to those of the shortest
octile paths. A robot that fits into a cell can drive them, so no shortest path is longer.

    python -m bench.planning.geometric [KIND ...]      only these kinds of maps, such as "rooms of 8"
"""

from __future__ import annotations

import math
import multiprocessing
import statistics
import sys
import time
from collections.abc import Sequence
from itertools import pairwise
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np
import psutil
from matplotlib.axes import Axes
from rich.progress import track
from scipy import ndimage

from bench import RESULTS
from robocorba.errors.paths import PathError
from robocorba.maps.model import Building, Wall
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest, Place, RouteMode
from robocorba.testing.fine_grid import FloorGeometry
from robocorba.testing.grid_maps import FLOOR, KINDS, Cell, Cells, OctileGraph, building_of, place_of, random_cells
from robocorba.testing.report import PROGRESS, at_least, at_most, quantile, summarize, timed_ms

SIZE, SEED = 512, 1
#: Sides of a cell and radii of the robot [m].
SCALES = ((1.0, 0.4), (0.25, 0.1))
#: Queries on a map: numbers of starts and of goals for each start, in random order.
STARTS, GOALS = 30, 10
#: Number of wall edits on a map, each followed by one query.
EDITS = 3
#: Time limit for one map from its planner's construction on [s]. Making the map and the octile paths is not included.
LIMIT_S = 30.0
#: Time limit for this preparation [s].
PREPARATION_S = 120.0
#: Tolerance of the ratio to the octile path.
ROUNDING = 1e-9


class Trip(NamedTuple):
    """A query and the length of the shortest octile path [m]."""

    start: Place
    goal: Place
    octile_m: float


class Found:
    """Results that a process reported about one map until it ended."""

    def __init__(self, kind: str, cell_m: float) -> None:
        self.kind, self.cell_m = kind, cell_m
        self.walls = self.failures = self.touches = 0
        self.times: dict[str, list[float]] = {"planner": [], "first": [], "update": [], "after": [], "query": []}
        self.to_octile: list[float] = []
        self.to_straight: list[float] = []
        self.memory_mb = 0.0
        self.is_finished = False

    def row(self) -> dict[str, Any]:
        def median(name: str) -> float | None:
            return statistics.median(self.times[name]) if self.times[name] else None

        queries = self.times["query"]
        return {
            "map": self.kind,
            "cell m": self.cell_m,
            "walls": self.walls,
            "planner ms": median("planner"),
            "first path ms": median("first"),
            "update ms": median("update"),
            "path after it ms": median("after"),
            "queries": len(queries),
            "median ms": median("query"),
            "p99 ms": quantile(queries, 0.99) if queries else None,
            "to octile, max": max(self.to_octile, default=None),
            "to straight, median": statistics.median(self.to_straight) if self.to_straight else None,
            "wrong": self.failures + self.touches,
            "MB": self.memory_mb or None,
            "finished": "yes" if self.is_finished else "limit",
        }


def main(kinds: Sequence[str]) -> None:
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        sys.exit(f"geometric: there is no kind {', '.join(unknown)}; there are {', '.join(KINDS)}")
    PathPlanner(Building("warm-up")).warm_up()  # the processes load the compiled kernels from disk
    asked = [(kind, *scale) for scale in SCALES for kind in kinds or KINDS]
    found = [in_a_process(*one) for one in track(asked, "maps", console=PROGRESS, transient=True)]
    if not show(found):
        sys.exit("geometric: a mark was missed")


def in_a_process(kind: str, cell_m: float, radius_m: float) -> Found:
    """Measure one map until it is done or the time limit."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=measure, args=(theirs, kind, SIZE, cell_m, radius_m), daemon=True)
    process.start()
    theirs.close()
    found = Found(kind, cell_m)
    deadline = time.monotonic() + PREPARATION_S
    try:
        while (left_s := deadline - time.monotonic()) > 0.0 and ours.poll(left_s):
            what, value = ours.recv()
            if what == "ready":
                found.walls, deadline = value, time.monotonic() + LIMIT_S
            elif what == "length":
                found.to_octile.append(value[0])
                found.to_straight.append(value[1])
            elif what == "failure":
                found.failures += 1
            elif what == "touch":
                found.touches += 1
            elif what == "done":
                found.is_finished, found.memory_mb = True, value
                break
            else:
                found.times[what].append(value)
    except EOFError:  # the process crashed, with its error on stderr
        found.failures += 1
    process.terminate()
    process.join()
    return found


def measure(report: Connection, kind: str, size: int, cell_m: float, radius_m: float) -> None:
    """Measure one map and report each figure immediately, as a pair of name and value."""
    cells = KINDS[kind](size, SEED)
    building = building_of(cells, cell_m, kind)
    trips = trips_on(cells, cell_m)
    judge = FloorGeometry(building, FLOOR)
    walls = edits(cells, cell_m)
    PathPlanner(Building("warm-up")).warm_up()

    report.send(("ready", len(building.floors[FLOOR].geometrical.walls)))
    planner, took_ms = timed_ms(PathPlanner, building)
    report.send(("planner", took_ms))
    ask(report, planner, judge, trips[0], radius_m, "first")
    for number, wall in enumerate(walls, start=1):
        edited = building.with_element(FLOOR, wall)
        _, took_ms = timed_ms(planner.update, edited, number)
        report.send(("update", took_ms))
        ask(report, planner, judge, trips[number], radius_m, "after")
        planner.update(building, number)
    ask(report, planner, judge, trips[0], radius_m, "")
    for trip in trips:
        ask(report, planner, judge, trip, radius_m, "query")
    report.send(("done", psutil.Process().memory_info().rss / 1e6))


def ask(report: Connection, planner: PathPlanner, judge: FloorGeometry, trip: Trip, radius_m: float, name: str) -> None:
    """One query. Its time is reported under `name`, its lengths only under the name "query"."""
    request = PathRequest(trip.start, trip.goal, radius=radius_m, mode=RouteMode.GEOMETRIC)
    path: Path | None = None
    began = time.perf_counter()
    try:
        path = planner.paths(request)[0]
    except PathError as error:
        report.send(("failure", str(error)[:200]))
    took_ms = (time.perf_counter() - began) * 1e3
    if name:
        report.send((name, took_ms))
    if path is not None and name == "query":
        at = [(point.x, point.y) for point in path.points]
        if judge.touching(list(pairwise(at)), radius_m):
            report.send(("touch", None))
        straight_m = math.dist(trip.start[1:], trip.goal[1:])
        report.send(("length", (path.distance / trip.octile_m, path.distance / straight_m)))


def trips_on(cells: Cells, cell_m: float) -> list[Trip]:
    """Random queries between centres of cells, each with a path."""
    graph = OctileGraph(cells, cell_m)
    chosen = random_cells(cells, STARTS * (GOALS + 1), SEED)
    trips = []
    for start, goals in zip(chosen[:STARTS], np.array(chosen[STARTS:]).reshape(STARTS, GOALS, 2), strict=True):
        lengths = graph.lengths_from(start)
        for goal in map(_cell, goals):
            if goal != start and np.isfinite(lengths[goal]):
                trips.append(Trip(place_of(start, cell_m), place_of(goal, cell_m), float(lengths[goal])))
    order = np.random.default_rng(SEED).permutation(len(trips))
    return [trips[i] for i in order]


def edits(cells: Cells, cell_m: float) -> list[Wall]:
    """Short walls in the widest open spots; in occupied cells if no spot is wide enough for robots to pass."""
    room = ndimage.distance_transform_cdt(np.pad(cells, 1), "chessboard")[1:-1, 1:-1]
    spots = np.argwhere(room >= 3) if (room >= 3).any() else np.argwhere(~cells)
    chosen = np.random.default_rng(SEED).integers(0, len(spots), EDITS)
    found = []
    for i, spot in enumerate(spots[chosen]):
        _, x, y = place_of(_cell(spot), cell_m)
        found.append(Wall(name=f"edit {i}", a=(x - 0.2 * cell_m, y), b=(x + 0.2 * cell_m, y + 0.1 * cell_m)))
    return found


def _cell(at: np.ndarray) -> Cell:
    return int(at[0]), int(at[1])


def show(found: Sequence[Found]) -> bool:
    """Print and write the results; returns whether every mark was reached."""
    ratios = [ratio for one in found for ratio in one.to_octile]
    marks = [
        at_most("paths to the shortest octile way", max(ratios, default=math.nan), 1.0 + ROUNDING),
        at_most("paths that touch something", sum(one.touches for one in found), 0),
        at_most("queries refused", sum(one.failures for one in found), 0),
        at_least("maps measured within the time limit", sum(one.is_finished for one in found), len(found)),
    ]

    def draw(axes: Axes) -> None:
        for one in found:
            times = sorted(one.times["query"])
            if times:
                shares = [i / len(times) for i in range(len(times))]
                axes.plot(times, shares, label=f"{one.kind}, {one.cell_m:g} m", linewidth=1)
        axes.set(xscale="log", xlabel="milliseconds", ylabel="share of queries that took less")
        axes.legend(fontsize=6, ncols=2)

    times = [took for one in found for took in one.times["query"]]
    median = f"{statistics.median(times):.1f} ms at the median" if times else "no query answered in time"
    return summarize(
        RESULTS / "geometric",
        f"geometric paths on {SIZE} x {SIZE} cells: {median}",
        [one.row() for one in found],
        marks,
        draw,
    )


if __name__ == "__main__":
    main(sys.argv[1:])
