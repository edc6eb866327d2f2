"""A hundred robots of `robocorba robots`: what idle ones take, and whether all answer and go on while forty move.

    python -m bench.robots.fleet [--robots 100] [--driving 40] [--seconds 20] [--stops 0]

Real processes in the five-floor sample. First nobody has a task; then some robots turn to and fro where they stand,
with control cycles and neighbours as for any other motion. Every robot is asked for its state again and again, one
after the other. A lease is lost if the simulation server logs that it expired.

With `--stops` nobody moves. In each round all robots are stopped by `robocorba stop --all`, and restarted by
`robocorba stop --all --reset`, which is repeated until it has restarted all of them. A robot stands if the command says
so and its own agent says that it is stopped; what the command says is not believed: all agents are asked after each."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import psutil

from bench.common.harness import System, progress, run, system
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.json_process import Cpu, ProcessFailed
from testkit.processes import ROBOCORBA, command_line, drain
from testkit.report import at_most, summarize, summary, timed_ms

START_LIMIT_S = 300.0
#: Time before a measurement begins [s].
SETTLE_S = 5.0
MAX_ANSWER_MS, MAX_IDLE_PERCENT, MAX_MB = 200.0, 0.7, 50.0
#: Pause between two rounds of questions [s].
PAUSE_S = 0.5
#: Time before a stop of all [s]. Timeout of a command [s], how often the reset is repeated, and the maximum time until
#: all robots are shown to stand [s].
BEFORE_STOP_S, COMMAND_LIMIT_S, MAX_RESETS, MAX_STAND_S = 40.0, 120.0, 5, 10.0
#: Floors of the sample, over which robots are spread.
FLOORS = ("L1", "L2", "L3", "L4", "L5")
#: Begins the process title of a robot.
TITLE = re.compile(r"robocorba\.clients\.robot (\S+) ")
#: What the simulation server logs.
EXPIRED = re.compile(r"its lease of .* expired")


class Robot(NamedTuple):
    """A robot of the fleet."""

    process: psutil.Process
    agent: RemoteAgent


Fleet = Mapping[str, Robot]


@contextlib.contextmanager
def fleet_of(place: System, count: int) -> Iterator[Fleet]:
    """So many robots, spread over all floors; all have started."""
    file = place.folder / "fleet.yaml"
    sizes = [len(range(number, count, len(FLOORS))) for number in range(len(FLOORS))]
    groups = [
        f"- {{prefix: {floor}-, count: {size}, floor: {floor}}}"
        for floor, size in zip(FLOORS, sizes, strict=True)
        if size
    ]
    file.write_text("\n".join(["robots:", *groups, ""]))
    where = ("--naming", str(place.orb.naming), "--state", str(place.running.state))
    process = place.launch(ROBOCORBA, "robots", str(file), *where)
    drain(process)
    assert process.stdout
    while (line := process.stdout.readline()) != "ready\n":
        if not line:
            raise ProcessFailed("the fleet has not started")
    children = ((child, TITLE.search(command_line(child))) for child in psutil.Process(process.pid).children())
    yield {found[1]: Robot(child, RemoteAgent(place.orb, found[1])) for child, found in children if found}
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=START_LIMIT_S)


# ---- idle and moving robots ----


def rows_for(seconds: float, fleet: Fleet, **groups: list[str]) -> list[dict[str, Any]]:
    """Ask all robots for their state for some time; a row about each group of robots, with answers of all [ms]."""
    answers: list[float] = []
    failures, cpu, began = 0, Cpu([robot.process.pid for robot in fleet.values()]), time.monotonic()
    while time.monotonic() < began + seconds:
        for robot in fleet.values():
            try:
                answers.append(timed_ms(robot.agent.state)[1])
            except NotReachable:
                failures += 1
        time.sleep(PAUSE_S)
    elapsed = time.monotonic() - began
    percent = dict(zip(fleet, (spent_s / elapsed * 100 for spent_s in cpu.spent_s()), strict=True))
    memory = {name: robot.process.memory_full_info().uss / 1e6 for name, robot in fleet.items()}
    return [
        {
            "when": when.replace("_", " "),
            "robots": len(names),
            **summary([percent[name] for name in names], "CPU of one, %", worst="highest"),
            **summary([memory[name] for name in names], "private, MB"),
            **summary(answers, "answers p50, ms", "p99", "worst"),
            "no answer": failures,
        }
        for when, names in groups.items()
    ]


def idle_and_moving(place: System, fleet: Fleet, robots: int, driving: int, seconds: float) -> bool:
    builder = ProgramBuilder("turning")
    with builder.repeat(10_000):
        builder.mbase_by(turn=1.5).mbase_by(turn=-1.5)
    names = list(fleet)
    drivers = names[:: max(1, len(names) // max(1, driving))][:driving]
    time.sleep(SETTLE_S)
    rows = rows_for(seconds, fleet, nobody_moves=names)
    for name in drivers:
        fleet[name].agent.load(dumps(builder.program()))
        fleet[name].agent.run()
    time.sleep(SETTLE_S)
    rows += rows_for(seconds, fleet, others_move=[name for name in names if name not in drivers], moves=drivers)
    states = {name: fleet[name].agent.state() for name in drivers}
    stopped = {name: state for name, state in states.items() if state.condition is not AgentCondition.RUNNING}
    print(*(f"{name}: {state.program.reason or state.reason}" for name, state in stopped.items()), sep="\n")
    expired = len(EXPIRED.findall((place.running.state / "logs" / "simulation.log").read_text()))
    marks = [
        at_most("robots that did not start", robots - len(names), 0),
        at_most("CPU of an idle robot, median, %", rows[0]["CPU of one, %"], MAX_IDLE_PERCENT),
        at_most("private memory of a robot, MB", rows[0]["private, MB"], MAX_MB),
        *(at_most(f"{row['when']}: slowest answer, ms", row["worst"], MAX_ANSWER_MS) for row in rows[:2]),
        at_most("calls without an answer", sum(row["no answer"] for row in rows[:2]), 0),
        at_most("leases lost", expired, 0),
        at_most("moving robots that stopped", len(stopped), 0),
    ]
    return summarize("fleet", f"{robots} robots, {len(drivers)} of which move", rows, marks)


# ---- stops of all ----


def stop_all(place: System, *options: str) -> tuple[float, str]:
    """Seconds and output of `robocorba stop --all`."""
    began = time.monotonic()
    command = (ROBOCORBA, "stop", "--all", "--naming", str(place.orb.naming), *options)
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_LIMIT_S)
    return time.monotonic() - began, done.stdout


def in_condition(fleet: Fleet, *conditions: AgentCondition) -> int:
    """The number of robots whose agents say that they are in one of these conditions."""
    count = 0
    for name, robot in fleet.items():
        try:
            count += robot.agent.state().condition in conditions
        except (NotReachable, RobotError) as error:
            print(f"{name} does not answer: {error}", flush=True)
    return count


def stop_round(place: System, fleet: Fleet) -> dict[str, Any]:
    """All are stopped, then restarted."""
    time.sleep(BEFORE_STOP_S)
    stop_s, printed = stop_all(place, "--state", str(place.running.state))
    shown = sum("\tstands" in line for line in printed.splitlines())
    stopped = in_condition(fleet, AgentCondition.STOPPED)
    left, reset_s = [len(fleet)], 0.0
    while left[-1] and len(left) <= MAX_RESETS:
        reset_s += stop_all(place, "--reset")[0]
        left.append(len(fleet) - in_condition(fleet, AgentCondition.IDLE, AgentCondition.RUNNING))
    return {
        "not shown to stand": len(fleet) - shown,
        "not stopped": len(fleet) - stopped,
        "after, s": stop_s,
        "left by the first reset": left[1],
        "left": left[-1],
        "resets took, s": reset_s,
    }


def stops_of_all(place: System, fleet: Fleet, robots: int, rounds: int) -> bool:
    rows = [stop_round(place, fleet) for _ in progress(range(rounds), "rounds")]
    marks = [
        at_most(f"robots {what}, in all rounds", sum(row[what] for row in rows), 0)
        for what in ("not shown to stand", "not stopped", "left", "left by the first reset")
    ]
    marks.append(at_most("robots that did not start", robots - len(fleet), 0))
    marks.append(at_most("slowest stop of all, s", max(row["after, s"] for row in rows), MAX_STAND_S))
    return summarize("stop_all", f"stops of a fleet of {robots}", rows, marks)


def main(robots: int = 100, driving: int = 40, seconds: float = 20.0, stops: int = 0) -> bool:
    with system() as place, fleet_of(place, robots) as fleet:
        if stops:
            return stops_of_all(place, fleet, robots, stops)
        return idle_and_moving(place, fleet, robots, driving, seconds)


if __name__ == "__main__":
    run(
        main,
        robots="of the fleet",
        driving="that move later",
        seconds="of each measurement",
        stops="of all, instead of measurements",
    )
