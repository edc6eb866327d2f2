"""A whole fleet is stopped by one command, and restarted by another one.

    python -m bench.robots.stop_all [--robots 200] [--rounds 3]

Real processes in the five-floor sample, as `robocorba robots` starts them; nobody moves. In each round all robots are
stopped by `robocorba stop --all`, and restarted by `robocorba stop --all --reset`, which is repeated until it has
restarted all of them. A robot stands if the command says so and its own agent says that it is stopped; what the command
says is not believed: all agents are asked after each of the two."""

from __future__ import annotations

import subprocess
import time
from typing import Any

from bench.common.harness import folder_of_bench, progress, run
from bench.robots.fleet import Robot, fleet_of
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from testkit.json_process import ProcessFailed
from testkit.processes import ROBOCORBA, Running, running_system
from testkit.report import at_most, curves, summarize

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


def in_condition(fleet: dict[str, Robot], *conditions: AgentCondition) -> int:
    """The number of robots whose agents say that they are in one of these conditions."""
    count = 0
    for name, robot in fleet.items():
        try:
            count += robot.agent.state().condition in conditions
        except (NotReachable, RobotError) as error:
            print(f"{name} does not answer: {error}", flush=True)
    return count


def round_of(system: Running, fleet: dict[str, Robot]) -> dict[str, Any]:
    """All are stopped, then restarted."""
    stop_s, printed = stop_all(system, "--state", str(system.state))
    shown = sum("\tstands" in line for line in printed.splitlines())
    stopped = in_condition(fleet, AgentCondition.STOPPED)
    left, reset_s = [len(fleet)], 0.0
    while left[-1] and len(left) <= MAX_RESETS:
        reset_s += stop_all(system, "--reset")[0]
        left.append(len(fleet) - in_condition(fleet, AgentCondition.IDLE, AgentCondition.RUNNING))
    return {
        "not shown to stand": len(fleet) - shown,
        "not stopped": len(fleet) - stopped,
        "after, s": stop_s,
        "left by the first reset": left[1],
        "resets": len(left) - 1,
        "left": left[-1],
        "resets took, s": reset_s,
    }


def main(robots: int = 200, rounds: int = 3) -> bool:
    rows = []
    with (
        folder_of_bench() as folder,
        running_system(folder) as (system, launch),
        Orb(system.naming) as orb,
        fleet_of(system, orb, launch, robots) as fleet,
    ):
        if len(fleet) < robots:
            raise ProcessFailed(f"{len(fleet)} of {robots} robots have started")
        for _ in progress(range(rounds), "rounds"):
            time.sleep(SETTLE_S)
            rows.append(round_of(system, fleet))
    marks = [
        at_most(f"robots {what}, in all rounds", sum(row[what] for row in rows), 0)
        for what in ("not shown to stand", "not stopped", "left", "left by the first reset")
    ]
    marks.append(at_most("slowest stop of all, s", max(row["after, s"] for row in rows), MAX_STAND_S))
    times = {what: [row[what] for row in rows] for what in ("after, s", "resets took, s")}
    return summarize(
        "stop_all", f"stops of a fleet of {robots}", rows, marks, curves(range(1, rounds + 1), times, "round")
    )


if __name__ == "__main__":
    run(main, robots="of the fleet", rounds="stop and restart")
