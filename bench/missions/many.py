"""Ten simultaneous missions: thirty robots of three sub-networks in one building.

    python -m bench.missions.many [--missions 10] [--robots 30]

Ten rooms lie along both sides of a shared corridor. In every other room three robots carry a table, in the others two
robots carry a box; some boxes go out through the door into the corridor. Each room has a leader and one more robot; the
other robots are in the corridor, where several leaders compete for them. All leaders begin within a second.

Every mission must end within a deadline: done, or with a reason. The plans and the status messages to the leaders show
whether a robot was in two missions at the same time. Afterwards all robots must be free, hold nothing and be
stationary. The CPU time of the processes is measured, idle and in missions: it shows whether delays are due to too few
cores."""

from __future__ import annotations

import math
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
from matplotlib.axes import Axes

from bench.common.harness import run
from bench.missions.simultaneous import (
    Costs,
    Errand,
    Outcome,
    aftermath,
    begin,
    booked_twice,
    ended,
    started,
    states_mixed,
)
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, Building, Door, Floor, FloorMap, GeometricalMap, MapObject, Wall
from robocorba.map_editor.topology import topological_map
from robocorba.simulation.registry import Pose
from testkit.missions import FLOOR, RobotStart
from testkit.missions import missions as mission_system
from testkit.report import at_least, at_most, summarize

SUBNETS = ("west", "middle", "east")
#: Size of a room, width of the corridor between the two rows, and width of a room's door [m].
ROOM, CORRIDOR_M, DOOR_M = (6.0, 5.0), 3.4, 1.8
TABLE, BOX = (1.2, 0.8), (0.6, 0.4)
#: Distance that objects are carried within a room, and from a door to a goal in the corridor [m].
ALONG_M, OUTSIDE_M = 1.2, 1.1
#: Rooms whose box goes out into the corridor.
GOES_OUT = (3, 7)
#: Time over which the CPU time of idle robots is measured [s].
IDLE_S = 10.0


class Room(NamedTuple):
    """x, y: its middle. side: of the corridor, 1 above and -1 below. item, start, goal: of its object."""

    number: int
    x: float
    y: float
    side: int

    @property
    def leader(self) -> str:
        return f"l{self.number}"

    @property
    def has_box(self) -> bool:
        return self.number % 2 == 1

    @property
    def item(self) -> str:
        return f"{'box' if self.has_box else 'table'}-{self.number}"

    @property
    def start(self) -> tuple[float, float]:
        return (self.x if self.number in GOES_OUT else self.x - ALONG_M / 2, self.y)

    @property
    def goal(self) -> tuple[float, float, float]:
        if self.number in GOES_OUT:
            return self.x, self.y - self.side * (ROOM[1] / 2 + OUTSIDE_M), math.pi / 2
        return self.x + ALONG_M / 2, self.y, 0.0


# ---- the building ----


def rooms(count: int) -> list[Room]:
    """Rooms in two rows, those above the corridor first."""
    above = (count + 1) // 2
    places = [(number % above, 1 if number < above else -1) for number in range(count)]
    half = CORRIDOR_M / 2 + ROOM[1] / 2
    return [Room(number, (column + 0.5) * ROOM[0], side * half, side) for number, (column, side) in enumerate(places)]


def building(of: Sequence[Room]) -> Building:
    """The corridor lies along y = 0."""
    east = max(room.x for room in of) + ROOM[0] / 2
    north = CORRIDOR_M / 2 + ROOM[1]
    outline = ((0.0, -north), (east, -north), (east, north), (0.0, north))
    lines = [*zip(outline, (*outline[1:], outline[0]), strict=True)]
    lines += [((0.0, side * CORRIDOR_M / 2), (east, side * CORRIDOR_M / 2)) for side in (1, -1)]
    for room in of:
        if (x := room.x + ROOM[0] / 2) < east:
            lines.append(((x, room.side * CORRIDOR_M / 2), (x, room.side * north)))
    walls = [Wall(f"wall-{number}", a, b) for number, (a, b) in enumerate(lines)]
    doors, items = [], []
    for room in of:
        y = room.side * CORRIDOR_M / 2
        doors.append(Door(f"door-{room.number}", (room.x - DOOR_M / 2, y), (room.x + DOOR_M / 2, y)))
        shape = BoxShape(BOX if room.has_box else TABLE)
        items.append(MapObject(room.item, shape, room.start, height=0.7, movable=True))
    plan = GeometricalMap(
        {wall.name: wall for wall in walls}, {item.name: item for item in items}, {door.name: door for door in doors}
    )
    found = Building("many rooms", {FLOOR: FloorMap(Floor(FLOOR, 1, 0.0, outline=outline), plan)})
    floor = found.floors[FLOOR]
    found.floors[FLOOR] = msgspec.structs.replace(floor, topological=topological_map(found, FLOOR))
    return found


