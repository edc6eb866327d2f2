"""Servers that are killed and forked again, while robots drive: what `robocorba up` and the warm parent keep of it.

    python -m bench.starts.forks [--forks 200]

The event channels of further sub-networks are killed in turn; two robots drive in circles all the time. Descriptors,
threads and zombies are counted after the first forks, when all connections and threads that stay are there, and at the
end."""

from __future__ import annotations

import contextlib
import signal
import tempfile
import time
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import psutil
from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.starts.memory import start_robots
from bench.starts.systems import OURS, SETTLE_S, System, load, system, versions
from robocorba.map_editor import native
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from robocorba.system.processes import RobotOrder
from testkit.buildings import two_floors
from testkit.processes import drain, eventually
from testkit.report import at_least, at_most, summarize

#: The first one is that of the robots.
SUBNETS = ("main", "a", "b", "c", "d", "e")
ROBOTS = (
    RobotOrder("left", floor="L1", at=(5.0, 2.0, 0.0), channel="main"),
    RobotOrder("right", floor="L1", at=(13.0, 2.0, 0.0), channel="main"),
)
#: Velocity on a circle with a radius of 1.5 m [m/s] and [rad/s], and its duration [s].
CIRCLE, DRIVE_S = (0.2, 0.0, 0.2 / 1.5), 3600.0
#: Forks before the first count.
FIRST_FORKS = 20
#: Connections and threads of `robocorba up` that come and go: more than these are leaked.
PASSING = 5
RESTART_LIMIT_S = 60.0
UP = "robocorba up"


def count(system: System) -> dict[str, dict[str, int]]:
    """Descriptors, threads and zombies of `robocorba up` and of the warm parent."""
    known = {row.pid for row in system.running.record().processes}
    up, *below = system.processes
    found = {}
    for name, process in ((UP, up), *(("warm parent", one) for one in below if one.pid not in known)):
        zombies = [child for child in process.children() if child.status() == psutil.STATUS_ZOMBIE]
        counted = {"descriptors": process.num_fds(), "threads": process.num_threads(), "zombies": len(zombies)}
        found[name] = counted
    return found


def kill(system: System, server: str) -> float:
    """Kill a server; returns the time until its supervisor considers it ready again [s]."""
    pid, began = system.running.pid(server), time.monotonic()
    psutil.Process(pid).send_signal(signal.SIGKILL)
    eventually(
        lambda: system.running.pid(server) not in (0, pid) and system.is_running(server), RESTART_LIMIT_S, server
    )
    return time.monotonic() - began


def _allowed(process: str, what: str) -> int:
    return PASSING if process == UP and what != "zombies" else 0


@contextlib.contextmanager
def driving(folder: Path) -> Iterator[tuple[System, list[RemoteAgent]]]:
    """A system with robots that drive, and their agents."""
    building = folder / "two-floors.yaml"
    native.save(two_floors(), building)
    options = ("--building", str(building), "--subnets", ",".join(SUBNETS))
    builder = ProgramBuilder("circles")
    builder.mbase_velocity(*CIRCLE, DRIVE_S)
    with system(versions("")[0], folder / "state", *options) as found, Orb(found.running.naming) as orb:
        drain(found.running.process)
        start_robots(found, orb, *ROBOTS)
        agents = [RemoteAgent(orb, order.name) for order in ROBOTS]
        for agent in agents:
            agent.load(dumps(builder.program()))
            agent.run()
        yield found, agents


def measure(forks: int = 200) -> bool:
    with (
        tempfile.TemporaryDirectory(prefix="robocorba-bench-") as name,
        driving(Path(name)) as (up, agents),
    ):
        victims = cycle(f"events_{subnet}" for subnet in SUBNETS[1:])
        for server in progress(islice(victims, FIRST_FORKS), "first forks", FIRST_FORKS):
            kill(up, server)
        time.sleep(SETTLE_S)
        before = count(up)
        times = [kill(up, server) for server in progress(islice(victims, forks), "forks", forks)]
        time.sleep(SETTLE_S)
        after = count(up)
        still = sum(agent.state().condition is AgentCondition.RUNNING for agent in agents)
    rows: list[dict[str, Any]] = [
        {"process": process, "when": when, **counted[process]}
        for process in before
        for when, counted in (("before", before), (f"after {forks} forks", after))
    ]
    marks = [
        at_most(f"{process}: more {what}", after[process][what] - number, _allowed(process, what))
        for process, counted in before.items()
        for what, number in counted.items()
    ]
    marks.append(at_least("robots that still drive", still, len(agents)))

    def draw(axes: Axes) -> None:
        axes.plot(times, ".")
        axes.set(xlabel="fork", ylabel="s from the kill to ready", ylim=(0, None))

    return summarize(
        "starts_forks", f"{forks} forks while robots drive, {OURS}", rows, marks, draw, s=times, load=load()
    )


if __name__ == "__main__":
    run(measure, forks="after the first ones")
