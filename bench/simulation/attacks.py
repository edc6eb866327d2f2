"""The longest calls of a driving robot and of a client while others attack the servers.

    python -m bench.simulation.attacks [--seconds S]

Attacks: stalled connections at every server, ten clients that ask for large pictures, and 100 that read a floor, export
and check the map, or edit it, without a pause. The robot commands and reads its state 20 times a second; a client calls
every server 10 times a second."""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from omniORB import CORBA

from bench.common.harness import progress, run
from robocorba.corba.calls import describe
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.testing.attacks import greedy_clients, stalled_connections
from robocorba.testing.report import at_most, distribution, summarize
from robocorba.testing.simulation import NO_MOUNT, Place, simulation

#: Longest call of those that attack nobody [s].
LONGEST_S = 0.5
#: Stalled connections at each server.
STALLED = (0, 8, 64, 500)
PICTURES, READERS = 10, 100
ALL = {"pictures": PICTURES, "readings": READERS, "maps": READERS, "edits": READERS}
ROUND = RoboCorba.Velocity(0.3, 0.0, 1.0)


class Caller(threading.Thread):
    """Makes calls in turn, each `every_s`; durations and failures by the name of the call."""

    def __init__(self, calls: dict[str, Callable[[], object]], every_s: float) -> None:
        super().__init__(daemon=True)
        self._calls, self._every_s = calls, every_s
        self.durations_s: dict[str, list[float]] = defaultdict(list)
        self.failures: list[str] = []
        self._ending = threading.Event()

    def run(self) -> None:
        while not self._ending.wait(self._every_s):
            for name, call in self._calls.items():
                began = time.perf_counter()
                try:
                    call()
                except CORBA.Exception as error:
                    self.failures.append(f"{name}: {describe(error)}")
                self.durations_s[name].append(time.perf_counter() - began)

    def end(self) -> None:
        self._ending.set()
        self.join()


def attack(place: Place, stalled: int, clients: Mapping[str, int]) -> contextlib.ExitStack:
    """clients: their number, by what they call."""
    stack = contextlib.ExitStack()
    for process in place.running.record().processes:
        if process.endpoint:
            stack.enter_context(stalled_connections(Address.parse(process.endpoint), stalled))
    for calls, count in clients.items():
        stack.enter_context(greedy_clients(place.launch, place.running.naming, calls, count))
    return stack


def measure(place: Place, seconds: float, name: str, stalled: int, clients: Mapping[str, int]) -> dict[str, Any]:
    session = place.log_on("R", 6.0, 6.0)
    sensor = session._get_sensor()
    laser = sensor.laser()
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    channel = place.orb.resolve("EventChannels/main", RoboCorba.EventChannel)
    robot = Caller({"command": lambda: session.command(ROUND, 0.5), "state": session.state}, 0.05)
    scanning = Caller({"scan": lambda: sensor.scan(session.state().at, NO_MOUNT, laser)}, 0.3)
    client = Caller(
        {
            "naming": place.orb.check_naming,
            "editor": place.editor._get_currentVersion,
            "planner": planner._get_mapVersion,
            "simulation": place.server._get_state,
            "database": lambda: place.database.getFloor("L2"),
            "channel": channel._get_name,
        },
        0.1,
    )
    with attack(place, stalled, clients):
        for caller in (robot, scanning, client):
            caller.start()
        time.sleep(seconds)
        for caller in (robot, scanning, client):
            caller.end()
        logged_on = place.names == {"R"}
    place.let_go()
    durations = robot.durations_s | scanning.durations_s | client.durations_s
    failures = robot.failures + scanning.failures + client.failures
    longest = {name: 1000 * max(values) for name, values in durations.items()}
    return {"attack": name, **longest, "failed": len(failures), "logged on": logged_on, "first": "".join(failures[:1])}


def main(seconds: float = 6.0) -> bool:
    attacks: list[tuple[str, int, dict[str, int]]] = []
    attacks += [(f"{count} stalled connections at each server", count, {}) for count in STALLED]
    attacks += [(f"{count} clients, {calls}", 0, {calls: count}) for calls, count in ALL.items()]
    attacks.append(("all of them", STALLED[-1], ALL))
    with tempfile.TemporaryDirectory() as folder, simulation(Path(folder), sensors=1) as place:
        rows = [measure(place, seconds, *each) for each in progress(attacks, "attacks")]
    times = [value for row in rows for value in row.values() if isinstance(value, float)]
    marks = [
        at_most("longest call of a robot or client, ms", max(times), 1000 * LONGEST_S),
        at_most("failed calls", sum(row["failed"] for row in rows), 0),
        at_most("robots logged off", sum(not row["logged on"] for row in rows), 0),
    ]
    calls = [name for name, value in rows[0].items() if isinstance(value, float)]
    curves = {str(row["attack"]): [row[name] for name in calls] for row in rows}
    draw = distribution(curves, "longest call, ms", "share of the kinds of calls")
    return summarize("simulation_attacks", "longest calls while others attack, ms", rows, marks, draw)


if __name__ == "__main__":
    run(main, seconds="duration of each attack")
