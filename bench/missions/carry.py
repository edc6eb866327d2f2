"""The paper's scene: three robots of two sub-networks carry a table through a room, from random start poses.

    python -m bench.missions.carry --seeds 5 [--loaded] [--actual B,...]

For each seed the robots first carry the table to a random start pose, drive to random places, and carry it to the
paper's goal. Both missions are measured: grips by the simulation server, with table and robots after the same step; the
time skew of carriers and of phases by the mission's report. --loaded: another process keeps a core busy. --actual:
these robots are actual ones, simulated by servers/smartpal; their bodies in the building, which follow them, are
measured."""

from __future__ import annotations

import argparse
import contextlib
import math
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes

from bench import RESULTS
from bench.common.places import random_places
from bench.common.processes import Process
from robocorba.corba.event_client import EventClient
from robocorba.errors.robots import InvalidProgram
from robocorba.kinematics.smartpal import RADIUS_M
from robocorba.maps.model import Building
from robocorba.maps.samples import load_sample, sample_path
from robocorba.planning.request import Place
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import dumps
from robocorba.testing.actual_robot import running_stand_in
from robocorba.testing.missions import FLOOR, MissionSystem, Start, Watch, missions
from robocorba.testing.processes import eventually
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, quantile, summarize

NAME = "missions"
BUILDING, TABLE, LEADER = "paper-scene", "table", "A"
CREW = {
    "A": Start(1.1, 3.3, 0.0, "lab"),
    "B": Start(5.2, 1.2, 0.0, "lab"),
    "C": Start(11.3, 3.1, 0.0, "hall"),
}
GOAL = (6.7, 3.1, 0.0)
#: Range of the table's start poses: middle and half width of x, y [m] and heading [rad].
STARTS = ((2.9, 0.35), (3.2, 0.3), (0.0, math.pi / 6))
#: Least distances of robots from the middle of the table and from each other at the start [m].
ASIDE_M, APART_M = 1.9, 0.9
MISSION_LIMIT_S, DRIVE_LIMIT_S = 240.0, 120.0
#: Limits of the marks: table at its goal, grips, and time skew at barriers and between control cycles.
TABLE_M, TABLE_DEG, GRIP_M, SKEW_MS = 0.05, 3.0, 0.02, 20.0


class Outcome(NamedTuple):
    """The outcome of a mission. skews_ms: at each barrier."""

    seed: int
    way: str
    result: str
    reason: str
    seconds: float
    off_m: float
    off_deg: float
    grip_m: float
    collisions: int
    touched: str
    nearest_m: float
    skews_ms: list[float]
    tick_ms: float
    latency_ms: float

    @property
    def is_right(self) -> bool:
        return self.result == "done" and self.off_m <= TABLE_M and self.off_deg <= TABLE_DEG

    def row(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "way": self.way,
            "result": self.result,
            "seconds": self.seconds,
            "table off, mm": 1000 * self.off_m,
            "deg": self.off_deg,
            "grips off, mm": 1000 * self.grip_m,
            "collisions": self.collisions,
            "barrier skew, ms": max(self.skews_ms, default=None),
            "tick skew p99, ms": self.tick_ms,
            "latency p99, ms": self.latency_ms,
            "touched": self.touched,
            "nearest robots, mm": 1000 * self.nearest_m,
            "why": self.reason,
        }


def carry(place: MissionSystem, seed: int, way: str, to: tuple[float, float, float]) -> Outcome:
    """Run a mission and measure it through the simulation server."""
    before = place.collisions
    began = time.monotonic()
    touched: list[str] = []
    with Watch(place, TABLE) as watch, EventClient(place.orb, CREW[LEADER].channel) as events:
        events.subscribe(lambda event: touched.append(" and ".join(event.payload["who"])), "simulation.collision")
        user = place.mission(LEADER, TABLE, f"{FLOOR}:{to[0]:.3f},{to[1]:.3f},{to[2]:.4f}")
        out, err = user.communicate(timeout=MISSION_LIMIT_S)
    seconds = time.monotonic() - began
    eventually(lambda: all(map(place.is_free, CREW)), 60.0, "all are free")
    last = (out.strip().splitlines() or [err.strip()])[-1].split("\t")
    at = place.body(TABLE)
    found = place.report(LEADER) if user.returncode in (0, 1) and len(last) > 1 else {}
    skews = [phase["skew_ms"] for phase in found.get("phases", ()) if phase["skew_ms"] is not None]
    ticks = found.get("tick_skew_ms") or {}
    latency = max((each["p99"] for each in found.get("latency_ms", {}).values() if each), default=math.nan)
    return Outcome(
        seed,
        way,
        "done" if user.returncode == 0 else "ended",
        "" if user.returncode == 0 else last[-1],
        found.get("seconds", seconds),
        math.dist(at[:2], to[:2]),
        abs(math.degrees(math.remainder(at.heading - to[2], math.tau))),
        watch.farthest_m(tuple(CREW)),
        place.collisions - before,
        ", ".join(dict.fromkeys(touched)),
        watch.nearest_m(RADIUS_M),
        skews,
        ticks.get("p99", math.nan),
        latency,
    )


