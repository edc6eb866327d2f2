"""A whole fleet is stopped by one command, and restarted by another one.

    python -m bench.robots.stop_all [--robots 200] [--rounds 3]

Real processes in the five-floor sample, as `robocorba robots` starts them; nobody moves. In each round all robots are
stopped by `robocorba stop --all`, and restarted by `robocorba stop --all --reset`, which is repeated until it has
restarted all of them. A robot stands if the command says so and its own agent says that it is stopped; what the command
says is not believed: all agents are asked after each of the two."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.robots.fleet import Robot, fleet_of
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from testkit.json_process import ProcessFailed
from testkit.processes import ROBOCORBA, Running, running_system
from testkit.report import at_most, summarize

#: Time after the fleet's start, and between rounds [s]. Timeout of a command [s], and how often the reset is repeated.
SETTLE_S, COMMAND_LIMIT_S, MAX_RESETS = 40.0, 120.0, 5
#: Maximum time until all robots are shown to stand [s].
MAX_STAND_S = 10.0


def stop_all(system: Running, *options: str) -> tuple[float, str]:
    """Seconds and output of `robocorba stop --all`."""
    began = time.monotonic()
    command = (ROBOCORBA, "stop", "--all", "--naming", str(system.naming), *options)
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_LIMIT_S)
    return time.monotonic() - began, done.stdout


def in_condition(robots: Iterable[Robot], *conditions: AgentCondition) -> int:
    """The number of robots whose agents say that they are in one of these conditions."""
    count = 0
    for robot in robots:
        try:
            count += robot.agent.state().condition in conditions
        except (NotReachable, RobotError) as error:
            print(f"a robot does not answer: {error}", flush=True)
    return count


def round_of(system: Running, fleet: dict[str, Robot]) -> dict[str, Any]:
    """All are stopped, then restarted."""
    stop_s, said = stop_all(system, "--state", str(system.state))
    shown = sum("\tstands" in line for line in said.splitlines())
    stopped = in_condition(fleet.values(), AgentCondition.STOPPED)
    left, reset_s = [len(fleet)], 0.0
    while left[-1] and len(left) <= MAX_RESETS:
        seconds, _ = stop_all(system, "--reset")
        reset_s += seconds
        left.append(len(fleet) - in_condition(fleet.values(), AgentCondition.IDLE, AgentCondition.RUNNING))
    return {
        "robots": len(fleet),
        "shown to stand": shown,
        "stopped": stopped,
        "after, s": stop_s,
        "left by the first reset": left[1],
        "resets": len(left) - 1,
        "left": left[-1],
        "resets took, s": reset_s,
        "load": os.getloadavg()[0],
    }


def main(robots: int = 200, rounds: int = 3) -> bool:
    rows = []
    with (
        tempfile.TemporaryDirectory(prefix="robocorba-bench-") as folder,
        running_system(Path(folder)) as (system, launch),
        Orb(system.naming) as orb,
        fleet_of(system, orb, launch, robots) as fleet,
    ):
        if len(fleet) < robots:
            raise ProcessFailed(f"{len(fleet)} of {robots} robots have started")
        for _ in progress(range(rounds), "rounds"):
            time.sleep(SETTLE_S)
            rows.append(round_of(system, fleet))
    marks = [
        at_most(
            "robots that were not shown to stand, in all rounds", robots * rounds - _sum(rows, "shown to stand"), 0
        ),
        at_most("robots whose agents did not say so", robots * rounds - _sum(rows, "stopped"), 0),
        at_most("slowest stop of all, s", max(row["after, s"] for row in rows), MAX_STAND_S),
        at_most("robots that no reset restarted", _sum(rows, "left"), 0),
        at_most("robots that the first resets left", _sum(rows, "left by the first reset"), 0),
    ]

    def draw(axes: Axes) -> None:
        axes.bar(range(1, rounds + 1), [row["after, s"] for row in rows], label="stop")
        axes.bar(range(1, rounds + 1), [-row["resets took, s"] for row in rows], label="resets (downwards)")
        axes.set(xlabel="round", ylabel="s")
        axes.legend()

    return summarize("stop_all", f"stops of a fleet of {robots}", rows, marks, draw)


def _sum(rows: list[dict[str, Any]], column: str) -> int:
    return sum(row[column] for row in rows)


if __name__ == "__main__":
    run(main, robots="of the fleet", rounds="stop and restart")
