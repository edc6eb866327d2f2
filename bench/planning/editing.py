"""1,000 edits by two client processes while four others query paths without pause, all over CORBA to one server.

    python -m bench.planning.editing [--rounds 3] [--edits 1000]

Before the edits begin, the four query for a while on their own: the difference is the cost of editing. An accepted
edit that is missing in the building fails the bench, as does any error of any client."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import msgspec

from bench.common.harness import folder_of_bench, progress, run
from robocorba.clients.robot_processes import servers
from robocorba.map_editor import native
from robocorba.map_editor.changes import ElementKey, elements_of, key_of
from robocorba.map_editor.corba import maps
from robocorba.map_editor.model import Area, BoxShape, CircleShape, Element, FloorMap, MapObject, PathEdge, PathNode
from robocorba.map_editor.samples import load_sample
from robocorba.orb.orb import Orb
from robocorba.planning.corba import paths
from robocorba.planning.request import SMARTPAL_RADIUS_M, Place
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.generated_buildings import random_trips
from testkit.json_process import ObjectProcess, checked_call
from testkit.report import at_most, distribution, summarize, summary, timed_ms

EDITORS, PLANNERS = 2, 4
#: Duration of the queries without edits [s].
QUIET_S = 3.0
#: Maximum time that a planner may wait for its next answer [ms].
MAX_GAP_MS = 100.0
BUILDING = "five-floors"

#: A counter of all editors, in the name of its sub-network: an overwritten edit is missing in the sum.
TALLY = Area(name="bench-tally", polygon=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), subnet="0")
TALLY_FLOOR = "L1"

#: Changed elements; None for removed ones.
Elements = dict[ElementKey, Element | None]
Trip = tuple[Place, Place]
#: Arrivals of paths [s of the clock that all processes share], and their durations [ms].
Answers = list[tuple[float, float]]
#: An accepted edit: the resulting version, the changed elements, and the ms from its first call to its last.
Accepted = tuple[int, Elements, float]


def main(rounds: int = 3, edits: int = 1000) -> bool:
    rows: list[dict[str, Any]] = []
    lost, samples = list[str](), dict[str, list[float]]()
    with folder_of_bench() as folder, servers(folder) as naming, Orb(naming) as orb, contextlib.ExitStack() as stack:
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        editor.create(TALLY_FLOOR, maps.element(TALLY))
        trips = _reachable(orb.resolve("PathPlanner", RoboCorba.PathPlanner))
        planners = [ObjectProcess(planner, naming, trips[i::PLANNERS]) for i in range(PLANNERS)]
        editors = [ObjectProcess(editing, naming, f"editor{i + 1}") for i in range(EDITORS)]
        for each in (*planners, *editors):
            stack.enter_context(each)
        for round_ in progress(range(1, rounds + 1), f"rounds of {edits} edits beside {PLANNERS} planners"):
            before, version = _elements(editor), editor._get_currentVersion()
            for each in planners:
                each.call("begin")
            time.sleep(QUIET_S)
            began = time.monotonic()
            for each in editors:
                each.send("edit", edits // EDITORS)
            results = [each.receive() for each in editors]
            ended = time.monotonic()
            answers = [each.call("end") for each in planners]
            made = [edit for found, _ in results for edit in found]
            errors = _errors(editor, before, version, made)
            lost += [f"round {round_}: {error}" for error in errors]
            took = [took_ms for _, _, took_ms in made]
            quiet, quiet_columns = _paths(answers, began - QUIET_S, began)
            busy, busy_columns = _paths(answers, began, ended)
            edit_columns: dict[str, Any] = {
                "edits/s": len(made) / (ended - began),
                **summary(took, "edit, median ms", "edit, p99 ms"),
                "stale": sum(repeated for _, repeated in results),
                "lost": len(errors),
            }
            rows.append({"round": f"{round_}, nobody edits", **dict.fromkeys(edit_columns), **quiet_columns})
            rows.append({"round": f"{round_}, edits", **edit_columns, **busy_columns})
            samples = {"edit": took, "getPath during edits": busy, "getPath, nobody edits": quiet}
    print("\n".join(lost[:10]))
    marks = [
        at_most("lost edits, errors", len(lost), 0),
        at_most("longest gap during edits, ms", max(row["longest gap ms"] for row in rows[1::2]), MAX_GAP_MS),
    ]
    title = f"{edits} edits by {EDITORS} clients beside {PLANNERS} planners"
    return summarize("editing", title, rows, marks, distribution(samples, "milliseconds"))


def _reachable(planner: Any) -> list[Trip]:
    """Trips with a path; a few random places are enclosed by furniture."""
    found = []
    for start, goal in random_trips(load_sample(BUILDING), SMARTPAL_RADIUS_M, 500, seed=11):
        with contextlib.suppress(RoboCorba.NoPath):
            planner.getPath(paths.point(start), paths.point(goal))
            found.append((start, goal))
    return found


def _paths(answers: list[Answers], began: float, ended: float) -> tuple[list[float], dict[str, Any]]:
    """The ms of all answers in an interval, and the columns about them; a gap is between two answers of one client."""
    took = [ms for each in answers for at, ms in each if began <= at <= ended]
    gaps = [
        (after - before) * 1e3
        for each in answers
        for (before, _), (after, _) in pairwise(each)
        if before < ended and after > began
    ]
    times = summary(took, "getPath, median ms", "getPath, p99 ms")
    return took, {"paths/s": len(took) / (ended - began), **times, "longest gap ms": max(gaps)}


def _elements(editor: Any) -> Elements:
    """All elements of the present building."""
    return dict(elements_of(native.loads(editor.exportMap())))


def _errors(editor: Any, before: Elements, version: int, edits: Sequence[Accepted]) -> list[str]:
    """Errors of the building after `edits`, if it was `before` at `version`."""
    made: dict[int, Elements] = {}
    replayed = dict(before)
    for change in editor.changesSince(version):
        element = maps.element_of(change.value)
        key = key_of(change.onFloor, element)
        made.setdefault(change.changedTo, {})[key] = None if change.kind == RoboCorba.REMOVED else element
    for _, after in sorted(made.items()):
        replayed.update(after)
    replayed = {key: element for key, element in replayed.items() if element is not None}
    lost = [f"the edit of version {number} is lost" for number, after, _ in edits if made.get(number) != after]
    if len(made) != len(edits):
        lost.append(f"{len(edits)} edits were accepted, the history holds {len(made)}")
    if replayed != _elements(editor):
        lost.append("the changes since the first version do not lead to the present building")
    tally = key_of(TALLY_FLOOR, TALLY)
    counted, sum_ = sum(tally in after for _, after, _ in edits), _count_of(replayed[tally]) - _count_of(before[tally])
    if counted != sum_:
        lost.append(f"the editors counted {counted} times, the tally rose by {sum_}")
    return lost


def _count_of(element: Element | None) -> int:
    assert isinstance(element, Area)
    return int(element.subnet)


# ---- the clients, each in a process of its own ----


class Planner:
    """Queries one path after another between `begin` and `end`."""

    def __init__(self, server: Any, trips: Sequence[Trip]) -> None:
        self._server, self._trips = server, trips
        self._answers: Answers = []
        self._error: RuntimeError | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread()

    def begin(self) -> None:
        self._ended.clear()
        self._answers = []
        self._thread = threading.Thread(target=self._query)
        self._thread.start()

    def end(self) -> Answers:
        self._ended.set()
        self._thread.join()
        if self._error:
            raise self._error
        return self._answers

    def _query(self) -> None:
        for start, goal in itertools.cycle([(paths.point(start), paths.point(goal)) for start, goal in self._trips]):
            if self._ended.is_set():
                return
            try:
                _, took_ms = timed_ms(checked_call, self._server.getPath, start, goal)
            except RuntimeError as error:
                self._error = error
                return
            self._answers.append((time.monotonic(), took_ms))


@contextlib.contextmanager
def planner(naming: Address, trips: Sequence[Trip]) -> Iterator[Planner]:
    with Orb(naming) as orb:
        yield Planner(orb.resolve("PathPlanner", RoboCorba.PathPlanner), trips)


@contextlib.contextmanager
def editing(naming: Address, name: str) -> Iterator[Editor]:
    with Orb(naming) as orb:
        yield Editor(orb.resolve("MapEditor", RoboCorba.MapEditor), name)


class Editor:
    """Makes edits that never close a passage, so that all queried paths exist all the time: a lamp on a table (which
    rebuilds the walls and objects of its floor), a short spur of the topological map, and the tally that all editors
    share."""

    def __init__(self, editor: Any, name: str) -> None:
        self._editor, self._name, self._repeated = editor, name, 0
        self._versions: dict[ElementKey, int] = {}

    def edit(self, count: int) -> tuple[list[Accepted], int]:
        """Make edits, and count those that were repeated because they were stale: ten on a floor, which leave nothing
        behind, then on the next floor."""
        found, self._repeated = list[Accepted](), 0
        floors = itertools.cycle(load_sample(BUILDING).floors.values())
        for step in itertools.islice(itertools.chain.from_iterable(map(self._ten, floors)), count):
            (version, after), took_ms = timed_ms(checked_call, step)
            found.append((version, after, took_ms))
        return found, self._repeated

    def _ten(self, entry: FloorMap) -> list[Callable[[], tuple[int, Elements]]]:
        floor, objects = entry.floor.name, entry.geometrical.objects.values()
        x, y = next(item.at for item in objects if isinstance(item.shape, BoxShape) and min(item.shape.size) >= 0.5)
        node = next(node for node in entry.topological.nodes.values() if not node.elevator)
        lamp = MapObject(name=f"{self._name}-lamp", shape=CircleShape(radius=0.1), at=(x, y))
        spur = PathNode(name=f"{self._name}-spur", at=(node.at[0] + 0.05, node.at[1]))
        edge = PathEdge(name=f"{self._name}-edge", a=node.name, b=spur.name)
        return [
            partial(self._create, floor, lamp),
            partial(self._change, floor, msgspec.structs.replace(lamp, at=(x + 0.05, y))),
            partial(self._create, floor, spur, edge),
            self._count,
            partial(self._change, floor, msgspec.structs.replace(edge, speed_limit=0.5)),
            partial(self._change, floor, msgspec.structs.replace(lamp, at=(x - 0.05, y))),
            partial(self._change, floor, edge),
            partial(self._remove, floor, edge, spur),
            self._count,
            partial(self._remove, floor, lamp),
        ]

    def _create(self, floor: str, *elements: Element) -> tuple[int, Elements]:
        transaction = self._editor.begin()
        for element in elements:
            transaction.create(floor, maps.element(element))
        return self._made(transaction.commit(), {key_of(floor, element): element for element in elements})

    def _change(self, floor: str, element: Element) -> tuple[int, Elements]:
        key = key_of(floor, element)
        version = self._editor.change(floor, maps.element(element), self._versions[key])
        return self._made(version, {key: element})

    def _remove(self, floor: str, *elements: Element) -> tuple[int, Elements]:
        transaction, keys = self._editor.begin(), [key_of(floor, element) for element in elements]
        for key in keys:
            transaction.remove(maps.element_id(*key.words), self._versions[key])
        return self._made(transaction.commit(), dict.fromkeys(keys))

    def _count(self) -> tuple[int, Elements]:
        """Read the tally and increment it; repeat if another editor did so in between."""
        key = key_of(TALLY_FLOOR, TALLY)
        while True:
            record = self._editor.read(maps.element_id(*key.words))
            higher = msgspec.structs.replace(TALLY, subnet=str(_count_of(maps.element_of(record.value)) + 1))
            with contextlib.suppress(RoboCorba.StaleEdit):
                version = self._editor.change(TALLY_FLOOR, maps.element(higher), record.changedAt)
                return self._made(version, {key: higher})
            self._repeated += 1

    def _made(self, version: int, after: Elements) -> tuple[int, Elements]:
        self._versions.update(dict.fromkeys(after, version))
        return version, after


if __name__ == "__main__":
    run(main)
