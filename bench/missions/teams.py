"""Carries by two to six robots in a hall, and by two through a door that they pass only at an angle.

    python -m bench.missions.teams [--carried 2] [--only TEAM]

An object is as heavy as its team can lift. It is carried to the other side of the hall and turned meanwhile, and back.
Behind the narrow door a cupboard stands so near that the desk and its two carriers fit neither straight nor across."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from bench.common.harness import progress, run
from bench.missions.sites import Site
from bench.missions.survival import NEAR_M, Outcome, Survival
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, Door, MapObject, Wall
from robocorba.simulation.registry import Pose
from testkit.buildings import rectangular
from testkit.missions import FLOOR, RobotStart
from testkit.missions import missions as mission_system
from testkit.report import at_least, at_most, summarize

#: Sizes of what teams of two to six robots carry [m].
SIZES = {2: (1.0, 0.8), 3: (1.2, 1.0), 4: (1.6, 1.0), 5: (2.0, 1.05), 6: (2.0, 1.3)}
NARROW = "2, narrow door"
#: Places of robots along the walls of both buildings, far from what is carried [m, rad].
STARTS = (
    *((0.6, 0.6, 0.8), (0.6, 6.4, -0.8), (13.4, 0.6, 2.4), (13.4, 6.4, -2.4)),
    *((5.6, 0.6, math.pi / 2), (5.6, 6.4, -math.pi / 2)),
)


def hall(item: MapObject) -> Building:
    """A hall of 14 m by 7 m, with what is carried at its west end."""
    return rectangular("hall", (14.0, 7.0), [FLOOR], (FLOOR, item))


def narrow_door(item: MapObject) -> Building:
    """The same with a wall across, a door of 1.4 m, and a cupboard 1.6 m behind it."""
    return rectangular(
        *("narrow door", (14.0, 7.0), [FLOOR], (FLOOR, item)),
        (FLOOR, Wall("wall", (7.0, 0.0), (7.0, 7.0))),
        (FLOOR, Door("door", (7.0, 2.8), (7.0, 4.2))),
        (FLOOR, MapObject("cupboard", BoxShape((0.6, 1.6)), (8.9, 3.5))),
    )


def sites() -> dict[str, Site]:
    """Where each team carries."""
    found = {}
    for count, size in SIZES.items():
        item = MapObject("load", BoxShape(size), (3.5, 3.5), height=0.7, movable=True)
        goals = Pose(FLOOR, 3.5, 3.5, 0.0), Pose(FLOOR, 10.0, 3.5, 1.0)
        found[str(count)] = Site(lambda item=item: hall(item), "load", goals, _starts(count))
    item = MapObject("load", BoxShape(SIZES[2]), (3.5, 3.5), math.pi / 2, height=0.7, movable=True)
    goals = Pose(FLOOR, 3.5, 3.5, math.pi / 2), Pose(FLOOR, 11.5, 3.5, 0.0)
    return {**found, NARROW: Site(lambda: narrow_door(item), "load", goals, _starts(2))}


def _starts(count: int) -> tuple[RobotStart, ...]:
    return tuple(RobotStart(*at, ("lab", "hall")[number % 2]) for number, at in enumerate(STARTS[:count]))


def carries(site: Site, count: int) -> list[Outcome]:
    """Carry to and fro at a site."""
    with tempfile.TemporaryDirectory() as name:
        native.save(site.building(), Path(name) / "site.yaml")
        with mission_system(Path(name), Path(name) / "site.yaml") as place:
            survival = Survival(place, site, "nothing", "", 1)
            return [survival.mission(kill=False) for _ in range(count)]


def row(team: str, outcomes: list[Outcome]) -> dict[str, Any]:
    done = [one for one in outcomes if one.result == "done"]
    return {
        "robots": team,
        "carries": len(outcomes),
        "done": len(done),
        "wrong": sum(bool(one.wrong) for one in outcomes),
        "attempts": max(one.attempts for one in outcomes),
        "s each": sum(one.end_s for one in outcomes) / len(outcomes),
        "mm off": max((1000 * one.off_m for one in done), default=math.nan),
    }


def main(carried: int = 2, only: str = "") -> bool:
    outcomes = {}
    for team in progress([team for team in sites() if only in ("", team)], "teams"):
        outcomes[team] = carries(sites()[team], carried)
        for one in outcomes[team]:
            print(f"{team}: {one.result} {one.reason} {' '.join(one.wrong)}")
    every = [one for team in outcomes.values() for one in team]
    marks = [
        at_least("carries that are done", sum(one.result == "done" for one in every), len(every)),
        at_most("carries with something wrong", sum(bool(one.wrong) for one in every), 0),
        at_most("from its goal, mm", max(1000 * one.off_m for one in every), 1000 * NEAR_M),
    ]

    def draw(axes: Axes) -> None:
        axes.bar(list(outcomes), [sum(one.end_s for one in team) / len(team) for team in outcomes.values()])
        axes.set(xlabel="robots", ylabel="time of a carry [s]")

    return summarize("mission_teams", "Carries by teams", [row(*each) for each in outcomes.items()], marks, draw)


if __name__ == "__main__":
    run(main, carried="carries of each team", only="this team only")
