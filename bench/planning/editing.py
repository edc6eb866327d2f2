"""1,000 edits by two client processes while four others query paths without pause, all over CORBA to one server.

Before the edits begin, the four query for a while on their own: the difference is the cost of editing. An accepted
edit that is missing in the building fails the bench, as does any error of any client."""

from __future__ import annotations

import itertools
import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

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
from testkit.json_process import checked_call
from testkit.report import at_most, distribution, summarize, summary, timed_ms

EDITORS, PLANNERS = 2, 4
#: Duration of the queries without edits, and of the warm-up before them [s].
QUIET_S, WARM_UP_S = 3.0, 0.5
#: Maximum time that a planner may wait for its next answer [ms].
MAX_GAP_MS = 100.0

#: A counter of all editors, in the name of its sub-network: an overwritten edit is missing in the sum.
TALLY = Area(name="bench-tally", polygon=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), subnet="0")
TALLY_FLOOR = "L1"

#: Changed elements; None for removed ones.
Elements = dict[ElementKey, Element | None]
Trip = tuple[Place, Place]
#: Arrivals of paths [s of the clock that all processes share], and their durations [ms].
Answers = list[tuple[float, float]]


class Accepted(NamedTuple):
    """An accepted edit: the resulting version, the changed elements, and the ms from its first call to its last."""

    version: int
    after: Elements
    took_ms: float


class Edited(NamedTuple):
    """Result of an editor: its edits, when they began and ended, and how many it repeated because they were stale."""

    edits: list[Accepted]
    began: float
    ended: float
    repeated: int


# ---- the bench ----


def main(rounds: int = 3, edits: int = 1000) -> bool:
    rows, lost, samples = [], [], {}
    with folder_of_bench() as state, servers(state) as naming, Orb(naming) as orb:
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        editor.create(TALLY_FLOOR, maps.element(TALLY))
        trips = _reachable(orb.resolve("PathPlanner", RoboCorba.PathPlanner))
        for round_ in progress(range(1, rounds + 1), f"rounds of {edits} edits beside {PLANNERS} planners"):
            before, version = _elements(editor), editor._get_currentVersion()
            answers, edited = _round(naming, trips, edits)
            made = [edit for each in edited for edit in each.edits]
            errors = _errors(editor, before, version, made)
            began, ended = min(each.began for each in edited), max(each.ended for each in edited)
            took = [edit.took_ms for edit in made]
            quiet, quiet_columns = _paths(answers, began - QUIET_S, began)
            busy, busy_columns = _paths(answers, began, ended)
            edit_columns: dict[str, Any] = {
                "edits/s": len(made) / (ended - began),
                **summary(took, "edit, median ms", "edit, p99 ms"),
                "stale": sum(each.repeated for each in edited),
                "lost": len(errors),
            }
            rows.append({"round": f"{round_}, nobody edits", **dict.fromkeys(edit_columns), **quiet_columns})
            rows.append({"round": f"{round_}, edits", **edit_columns, **busy_columns})
            samples = {"edit": took, "getPath during edits": busy, "getPath, nobody edits": quiet}
            lost += [f"round {round_}: {error}" for error in errors]
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
    for start, goal in random_trips(load_sample("five-floors"), SMARTPAL_RADIUS_M, 500, seed=11):
        try:
            planner.getPath(paths.point(start), paths.point(goal))
        except RoboCorba.NoPath:
            continue
        found.append((start, goal))
    return found


