"""getPath over IIOP on the sample buildings, compared to a null call to the same object; both alternate.

python -m bench.planning.get_path [--calls 2200] [--rounds 5]"""

from __future__ import annotations

import contextlib
import statistics
from collections.abc import Iterable
from functools import partial
from typing import Any

from bench.common.harness import alternately, run, system
from robocorba.map_editor.samples import SAMPLES, load_sample, sample_path
from robocorba.planning.corba import paths
from robocorba.planning.request import SMARTPAL_RADIUS_M, Place
from robocorba.stubs import RoboCorba
from testkit.generated_buildings import random_trips
from testkit.report import at_most, quantile, summarize

#: Required median of getPath, in null calls.
MAX_NULL_CALLS = 2.0
NULL, PATH = "null call", "getPath"


def calls_of(planner: Any, trips: Iterable[tuple[Place, Place]]) -> tuple[list[dict[str, Any]], list[int]]:
    """A null call and a getPath for each trip that has a path, and the numbers of the paths' points: a few random
    places are enclosed by furniture."""
    found, points = [], []
    for trip in trips:
        get_path = partial(planner.getPath, *map(paths.point, trip))
        with contextlib.suppress(RoboCorba.NoPath):
            points.append(len(get_path()))
            found.append({NULL: planner._non_existent, PATH: get_path})
    return found, points


def measure(name: str, calls: int, rounds: int) -> bool:
    """Time both calls on one sample building, in rounds of queries at random places."""
    rows: list[dict[str, Any]] = []
    with system(building=sample_path(name)) as found:
        trips = random_trips(load_sample(name), SMARTPAL_RADIUS_M, calls, seed=7)
        turns, points = calls_of(found.resolve("PathPlanner"), trips)
        for number in range(1, rounds + 1):
            ms = alternately(turns)
            null, path = (1e3 * statistics.median(ms[what]) for what in (NULL, PATH))
            row = {"round": number, "null call, us": null, "getPath, us": path}
            rows.append({**row, "p99": 1e3 * quantile(ms[PATH], 0.99), "getPath / null call": path / null})
    ratio = statistics.median(row["getPath / null call"] for row in rows)
    title = f"getPath over IIOP, {name}, {statistics.mean(points):.0f} points, medians of {len(turns)} random queries"
    marks = [at_most("getPath, median, in null calls", ratio, MAX_NULL_CALLS)]
    return summarize(f"get_path_{name}", title, rows, marks, ms, "ms", without_a_path=len(trips) - len(turns))


def main(calls: int = 2200, rounds: int = 5) -> bool:
    reached = [measure(name, calls, rounds) for name in SAMPLES]
    return all(reached)


if __name__ == "__main__":
    run(main, calls="queries in a round")
