"""The paper's scene: three robots of two sub-networks carry a table through a room, from random start poses.

    python -m bench.missions.carry --seeds 5 [--actual B,...]

For each seed the robots first carry the table to a random start pose, drive to random places, and carry it to the
paper's goal. Both missions are measured: grips by the simulation server, with table and robots after the same step; the
time skew of carriers and of phases by the mission's report. --actual: these robots are actual ones, simulated by
servers/smartpal; their bodies in the building, which follow them, are measured."""

from __future__ import annotations

import contextlib
import math
import random
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from bench.common.harness import folder_of_bench, run
from robocorba.errors.robots import InvalidProgram
from robocorba.map_editor.samples import load_sample, sample_path
from robocorba.planning.request import Place
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import dumps
from testkit.actual_robot import running_stand_in
from testkit.generated_buildings import random_places
from testkit.missions import FLOOR, MissionSystem, RobotStart, Watch, missions
from testkit.processes import eventually
from testkit.report import Mark, at_least, at_most, quantile, summarize

NAME = "missions"
BUILDING, TABLE, LEADER = "paper-scene", "table", "A"
CREW = {
    "A": RobotStart(1.1, 3.3, 0.0, "lab"),
    "B": RobotStart(5.2, 1.2, 0.0, "lab"),
    "C": RobotStart(11.3, 3.1, 0.0, "hall"),
}
GOAL = (6.7, 3.1, 0.0)
#: Range of the table's start poses: middle and half width of x, y [m] and heading [rad].
STARTS = ((2.9, 0.35), (3.2, 0.3), (0.0, math.pi / 6))
#: Minimum distances of robots from the middle of the table and from each other at the start [m].
ASIDE_M, APART_M = 1.9, 0.9
MISSION_LIMIT_S, DRIVE_LIMIT_S = 240.0, 120.0
#: Limits of the marks: table at its goal, grips, and time skew at barriers and between control cycles.
TABLE_M, TABLE_DEG, GRIP_M, SKEW_MS = 0.05, 3.0, 0.02, 20.0


class Carried(NamedTuple):
    """A mission: its row of the table, the time skew at each barrier, and the leader's report, empty if there is
    none."""

    row: dict[str, Any]
    skews_ms: list[float]
    report: dict[str, Any]


def carries(place: MissionSystem, seeds: Sequence[int]) -> Iterator[Carried]:
    """Both missions of each seed."""
    for seed in seeds:
        rng = random.Random(seed)
        x, y, heading = (middle + rng.uniform(-half, half) for middle, half in STARTS)
        for way, to in (("to its start", (x, y, heading)), ("to its goal", GOAL)):
            carried = _carry(place, seed, way, to)
            print(*carried.row.values(), sep="\t", flush=True)
            yield carried
            _spread_out(place, seed)


def _carry(place: MissionSystem, seed: int, way: str, to: tuple[float, float, float]) -> Carried:
    """Run a mission and measure it through the simulation server."""
    before = place.collisions
    with Watch(place, TABLE) as watch:
        user = place.mission(LEADER, TABLE, f"{FLOOR}:{to[0]:.3f},{to[1]:.3f},{to[2]:.4f}")
        result, why = place.result(user, MISSION_LIMIT_S)
    with contextlib.suppress(AssertionError):  # then the missions behind it fail too, and count
        eventually(lambda: all(map(place.is_free, CREW)), 60.0, "all are free")
    at, found = place.body(TABLE), {} if result == "error" else place.report(LEADER)
    skews = [phase["skew_ms"] for phase in found.get("phases", ()) if phase["skew_ms"] is not None]
    row = {
        "seed": seed,
        "way": way,
        "result": result,
        "seconds": found.get("seconds", math.nan),
        "table off, mm": 1000 * math.dist(at[:2], to[:2]),
        "deg": abs(math.degrees(math.remainder(at.heading - to[2], math.tau))),
        "grips off, mm": 1000 * watch.farthest_m(tuple(CREW)),
        "collisions": place.collisions - before,
        "barrier skew, ms": max(skews, default=None),
        "tick skew p99, ms": (found.get("tick_skew_ms") or {}).get("p99", math.nan),
        "why": "" if result == "done" else why,
    }
    return Carried(row, skews, found)


