"""Geometric paths on grid maps of 512 x 512 cells: the first one, a typical one, the first one after an edit.

Lengths are compared to those of the shortest octile paths. A robot that fits into a cell can drive them, so no shortest
path is longer.

    python -m bench.planning.geometric [--kind "rooms of 8"]
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from bench.common.harness import progress, run
from robocorba.errors.paths import PathError
from robocorba.map_editor.model import Building, Wall
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest, Place, RouteMode
from testkit.fine_grid import FloorGeometry
from testkit.grid_maps import FLOOR, KINDS, Cell, Cells, OctileGraph, building_of, place_of, random_cells
from testkit.report import at_least, at_most, summarize, summary, timed_ms

SIZE, SEED = 512, 1
#: Sides of a cell and radii of the robot [m].
SCALES = ((1.0, 0.4), (0.25, 0.1))
#: Queries on a map: numbers of starts and of goals for each start, in random order.
STARTS, GOALS = 30, 10
#: Number of wall edits on a map, each followed by one query.
EDITS = 3
#: Time after which no further query of a map begins [s].
LIMIT_S = 30.0
#: The maps with the most walls, which have marks of their own; largest times of each map [ms].
SMALLEST = "maze of 1"
MAX_MS = {"first path ms": 300.0, "median ms": 5.0, "p99 ms": 50.0, "update ms": 50.0}
#: Tolerance of the ratio to the octile path.
ROUNDING = 1e-9

#: Figures of a map by their name: times [ms], "octile" and "straight" (ratios of lengths), "failure", "touch".
Found = Mapping[str, Sequence[Any]]


class Trip(NamedTuple):
    """A query and the length of the shortest octile path [m]."""

    start: Place
    goal: Place
    octile_m: float


def main(kind: str = "") -> bool:
    PathPlanner(Building("warm-up")).warm_up()
    asked = [(one, *scale) for scale in SCALES for one in KINDS if kind in ("", one)]
    maps = [(one, cell_m, measure(one, SIZE, cell_m, radius_m)) for one, cell_m, radius_m in progress(asked, "maps")]
    rows = [row(*one) for one in maps]
    marks = [
        at_most(f"{column}, {which}", max(row[column] for row in rows if (row["map"] == SMALLEST) is is_it), limit)
        for which, is_it in ((SMALLEST, True), ("other maps", False))
        for column, limit in MAX_MS.items()
        if any((row["map"] == SMALLEST) is is_it for row in rows)
    ]
    marks += [
        at_most("paths to the shortest octile way", max(row["to octile, max"] for row in rows), 1.0 + ROUNDING),
        at_most("paths that touch something", sum(len(found["touch"]) for _, _, found in maps), 0),
        at_most("queries refused", sum(len(found["failure"]) for _, _, found in maps), 0),
        at_least("maps measured within the time limit", sum(row["left"] == 0 for row in rows), len(maps)),
    ]
    samples = {f"{kind}, {cell_m:g} m": found["query"] for kind, cell_m, found in maps}
    return summarize("geometric", f"geometric paths on {SIZE} x {SIZE} cells", rows, marks, samples, "ms")


def row(kind: str, cell_m: float, found: Found) -> dict[str, Any]:
    return {
        "map": kind,
        "cell m": cell_m,
        "walls": sum(found["walls"]),
        **summary(found["planner"], "planner ms"),
        **summary(found["first"], "first path ms"),
        **summary(found["update"], "update ms"),
        **summary(found["after"], "path after it ms"),
        "queries": len(found["query"]),
        "left": sum(found["left"]),
        **summary(found["query"], "median ms", "p99 ms"),
        "to octile, max": max(found["octile"], default=math.nan),
        **summary(found["straight"], "to straight, median"),
        "wrong": len(found["failure"]) + len(found["touch"]),
    }


def measure(kind: str, size: int, cell_m: float, radius_m: float) -> Found:
    """The figures of one map."""
    cells = KINDS[kind](size, SEED)
    building = building_of(cells, cell_m, kind)
    trips = trips_on(cells, cell_m)
    judge = FloorGeometry(building, FLOOR)
    found: dict[str, list[Any]] = defaultdict(list, walls=[len(building.floors[FLOOR].geometrical.walls)])
    until = time.monotonic() + LIMIT_S
    planner, took_ms = timed_ms(PathPlanner, building)
    found["planner"].append(took_ms)
    ask(found, planner, judge, trips[0], radius_m, "first")
    for number, wall in enumerate(edits(cells, cell_m), start=1):
        found["update"].append(timed_ms(planner.update, building.with_element(FLOOR, wall), number)[1])
        ask(found, planner, judge, trips[number], radius_m, "after")
        planner.update(building, number)
    for number, trip in enumerate(trips):
        if time.monotonic() > until:
            found["left"].append(len(trips) - number)
            break
        ask(found, planner, judge, trip, radius_m, "query")
    return found


def ask(
    found: dict[str, list[Any]], planner: PathPlanner, judge: FloorGeometry, trip: Trip, radius_m: float, name: str
) -> None:
    """One query. Its time is kept under `name`, its lengths only of the name "query"."""
    request = PathRequest(trip.start, trip.goal, radius=radius_m, mode=RouteMode.GEOMETRIC)
    try:
        paths, took_ms = timed_ms(planner.paths, request)
    except PathError as error:
        found["failure"].append(str(error)[:200])
        return
    found[name].append(took_ms)
    if name == "query":
        at = [(point.x, point.y) for point in paths[0].points]
        if judge.touching(list(pairwise(at)), radius_m):
            found["touch"].append(trip)
        found["octile"].append(paths[0].distance / trip.octile_m)
        found["straight"].append(paths[0].distance / math.dist(trip.start[1:], trip.goal[1:]))


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


if __name__ == "__main__":
    run(main, kind="|".join(("", *KINDS)))
