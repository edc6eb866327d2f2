"""Random requests with all options on random buildings with all rules, and on the samples: every answer judged.

    python -m tests.planning.every_request [BUILDINGS [REQUESTS [FIRST_SEED]]]

Measures no times: it counts the objections of the judge, prints examples, and exits with 1 if there are any."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
from rich.progress import track

from robocorba.maps.model import Building
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest
from robocorba.testing.report import PROGRESS
from tests.planning.adversary import Adversary
from tests.planning.every_building import DRAWN, IMPORTED
from tests.planning.judge import Judge, Verdict
from tests.planning.scenes import request_for, ruled_building, with_rules

#: Generated buildings, and requests on each building.
BUILDINGS, REQUESTS = 400, 50
#: Examples of objections that are printed.
EXAMPLES = 10


def judged(building: Building, count: int, seed: int) -> Iterator[tuple[PathRequest, Verdict]]:
    """Random requests on a building, each with the verdict on its answer."""
    rng, planner, judge = np.random.default_rng([seed, 2]), PathPlanner(building), Judge(building)
    for query in Adversary(building, 0.25, judge.fits, seed).queries(count):
        request = request_for(building, query, rng)
        yield request, judge.verdict(planner, request)


def cases(count: int, first: int) -> dict[str, Callable[[], Building]]:
    """Generated buildings by their seed, and the samples and real buildings with random rules."""
    found: dict[str, Callable[[], Building]] = {
        f"ruled {seed}": lambda seed=seed: ruled_building(seed)
        for seed in range(first, first + count)  # type: ignore
    }
    for number, (name, case) in enumerate({**DRAWN, **IMPORTED}.items()):
        found[name] = case.make
        found[f"{name}, ruled"] = lambda case=case, number=number: with_rules(  # type: ignore[misc]
            case.make(), np.random.default_rng(number)
        )
    return found


def main(buildings: int = BUILDINGS, requests: int = REQUESTS, first: int = 0) -> None:
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    for number, (name, make) in enumerate(
        track(cases(buildings, first).items(), "buildings", console=PROGRESS, transient=True)
    ):
        for request, verdict in judged(make(), requests, number):
            counts["requests"] += 1
            counts[verdict.outcome] += 1
            counts["objections"] += len(verdict.objections)
            wrong += [f"{name}: {request}\n    {text}" for text in verdict.objections[:1]]
    for text in wrong[:EXAMPLES]:
        print(text)
    print(", ".join(f"{count} {name}" for name, count in counts.items()))
    if wrong:
        sys.exit(f"{len(wrong)} answers are wrong")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
