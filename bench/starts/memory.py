"""Private memory of the servers and of a robot, which the supervisor starts: python -m bench.starts.memory

`private` is what a process has for itself alone (USS), `with its share` adds its part of what several processes share
(PSS): the sum over all processes is what the system takes from the machine."""

from __future__ import annotations

import contextlib
import time
from typing import Any

import psutil

from bench.common.harness import folder_of_bench, run
from bench.starts.kills import OBJECTS
from robocorba.orb.orb import Orb
from robocorba.system.corba.remote_supervisor import RemoteSupervisor
from robocorba.system.names import SUPERVISOR
from robocorba.system.processes import ProcessPhase, RobotOrder
from robocorba.system.supervision.system import NAMING_SERVICE
from testkit.processes import Running, eventually, running_system
from testkit.report import at_most, bars, summarize

#: Required private memory of a robot [MB].
MAX_ROBOT_MB = 50.0
START_LIMIT_S, SETTLE_S = 300.0, 3.0
ROBOT = RobotOrder("memory", channel="main")


def start_robot(running: Running, orb: Orb) -> None:
    supervisor = RemoteSupervisor(orb, running.state / SUPERVISOR)
    supervisor.start_robot(ROBOT)

    def is_ready() -> bool:
        return (ROBOT.process, ProcessPhase.READY) in [(each.name, each.phase) for each in supervisor.processes()]

    eventually(is_ready, START_LIMIT_S, "a robot that is ready")


def memory(running: Running) -> list[dict[str, Any]]:
    """A row for each process."""
    names = {process.pid: process.name for process in running.record().processes}
    up = psutil.Process(running.process.pid)
    names[up.pid] = "robocorba up"
    rows: list[dict[str, Any]] = []
    for process in (up, *up.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            full, name = process.memory_full_info(), names.get(process.pid, "warm parent")
            rows.append({"process": name, "private, MB": full.uss / 1e6, "with its share": full.pss / 1e6})
    return rows


def main() -> bool:
    with folder_of_bench() as folder, running_system(folder) as (running, _):
        with Orb(running.naming) as orb:
            start_robot(running, orb)
        time.sleep(SETTLE_S)
        rows = memory(running)
    private = {row["process"]: row["private, MB"] for row in rows}
    shared = sum(row["with its share"] for row in rows)
    servers = sum(mb for name, mb in private.items() if name in OBJECTS.keys() - {NAMING_SERVICE})
    rows.append({"process": "all servers", "private, MB": servers, "with its share": None})
    rows.append({"process": "everything", "private, MB": None, "with its share": shared})
    marks = [at_most("a robot's private memory, MB", private[ROBOT.process], MAX_ROBOT_MB)]
    return summarize(
        "starts_memory", "memory of a system and a robot", rows, marks, bars(private, "private memory, MB")
    )


if __name__ == "__main__":
    run(main)
