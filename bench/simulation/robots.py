"""Robots over CORBA, each with its own session: a command and a state request ten times a second.

python -m bench.simulation.robots [--seconds S] [--runs N] [--robots N]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench import RESULTS
from bench.simulation.building import office, robots
from bench.simulation.robots_client import Clients, Worked, pids_of
from robocorba.clients.robot_processes import servers
from robocorba.corba.conversion import simulation
from robocorba.corba.orb import Orb
from robocorba.maps import native
from robocorba.simulation.management_agent import DEFAULT_LIMIT
from robocorba.simulation.registry import Description
from robocorba.stubs import RoboCorba
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, quantile, summarize, timed_ms

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
#: Modes of the log-on: one robot after the other, or all processes simultaneously.
BY_TURNS, AT_ONCE = "one by one", "at once"
#: Driving time before the measurement [s].
WARM_UP_S = 5.0
#: Lead time for starting all clients simultaneously [s].
LEAD_S = 0.2
NULL_CALLS = 3000
#: Interval between samples of the server's pace [s].
SAMPLE_S = 1.0
MIN_PACE, MAX_COMMAND_MS, MAX_LOG_ON_MS, MIN_MADE = 0.98, 20.0, 10.0, 0.99


class Paces:
    """Samples the server's pace within a `with`."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self.achieved: list[float] = []
        self._times: list[tuple[float, float]] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Paces:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    @property
    def pace(self) -> float:
        """Simulated seconds per second, from the first sample to the last."""
        (first, began), (last, ended) = self._times[0], self._times[-1]
        return (ended - began) / (last - first)

    def _run(self) -> None:
        while not self._closing.wait(SAMPLE_S):
            state = self._server._get_state()
            self.achieved.append(state.achieved)
            self._times.append((time.monotonic(), state.time))


def null_calls(server: Any, about: Description) -> list[float]:
    """Durations of heartbeats of a single robot [ms]."""
    session = server.registerRobot(simulation.description(about))
    took = [timed_ms(session.heartbeat)[1] for _ in range(NULL_CALLS)]
    session.deregister()
    return took


def is_refused(server: Any, about: Description) -> bool:
    """Whether the server refuses one more robot with ServerFull."""
    try:
        server.registerRobot(simulation.description(about)).deregister()
    except RoboCorba.ServerFull as full:
        return bool(full.limit == full.now)
    return False


def log_on(server: Any, clients: Clients, crowd: list[Description], count: int) -> dict[str, Any]:
    """Log `count` robots on, off and on again, and try one more: times [ms], and whether that one was refused."""
    by_turns = clients.log_on(crowd[:-1], count, at_once=False)["log on"]
    clients.all("log_off")
    at_once = clients.log_on(crowd[:-1], count)["log on"]
    return {BY_TURNS: by_turns, AT_ONCE: at_once, "refused": is_refused(server, crowd[-1])}


def drive(server: Any, clients: Clients, threads: int, seconds: float, pid: int) -> dict[str, Any]:
    """Drive all logged-on robots; the server is process `pid`."""
    how = {"rate": RATE, "threads": threads}
    clients.all("drive", begin=time.monotonic(), seconds=WARM_UP_S, **how)
    worked, collisions = Worked([pid]), server._get_state().collisions
    with Paces(server) as paces:
        found = clients.all("drive", begin=time.monotonic() + LEAD_S, seconds=seconds, **how)
    return {
        **found,
        "achieved": paces.achieved,
        "pace": paces.pace,
        "server": worked.seconds()[0] / (seconds + LEAD_S),
        "collisions": server._get_state().collisions - collisions,
    }


def row_of(name: str, load: Load, found: dict[str, Any], count: int, seconds: float) -> dict[str, Any]:
    """Row of one run with driving robots."""
    from_due = [late + ms for late, ms in zip(found["late"], found["command"], strict=True)]
    return {
        "callers": load.callers,
        "run": name,
        "command ms": statistics.median(found["command"]),
        "command p99": quantile(found["command"], 0.99),
        "worst": max(found["command"]),
        "from due p99": quantile(from_due, 0.99),
        "state ms": statistics.median(found["state"]),
        "state p99": quantile(found["state"], 0.99),
        "made": len(found["command"]) / found["due"],
        "lost": found["lost"],
        "achieved": statistics.median(found["achieved"]),
        "pace": found["pace"],
        "server cores": found["server"],
        "client cores": found["cpu"],
        "hits/min": found["collisions"] / (count * seconds / 60),
    }


