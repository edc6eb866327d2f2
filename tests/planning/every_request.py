"""Random requests with all options on random buildings with all rules, and on the samples: every answer judged.

    python -m tests.planning.every_request [BUILDINGS [REQUESTS [FIRST_SEED]]]

Measures no times: it counts the objections of the judge, prints examples, and exits with 1 if there are any."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from rich.progress import track

from robocorba.map_editor.model import Building
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import PathRequest
from testkit.report import PROGRESS
from tests.planning.adversary import Adversary
from tests.planning.every_building import DRAWN, IMPORTED, report
from tests.planning.judge import Judge, Verdict
from tests.planning.scenes import request_for, ruled_building, with_rules

#: Generated buildings, and requests on each building.
BUILDINGS, REQUESTS = 400, 50


def judged(building: Building, count: int, seed: int) -> Iterator[tuple[PathRequest, Verdict]]:
    """Random requests on a building, each with the verdict on its answer."""
    rng, planner, judge = np.random.default_rng([seed, 2]), PathPlanner(building), Judge(building)
    for query in Adversary(building, 0.25, judge.fits, seed).queries(count):
        request = request_for(building, query, rng)
        yield request, judge.verdict(planner, request)


def cases(count: int, first: int) -> dict[str, Callable[[], Building]]:
    """Generated buildings by their seed, and the samples and real buildings with random rules."""
    found: dict[str, Callable[[], Building]] = {
        f"ruled {seed}": partial(ruled_building, seed) for seed in range(first, first + count)
    }
    for number, (name, case) in enumerate({**DRAWN, **IMPORTED}.items()):
        found |= {name: case.make, f"{name}, ruled": partial(_ruled, case.make, number)}
    return found


def _ruled(make: Callable[[], Building], seed: int) -> Building:
    return with_rules(make(), np.random.default_rng(seed))


def answers(buildings: int = BUILDINGS, requests: int = REQUESTS, first: int = 0) -> Iterator[tuple[str, Verdict]]:
    """The verdicts on the answers to all requests."""
    every = track(cases(buildings, first).items(), "buildings", console=PROGRESS, transient=True)
    for number, (name, make) in enumerate(every):
        for request, verdict in judged(make(), requests, number):
            yield f"{name}: {request}", verdict


if __name__ == "__main__":
    report(answers(*map(int, sys.argv[1:])))
