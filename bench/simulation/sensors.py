"""Latency of scans of 360 rays over CORBA, beside null calls: python -m bench.simulation.sensors"""

from __future__ import annotations

import statistics
from functools import partial

from bench.common.harness import alternately, progress, run, system
from bench.simulation.robots_client import FULL, NO_MOUNT
from robocorba.simulation.corba import scans, sessions
from testkit.generated_buildings import office, robots
from testkit.report import at_most, summarize, summary

CALLS = 2000
NULL, SCAN = "dismiss (null call)", f"scan, {FULL.fan.count} rays"
MAX_NULL_CALLS = 2.0


def main(rounds: int = 5) -> bool:
    building = office()
    with system(building=building) as found:
        session = found.resolve("SimulationServer").registerRobot(sessions.description(robots(building, 1)[0]))
        sensor, at = session._get_sensor(), session.state().at
        scan = partial(sensor.scan, at, NO_MOUNT, scans.spec(FULL))
        calls = {"heartbeat": session.heartbeat, NULL: partial(sensor.dismiss, ""), SCAN: scan}
        took = [alternately([calls] * CALLS) for _ in progress(range(rounds), "rounds")]
        session.deregister()
    rows = [
        {"round": number, "call": what, **summary(each[what], "median ms", "p99 ms")}
        for number, each in enumerate(took, 1)
        for what in calls
    ]
    ratio = statistics.median(statistics.median(each[SCAN]) / statistics.median(each[NULL]) for each in took)
    title = f"one client, idle system, rounds of {CALLS} calls"
    marks = [at_most(f"a {SCAN}, in null calls, median of rounds", ratio, MAX_NULL_CALLS)]
    return summarize("simulation_sensors", title, rows, marks, took[-1], "ms")


if __name__ == "__main__":
    run(main)