def _spread_out(place: MissionSystem, seed: int) -> None:
    """Drive the robots to free places away from the table."""
    table = place.body(TABLE)
    chosen: list[Place] = []
    for spot in random_places(load_sample(BUILDING), RADIUS_M + 0.1, 400, seed):
        others = [math.dist((spot.x, spot.y), (one.x, one.y)) for one in chosen]
        if math.dist((spot.x, spot.y), table[:2]) > ASIDE_M and min(others, default=9.0) > APART_M and spot.y < 6.0:
            chosen.append(spot)
        if len(chosen) == len(CREW):
            break
    rng = random.Random(seed)
    with contextlib.suppress(AssertionError):  # as above
        _drive_there(place, dict(zip(CREW, chosen, strict=True)), rng)


def _drive_there(place: MissionSystem, spots: Mapping[str, Place], rng: random.Random) -> None:
    for name, spot in spots.items():  # one after another, so that they cannot block each other
        agent = place.agent(name)
        heading = rng.uniform(-math.pi, math.pi)
        eventually(partial(place.is_free, name), DRIVE_LIMIT_S, f"{name} is free")
        program = ProgramBuilder("there").mbase_path(FLOOR, spot.x, spot.y, heading=heading).program()
        with contextlib.suppress(InvalidProgram):  # a robot that was pushed to a wall stays there
            agent.load(dumps(program))
            agent.run()
        eventually(partial(place.is_free, name), DRIVE_LIMIT_S, f"{name} is there")


def marks(carried: Sequence[Carried]) -> list[Mark]:
    rows, skews = [one.row for one in carried], [skew for one in carried for skew in one.skews_ms]

    def most(column: str) -> float:
        """Of the missions in which it could be measured."""
        return max((float(row[column]) for row in rows if not math.isnan(row[column])), default=math.nan)

    right = [
        row["result"] == "done" and row["table off, mm"] <= 1000 * TABLE_M and row["deg"] <= TABLE_DEG for row in rows
    ]
    return [
        at_least("missions done with the table at its goal", sum(right), len(rows)),
        at_most("table, largest distance from its goal, m", most("table off, mm") / 1000, TABLE_M),
        at_most("table, largest turn from its goal, deg", most("deg"), TABLE_DEG),
        at_most("grips, largest distance from the hands, m", most("grips off, mm") / 1000, GRIP_M),
        at_most("collisions", sum(row["collisions"] for row in rows), 0),
        at_most("p99 of the skew at barriers, ms", quantile(skews, 0.99) if skews else math.nan, SKEW_MS),
        at_most("worst p99 of the skew of ticks, ms", most("tick skew p99, ms"), SKEW_MS),
    ]


def report(name: str, title: str, carried: Sequence[Carried], more: Sequence[Mark] = ()) -> bool:
    """Whether all marks were reached."""
    return summarize(name, title, [one.row for one in carried], [*marks(carried), *more])


def main(seeds: int = 5, first: int = 1, actual: str = "") -> bool:
    names = [name for name in actual.split(",") if name]
    if unknown := sorted(set(names) - CREW.keys()):
        sys.exit(f"--actual: unknown robot {', '.join(unknown)}; known: {', '.join(CREW)}")
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        place = stack.enter_context(missions(folder, sample_path(BUILDING)))
        crew = dict(CREW)
        for seed, name in enumerate(names, 1):
            robot = stack.enter_context(running_stand_in(folder / f"actual-{name}", "--seed", str(seed), orb=place.orb))
            crew[name] = CREW[name]._replace(adaptor=("smartpal", "--naming", str(robot.naming)))
        place.start(crew)
        carried = list(carries(place, range(first, first + seeds)))
    title = f"the paper's scene, {seeds} seeds, {len(carried)} missions"
    title += f", actual: {', '.join(names)}" if names else ""
    return report(NAME, title, carried)


if __name__ == "__main__":
    run(main, first="the first seed", actual="robots that are actual ones: NAME,...")