def log_on_rows_of(name: str, load: Load, found: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows of one run with robots that log on."""
    return [
        {
            "processes": load.processes,
            "run": name,
            "robots log on": how,
            "median ms": statistics.median(found[how]),
            "p99 ms": quantile(found[how], 0.99),
            "worst ms": max(found[how]),
        }
        for how in (BY_TURNS, AT_ONCE)
    ]


def marks_of(rows: list[dict[str, Any]], count: int) -> list[Mark]:
    """Required results with driving robots, by medians of the runs. With MANY callers the command time has no mark: the
    callers compete for few cores."""
    marks = []
    for load in (FEW, MANY):
        these = [row for row in rows if row["callers"] == load.callers]
        crowd = f"{count} robots, {load.callers} callers"
        achieved = statistics.median(row["achieved"] for row in these)
        marks.append(at_least(f"{crowd}: simulated seconds in a second (achieved)", achieved, MIN_PACE))
        made = statistics.median(row["made"] for row in these)
        marks.append(at_least(f"{crowd}: commands made of those due", made, MIN_MADE))
        if load is FEW:
            p99 = statistics.median(row["command p99"] for row in these)
            marks.append(at_most(f"{crowd}: command, p99 ms", p99, MAX_COMMAND_MS))
    return marks


def log_on_marks_of(rows: list[dict[str, Any]], count: int, refused: int) -> list[Mark]:
    """Required results of the log-on, by medians of the runs."""
    p99 = statistics.median(row["p99 ms"] for row in rows if row["robots log on"] == BY_TURNS)
    return [
        at_most(f"log on {BY_TURNS}, p99 ms", p99, MAX_LOG_ON_MS),
        at_least(f"how often robot {count + 1} was refused with ServerFull", refused, len(rows) / 2),
    ]


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="of load in a run (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=3, help="default: %(default)s")
    parser.add_argument("--robots", type=int, default=DEFAULT_LIMIT, help="default: %(default)s, the server's limit")
    options = parser.parse_args()
    log_ons: list[tuple[Load, dict[str, Any]]] = []
    drives: list[tuple[Load, dict[str, Any]]] = []
    crowd = robots(office(), 2 * options.robots)
    with tempfile.TemporaryDirectory() as folder:
        state, building = Path(folder) / "state", Path(folder) / "office.yaml"
        native.save(office(), building)
        with servers(state, "--building", str(building)) as naming, Orb(naming) as orb:
            server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
            if options.robots != DEFAULT_LIMIT:
                key = (state / "administrator.ior").read_text()
                orb.reference(key, RoboCorba.SimulationAdministrator).setLimit(options.robots)
            (pid,) = pids_of(state, "simulation")
            null = null_calls(server, crowd[0])
            for load in (FEW, MANY):
                with Clients(naming, load.processes, Path(folder)) as clients:
                    for run in range(1, options.runs + 1):
                        with PROGRESS.status(f"{load.callers} callers, run {run} of {options.runs}"):
                            log_ons.append((load, log_on(server, clients, crowd, options.robots)))
                            drives.append((load, drive(server, clients, load.threads, options.seconds, pid)))
                            clients.all("log_off")
    runs = [str(1 + number % options.runs) for number in range(len(drives))]
    rows = [
        row_of(run, load, found, options.robots, options.seconds)
        for run, (load, found) in zip(runs, drives, strict=True)
    ]
    on_rows = [
        row for run, (load, found) in zip(runs, log_ons, strict=True) for row in log_on_rows_of(run, load, found)
    ]
    refused = sum(found["refused"] for _, found in log_ons)
    idle = f"null call (heartbeat, idle): {statistics.median(null):.3f} ms, p99 {quantile(null, 0.99):.3f} ms"
    title = f"{options.robots} robots at {RATE:g} Hz for {options.seconds:g} s; {idle}"
    is_reached = summarize(
        RESULTS / NAME, title, rows, marks_of(rows, options.robots), lambda axes: _draw(axes, null, drives)
    )
    title = f"{options.robots} robots log on; {idle}"
    on_curves = {how: [ms for _, found in log_ons for ms in found[how]] for how in (BY_TURNS, AT_ONCE)}
    on_marks = log_on_marks_of(on_rows, options.robots, refused)
    are_reached = summarize(
        RESULTS / f"{NAME}_log_on", title, on_rows, on_marks, lambda axes: _draw_curves(axes, on_curves)
    )
    return 0 if is_reached and are_reached else 1


def _draw(axes: Axes, null: list[float], drives: list[tuple[Load, dict[str, Any]]]) -> None:
    curves = {"heartbeat, idle": null}
    for load, found in drives:
        for what in ("command", "state"):
            curves.setdefault(f"{what}, {load.callers} callers", []).extend(found[what])
    _draw_curves(axes, curves)


def _draw_curves(axes: Axes, curves: dict[str, list[float]]) -> None:
    for label, values in curves.items():
        ordered = sorted(values)
        axes.plot(ordered, [i / len(ordered) for i in range(len(ordered))], label=label)
    axes.set(xscale="log", xlabel="ms", ylabel="share of calls that took less")
    axes.legend()


if __name__ == "__main__":
    sys.exit(main())
