"""Edits by two client processes while four others query paths without pause, all over CORBA to one server.

    python -m bench.planning.editing [--rounds 2] [--seconds 25]

Before the edits begin, the four query for a while on their own: the difference is the cost of editing. An accepted
edit that is missing in the building fails the bench, as does any error of any client."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import msgspec

from bench.common.harness import progress, run, system
from bench.planning.get_path import PATH, calls_of
from robocorba.map_editor import native
from robocorba.map_editor.changes import ElementKey, elements_of, key_of
from robocorba.map_editor.corba import maps
from robocorba.map_editor.model import Area, BoxShape, CircleShape, Element, FloorMap, MapObject, PathNode
from robocorba.map_editor.samples import load_sample, sample_path
from robocorba.orb.orb import Orb
from robocorba.planning.request import SMARTPAL_RADIUS_M, Place
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.generated_buildings import random_trips
from testkit.json_process import ObjectProcess
from testkit.report import at_most, summarize, summary, timed_ms

EDITORS, PLANNERS = 2, 4
#: Duration of the queries without edits [s].
QUIET_S = 3.0
#: Maximum time that a planner may wait for its next answer [ms].
MAX_GAP_MS = 100.0
BUILDING = "five-floors"
#: A counter of all editors, in the name of its sub-network: an overwritten edit is missing in the sum.
TALLY = Area(name="bench-tally", polygon=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), subnet="0")
TALLY_FLOOR = "L1"
TALLY_KEY = key_of(TALLY_FLOOR, TALLY)

#: An accepted edit: the resulting version, the changed element, None for a removed one, and its duration [ms].
Accepted = tuple[int, ElementKey, Element | None, float]


def main(rounds: int = 2, seconds: float = 25.0) -> bool:
    rows: list[dict[str, Any]] = []
    lost, samples = list[str](), dict[str, list[float]]()
    with system(building=sample_path(BUILDING)) as found, contextlib.ExitStack() as stack:
        editor = found.resolve("MapEditor")
        editor.create(TALLY_FLOOR, maps.element(TALLY))
        trips = random_trips(load_sample(BUILDING), SMARTPAL_RADIUS_M, 500, seed=11)
        planners = [ObjectProcess(planner, found.orb.naming, trips[i::PLANNERS]) for i in range(PLANNERS)]
        editors = [ObjectProcess(editing, found.orb.naming, f"editor{i + 1}") for i in range(EDITORS)]
        for process in (*planners, *editors):
            stack.enter_context(process)
        for number in progress(range(1, rounds + 1), f"rounds of edits beside {PLANNERS} planners"):
            before, version = _elements(editor), editor._get_currentVersion()
            (quiet,) = at_once(QUIET_S, query=planners)
            busy, made = at_once(seconds, query=planners, edit=editors)
            lost += [f"round {number}: {error}" for error in _errors(editor, before, version, made)]
            took = [took_ms for *_, took_ms in made]
            edits = {"edits/s": len(made) / seconds, **summary(took, "edit, median ms", "edit, p99 ms")}
            for what, ms, more in (("nobody edits", quiet, {}), ("edits", busy, edits)):
                times = summary(ms, "getPath, median ms", "getPath, p99 ms", "longest gap ms")
                rows.append({"round": f"{number}, {what}", **times, **more})
            samples = {"edit": took, "getPath during edits": busy, "getPath, nobody edits": quiet}
    print("\n".join(lost[:10]))
    marks = [
        at_most("lost edits, errors", len(lost), 0),
        at_most("longest gap during edits, ms", max(row["longest gap ms"] for row in rows[1::2]), MAX_GAP_MS),
    ]
    title = f"edits by {EDITORS} clients beside {PLANNERS} planners"
    return summarize("editing", title, rows, marks, samples, "ms")


def at_once(seconds: float, **processes: Sequence[ObjectProcess]) -> Iterator[list[Any]]:
    """Call the methods of these names in all their processes; the joined answers of each."""
    for method, some in processes.items():
        for process in some:
            process.send(method, seconds)
    return (list(itertools.chain(*[process.receive() for process in some])) for some in processes.values())


def _elements(editor: Any) -> dict[ElementKey, Element]:
    """All elements of the present building."""
    return dict(elements_of(native.loads(editor.exportMap())))


def _errors(editor: Any, before: dict[ElementKey, Element], version: int, edits: Sequence[Accepted]) -> Iterator[str]:
    """Errors of the building after `edits`, if it was `before` at `version`."""
    made: dict[int, tuple[ElementKey, Element | None]] = {}
    for change in editor.changesSince(version):
        element = maps.element_of(change.value)
        key = key_of(change.onFloor, element)
        made[change.changedTo] = key, None if change.kind == RoboCorba.REMOVED else element
    replayed: dict[ElementKey, Element | None] = {**before, **dict(made[number] for number in sorted(made))}
    for number, key, after, _ in edits:
        if made.get(number) != (key, after):
            yield f"the edit of version {number} is lost"
    if len(made) != len(edits):
        yield f"{len(edits)} edits were accepted, the history holds {len(made)}"
    present = _elements(editor)
    if {key: element for key, element in replayed.items() if element is not None} != present:
        yield "the changes since the first version do not lead to the present building"
    counted = sum(key == TALLY_KEY for _, key, _, _ in edits)
    if counted != (rose := _count_of(present[TALLY_KEY]) - _count_of(before[TALLY_KEY])):
        yield f"the editors counted {counted} times, the tally rose by {rose}"


def _count_of(element: Element | None) -> int:
    assert isinstance(element, Area)
    return int(element.subnet)


# ---- the clients, each in a process of its own ----


class Planner:
    """Queries one path after another."""

    def __init__(self, server: Any, trips: Sequence[tuple[Place, Place]]) -> None:
        self._calls = [turn[PATH] for turn in calls_of(server, trips)[0]]

    def query(self, seconds: float) -> list[float]:
        """The durations of all queries in this time, which are the gaps between answers [ms]."""
        until, calls = time.monotonic() + seconds, itertools.cycle(self._calls)
        found = []
        while time.monotonic() < until:
            found.append(timed_ms(next(calls))[1])
        return found


class Editor:
    """Makes edits that never close a passage, so that all queried paths exist all the time: a lamp on a table (which
    rebuilds the walls and objects of its floor), a node of the topological map, and the tally that all editors
    share."""

    def __init__(self, editor: Any, name: str) -> None:
        self._editor, self._name = editor, name
        self._versions: dict[ElementKey, int] = {}
        self._steps = itertools.chain.from_iterable(
            map(self._steps_on, itertools.cycle(load_sample(BUILDING).floors.values()))
        )

    def edit(self, seconds: float) -> list[Accepted]:
        """Make edits for this time: eight on a floor, which leave nothing behind, then on the next floor."""
        until, found = time.monotonic() + seconds, list[Accepted]()
        while time.monotonic() < until:
            (version, key, after), took_ms = timed_ms(next(self._steps))
            self._versions[key] = version
            found.append((version, key, after, took_ms))
        return found

    def _steps_on(self, entry: FloorMap) -> Iterator[Callable[[], tuple[int, ElementKey, Element | None]]]:
        floor, objects = entry.floor.name, entry.geometrical.objects.values()
        x, y = next(item.at for item in objects if isinstance(item.shape, BoxShape) and min(item.shape.size) >= 0.5)
        node = next(node for node in entry.topological.nodes.values() if not node.elevator)
        lamp = MapObject(name=f"{self._name}-lamp", shape=CircleShape(radius=0.1), at=(x, y))
        for element in (lamp, PathNode(name=f"{self._name}-node", at=(node.at[0] + 0.05, node.at[1]))):
            moved = msgspec.structs.replace(element, at=(element.at[0] + 0.05, element.at[1]))
            yield partial(self._create, floor, element)
            yield partial(self._change, floor, moved)
            yield self._count
            yield partial(self._remove, floor, element)

    def _create(self, floor: str, element: Element) -> tuple[int, ElementKey, Element]:
        return self._editor.create(floor, maps.element(element)), key_of(floor, element), element

    def _change(self, floor: str, element: Element) -> tuple[int, ElementKey, Element]:
        key = key_of(floor, element)
        return self._editor.change(floor, maps.element(element), self._versions[key]), key, element

    def _remove(self, floor: str, element: Element) -> tuple[int, ElementKey, None]:
        key = key_of(floor, element)
        return self._editor.remove(maps.element_id(*key.words), self._versions[key]), key, None

    def _count(self) -> tuple[int, ElementKey, Element]:
        """Read the tally and increment it; repeat if another editor did so in between."""
        while True:
            record = self._editor.read(maps.element_id(*TALLY_KEY.words))
            higher = msgspec.structs.replace(TALLY, subnet=str(_count_of(maps.element_of(record.value)) + 1))
            with contextlib.suppress(RoboCorba.StaleEdit):
                return self._editor.change(TALLY_FLOOR, maps.element(higher), record.changedAt), TALLY_KEY, higher


@contextlib.contextmanager
def planner(naming: Address, trips: Sequence[tuple[Place, Place]]) -> Iterator[Planner]:
    with Orb(naming) as orb:
        yield Planner(orb.resolve("PathPlanner", RoboCorba.PathPlanner), trips)


@contextlib.contextmanager
def editing(naming: Address, name: str) -> Iterator[Editor]:
    with Orb(naming) as orb:
        yield Editor(orb.resolve("MapEditor", RoboCorba.MapEditor), name)


if __name__ == "__main__":
    run(main, seconds="of edits in a round")
