"""The buildings of the planner tests, drawn, generated and imported, and the judge's verdicts on queries in them."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

from robocorba.map_editor.formats import read_map
from robocorba.map_editor.model import Building
from robocorba.map_editor.samples import SAMPLES, load_sample
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Criterion, PathRequest, RouteMode
from testkit.grid_maps import KINDS, building_of
from tests.planning.adversary import Query
from tests.planning.judge import Judge, Verdict
from tests.planning.scenes import (
    isolated_node,
    one_way_hall,
    random_building,
    random_room,
    tower,
    two_halls,
    two_rooms,
    with_random_roads,
)

#: Folder of real buildings, tested if present.
REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "rmf"
#: Side of a cell of the generated grid maps [m].
GRID_CELL_M = 0.5
#: A geometric path may be longer than the shortest by this factor: arcs become tangent lines outside of them.
MAX_RATIO = 1.01
#: Shorter paths are not compared, because the tangent lines of one arc count for more [m].
SHORT_M = 0.5
#: Examples of objections that are printed.
MAX_EXAMPLES = 10
#: Kinds of grid maps, and their number of random nodes.
GRID_KINDS = (("rooms of 8", 0), ("maze of 4", 30), ("cave", 30), ("city", 0), ("laser", 30))


class Case(NamedTuple):
    """A building and the radius of its robot. `is_small`: a visibility graph gives exact lengths within seconds."""

    make: Callable[[], Building]
    radius_m: float
    is_small: bool = True


def _grid(kind: str, size: int, nodes: int) -> Building:
    return with_random_roads(building_of(KINDS[kind](size, 1), GRID_CELL_M), nodes, seed=1)


def _real(file: str) -> Building:
    return read_map(REAL / file).building


#: Drawn and sample buildings by name, with radii that fit them.
DRAWN: dict[str, Case] = {
    "two halls": Case(two_halls, 0.4),
    "one-way hall": Case(one_way_hall, 0.4),
    "isolated node": Case(isolated_node, 0.4),
    "two rooms": Case(partial(two_rooms, 1.2), 0.4),
    "tower": Case(tower, 0.4),
    "tower, L3 not served": Case(partial(tower, 3, ("L1", "L2")), 0.4),
    **{name: Case(partial(load_sample, name), 0.4, is_small=name == "paper-scene") for name in SAMPLES},
}
REAL_FILES = ("office.building.yaml", "hotel.building.yaml")
IMPORTED: dict[str, Case] = {
    file: Case(partial(_real, file), 0.25, is_small="office" in file) for file in REAL_FILES if (REAL / file).exists()
}


def grids(size: int) -> dict[str, Case]:
    """Grid maps of size x size cells, some with a random roadmap."""
    return {
        f"{kind}, {nodes} nodes": Case(partial(_grid, kind, size, nodes), 0.2, is_small=size <= 32)
        for kind, nodes in GRID_KINDS
    }


def rooms_at_random(seeds: range) -> dict[str, Case]:
    """Single rooms with boxes and walls, without a roadmap."""
    return {f"random room {seed}": Case(partial(random_room, seed), 0.4) for seed in seeds}


def buildings_at_random(seeds: range) -> dict[str, Case]:
    """Generated buildings; every third is for a large robot."""
    return {
        f"random building {seed}": Case(partial(random_building, seed), 0.4 if seed % 3 == 0 else 0.25)
        for seed in seeds
    }


def judged(
    case: Case, planner: PathPlanner, judge: Judge, mode: RouteMode, queries: Iterable[Query]
) -> Iterator[tuple[Query, Verdict, float | None]]:
    """The verdict on each query, the best path by distance and by time in turn. On small buildings the length of a
    geometric path by distance is compared to that of the shortest: their ratio, None if not compared."""
    for query, best in zip(queries, cycle(Criterion), strict=False):
        request = PathRequest(query.start, query.goal, radius=case.radius_m, speed=0.8, mode=mode, best=best)
        verdict, ratio = judge.verdict(planner, request), None
        is_compared = case.is_small and mode is RouteMode.GEOMETRIC and best is Criterion.SHORTEST_DISTANCE
        if is_compared and verdict.length_m > SHORT_M and not verdict.objections:
            length = judge.exact_length(request)
            ratio = None if math.isnan(length) else verdict.length_m / length
        yield query, verdict, ratio


def report(answers: Iterable[tuple[str, Verdict]]) -> None:
    """Print the counts of answers and examples of objections; exit with 1 if there are any."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    for asked, verdict in answers:
        counts.update(["answers", verdict.outcome])
        wrong += [f"{asked}\n    {text}" for text in verdict.objections[:1]]
    print(*wrong[:MAX_EXAMPLES], ", ".join(f"{count} {name}" for name, count in counts.items()), sep="\n")
    if wrong:
        sys.exit(f"{len(wrong)} answers are wrong")