def crew(of: Sequence[Room], count: int) -> dict[str, RobotStart]:
    """Leaders and as many other robots in the rooms, the rest in two rows along the corridor; neighbours are in
    different sub-networks."""
    places = [(room.x - 2.3, room.y + 1.7 * room.side, 0.0) for room in of]
    places += [(room.x + 2.3, room.y + 1.7 * room.side, math.pi) for room in of]
    left = count - len(places)
    east = max(room.x for room in of) + ROOM[0] / 2
    pitch = east / max(1, (left + 1) // 2)
    for number in range(max(0, left)):  # not before doors
        places.append((min(pitch * (number // 2 + 1), east - 0.7), 0.85 * (-1) ** number, 0.0))
    names = [room.leader for room in of] + [f"r{number}" for number in range(count - len(of))]
    return {
        name: RobotStart(*place, SUBNETS[(number + number // len(SUBNETS)) % len(SUBNETS)])
        for number, (name, place) in enumerate(zip(names, places, strict=False))
    }


def main(missions: int = 10, robots: int = 30) -> bool:
    of = rooms(missions)
    errands = [Errand(room.leader, room.item, Pose(FLOOR, *room.goal)) for room in of]
    starts, paces = crew(of, robots), list[float]()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        native.save(building(of), folder / "many-rooms.yaml")
        with mission_system(folder, folder / "many-rooms.yaml", ",".join(SUBNETS)) as place, started(place, starts):
            costs = Costs(place)
            time.sleep(IDLE_S)
            costs.print("waiting")
            before = place.collisions
            spread_s = begin(place, errands)
            outcomes = list(ended(place, errands, paces))
            costs.print("missions")
            wrong = aftermath(place, list(starts), [room.item for room in of])
            collisions = place.collisions - before
    twice, mixed, done = booked_twice(outcomes), states_mixed(outcomes), sum(one.is_right for one in outcomes)
    print(*twice, *mixed, *wrong, sep="\n")
    print(f"{done} of {len(outcomes)} done; {collisions} collisions; load {os.getloadavg()[0]:.1f}")
    print(f"simulated seconds in a second: {statistics.median(paces):.2f} at the median, {min(paces):.2f} at least")
    marks = [
        at_most("leaders began within, s", spread_s, 1.0),
        at_least("missions that ended, done or with a reason", sum(one.has_ended for one in outcomes), len(outcomes)),
        at_most("robots booked twice, by plans", len(twice), 0),
        at_most("robots in two missions at the same time, by their status messages", len(mixed), 0),
        at_most("errors afterwards", len(wrong), 0),
    ]
    title = f"{len(outcomes)} simultaneous missions, {len(starts)} robots: {done} done, {collisions} collisions"
    return summarize("many_missions", title, [one.row for one in outcomes], marks, partial(_draw, outcomes))


def _draw(outcomes: Sequence[Outcome], axes: Axes) -> None:
    """Draw the time from the first call to the agreement, and from there to the end."""
    names, seconds = [one.row["leader"] for one in outcomes], [one.row["seconds"] for one in outcomes]
    waited = [min(s, one.row["agreed after, s"]) for s, one in zip(seconds, outcomes, strict=True)]
    axes.barh(names, seconds, label="mission")
    axes.barh(names, waited, label="looking for helpers")
    axes.set(xlabel="s")
    axes.legend()


if __name__ == "__main__":
    run(main)