def spread_out(place: MissionSystem, building: Building, seed: int) -> None:
    """Drive the robots to free places away from the table."""
    table = place.body(TABLE)
    chosen: list[Place] = []
    for spot in random_places(building, RADIUS_M + 0.1, 400, seed):
        others = [math.dist((spot.x, spot.y), (one.x, one.y)) for one in chosen]
        if math.dist((spot.x, spot.y), table[:2]) > ASIDE_M and min(others, default=9.0) > APART_M and spot.y < 6.0:
            chosen.append(spot)
        if len(chosen) == len(CREW):
            break
    rng = random.Random(seed)
    for name, spot in zip(CREW, chosen, strict=True):  # one after another, so that they cannot block each other
        agent = place.agent(name)
        heading = rng.uniform(-math.pi, math.pi)
        eventually(partial(place.is_free, name), DRIVE_LIMIT_S, f"{name} is free")
        program = ProgramBuilder("there").mbase_path(FLOOR, spot.x, spot.y, heading=heading).program()
        with contextlib.suppress(InvalidProgram):  # a robot that was pushed to a wall stays there
            agent.load(dumps(program))
            agent.run()
        eventually(partial(place.is_free, name), DRIVE_LIMIT_S, f"{name} is there")


@contextlib.contextmanager
def another_load(is_wanted: bool, folder: Path) -> Iterator[None]:
    """A process that keeps one core busy."""
    if not is_wanted:
        yield
        return
    with Process((sys.executable, "-c", "while True: pass"), folder / "load.log"):
        yield


@contextlib.contextmanager
def stand_ins(place: MissionSystem, names: Sequence[str]) -> Iterator[dict[str, tuple[str, ...]]]:
    """A simulated actual robot for each name; yields their adaptors with arguments."""
    with contextlib.ExitStack() as stack:
        found = {}
        for seed, name in enumerate(names, 1):
            folder = place.folder / f"actual-{name}"
            folder.mkdir()
            robot = stack.enter_context(running_stand_in(folder, "--seed", str(seed), orb=place.orb))
            found[name] = ("smartpal", "--naming", str(robot.naming))
        yield found


def marks(outcomes: Sequence[Outcome]) -> list[Mark]:
    skews = [skew for one in outcomes for skew in one.skews_ms]
    return [
        at_least("missions done with the table at its goal", sum(o.is_right for o in outcomes), len(outcomes)),
        at_most("table, largest distance from its goal, m", max(one.off_m for one in outcomes), TABLE_M),
        at_most("table, largest turn from its goal, deg", max(one.off_deg for one in outcomes), TABLE_DEG),
        at_most("grips, largest distance from the hands, m", max(one.grip_m for one in outcomes), GRIP_M),
        at_most("collisions", sum(one.collisions for one in outcomes), 0),
        at_most("p99 of the skew at barriers, ms", quantile(skews, 0.99) if skews else math.nan, SKEW_MS),
        at_most("worst p99 of the skew of ticks, ms", max(one.tick_ms for one in outcomes), SKEW_MS),
    ]


def main() -> int:
    """Exit code: 0 if every mark was reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="default: %(default)s")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default: %(default)s)")
    parser.add_argument("--loaded", action="store_true", help="keep a core busy")
    parser.add_argument("--actual", default="", metavar="ROBOT,...", help="robots that are actual ones")
    options = parser.parse_args()
    building = load_sample(BUILDING)
    actual = [name for name in options.actual.split(",") if name]
    if unknown := sorted(set(actual) - CREW.keys()):
        parser.error(f"--actual: unknown robot {', '.join(unknown)}; known: {', '.join(CREW)}")
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        with (
            missions(folder, sample_path(BUILDING)) as place,
            another_load(options.loaded, folder),
            stand_ins(place, actual) as adaptors,
        ):
            place.start({name: at._replace(adaptor=adaptors.get(name, ())) for name, at in CREW.items()})
            for seed in range(options.first, options.first + options.seeds):
                rng = random.Random(seed)
                x, y, heading = (middle + rng.uniform(-half, half) for middle, half in STARTS)
                for way, to in (("to its start", (x, y, heading)), ("to its goal", GOAL)):
                    with PROGRESS.status(f"seed {seed} of {options.seeds}: {way}"):
                        outcomes.append(carry(place, seed, way, to))
                        print(*outcomes[-1].row().values(), sep="\t", flush=True)
                        spread_out(place, building, seed)
    title = f"the paper's scene, {options.seeds} seeds, {len(outcomes)} missions{', a core busy' * options.loaded}"
    title += f", actual: {', '.join(actual)}" if actual else ""
    name = f"{NAME}_actual" if actual else NAME
    is_reached = summarize(
        RESULTS / name, title, [one.row() for one in outcomes], marks(outcomes), lambda axes: draw(axes, outcomes)
    )
    return 0 if is_reached else 1


def draw(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    axes.plot([1000 * one.off_m for one in outcomes], "o-", label="table from its goal, mm")
    axes.plot([1000 * one.grip_m for one in outcomes], "s-", label="grips from their hands, mm")
    axes.plot([one.tick_ms for one in outcomes], "^-", label="p99 of the skew of ticks, ms")
    axes.set(xlabel="mission")
    axes.legend()


if __name__ == "__main__":
    sys.exit(main())
