"""Private memory of the servers and of a robot, beside that of an earlier commit.

    python -m bench.starts.memory [--base COMMIT]

`private` is what a process has for itself alone (USS), `with its share` adds its part of what several processes share
(PSS): the sum over all processes is what the system takes from the machine. A robot is started by the supervisor."""

from __future__ import annotations

import contextlib
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from bench.common.harness import run
from bench.starts.systems import BASE, OURS, SERVERS, SETTLE_S, System, load, systems
from robocorba.orb.orb import Orb
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.names import SUPERVISOR
from robocorba.system.processes import ProcessPhase, RobotOrder
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.processes import eventually
from testkit.report import at_most, bars, summarize

#: Required values: private memory of all servers, by that of the base, and of a robot [MB].
MAX_SERVERS_RATIO, MAX_ROBOT_MB = 0.4, 50.0
START_LIMIT_S = 300.0
ROBOT = RobotOrder("memory", channel="main")


def start_robots(system: System, orb: Orb, *orders: RobotOrder) -> None:
    """Start robots by the system's supervisor, and wait until all are ready."""
    supervisor = RemoteSupervisor(orb, system.running.state / SUPERVISOR)
    for order in orders:
        supervisor.start_robot(order)

    def ready() -> set[str]:
        return {state.name for state in supervisor.processes() if state.phase is ProcessPhase.READY}

    eventually(lambda: {order.process for order in orders} <= ready(), START_LIMIT_S, "robots that are ready")


def memory(system: System) -> list[dict[str, Any]]:
    """A row for each process of a system, in MB."""
    names = {process.pid: process.name for process in system.running.record().processes}
    names[system.running.process.pid] = "robocorba up"
    rows = []
    for process in system.processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            full, name = process.memory_full_info(), names.get(process.pid, "warm parent")
            both = {"private, MB": full.uss / 1e6, "with its share": full.pss / 1e6}
            rows.append({"process": name, "version": system.version.name, **both})
    return rows


def measure(base: str = BASE) -> bool:
    with tempfile.TemporaryDirectory(prefix="robocorba-bench-") as name, systems(base, Path(name)) as both:
        with Orb(both[0].running.naming) as orb:
            for system in both:
                start_robots(system, orb, ROBOT)
        time.sleep(SETTLE_S)
        rows = [row for system in both for row in memory(system)]
    private = {(row["version"], row["process"]): row["private, MB"] for row in rows}
    servers = {system.version.name: sum(private[system.version.name, one] for one in SERVERS) for system in both}
    for version, total in servers.items():
        shared = sum(row["with its share"] for row in rows if row["version"] == version)
        rows.append({"process": "all servers", "version": version, "private, MB": total, "with its share": None})
        rows.append({"process": "everything", "version": version, "private, MB": None, "with its share": shared})
    marks = [at_most("a robot's private memory, MB", private[OURS, ROBOT.process], MAX_ROBOT_MB)]
    for version, total in servers.items():
        if version != OURS:
            marks.append(
                at_most("servers' private memory by that of the base", servers[OURS] / total, MAX_SERVERS_RATIO)
            )
    picture = bars({f"{process}, {version}": mb for (version, process), mb in private.items()}, "private memory, MB")
    return summarize(
        "starts_memory", f"memory of a system with {NAMING_SERVICE} and a robot", rows, marks, picture, load=load()
    )


if __name__ == "__main__":
    run(measure, base="commit to compare with, empty for none")
