"""1,000 edits by two client processes while four others query paths without pause, all over CORBA to one server.

Before the edits begin, the four query for a while on their own: the difference is the cost of editing. An accepted
edit that is missing in the building fails the bench, as does any error of any client.
"""

from __future__ import annotations

import itertools
import multiprocessing
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
from omniORB import CORBA

from bench import RESULTS
from bench.common.places import random_trips
from robocorba.clients.robot_processes import servers
from robocorba.corba.calls import describe, error_of
from robocorba.corba.conversion import maps, paths
from robocorba.corba.orb import Orb
from robocorba.maps import native
from robocorba.maps.changes import ElementKey, elements_of, key_of
from robocorba.maps.model import Area, BoxShape, CircleShape, Element, FloorMap, MapObject, PathEdge, PathNode
from robocorba.maps.samples import load_sample
from robocorba.planning.request import Place
from robocorba.settings import Address
from robocorba.spatial.pose import SMARTPAL_RADIUS_M, XY
from robocorba.stubs import RoboCorba
from robocorba.testing.report import PROGRESS, quantile, summarize_samples, timed_ms

ROUNDS, EDITS, EDITORS, PLANNERS = 3, 1000, 2, 4
#: Duration of the queries without edits, and of the warm-up before them [s].
QUIET_S, WARM_UP_S = 3.0, 0.5
#: Greatest time that a planner may wait for its next answer [ms].
MAX_GAP_MS = 100.0

#: A counter of all editors, in the name of its sub-network: an overwritten edit is missing in the sum.
TALLY = Area(name="bench-tally", polygon=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), subnet="0")
TALLY_FLOOR = "L1"

T = TypeVar("T")
#: Changed elements; None for removed ones.
Elements = dict[ElementKey, Element | None]
Trip = tuple[Place, Place]


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


class Answer(NamedTuple):
    """Arrival of a path [s of the clock that all processes share], and its duration [ms]."""

    at: float
    took_ms: float


# ---- the bench ----


def main() -> None:
    rows, missed = [], []
    samples: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as state, servers(Path(state)) as naming, Orb(naming) as orb:
        editor = orb.resolve("MapEditor", RoboCorba.MapEditor)
        editor.create(TALLY_FLOOR, maps.element(TALLY))
        trips = _reachable(orb.resolve("PathPlanner", RoboCorba.PathPlanner))
        for round_ in range(1, ROUNDS + 1):
            before, version = _elements(editor), editor._get_currentVersion()
            with PROGRESS.status(f"round {round_} of {ROUNDS}: {EDITS} edits beside {PLANNERS} planners"):
                answers, edited = _round(naming, trips)
            edits = [edit for each in edited for edit in each.edits]
            lost = _lost(editor, before, version, edits)
            began, ended = min(each.began for each in edited), max(each.ended for each in edited)
            quiet, quiet_gap = _within(answers, began - QUIET_S, began)
            busy, gap = _within(answers, began, ended)
            took = [edit.took_ms for edit in edits]
            rows += [
                {**_row(f"{round_}, nobody edits"), **_paths(quiet, quiet_gap, QUIET_S)},
                {
                    **_row(f"{round_}, edits"),
                    "edits/s": len(edits) / (ended - began),
                    "edit, median ms": statistics.median(took),
                    "edit, p99 ms": quantile(took, 0.99),
                    "stale": sum(each.repeated for each in edited),
                    "lost": len(lost),
                    **_paths(busy, gap, ended - began),
                },
            ]
            samples = {"edit": took, "getPath during edits": busy, "getPath, nobody edits": quiet}
            missed += [f"round {round_}: {what}" for what in lost]
            if gap > MAX_GAP_MS:
                missed.append(f"round {round_}: a planner waited {gap:.0f} ms, {MAX_GAP_MS:g} ms are allowed")
    summarize_samples(
        RESULTS / "editing",
        f"{EDITS} edits by {EDITORS} clients beside {PLANNERS} planners",
        rows,
        samples,
        "milliseconds",
    )
    if missed:
        sys.exit("editing: " + "; ".join(missed[:10]))


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


