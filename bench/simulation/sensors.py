"""Latency of scans of 360 rays over CORBA, beside null calls: python -m bench.simulation.sensors"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

from bench.common.harness import folder_of_bench, run
from bench.simulation.robots_client import FULL, NO_MOUNT, office_system
from robocorba.simulation.corba import scans, sessions
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import ScanSpec
from testkit.generated_buildings import office, robots
from testkit.report import PROGRESS, Mark, at_most, distribution, quantile, summarize, timed_ms

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


def main() -> bool:
    with folder_of_bench() as folder, office_system(folder) as (_, _, server), PROGRESS.status("latency"):
        rounds = latency(server)
    calls = latency_rows(rounds)
    samples = {what: [ms for took in rounds for ms in took[what]] for what in rounds[0]}
    title = f"one client, idle system, medians of {ROUNDS} rounds of {CALLS} calls"
    return summarize("simulation_sensors", title, calls, marks_of(calls), distribution(samples, "ms"))


if __name__ == "__main__":
    run(main)
