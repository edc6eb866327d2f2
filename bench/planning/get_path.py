"""getPath over IIOP on the sample buildings, compared to a null call to the same object; both alternate.

python -m bench.planning.get_path [--calls 2200] [--rounds 5]"""

from __future__ import annotations

import statistics
from typing import Any

from bench.common.harness import folder_of_bench, run
from robocorba.clients.robot_processes import servers
from robocorba.map_editor.samples import SAMPLES, load_sample, sample_path
from robocorba.orb.orb import Orb
from robocorba.planning.request import SMARTPAL_RADIUS_M
from robocorba.stubs import RoboCorba
from testkit.generated_buildings import random_places
from testkit.report import at_most, distribution, quantile, summarize, timed_ms

#: Required median of getPath, in null calls.
MAX_NULL_CALLS = 2.0


def measure(name: str, calls: int, rounds: int) -> bool:
    """Time both calls on one sample building, in rounds of queries at random places."""
    places = random_places(load_sample(name), SMARTPAL_RADIUS_M, 2 * calls, seed=7)
    points = [RoboCorba.Point(*place) for place in places]
    rows: list[dict[str, Any]] = []
    with (
        folder_of_bench() as folder,
        servers(folder, "--building", str(sample_path(name))) as naming,
        Orb(naming) as orb,
    ):
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        pairs = [pair for pair in zip(points[::2], points[1::2], strict=True) if _is_reachable(planner, *pair)]
        length = round(statistics.mean(len(planner.getPath(*pair)) for pair in pairs))
        for round_ in range(1, rounds + 1):
            us: dict[str, list[float]] = {"null call": [], "getPath": []}
            for pair in pairs:  # alternating, so that a busy moment of the machine affects both
                us["null call"].append(1e3 * timed_ms(planner._non_existent)[1])
                us["getPath"].append(1e3 * timed_ms(planner.getPath, *pair)[1])
            null, path = map(statistics.median, us.values())
            p99 = quantile(us["getPath"], 0.99)
            row = {"round": round_, "null call, us": null, "getPath, us": path, "getPath p99, us": p99}
            rows.append({**row, "getPath / null call": path / null})
    ratio = statistics.median(row["getPath / null call"] for row in rows)
    title = f"getPath over IIOP, {name}, {length} points, medians of {len(pairs)} random queries"
    marks = [at_most("getPath, median, in null calls", ratio, MAX_NULL_CALLS)]
    return summarize(f"get_path_{name}", title, rows, marks, distribution(us, "us"))


def _is_reachable(planner: Any, start: Any, goal: Any) -> bool:
    """Whether there is a path; a few random places are enclosed by furniture."""
    try:
        planner.getPath(start, goal)
    except RoboCorba.NoPath:
        return False
    return True


def main(calls: int = 2200, rounds: int = 5) -> bool:
    reached = [measure(name, calls, rounds) for name in SAMPLES]
    return all(reached)


if __name__ == "__main__":
    run(main, calls="queries in a round")
