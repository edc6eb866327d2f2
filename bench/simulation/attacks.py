"""The longest calls of a driving robot and of a client while others attack the servers.

    python -m bench.simulation.attacks [--seconds S]

Attacks: stalled connections at every server; ten clients that ask for large pictures; 100 that read a floor; 100 that
export and check the map; 100 that edit it; 100 that ask for ten paths among 64 obstacles; 100 that scan a million rays
in a call; all without a pause. The robot commands and reads its state 20 times a second and scans 3 times; a client
calls every server 10 times a second."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bench.chaos.bystander import Bystander
from bench.common.harness import progress, run
from robocorba.stubs import RoboCorba
from robocorba.system.settings import Address
from testkit.attacks import greedy_clients, stalled_connections
from testkit.report import at_most, distribution, summarize
from testkit.simulation import NO_MOUNT, Place, simulation

#: Longest call of those that attack nobody [s].
LONGEST_S = 0.5
#: Stalled connections at each server: none, and up to more than a pool of threads would have.
STALLED = (0, 8, 64, 500)
#: Clients that ask for pictures, and of each other kind.
PICTURES, READERS = 10, 100
#: All clients, by what they call.
ALL = {"pictures": PICTURES, "readings": READERS, "maps": READERS, "edits": READERS, "plans": READERS, "scans": READERS}
#: A path that a client asks for.
FROM_TO = (RoboCorba.Point("L1", 3.0, 3.0), RoboCorba.Point("L1", 15.0, 3.0))
ROUND = RoboCorba.Velocity(0.3, 0.0, 1.0)
#: Intervals between the commands of the robot, between its scans, and between calls of the client [s].
ROBOT_INTERVAL_S, SCAN_INTERVAL_S, CLIENT_INTERVAL_S = 0.05, 0.3, 0.1


@contextlib.contextmanager
def attack(place: Place, stalled: int, clients: Mapping[str, int]) -> Iterator[None]:
    """stalled: connections at each server. clients: their number, by what they call."""
    with contextlib.ExitStack() as stack:
        for process in place.running.record().processes:
            if process.endpoint:
                stack.enter_context(stalled_connections(Address.parse(process.endpoint), stalled))
        for calls, count in clients.items():
            stack.enter_context(greedy_clients(place.launch, place.running.naming, calls, count))
        yield


def measure(place: Place, seconds: float, name: str, stalled: int, clients: Mapping[str, int]) -> dict[str, Any]:
    session = place.log_on("R", 6.0, 6.0)
    sensor = session._get_sensor()
    laser = sensor.laser()
    planner = place.orb.resolve("PathPlanner", RoboCorba.PathPlanner)
    channel = place.orb.resolve("EventChannels/main", RoboCorba.EventChannel)
    on_session = {"command": lambda: session.command(ROUND, 0.5), "state": session.state}
    on_sensor = {"scan": lambda: sensor.scan(session.state().at, NO_MOUNT, laser)}
    on_servers = {
        "naming": place.orb.check_naming,
        "editor": place.editor._get_currentVersion,
        "planner": lambda: planner.getPath(*FROM_TO),
        "simulation": place.server._get_state,
        "database": lambda: place.database.getFloor("L2"),
        "channel": channel._get_name,
    }
    with attack(place, stalled, clients):
        callers = [
            Bystander(on_session, ROBOT_INTERVAL_S),
            Bystander(on_sensor, SCAN_INTERVAL_S),
            Bystander(on_servers, CLIENT_INTERVAL_S),
        ]
        time.sleep(seconds)
        for caller in callers:
            caller.close()
        logged_on = place.names == {"R"}
    place.let_go()
    longest: dict[str, float] = {}
    errors: dict[str, str] = {}
    for caller in callers:
        took_s, failed = caller.longest()
        longest |= {call: 1000 * each for call, each in took_s.items()}
        errors |= failed
    first = next((f"{call}: {error}" for call, error in errors.items()), "")
    return {"attack": name, **longest, "failed": len(errors), "logged on": logged_on, "first": first}


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
        at_most("kinds of calls that failed", sum(row["failed"] for row in rows), 0),
        at_most("robots logged off", sum(not row["logged on"] for row in rows), 0),
    ]
    calls = [name for name, value in rows[0].items() if isinstance(value, float)]
    curves = {str(row["attack"]): [row[name] for name in calls] for row in rows}
    draw = distribution(curves, "longest call, ms", "share of the kinds of calls")
    return summarize("simulation_attacks", "longest calls while others attack, ms", rows, marks, draw)


if __name__ == "__main__":
    run(main, seconds="duration of each attack")
