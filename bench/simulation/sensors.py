"""Scans of 360 rays over CORBA: throughput with one and two virtual sensor servers, and latency.

python -m bench.simulation.sensors [--seconds S] [--runs N]
"""

from __future__ import annotations

import argparse
import contextlib
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.processes import Process
from bench.simulation.building import office, robots
from bench.simulation.robots_client import FULL, NO_MOUNT, START_LIMIT_S, Clients, Worked, pids_of
from robocorba.clients.robot_processes import servers
from robocorba.corba.conversion import scans, simulation
from robocorba.corba.orb import Orb
from robocorba.maps import native
from robocorba.sensing.fan import Fan
from robocorba.sensing.virtual_sensor import ScanSpec
from robocorba.stubs import RoboCorba
from robocorba.testing.report import PROGRESS, Mark, at_most, quantile, summarize, timed_ms

NAME = "simulation_sensors"
SENSORS = (1, 2)
#: Client processes, threads of each, and robots; each thread makes one scan at a time.
PROCESSES, THREADS, ROBOTS = 2, 2, 40
#: Time for spreading the robots by load [s].
SETTLE_S = 3.0
CALLS, ROUNDS = 2000, 5
NULL, SCAN = "dismiss (null call)", f"scan, {FULL.fan.count} rays"
MAX_NULL_CALLS = 2.0
#: Treatment of idle cores: waking one up can take longer than the call.
ALONE, AWAKE = "left alone", "kept awake"
ONE_RAY = ScanSpec(Fan(0.0, 1.0, 1, FULL.fan.range_m))


def latency(server: Any) -> list[dict[str, list[float]]]:
    """Durations of calls of a single client [ms], by kind, in ROUNDS rounds; kinds alternate, so that a disturbance of
    the machine affects all of them."""
    session = server.registerRobot(simulation.description(robots(office(), 1)[0]))
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


@contextlib.contextmanager
def awake(folder: Path) -> Iterator[None]:
    """Keep all cores awake with SCHED_IDLE loops, which any other thread preempts."""
    loop = "import os; os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0)); print('{}', flush=True)"
    with contextlib.ExitStack() as stack:
        for core in os.sched_getaffinity(0):
            command = (sys.executable, "-c", f"{loop}\nwhile True: pass")
            stack.enter_context(Process(command, folder / f"awake-{core}.log", (core,))).receive(START_LIMIT_S)
        yield


def throughput(server: Any, clients: Clients, state: Path, seconds: float, runs: int) -> list[dict[str, Any]]:
    """Rows of runs in which all clients scan as fast as possible."""
    clients.log_on(robots(office(), ROBOTS), ROBOTS)
    rows = []
    pids = pids_of(state, "sensor_")
    clients.all("scan", begin=time.monotonic(), seconds=SETTLE_S, threads=THREADS)
    for number in range(1, runs + 1):
        worked = Worked(pids)
        found = clients.all("scan", begin=time.monotonic() + 0.2, seconds=seconds, threads=THREADS)
        cpu = worked.seconds()
        rows.append(
            {
                "sensors": len(pids),
                "run": str(number),
                "scans/s": len(found["scan"]) / seconds,
                "scans a sensor's CPU s": len(found["scan"]) / sum(cpu),
                "scan ms": statistics.median(found["scan"]),
                "scan p99": quantile(found["scan"], 0.99),
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


def latency_rows(cores: str, rounds: list[dict[str, list[float]]]) -> list[dict[str, Any]]:
    """Medians over the rounds; ratios are computed within each round."""
    rows = []
    for what in rounds[0]:
        medians = [statistics.median(took[what]) for took in rounds]
        nulls = [statistics.median(took[NULL]) for took in rounds]
        rows.append(
            {
                "cores": cores,
                "call": what,
                "median ms": statistics.median(medians),
                "p99 ms": statistics.median(quantile(took[what], 0.99) for took in rounds),
                "null calls": statistics.median(a / b for a, b in zip(medians, nulls, strict=True)),
            }
        )
    return rows


def marks_of(rows: list[dict[str, Any]]) -> list[Mark]:
    """Required results."""
    ratio = next(row["null calls"] for row in rows if (row["cores"], row["call"]) == (ALONE, SCAN))
    return [at_most(f"a {SCAN}, in null calls", ratio, MAX_NULL_CALLS)]


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of load in a run (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=3, help="default: %(default)s")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    rounds: dict[str, list[dict[str, list[float]]]] = {}
    for sensors in SENSORS:
        with tempfile.TemporaryDirectory() as folder:
            state, building = Path(folder) / "state", Path(folder) / "office.yaml"
            native.save(office(), building)
            with servers(state, "--building", str(building), "--sensors", str(sensors)) as naming, Orb(naming) as orb:
                server = orb.resolve("SimulationServer", RoboCorba.SimulationServer)
                if not rounds:
                    with PROGRESS.status("latency"):
                        rounds[ALONE] = latency(server)
                        with awake(Path(folder)):
                            rounds[AWAKE] = latency(server)
                with Clients(naming, PROCESSES, Path(folder)) as clients, PROGRESS.status(f"{sensors} sensors"):
                    rows += throughput(server, clients, state, options.seconds, options.runs)
    title = f"{ROBOTS} robots of {PROCESSES} x {THREADS} clients, {FULL.fan.count} rays, as fast as possible"
    summarize(RESULTS / NAME, title, rows, [], lambda axes: _draw(axes, rows))
    calls = [row for cores, found in rounds.items() for row in latency_rows(cores, found)]
    title = f"one client, idle system, medians of {ROUNDS} rounds of {CALLS} calls"
    return (
        0
        if summarize(
            RESULTS / f"{NAME}_latency", title, calls, marks_of(calls), lambda axes: _draw_latency(axes, rounds)
        )
        else 1
    )


def _draw(axes: Axes, rows: list[dict[str, Any]]) -> None:
    for column in ("scans/s", "scans a sensor's CPU s"):
        for sensors in SENSORS:
            found = [row[column] for row in rows if row["sensors"] == sensors]
            axes.barh(f"{column}, {sensors} sensors", statistics.median(found))


def _draw_latency(axes: Axes, rounds: dict[str, list[dict[str, list[float]]]]) -> None:
    for cores, style in ((ALONE, "-"), (AWAKE, ":")):
        for number, what in enumerate(rounds[cores][0]):
            ordered = sorted(ms for took in rounds[cores] for ms in took[what])
            shares = [i / len(ordered) for i in range(len(ordered))]
            axes.plot(ordered, shares, style, color=f"C{number}", label=f"{what}, cores {cores}")
    axes.set(xscale="log", xlabel="ms", ylabel="share of calls that took less")
    axes.legend()


if __name__ == "__main__":
    sys.exit(main())
