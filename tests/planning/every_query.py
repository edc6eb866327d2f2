"""Adversarial queries on every kind of building, each answer judged by shapely, networkx and visibility graphs.

The bench measures no times: it counts wrong answers and writes examples to every_query_wrong.txt.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from rich.progress import track

from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import RouteMode
from robocorba.testing.report import PROGRESS, RESULTS, Mark, at_least, at_most, summarize
from tests.planning.adversary import Adversary, Query
from tests.planning.every_building import (
    DRAWN,
    IMPORTED,
    MAX_RATIO,
    Case,
    buildings_at_random,
    grids,
    judged,
    rooms_at_random,
)
from tests.planning.judge import Judge, Verdict

#: Queries in each mode, spread evenly over all buildings.
QUERIES = 10_000
#: Time limit for one building in one mode [s]: a slow planner gets fewer queries there.
LIMIT_S = 60.0
#: Side of the grid maps [cells].
GRID_SIZE = 96
#: Number of wrong answers that are written for each building and mode.
EXAMPLES = 5

GROUPS: dict[str, dict[str, Case]] = {
    **{name: {name: case} for name, case in {**DRAWN, **IMPORTED, **grids(GRID_SIZE)}.items()},
    "random rooms": rooms_at_random(range(6)),
    "random buildings": buildings_at_random(range(40)),
}


class Tally:
    """Results in one mode on a group of buildings."""

    def __init__(self, group: str, mode: RouteMode) -> None:
        self.group, self.mode = group, mode
        self.counts: Counter[str] = Counter()
        self.ratios: list[float] = []
        self.wrong: list[str] = []

    def add(self, building: str, query: Query, verdict: Verdict, ratio: float | None) -> None:
        self.counts["queries"] += 1
        self.counts[verdict.outcome] += 1
        self.counts["with objections"] += bool(verdict.objections)
        too_long = ratio is not None and ratio > MAX_RATIO
        self.counts["too long"] += too_long
        if ratio is not None:
            self.ratios.append(ratio)
        if (too_long or verdict.objections) and len(self.wrong) < EXAMPLES:
            self.wrong.append(f"{building}, {self.mode.name}: {query}\n    {verdict}, ratio {ratio}")

    def row(self) -> dict[str, Any]:
        return {
            "building": self.group,
            "mode": self.mode.name.lower(),
            **{
                name: self.counts[name]
                for name in ("queries", "found", "NoPath", "NotFree", "with objections", "too long")
            },
            "longest ratio": max(self.ratios, default=None),
        }


def main() -> None:
    share = -(-QUERIES // sum(map(len, GROUPS.values())))
    tallies: list[Tally] = []
    for group, cases in track(GROUPS.items(), "buildings", console=PROGRESS, transient=True):
        by_mode = {mode: Tally(group, mode) for mode in RouteMode}
        for name, case in cases.items():
            try_building(name, case, share, by_mode)
        tallies += by_mode.values()
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / "every_query_wrong.txt").write_text("\n".join(text for tally in tallies for text in tally.wrong) + "\n")
    if not show(tallies):
        sys.exit("every_query: some answers are wrong, see every_query_wrong.txt")


def try_building(name: str, case: Case, count: int, tallies: dict[RouteMode, Tally]) -> None:
    """Make `count` queries in each mode and judge the answers."""
    building = case.make()
    planner, judge = PathPlanner(building), Judge(building)
    queries = list(Adversary(building, case.radius_m, judge.fits).queries(count))
    for mode, tally in tallies.items():
        deadline = time.monotonic() + LIMIT_S
        for answer in judged(case, planner, judge, mode, queries):
            tally.add(name, *answer)
            if time.monotonic() > deadline:
                break


def show(tallies: Sequence[Tally]) -> bool:
    """Print and write the results; returns whether every answer was right."""
    total: Counter[str] = Counter()
    for tally in tallies:
        total.update(tally.counts)
    fewest = min(sum(tally.counts["queries"] for tally in tallies if tally.mode is mode) for mode in RouteMode)
    ratios = sorted(ratio for tally in tallies for ratio in tally.ratios)
    marks: list[Mark] = [
        at_least("queries in each mode", fewest, QUERIES),
        at_most("answers with objections", total["with objections"], 0),
        at_most("longest geometric path to the shortest", max(ratios, default=1.0), MAX_RATIO),
    ]

    def draw(axes: Axes) -> None:
        axes.plot(ratios, [i / len(ratios) for i in range(len(ratios))])
        axes.set(xlabel="length of geometric paths to that of the shortest", ylabel="share of paths below")

    wrong = total["with objections"] + total["too long"]
    title = f"{wrong:,} of {total['queries']:,} answers are wrong"
    return summarize("every_query", title, [tally.row() for tally in tallies], marks, draw)


if __name__ == "__main__":
    main()
