"""What roles cost: the same calls of a plain system and of a guarded one, in turns in the same run.

    python -m bench.chaos.guarded_cost [--rounds 100]

A null call reads the map's version. Events go from one supplier to one consumer, each in a call of its own and in calls
of a hundred, until the consumer has them all. The client of the guarded system is a robot. The fastest tenth of the
rounds is compared: other processes on the machine make calls longer, never shorter."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from bench.common.harness import folder_of_bench, progress, run
from robocorba.events.corba.event_client import EventClient
from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.roles import Role
from robocorba.system.settings import RoleNaming, role_file
from testkit.buildings import two_floors
from testkit.json_process import ObjectProcess
from testkit.processes import running_system
from testkit.report import at_most, bars, quantile, summarize

NULL, PATH, EVENT, EVENTS = "null call", "getPath", "an event", "an event of a hundred"
#: Calls or events in a round.
CALLS = {NULL: 200, PATH: 50, EVENT: 200, EVENTS: 2000}
RATIO = "guarded / plain"
#: A guarded call may take longer by this factor.
MAX_RATIO = 1.1
LIMIT_S = 60.0


class Client:
    """Calls one system. Times are seconds for each call or event."""

    def __init__(self, orb: Orb, events: EventClient) -> None:
        self._events, self._count, self._all_there = events, 0, threading.Event()
        self._planner = orb.resolve("PathPlanner", RoboCorba.PathPlanner)
        self._wanted = 0
        events.subscribe(lambda event: self._note(), "cost")

    def measure(self, what: str, calls: int) -> float:
        """The mean duration of `calls` calls or events [s]."""
        begin = {NULL: self._null, PATH: self._path, EVENT: self._push, EVENTS: self._push_hundreds}[what]
        self._wanted += calls
        self._all_there.clear()
        began = time.perf_counter()
        begin(calls)
        if what in (EVENT, EVENTS):
            assert self._all_there.wait(LIMIT_S), "events are missing"
        else:
            self._wanted -= calls
        return (time.perf_counter() - began) / calls

    def _null(self, calls: int) -> None:
        for _ in range(calls):
            self._planner._get_mapVersion()

    def _path(self, calls: int) -> None:
        start, goal = RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L2", 3.0, 3.0)
        for _ in range(calls):
            self._planner.getPath(start, goal)

    def _push(self, calls: int) -> None:
        for _ in range(calls):
            self._events.push("cost", 1)

    def _push_hundreds(self, calls: int) -> None:
        for _ in range(calls // 100):
            self._events.push_many("cost", [1] * 100)

    def _note(self) -> None:
        self._count += 1
        if self._count == self._wanted:
            self._all_there.set()


@contextlib.contextmanager
def client(folder: Path, is_guarded: bool) -> Iterator[Client]:
    """A system and its client."""
    folder.mkdir()
    native.save(two_floors(), folder / "two-floors.yaml")
    options = ("--building", "two-floors.yaml", *(("--guarded",) if is_guarded else ()))
    with running_system(folder, *options) as (running, _):
        naming = RoleNaming.read(role_file(running.state, Role.ROBOT)) if is_guarded else running.naming
        with Orb(naming) as orb, EventClient(orb, "main", "cost") as events:
            yield Client(orb, events)


def main(rounds: int = 100) -> bool:
    systems = {"plain": False, "guarded": True}
    took: dict[tuple[str, str], list[float]] = defaultdict(list)
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        clients = {
            system: stack.enter_context(ObjectProcess(client, folder / system, is_guarded))
            for system, is_guarded in systems.items()
        }
        for number in progress(range(rounds), "rounds"):
            for what, calls in CALLS.items():
                for system in sorted(clients, reverse=number % 2 == 0):
                    took[what, system].append(clients[system].call("measure", what, calls))
    rows = []
    for what in CALLS:
        plain, guarded = (quantile(took[what, system], 0.1) for system in systems)
        rows.append({"what": what, "plain, us": plain * 1e6, "guarded, us": guarded * 1e6, RATIO: guarded / plain})
    marks = [at_most(f"{row['what']}: {RATIO}", row[RATIO], MAX_RATIO) for row in rows]
    ratios = {row["what"]: row[RATIO] for row in rows}
    return summarize("chaos_guarded_cost", "What roles cost", rows, marks, bars(ratios, RATIO))


if __name__ == "__main__":
    run(main)
