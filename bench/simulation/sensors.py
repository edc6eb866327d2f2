"""Scans of 360 rays over CORBA: throughput with one and two virtual sensor servers, and latency.

python -m bench.simulation.sensors [--seconds S] [--runs N]
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.common.harness import folder_of_bench, run
from bench.simulation.robots_client import FULL, NO_MOUNT, Clients, office_system
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import ScanSpec
from testkit.generated_buildings import office, robots
from testkit.json_process import Cpu, pids_of
from testkit.report import PROGRESS, Mark, at_most, bars, distribution, quantile, summarize, summary, timed_ms

NAME = "simulation_sensors"
SENSORS = (1, 2)
#: Client processes, threads of each, and robots; each thread makes one scan at a time.
PROCESSES, THREADS, ROBOTS = 2, 2, 40
#: Time for spreading the robots by load [s].
SETTLE_S = 3.0
CALLS, ROUNDS = 2000, 5
NULL, SCAN = "dismiss (null call)", f"scan, {FULL.fan.count} rays"
MAX_NULL_CALLS = 2.0
ONE_RAY = ScanSpec(Fan(0.0, 1.0, 1, FULL.fan.range_m))


def latency(server: Any) -> list[dict[str, list[float]]]:
    """Durations of calls of a single client [ms], by kind, in ROUNDS rounds; kinds alternate, so that a disturbance of
    the machine affects all of them."""
    session = server.registerRobot(sessions.description(robots(office(), 1)[0]))
    sensor, at = session._get_sensor(), session.state().at
    full, one = scans.spec(FULL), scans.spec(ONE_RAY)
    calls: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
        "heartbeat": (session.heartbeat, ()),
        NULL: (sensor.dismiss, ("",)),
        "scan, 1 ray": (sensor.scan, (at, NO_MOUNT, one)),
        SCAN: (sensor.scan, (at, NO_MOUNT, full)),
    }
    found = []
    for _ in range(ROUNDS):
        took: dict[str, list[float]] = {what: [] for what in calls}
        for _ in range(CALLS):
            for what, (call, arguments) in calls.items():
                took[what].append(timed_ms(call, *arguments)[1])
        found.append(took)
    session.deregister()
    return found


def throughput(server: Any, clients: Clients, state: Path, seconds: float, runs: int) -> list[dict[str, Any]]:
    """Rows of runs in which all clients scan as fast as possible."""
    clients.log_on(robots(office(), ROBOTS), ROBOTS)
    rows = []
    pids = pids_of(state, "sensor_")
    clients.all("scan", time.monotonic(), SETTLE_S, THREADS)
    for number in range(1, runs + 1):
        worked = Cpu(pids)
        found = clients.all("scan", time.monotonic() + 0.2, seconds, THREADS)
        cpu = worked.spent_s()
        rows.append(
            {
                "sensors": len(pids),
                "run": str(number),
                "scans/s": len(found["scan"]) / seconds,
                "scans a sensor's CPU s": len(found["scan"]) / sum(cpu),
                **summary(found["scan"], "scan ms", "scan p99"),
                "cores of sensors": spread(each / seconds for each in cpu),
                "cores of clients": found["cpu"],
                "robots of sensors": spread(each.robots for each in server.sensors()),
            }
        )
    clients.all("log_off")
    return rows


def spread(values: Any) -> str:
    """Values of the sensor servers, side by side."""
    return " + ".join(f"{value:.3g}" for value in values)


def latency_rows(rounds: list[dict[str, list[float]]]) -> list[dict[str, Any]]:
    """Medians over the rounds; ratios are computed within each round."""
    rows = []
    for what in rounds[0]:
        medians = [statistics.median(took[what]) for took in rounds]
        nulls = [statistics.median(took[NULL]) for took in rounds]
        rows.append(
            {
                "call": what,
                "median ms": statistics.median(medians),
                "p99 ms": statistics.median(quantile(took[what], 0.99) for took in rounds),
                "null calls": statistics.median(a / b for a, b in zip(medians, nulls, strict=True)),
            }
        )
    return rows


def marks_of(rows: list[dict[str, Any]]) -> list[Mark]:
    """Required results."""
    ratio = next(row["null calls"] for row in rows if row["call"] == SCAN)
    return [at_most(f"a {SCAN}, in null calls", ratio, MAX_NULL_CALLS)]


def main(seconds: float = 10.0, runs: int = 3) -> bool:
    rows: list[dict[str, Any]] = []
    rounds: list[dict[str, list[float]]] = []
    for sensors in SENSORS:
        with folder_of_bench() as folder, office_system(folder, "--sensors", str(sensors)) as (naming, _, server):
            if not rounds:
                with PROGRESS.status("latency"):
                    rounds = latency(server)
            with Clients(naming, PROCESSES) as clients, PROGRESS.status(f"{sensors} sensors"):
                rows += throughput(server, clients, folder / "state", seconds, runs)
    medians = {
        f"{column}, {sensors} sensors": statistics.median(row[column] for row in rows if row["sensors"] == sensors)
        for column in ("scans/s", "scans a sensor's CPU s")
        for sensors in SENSORS
    }
    title = f"{ROBOTS} robots of {PROCESSES} x {THREADS} clients, {FULL.fan.count} rays, as fast as possible"
    summarize(NAME, title, rows, [], bars(medians, "scans"))
    calls = latency_rows(rounds)
    samples = {what: [ms for took in rounds for ms in took[what]] for what in rounds[0]}
    title = f"one client, idle system, medians of {ROUNDS} rounds of {CALLS} calls"
    return summarize(f"{NAME}_latency", title, calls, marks_of(calls), distribution(samples, "ms"))


if __name__ == "__main__":
    run(main, seconds="of load in a run")
