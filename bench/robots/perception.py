"""Robots that avoid what they see: no contact with things that no map has, and what seeing takes.

    python -m bench.robots.perception [--robots 6] [--things 20] [--minutes 30]

Robots drive from place to place in a hall with things between them: bodies in the simulation that report to nobody
where they are. Two more robots avoid what the simulation knows, to compare what they take at the same time."""

from __future__ import annotations

import contextlib
import random
import statistics
import time

from bench.common.harness import folder_of_bench, run
from bench.robots.protection import contacts_of
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building, Wall
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.agent_state import AgentCondition, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.buildings import rectangular
from testkit.heartbeats import heartbeats
from testkit.json_process import Cpu
from testkit.missions import FLOOR, MissionSystem, RobotStart, missions
from testkit.report import at_least, at_most, summarize
from testkit.simulation import about

MAX_COST_PERCENT, MIN_ARRIVED = 3.0, 0.99
#: Where robots drive to, and between them, where things are [m].
PLACES = [(x, y) for x in (1.5, 4.5, 7.5, 10.5, 13.5, 16.5) for y in (1.5, 4.5, 7.5, 10.5)]
BETWEEN = [(x, y) for x in (3.0, 6.0, 9.0, 12.0, 15.0) for y in (1.5, 3.0, 4.5, 7.5, 9.0, 10.5)]


def hall() -> Building:
    walls = ((FLOOR, Wall(f"w{x}", (x, 5.4), (x, 6.6))) for x in (4.5, 9.0, 13.5))
    return rectangular("hall", (18.0, 12.0), [FLOOR], *walls)


def drive(place: MissionSystem, seconds: float, choice: random.Random) -> dict[str, list[str]]:
    """Let each robot drive to another free place as soon as it is at one: why its drives failed, empty if not. A robot
    that was stopped, as where servers answer it too late, is started again, and that drive has failed."""
    goals: dict[str, XY] = {}
    ends: dict[str, list[str]] = {name: [] for name in place.robots}
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for name in place.robots:
            agent, state = place.agent(name), place.agent(name).state()
            if state.condition is AgentCondition.RUNNING:
                continue
            with contextlib.suppress(RoboCorbaError):
                is_stopped = state.condition is AgentCondition.STOPPED
                if goal := goals.pop(name, None):
                    reason = f"{name} to {goal}: {state.program.reason or state.reason}"
                    is_there = state.program.result is ProgramResult.DONE and not is_stopped
                    ends[name].append("" if is_there else reason)
                if is_stopped:
                    agent.reset_stop()
                x, y = choice.choice([each for each in PLACES if each not in goals.values()])
                agent.load(dumps(ProgramBuilder("go").mbase_path(FLOOR, x, y).program()))
                agent.run()
                goals[name] = x, y
        time.sleep(0.1)
    return ends


def main(robots: int = 6, things: int = 20, minutes: float = 30.0) -> bool:
    choice = random.Random(1)
    with folder_of_bench() as folder, missions(folder, hall()) as place:
        bodies = []
        for number, (x, y) in enumerate(choice.sample(BETWEEN, things)):
            at, radius_m = (x + choice.uniform(-0.3, 0.3), y + choice.uniform(-0.3, 0.3)), choice.uniform(0.1, 0.3)
            bodies.append(place.server.registerRobot(about(f"thing{number}", *at, floor=FLOOR, radius=radius_m)))
        with contextlib.closing(heartbeats(lambda: bodies)):
            starts = [RobotStart(x, y, 0.0, "") for x, y in choice.sample(PLACES, robots + 2)]
            seeing, others = [f"S{number}" for number in range(robots)], ["M0", "M1"]
            place.start(dict(zip(seeing, starts, strict=False)), "--perceive", "sensors")
            place.start(dict(zip(others, starts[robots:], strict=True)))
            cpu = Cpu([process.pid for process in place.robots.values()])
            ends = drive(place, 60.0 * minutes, choice)
            busy = dict(zip(place.robots, (took_s / (0.6 * minutes) for took_s in cpu.spent_s()), strict=True))
            contacts = {name: contacts_of(place.orb, name) for name in place.robots}
    rows = [
        {"robot": name, "arrived": ends[name].count(""), "contacts": contacts[name], "CPU, %": busy[name]}
        for name in busy
    ]
    drives = [end for name in seeing for end in ends[name]]
    print(*filter(None, drives), sep="\n")
    of = {"see": [busy[name] for name in seeing], "don't": [busy[name] for name in others]}
    cost = statistics.median(of["see"]) - statistics.median(of["don't"])
    marks = [
        at_most("contacts of robots that see", sum(contacts[name] for name in seeing), 0),
        at_least("share of drives that arrive", drives.count("") / max(1, len(drives)), MIN_ARRIVED),
        at_most("cost of a robot, % of a core", cost, MAX_COST_PERCENT),
    ]
    title = f"{robots} robots among {things} things that no map has"
    return summarize("perception", title, rows, marks, of, "CPU, %")


if __name__ == "__main__":
    run(main)
