"""A hundred robots of `robocorba robots`: what idle ones take, and whether all answer and go on while forty move.

    python -m bench.robots.fleet [--robots 100] [--driving 40] [--seconds 30] [--stops 0]

Real processes in the five-floor sample. First nobody has a task; then some robots turn to and fro where they stand,
with control cycles and neighbours as for any other motion. Every robot is asked for its state again and again, one
after the other. A lease is lost if the simulation server logs that it expired.

With `--stops` nobody moves. In each round all robots are stopped by `robocorba stop --all`, and restarted by
`robocorba stop --all --reset`, which is repeated until it has restarted all of them. A robot stands if the command says
so and its own agent says that it is stopped; what the command says is not believed: all agents are asked after each."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import statistics
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import psutil

from bench.common.harness import folder_of_bench, progress, run
from robocorba.errors.robots import RobotError
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.json_process import ProcessFailed
from testkit.processes import ROBOCORBA, Launcher, Running, command_line, drain, running_system
from testkit.report import at_most, curves, distribution, quantile, summarize

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


class Measured(NamedTuple):
    """Of some time: answers [ms], calls without one, CPU of each robot and of each server in percent of a core."""

    answers_ms: list[float]
    failures: int
    robots: dict[str, float]
    servers: dict[str, float]


def turning() -> str:
    """A program that ends after hours."""
    builder = ProgramBuilder("turning")
    with builder.repeat(10_000):
        builder.mbase_by(turn=1.5).mbase_by(turn=-1.5)
    return dumps(builder.program())


@contextlib.contextmanager
def fleet_of(system: Running, orb: Orb, launch: Launcher, count: int) -> Iterator[dict[str, Robot]]:
    """So many robots, spread over all floors; all have started."""
    file = system.state / "fleet.yaml"
    sizes = [count // len(FLOORS) + (number < count % len(FLOORS)) for number in range(len(FLOORS))]
    groups = [
        f"- {{prefix: {floor}-, count: {n}, floor: {floor}}}" for floor, n in zip(FLOORS, sizes, strict=True) if n
    ]
    file.write_text("\n".join(["robots:", *groups, ""]))
    process = launch(ROBOCORBA, "robots", str(file), "--naming", str(orb.naming), "--state", str(system.state))
    drain(process)
    assert process.stdout
    while (line := process.stdout.readline()) != "ready\n":
        if not line:
            raise ProcessFailed("the fleet has not started")
    robots = {}
    for child in psutil.Process(process.pid).children():
        if found := TITLE.search(command_line(child)):
            robots[found[1]] = Robot(child, RemoteAgent(orb, found[1]))
    yield robots
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=START_LIMIT_S)


def measure_for(seconds: float, system: Running, robots: Mapping[str, Robot]) -> Measured:
    """Ask all robots for their state for some time."""
    servers = {row.name: psutil.Process(row.pid) for row in system.record().processes}
    processes = {**{name: robot.process for name, robot in robots.items()}, **servers}
    answers: list[float] = []
    failures = 0
    began, before = time.monotonic(), {name: _cpu_s(process) for name, process in processes.items()}
    while time.monotonic() < began + seconds:
        for robot in robots.values():
            asked = time.perf_counter()
            try:
                robot.agent.state()
            except NotReachable:
                failures += 1
            answers.append((time.perf_counter() - asked) * 1e3)
        time.sleep(PAUSE_S)
    elapsed = time.monotonic() - began
    busy = {name: (_cpu_s(process) - before[name]) / elapsed * 100 for name, process in processes.items()}
    return Measured(answers, failures, {name: busy[name] for name in robots}, {name: busy[name] for name in servers})


def _cpu_s(process: psutil.Process) -> float:
    return float(sum(process.cpu_times()[:2]))


def row(when: str, measured: Measured, robots: Mapping[str, Robot], names: Sequence[str]) -> dict[str, Any]:
    """Of the robots with these names."""
    busy = [measured.robots[name] for name in names]
    return {
        "when": when,
        "robots": len(names),
        "CPU of one, %": statistics.median(busy),
        "highest": max(busy),
        "private, MB": statistics.median(robots[name].process.memory_full_info().uss / 1e6 for name in names),
        "simulation, %": measured.servers["simulation"],
        "answers p50, ms": statistics.median(measured.answers_ms),
        "p99": quantile(measured.answers_ms, 0.99),
        "worst": max(measured.answers_ms),
        "load": os.getloadavg()[0],
    }


def stop_all(system: Running, *options: str) -> tuple[float, str]:
    """Seconds and output of `robocorba stop --all`."""
    began = time.monotonic()
    command = (ROBOCORBA, "stop", "--all", "--naming", str(system.naming), *options)
    done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_LIMIT_S)
    return time.monotonic() - began, done.stdout


def in_condition(fleet: Mapping[str, Robot], *conditions: AgentCondition) -> int:
    """The number of robots whose agents say that they are in one of these conditions."""
    count = 0
    for name, robot in fleet.items():
        try:
            count += robot.agent.state().condition in conditions
        except (NotReachable, RobotError) as error:
            print(f"{name} does not answer: {error}", flush=True)
    return count


def stop_round(system: Running, fleet: Mapping[str, Robot]) -> dict[str, Any]:
    """All are stopped, then restarted."""
    time.sleep(BEFORE_STOP_S)
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


def stops_of_all(system: Running, fleet: Mapping[str, Robot], robots: int, rounds: int) -> bool:
    rows = [stop_round(system, fleet) for _ in progress(range(rounds), "rounds")]
    marks = [
        at_most(f"robots {what}, in all rounds", sum(row[what] for row in rows), 0)
        for what in ("not shown to stand", "not stopped", "left", "left by the first reset")
    ]
    marks.append(at_most("robots that did not start", robots - len(fleet), 0))
    marks.append(at_most("slowest stop of all, s", max(row["after, s"] for row in rows), MAX_STAND_S))
    times = {what: [row[what] for row in rows] for what in ("after, s", "resets took, s")}
    draw = curves(range(1, rounds + 1), times, "round")
    return summarize("stop_all", f"stops of a fleet of {robots}", rows, marks, draw)


def main(robots: int = 100, driving: int = 40, seconds: float = 30.0, stops: int = 0) -> bool:
    with (
        folder_of_bench() as folder,
        running_system(folder) as (system, launch),
        Orb(system.naming) as orb,
        fleet_of(system, orb, launch, robots) as fleet,
    ):
        if stops:
            return stops_of_all(system, fleet, robots, stops)
        names = list(fleet)
        drivers = names[:: max(1, len(names) // max(1, driving))][:driving]
        others = [name for name in names if name not in drivers]
        time.sleep(SETTLE_S)
        idle = measure_for(seconds, system, fleet)
        rows = [row("nobody moves", idle, fleet, names)]
        for name in drivers:
            fleet[name].agent.load(turning())
            fleet[name].agent.run()
        time.sleep(SETTLE_S)
        moving = measure_for(seconds, system, fleet)
        rows += [row("idle, others move", moving, fleet, others), row("moves", moving, fleet, drivers)]
        states = {name: fleet[name].agent.state() for name in drivers}
        stopped = {name: state for name, state in states.items() if state.condition is not AgentCondition.RUNNING}
        for name, state in stopped.items():
            print(f"{name}: {state.condition.name.lower()} {state.program.reason if state.program else state.reason}")
        expired = len(EXPIRED.findall((system.state / "logs" / "simulation.log").read_text()))
    marks = [
        at_most("robots that did not start", robots - len(names), 0),
        at_most("CPU of an idle robot, median, %", rows[0]["CPU of one, %"], MAX_IDLE_PERCENT),
        at_most("private memory of a robot, MB", rows[0]["private, MB"], MAX_MB),
        at_most("nobody moves: slowest answer, ms", rows[0]["worst"], MAX_ANSWER_MS),
        at_most("others move: slowest answer, ms", rows[1]["worst"], MAX_ANSWER_MS),
        at_most("calls without an answer", idle.failures + moving.failures, 0),
        at_most("leases lost", expired, 0),
        at_most("moving robots that stopped", len(stopped), 0),
    ]

    samples = {"nobody moves": idle.answers_ms, f"{len(drivers)} move": moving.answers_ms}
    draw = distribution(samples, "ms until a robot's answer")
    return summarize("fleet", f"{robots} robots, {len(drivers)} of which move", rows, marks, draw)


if __name__ == "__main__":
    run(
        main,
        robots="of the fleet",
        driving="that move later",
        seconds="of each measurement",
        stops="of all, instead of measurements",
    )