def _round(naming: Address, trips: Sequence[Trip], edits: int) -> tuple[list[Answers], list[Edited]]:
    """Answers of each planner and results of each editor; each is a process with its own ORB."""
    context, clients = multiprocessing.get_context("spawn"), EDITORS + PLANNERS
    start, done = context.Barrier(clients, timeout=60), context.Event()
    with ProcessPoolExecutor(clients, context, initializer=_remember, initargs=(start, done)) as pool:
        planners = [pool.submit(plan, naming, trips[i::PLANNERS]) for i in range(PLANNERS)]
        editors = [pool.submit(edit, naming, f"editor{i + 1}", edits // EDITORS) for i in range(EDITORS)]
        wait(editors)
        done.set()
    futures: list[Future[Any]] = [*editors, *planners]
    errors = [error for error in (future.exception() for future in futures) if error]
    # If a client fails early, the others fail at the start barrier: those errors come last.
    for error in sorted(errors, key=lambda error: isinstance(error, threading.BrokenBarrierError)):
        raise error
    return [future.result() for future in planners], [future.result() for future in editors]


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
    lost = [f"the edit of version {edit.version} is lost" for edit in edits if made.get(edit.version) != edit.after]
    if len(made) != len(edits):
        lost.append(f"{len(edits)} edits were accepted, the history holds {len(made)}")
    if replayed != _elements(editor):
        lost.append("the changes since the first version do not lead to the present building")
    tally = key_of(TALLY_FLOOR, TALLY)
    counted, sum_ = sum(tally in edit.after for edit in edits), _count_of(replayed[tally]) - _count_of(before[tally])
    if counted != sum_:
        lost.append(f"the editors counted {counted} times, the tally rose by {sum_}")
    return lost


def _count_of(element: Element | None) -> int:
    assert isinstance(element, Area)
    return int(element.subnet)


# ---- the clients, each in a process of its own ----

_start: threading.Barrier
_done: threading.Event


def _remember(start: Any, done: Any) -> None:
    """Store what all clients share: the common start, and the end of the editors."""
    global _start, _done
    _start, _done = start, done


def plan(naming: Address, trips: Sequence[Trip]) -> Answers:
    """Query one path after another until the editors are done."""
    answers: Answers = []
    points = [(paths.point(start), paths.point(goal)) for start, goal in trips]
    with Orb(naming) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        _start.wait()
        for start, goal in itertools.cycle(points):
            _, took_ms = timed_ms(checked_call, planner.getPath, start, goal)
            answers.append((time.monotonic(), took_ms))
            if _done.is_set():
                break
    return answers


def edit(naming: Address, name: str, count: int) -> Edited:
    """After the quiet time, make `count` edits in sequence."""
    edits = []
    with Orb(naming) as orb:
        editor = Editor(orb.resolve("MapEditor", RoboCorba.MapEditor), name)
        _start.wait()
        time.sleep(WARM_UP_S + QUIET_S)
        began = time.monotonic()
        for step in itertools.islice(editor.steps(), count):
            (version, after), took_ms = timed_ms(checked_call, step)
            edits.append(Accepted(version, after, took_ms))
        return Edited(edits, began, time.monotonic(), editor.repeated)


Step = Callable[[], tuple[int, Elements]]


class Editor:
    """Makes edits that never close a passage, so that all queried paths exist all the time: a lamp on a table (which
    rebuilds the walls and objects of its floor), a short spur of the topological map, and the tally that all editors
    share."""

    def __init__(self, editor: Any, name: str) -> None:
        self.editor, self.name, self.repeated = editor, name, 0
        self.floors = load_sample("five-floors").floors
        self.versions: dict[ElementKey, int] = {}

    def steps(self) -> Iterator[Step]:
        """Endless edits: ten on a floor, which leave nothing behind, then on the next floor."""
        return itertools.chain.from_iterable(self._ten(entry) for entry in itertools.cycle(self.floors.values()))

    def _ten(self, entry: FloorMap) -> list[Step]:
        floor, objects = entry.floor.name, entry.geometrical.objects.values()
        x, y = next(item.at for item in objects if isinstance(item.shape, BoxShape) and min(item.shape.size) >= 0.5)
        node = next(node for node in entry.topological.nodes.values() if not node.elevator)
        lamp = MapObject(name=f"{self.name}-lamp", shape=CircleShape(radius=0.1), at=(x, y))
        spur = PathNode(name=f"{self.name}-spur", at=(node.at[0] + 0.05, node.at[1]))
        edge = PathEdge(name=f"{self.name}-edge", a=node.name, b=spur.name)
        return [
            partial(self._create, floor, lamp),
            partial(self._change, floor, msgspec.structs.replace(lamp, at=(x + 0.05, y))),
            partial(self._create_together, floor, spur, edge),
            self._count,
            partial(self._change, floor, msgspec.structs.replace(edge, speed_limit=0.5)),
            partial(self._change, floor, msgspec.structs.replace(lamp, at=(x - 0.05, y))),
            partial(self._change, floor, edge),
            partial(self._remove_together, floor, edge, spur),
            self._count,
            partial(self._remove, floor, lamp),
        ]

    def _create(self, floor: str, element: Element) -> tuple[int, Elements]:
        return self._made(self.editor.create(floor, maps.element(element)), {key_of(floor, element): element})

    def _change(self, floor: str, element: Element) -> tuple[int, Elements]:
        key = key_of(floor, element)
        version = self.editor.change(floor, maps.element(element), self.versions[key])
        return self._made(version, {key: element})

    def _remove(self, floor: str, element: Element) -> tuple[int, Elements]:
        key = key_of(floor, element)
        return self._made(self.editor.remove(maps.element_id(*key.words), self.versions[key]), {key: None})

    def _create_together(self, floor: str, *elements: Element) -> tuple[int, Elements]:
        transaction = self.editor.begin()
        for element in elements:
            transaction.create(floor, maps.element(element))
        return self._made(transaction.commit(), {key_of(floor, element): element for element in elements})

    def _remove_together(self, floor: str, *elements: Element) -> tuple[int, Elements]:
        transaction, keys = self.editor.begin(), [key_of(floor, element) for element in elements]
        for key in keys:
            transaction.remove(maps.element_id(*key.words), self.versions[key])
        return self._made(transaction.commit(), dict.fromkeys(keys))

    def _count(self) -> tuple[int, Elements]:
        """Read the tally and increment it; repeat if another editor did so in between."""
        key = key_of(TALLY_FLOOR, TALLY)
        while True:
            record = self.editor.read(maps.element_id(*key.words))
            higher = msgspec.structs.replace(TALLY, subnet=str(_count_of(maps.element_of(record.value)) + 1))
            try:
                return self._made(
                    self.editor.change(TALLY_FLOOR, maps.element(higher), record.changedAt), {key: higher}
                )
            except RoboCorba.StaleEdit:
                self.repeated += 1

    def _made(self, version: int, after: Elements) -> tuple[int, Elements]:
        self.versions.update(dict.fromkeys(after, version))
        return version, after


if __name__ == "__main__":
    run(main)
