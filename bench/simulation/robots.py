"""Robots over CORBA, each with its own session: a command and a state request ten times a second.

python -m bench.simulation.robots [--seconds S] [--runs N] [--robots N]
"""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from typing import Any, NamedTuple

from bench.common.harness import alternately, run, sampled, system
from bench.simulation.robots_client import Clients
from robocorba.simulation.corba import sessions
from robocorba.simulation.management_agent import DEFAULT_LIMIT
from robocorba.stubs import RoboCorba
from testkit.generated_buildings import office
from testkit.generated_buildings import robots as robots_in
from testkit.json_process import Cpu
from testkit.report import PROGRESS, Mark, at_least, at_most, quantile, summarize, summary

RATE = 10.0


class Load(NamedTuple):
    """Distribution of robots to processes and threads; each thread is a caller with one call at a time."""

    processes: int
    threads: int

    @property
    def callers(self) -> int:
        return self.processes * self.threads


#: Few callers that share connections, and one caller for each of 300 robots.
FEW, MANY = Load(3, 4), Load(12, 25)
#: Driving time before the measurement [s].
WARM_UP_S = 5.0
#: Lead time for starting all clients simultaneously [s].
LEAD_S = 0.2
NULL_CALLS = 3000
#: Interval between samples of the server's pace [s].
SAMPLE_S = 1.0
MIN_PACE, MAX_COMMAND_MS, MAX_LOG_ON_MS, MIN_MADE = 0.98, 20.0, 10.0, 0.99


def drive(server: Any, clients: Clients, threads: int, seconds: float, pid: int) -> dict[str, Any]:
    """Drive all logged-on robots; the server is process `pid`."""
    clients.all("drive", time.monotonic(), WARM_UP_S, RATE, threads)
    cpu = Cpu([pid])
    with sampled(server._get_state, SAMPLE_S) as samples:
        found = clients.all("drive", time.monotonic() + LEAD_S, seconds, RATE, threads)
    (began, first), (ended, last) = samples[0], samples[-1]
    return {
        **found,
        "achieved": statistics.median(state.achieved for _, state in samples),
        "pace": (last.time - first.time) / (ended - began),
        "server": cpu.spent_s()[0] / (seconds + LEAD_S),
    }


def row_of(name: str, load: Load, found: dict[str, Any]) -> dict[str, Any]:
    """Row of one run with driving robots."""
    from_due = [late + ms for late, ms in zip(found["late"], found["command"], strict=True)]
    return {
        "callers": load.callers,
        "run": name,
        **summary(found["command"], "command ms", "command p99", "worst"),
        "from due p99": quantile(from_due, 0.99),
        **summary(found["state"], "state ms", "state p99"),
        "made": len(found["command"]) / found["due"],
        "lost": found["lost"],
        "achieved": found["achieved"],
        "pace": found["pace"],
        "server cores": found["server"],
        "client cores": found["cpu"],
    }


def marks_of(rows: list[dict[str, Any]], count: int) -> list[Mark]:
    """Required results with driving robots, by medians of the runs. With MANY callers the command time has no mark: the
    callers compete for few cores."""
    marks = []
    for load in (FEW, MANY):
        achieved, made, p99 = (
            statistics.median(row[column] for row in rows if row["callers"] == load.callers)
            for column in ("achieved", "made", "command p99")
        )
        crowd = f"{count} robots, {load.callers} callers"
        marks.append(at_least(f"{crowd}: simulated seconds in a second (achieved)", achieved, MIN_PACE))
        marks.append(at_least(f"{crowd}: commands made of those due", made, MIN_MADE))
        if load is FEW:
            marks.append(at_most(f"{crowd}: command, p99 ms", p99, MAX_COMMAND_MS))
    return marks


def main(seconds: float = 15.0, runs: int = 2, robots: int = DEFAULT_LIMIT) -> bool:
    rows, calls = [], defaultdict[str, list[float]](list)
    building = office()
    crowd = robots_in(building, 2 * robots)
    with system(building=building) as place:
        key = (place.running.state / "administrator.ior").read_text()
        place.orb.reference(key, RoboCorba.SimulationAdministrator).setLimit(robots)
        server = place.resolve("SimulationServer")
        session = server.registerRobot(sessions.description(crowd[0]))
        calls |= alternately([{"null call (heartbeat, idle)": session.heartbeat}] * NULL_CALLS)
        session.deregister()
        for load in (FEW, MANY):
            with Clients(place.orb.naming, load.processes) as clients:
                for number in range(1, runs + 1):
                    with PROGRESS.status(f"{load.callers} callers, run {number} of {runs}"):
                        calls["log on"] += clients.log_on(crowd, robots)
                        found = drive(server, clients, load.threads, seconds, place.running.pid("simulation"))
                        clients.all("log_off")
                    rows.append(row_of(str(number), load, found))
                    for what in ("command", "state"):
                        calls[f"{what}, {load.callers} callers"] += found[what]
    for what in ("null call (heartbeat, idle)", "log on"):
        rows.append({"run": what, **summary(calls[what], "command ms", "command p99", "worst")})
    marks = [*marks_of(rows[:-2], robots), at_most("log on, p99 ms", quantile(calls["log on"], 0.99), MAX_LOG_ON_MS)]
    title = f"{robots} robots at {RATE:g} Hz for {seconds:g} s"
    return summarize("simulation_robots", title, rows, marks, calls, "ms")


if __name__ == "__main__":
    run(main, seconds="of load in a run", robots="the default is the server's limit")
