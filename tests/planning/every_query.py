"""Adversarial queries on every kind of building in each mode, each answer judged by shapely, networkx and visibility
graphs.

    python -m tests.planning.every_query

Measures no times: it counts wrong answers, prints examples, and exits with 1 if there are any."""

from __future__ import annotations

from collections.abc import Iterator

from rich.progress import track

from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import RouteMode
from testkit.report import PROGRESS
from tests.planning.adversary import Adversary
from tests.planning.every_building import (
    DRAWN,
    IMPORTED,
    MAX_RATIO,
    buildings_at_random,
    grids,
    judged,
    report,
    rooms_at_random,
)
from tests.planning.judge import Judge, Verdict

#: Queries in each mode, spread evenly over all buildings.
QUERIES = 10_000
#: Side of the grid maps [cells].
GRID_SIZE = 96
CASES = {**DRAWN, **IMPORTED, **grids(GRID_SIZE), **rooms_at_random(range(6)), **buildings_at_random(range(40))}


def answers() -> Iterator[tuple[str, Verdict]]:
    """The verdicts on all answers; a geometric path that is too long is another objection."""
    for name, case in track(CASES.items(), "buildings", console=PROGRESS, transient=True):
        building = case.make()
        planner, judge = PathPlanner(building), Judge(building)
        queries = list(Adversary(building, case.radius_m, judge.fits).queries(-(-QUERIES // len(CASES))))
        for mode in RouteMode:
            for query, verdict, ratio in judged(case, planner, judge, mode, queries):
                if ratio and ratio > MAX_RATIO:
                    verdict = verdict._replace(objections=(f"{ratio} times as long as the shortest",))
                yield f"{name}, {mode.name}: {query}", verdict


if __name__ == "__main__":
    report(answers())
