"""Robots over CORBA, each with its own session: a command and a state request ten times a second.

python -m bench.simulation.robots [--seconds S] [--runs N] [--robots N]
"""

from __future__ import annotations

import contextlib
import statistics
import time
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

from bench.common.harness import folder_of_bench, run
from bench.simulation.robots_client import Clients, office_system
from robocorba.simulation.corba import sessions
from robocorba.simulation.management_agent import DEFAULT_LIMIT
from robocorba.simulation.registry import Description
from robocorba.stubs import RoboCorba
from robocorba.system.repeating import Repeating
from testkit.generated_buildings import office
from testkit.generated_buildings import robots as robots_in
from testkit.json_process import Cpu, pids_of
from testkit.report import PROGRESS, Mark, at_least, at_most, distribution, quantile, summarize, summary, timed_ms

NAME = "simulation_robots"
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


@contextlib.contextmanager
def paces(server: Any) -> Iterator[list[tuple[float, float, float]]]:
    """Samples of the server's pace within the `with`: its own figure, the time, and the simulated time [s]."""
    samples: list[tuple[float, float, float]] = []

    def sample() -> None:
        state = server._get_state()
        samples.append((state.achieved, time.monotonic(), state.time))

    with contextlib.closing(Repeating("pace", sample, SAMPLE_S).start()):
        yield samples


def null_calls(server: Any, about: Description) -> list[float]:
    """Durations of heartbeats of a single robot [ms]."""
    session = server.registerRobot(sessions.description(about))
    took = [timed_ms(session.heartbeat)[1] for _ in range(NULL_CALLS)]
    session.deregister()
    return took


def drive(server: Any, clients: Clients, threads: int, seconds: float, pid: int) -> dict[str, Any]:
    """Drive all logged-on robots; the server is process `pid`."""
    clients.all("drive", time.monotonic(), WARM_UP_S, RATE, threads)
    cpu, collisions = Cpu([pid]), server._get_state().collisions
    with paces(server) as samples:
        found = clients.all("drive", time.monotonic() + LEAD_S, seconds, RATE, threads)
    (_, first, began), (_, last, ended) = samples[0], samples[-1]
    return {
        **found,
        "achieved": [achieved for achieved, _, _ in samples],
        "pace": (ended - began) / (last - first),
        "server": cpu.spent_s()[0] / (seconds + LEAD_S),
        "collisions": server._get_state().collisions - collisions,
    }


def row_of(name: str, load: Load, found: dict[str, Any], count: int, seconds: float) -> dict[str, Any]:
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
        "achieved": statistics.median(found["achieved"]),
        "pace": found["pace"],
        "server cores": found["server"],
        "client cores": found["cpu"],
        "hits/min": found["collisions"] / (count * seconds / 60),
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


def main(seconds: float = 30.0, runs: int = 3, robots: int = DEFAULT_LIMIT) -> bool:
    rows, on_rows = [], []
    calls: dict[str, list[float]] = defaultdict(list)
    crowd = robots_in(office(), 2 * robots)
    with folder_of_bench() as folder, office_system(folder) as (naming, orb, server):
        state = folder / "state"
        key = (state / "administrator.ior").read_text()
        orb.reference(key, RoboCorba.SimulationAdministrator).setLimit(robots)
        (pid,) = pids_of(state, "simulation")
        null = calls["heartbeat, idle"] = null_calls(server, crowd[0])
        for load in (FEW, MANY):
            with Clients(naming, load.processes) as clients:
                for number in range(1, runs + 1):
                    with PROGRESS.status(f"{load.callers} callers, run {number} of {runs}"):
                        on = clients.log_on(crowd, robots, at_once=False)["log on"]
                        found = drive(server, clients, load.threads, seconds, pid)
                        clients.all("log_off")
                    calls["log on"] += on
                    times = summary(on, "median ms", "p99 ms", "worst ms")
                    on_rows.append({"processes": load.processes, "run": number, **times})
                    rows.append(row_of(str(number), load, found, robots, seconds))
                    for what in ("command", "state"):
                        calls[f"{what}, {load.callers} callers"] += found[what]
    idle = f"null call (heartbeat, idle): {statistics.median(null):.3f} ms, p99 {quantile(null, 0.99):.3f} ms"
    title = f"{robots} robots at {RATE:g} Hz for {seconds:g} s; {idle}"
    log_on = calls.pop("log on")
    is_reached = summarize(NAME, title, rows, marks_of(rows, robots), distribution(calls, "ms"))
    mark = at_most("log on, p99 ms", statistics.median(row["p99 ms"] for row in on_rows), MAX_LOG_ON_MS)
    title = f"{robots} robots log on, one after the other; {idle}"
    return summarize(f"{NAME}_log_on", title, on_rows, [mark], distribution({"log on": log_on}, "ms")) and is_reached


if __name__ == "__main__":
    run(main, seconds="of load in a run", robots="the default is the server's limit")