def _round(naming: Address, trips: Sequence[Trip]) -> tuple[list[list[Answer]], list[Edited]]:
    """Answers of each planner and results of each editor; each is a process with its own ORB."""
    context, clients = multiprocessing.get_context("spawn"), EDITORS + PLANNERS
    start, done = context.Barrier(clients, timeout=60), context.Event()
    with ProcessPoolExecutor(clients, context, initializer=_remember, initargs=(start, done)) as pool:
        planners = [pool.submit(plan, naming, trips[i::PLANNERS]) for i in range(PLANNERS)]
        editors = [pool.submit(edit, naming, f"editor{i + 1}", EDITS // EDITORS) for i in range(EDITORS)]
        wait(editors)
        done.set()
        wait(planners)
    futures: list[Future[Any]] = [*editors, *planners]
    errors = [error for error in (future.exception() for future in futures) if error]
    # If a client fails early, the others fail at the start barrier: those errors come last.
    for error in sorted(errors, key=lambda error: isinstance(error, threading.BrokenBarrierError)):
        raise error
    return [future.result() for future in planners], [future.result() for future in editors]


def _within(answers: list[list[Answer]], began: float, ended: float) -> tuple[list[float], float]:
    """The ms of all answers in an interval, and the longest gap between two answers of one client."""
    took = [answer.took_ms for each in answers for answer in each if began <= answer.at <= ended]
    gaps = [
        (after.at - before.at) * 1e3
        for each in answers
        for before, after in pairwise(each)
        if before.at < ended and after.at > began
    ]
    return took, max(gaps)


def _row(round_: str) -> dict[str, Any]:
    """A row of the table without edits."""
    edits = ("edits/s", "edit, median ms", "edit, p99 ms", "stale", "lost")
    return {"round": round_, **dict.fromkeys(edits)}


def _paths(took: Sequence[float], gap: float, seconds: float) -> dict[str, float]:
    """The columns of a row about paths."""
    return {
        "paths/s": len(took) / seconds,
        "getPath, median ms": statistics.median(took),
        "getPath, p99 ms": quantile(took, 0.99),
        "longest gap ms": gap,
    }


def _elements(editor: Any) -> Elements:
    """All elements of the present building."""
    return dict(elements_of(native.loads(editor.exportMap())))


def _lost(editor: Any, before: Elements, version: int, edits: Sequence[Accepted]) -> list[str]:
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


def plan(naming: Address, trips: Sequence[Trip]) -> list[Answer]:
    """Query one path after another until the editors are done."""
    answers = []
    points = [(paths.point(start), paths.point(goal)) for start, goal in trips]
    with Orb(naming) as orb:
        planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        _start.wait()
        for start, goal in itertools.cycle(points):
            _, took_ms = timed_ms(_with_picklable_errors, planner.getPath, start, goal)
            answers.append(Answer(time.monotonic(), took_ms))
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
            (version, after), took_ms = timed_ms(_with_picklable_errors, step)
            edits.append(Accepted(version, after, took_ms))
        return Edited(edits, began, time.monotonic(), editor.repeated)


def _with_picklable_errors(call: Callable[..., T], *arguments: object) -> T:
    """Make a call; its CORBA exceptions become one that can be pickled."""
    try:
        return call(*arguments)
    except CORBA.UserException as error:
        raise RuntimeError(error_of(error)) from None
    except CORBA.SystemException as error:
        raise RuntimeError(describe(error)) from None


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
        floor, (x, y), node = entry.floor.name, _table(entry), _plain_node(entry)
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
            read = maps.element_of(record.value)
            higher = msgspec.structs.replace(TALLY, subnet=str(_count_of(read) + 1))
            try:
                version = self.editor.change(TALLY_FLOOR, maps.element(higher), record.changedAt)
            except RoboCorba.StaleEdit:
                self.repeated += 1
                continue
            return self._made(version, {key: higher})

    def _made(self, version: int, after: Elements) -> tuple[int, Elements]:
        self.versions.update(dict.fromkeys(after, version))
        return version, after


def _table(entry: FloorMap) -> XY:
    """The centre of a piece of furniture that a lamp fits on."""
    objects = entry.geometrical.objects.values()
    return next(item.at for item in objects if isinstance(item.shape, BoxShape) and min(item.shape.size) >= 0.5)


def _plain_node(entry: FloorMap) -> PathNode:
    """A node outside the elevators."""
    return next(node for node in entry.topological.nodes.values() if not node.elevator)


if __name__ == "__main__":
    main()
