"""Robots that avoid what they see: no contact with things that no map has, and what seeing takes.

    python -m bench.robots.perception [--robots 6] [--things 20] [--minutes 30]

Robots drive from place to place in a hall with things between the places: bodies in the simulation that tell nobody
where they are. The same once more where robots avoid what the simulation knows, for what they take then."""

from __future__ import annotations

import contextlib
import random
import statistics
import time
from typing import Any, NamedTuple

import psutil

from bench.common.harness import folder_of_bench, run
from robocorba.errors.base import RoboCorbaError
from robocorba.map_editor.model import Building, Floor, FloorMap, GeometricalMap, Wall
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.agent_state import AgentCondition, ProgramResult
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.heartbeats import heartbeats
from testkit.missions import FLOOR, MissionSystem, RobotStart, missions
from testkit.report import at_least, at_most, distribution, summarize
from testkit.simulation import about

WIDE_M, DEEP_M, SETTLE_S, MAX_COST_PERCENT, MIN_ARRIVED = 18.0, 12.0, 5.0, 3.0, 0.99
#: Where robots drive to, and between them, where things are [m].
PLACES = [(x, y) for x in (1.5, 4.5, 7.5, 10.5, 13.5, 16.5) for y in (1.5, 4.5, 7.5, 10.5)]
BETWEEN = [(x, y) for x in (3.0, 6.0, 9.0, 12.0, 15.0) for y in (1.5, 4.5, 7.5, 10.5, 3.0, 9.0)]


class Measured(NamedTuple):
    """Of some time: drives that arrived, reasons of the others, contacts, CPU of each robot in percent of a core."""

    arrived: int
    failed: list[str]
    contacts: int
    busy: list[float]


def hall() -> Building:
    corners = ((0.0, 0.0), (WIDE_M, 0.0), (WIDE_M, DEEP_M), (0.0, DEEP_M))
    walls = {f"w{x}": Wall(f"w{x}", (x, 5.4), (x, 6.6)) for x in (4.5, 9.0, 13.5)}
    plan = GeometricalMap(walls, {}, {})
    return Building("hall", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=corners), plan)})


def measure(place: MissionSystem, names: list[str], seconds: float, choice: random.Random) -> Measured:
    """Each robot drives to another free place as soon as it is at one."""
    goals: dict[str, XY] = {}
    failed, arrived = [], 0
    processes = {name: psutil.Process(place.robots[name].pid) for name in names}
    before = {name: sum(process.cpu_times()[:2]) for name, process in processes.items()}
    contacts, began = place.server._get_state().collisions, time.monotonic()
    while time.monotonic() < began + seconds:
        for name in names:
            agent, state = place.agent(name), place.agent(name).state()
            if state.condition is AgentCondition.RUNNING:
                continue
            if state.condition is AgentCondition.STOPPED:  # on a busy machine servers may answer too late
                goals.pop(name, None)
                with contextlib.suppress(RoboCorbaError):
                    agent.reset_stop()
                continue
            if name in goals:
                is_there = state.program.result is ProgramResult.DONE
                arrived += is_there
                failed += [] if is_there else [f"{name} to {goals[name]}: {state.program.reason}"]
            goals[name] = choice.choice([each for each in PLACES if each not in goals.values()])
            with contextlib.suppress(RoboCorbaError):
                agent.load(dumps(ProgramBuilder("go").mbase_path(FLOOR, *goals[name]).program()))
                agent.run()
        time.sleep(0.1)
    elapsed = time.monotonic() - began
    busy = [(sum(each.cpu_times()[:2]) - before[name]) / elapsed * 100 for name, each in processes.items()]
    print(*failed, sep="\n", flush=True)
    return Measured(arrived, failed, place.server._get_state().collisions - contacts, busy)


def main(robots: int = 6, things: int = 20, minutes: float = 30.0) -> bool:
    found: dict[str, Measured] = {}
    for perceives in ("simulation", "sensors"):
        choice = random.Random(1)
        with folder_of_bench() as folder, missions(folder, hall()) as place:
            bodies = []
            beats = heartbeats(lambda bodies=bodies: bodies)
            for number, (x, y) in enumerate(choice.sample(BETWEEN, things)):
                at = x + choice.uniform(-0.3, 0.3), y + choice.uniform(-0.3, 0.3)
                bodies.append(
                    place.server.registerRobot(
                        about(f"thing{number}", *at, floor=FLOOR, radius=choice.uniform(0.1, 0.3))
                    )
                )
            names = [f"R{number}" for number in range(robots)]
            starts = dict(zip(names, choice.sample(PLACES, robots), strict=True))
            place.start({name: RobotStart(*at, 0.0, "") for name, at in starts.items()}, "--perceive", perceives)
            time.sleep(SETTLE_S)
            found[perceives] = measure(place, names, 60.0 * minutes, choice)
            place.end()
            beats.close()
    rows: list[dict[str, Any]] = [
        {
            "avoids by": by,
            "arrived": each.arrived,
            "failed": len(each.failed),
            "contacts": each.contacts,
            "CPU of one, %": statistics.median(each.busy),
        }
        for by, each in found.items()
    ]
    seen = found["sensors"]
    cost = statistics.median(seen.busy) - statistics.median(found["simulation"].busy)
    marks = [
        at_most("contacts", seen.contacts, 0),
        at_least("share of drives that arrive", seen.arrived / max(1, seen.arrived + len(seen.failed)), MIN_ARRIVED),
        at_most("cost of a robot, % of a core", cost, MAX_COST_PERCENT),
    ]
    draw = distribution({by: each.busy for by, each in found.items()}, "CPU of a robot, %")
    return summarize("perception", f"{robots} robots and {things} things that no map has", rows, marks, draw)


if __name__ == "__main__":
    run(main)
