"""The cooperative icon move_table: who stands where around an object, and how all of them carry it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import NamedTuple

from shapely import Polygon

from robocorba.errors.robots import MissionFailed
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.polygons import FloorArea
from robocorba.missions.carry import CarryPlan, Leg, plan_carry
from robocorba.missions.formation import Pose
from robocorba.missions.gathering import Ways, loosened, waves
from robocorba.missions.helpers import assigned
from robocorba.missions.subplan import (
    Approach,
    BackOff,
    CallCabin,
    Carry,
    CooperativePlan,
    Gather,
    PutDown,
    Reserve,
    Ride,
    Step,
    SubPlan,
    TakeHold,
    Wait,
)
from robocorba.missions.surroundings import placed
from robocorba.missions.swept_area import taken
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import World
from robocorba.planning.request import Place
from robocorba.programs.icons import Destination
from robocorba.simulation.building import PAYLOAD_KG
from robocorba.simulation.elevator import BOARDING_LIMIT_S
from robocorba.simulation.reservations import MOST_LIMIT_S
from robocorba.spatial.frames import out_of

#: Helpers gather so far behind their places, m, and back off as far.
BACK_M = 0.3
#: Under the board's edge, m.
BOARD_M = 0.02
#: A cabin is called from where everything is clear of its doors by so much, m.
CLEAR_M = 0.15
LOOK_S = 0.1
#: Through its doors, at most: m/s, rad/s, m/s²; and what is left of the time that they stay open, s.
HURRY, SPARE_S = (0.4, 0.5, 0.6), 4.0
#: Others who carry have so long to go by, and so long is reserved then, s: as long as it can be.
RESERVED_LIMIT_S = MOST_LIMIT_S
GATHER_LIMIT_S, NEAR_LIMIT_S, CABIN_LIMIT_S = 240.0, 30.0, 300.0
#: A carry may take so many times as long as planned, and some more, s.
CARRY_TIMES, CARRY_MORE_S = 3.0, 20.0


class _Turn(NamedTuple):
    """What all robots do at the same time: a name for people, and each one's step."""

    phase: str
    steps: Sequence[Step | Wait]


class MoveTable:
    """As an Expansion: plans when it is made, for the robots that a thing of this weight needs.

    Raises MissionFailed, ImpossibleCarry, NotReachable."""

    def __init__(self, world: World, table: str, goal: Destination, robots: int = 0) -> None:
        self._world = world
        self._thing = thing = world.thing(table)
        count = robots or max(2, math.ceil(thing.mass_kg / PAYLOAD_KG - 1e-9))
        self._carry: CarryPlan = plan_carry(
            world.building(),
            table,
            (thing.floor, thing.x, thing.y, thing.heading),
            (goal.floor, goal.x, goal.y, goal.heading),
            count,
            blocked=world.others(table),
        )
        self.helpers = count - 1
        self.wanted: frozenset[str] = frozenset()
        self.meeting_point = Place(thing.floor, thing.x, thing.y)

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        thing, formation = self._thing, self._carry.formation
        at = (thing.x, thing.y, thing.heading)
        ways = Ways(self._world, thing)
        behind, names = self._gathered(leader, robots, ways)
        limit_s = RESERVED_LIMIT_S
        way = Reserve(areas=self._taken(), hold_s=limit_s, limit_s=limit_s)
        turns = [
            _Turn("reserving", [way if name == leader else Wait(limit_s=limit_s) for name in names]),
            *self._gatherings(behind, [robots[name] for name in names], ways),
            _Turn("approaching", [_approach(_placed(place, at)) for place in formation.places()]),
            _Turn("gripping", [self._hold(_placed((grip.x, grip.y, 0.0), at)) for grip in formation.grips]),
        ]
        legs = self._carry.legs
        for before, leg, after in zip([None, *legs[:-1]], legs, [*legs[1:], None], strict=True):
            turns += self._leg(mission, leg, before.elevator_after if before else "", after.floor if after else "")
        turns.append(_Turn("putting down", [PutDown(limit_s=NEAR_LIMIT_S) for _ in names]))
        turns.append(_Turn("backing off", [BackOff(distance_m=BACK_M, limit_s=NEAR_LIMIT_S) for _ in names]))
        subplans = tuple(
            SubPlan(name, "leader" if name == leader else "helper", tuple(turn.steps[place] for turn in turns))
            for place, name in enumerate(names)
        )
        return CooperativePlan(mission, "move table", leader, thing.name, tuple(turn.phase for turn in turns), subplans)

    def _gathered(self, leader: str, robots: dict[str, Place], ways: Ways) -> tuple[list[Pose], list[str]]:
        """Places behind those in which they carry, and who goes to each of them. Raises MissionFailed.

        Side by side only where there is no room for more between them."""
        thing, close = self._thing, self._carry.formation.places(BACK_M)

        def found(places: Sequence[Pose]) -> tuple[list[Pose], list[str]]:
            behind = [_placed(place, (thing.x, thing.y, thing.heading)) for place in places]
            goals = [Place(thing.floor, x, y) for x, y, _ in behind]
            return behind, assigned(robots, goals, leader, ways.length_m)

        with contextlib.suppress(MissionFailed):
            return found(loosened(close))
        return found(close)

    def _gatherings(self, behind: Sequence[Pose], starts: Sequence[Place], ways: Ways) -> list[_Turn]:
        """All at once, or one after the other where they would stand in each other's way."""
        floor, limit_s = self._thing.floor, GATHER_LIMIT_S
        goals = [Place(floor, x, y) for x, y, _ in behind]
        points = [ways.points(start, goal) for start, goal in zip(starts, goals, strict=True)]
        turns = []
        for wave in waves(starts, goals, points):
            steps: list[Step | Wait] = [
                Gather(floor=floor, x=x, y=y, heading=heading, limit_s=limit_s) if number in wave else Wait()
                for number, (x, y, heading) in enumerate(behind)
            ]
            turns.append(_Turn("gathering", steps))
        return turns

    def _taken(self) -> tuple[FloorArea, ...]:
        return taken(self._carry.legs, self._carry.formation, self._thing.outline, BACK_M)

    def _hold(self, at: Pose) -> TakeHold:
        height_m = self._thing.height_m - BOARD_M
        stands = self._thing.x, self._thing.y, self._thing.heading
        return TakeHold(thing=self._thing.name, at=stands, x=at[0], y=at[1], height_m=height_m, limit_s=NEAR_LIMIT_S)

    def _leg(self, mission: str, leg: Leg, came_by: str, next_floor: str) -> list[_Turn]:
        """On one floor: out of the elevator that they came by, to the goal or into the next one, and the ride."""
        turns, way, elevator = [], _poses(leg), leg.elevator_after
        if came_by:
            outside, inside = self._at_doors(way[::-1], came_by)
            turns += self._through_doors("driving out", inside[::-1], came_by)
            way = outside[::-1]
        if not elevator:
            return [*turns, *self._carried("carrying", way)]
        outside, inside = self._at_doors(way, elevator)
        count = len(self._carry.formation.grips)
        party = f"{mission} to {next_floor}"
        call = CallCabin(elevator=elevator, destination=next_floor, party=party, size=count, limit_s=CABIN_LIMIT_S)
        ride = Ride(elevator=elevator, destination=next_floor, limit_s=CABIN_LIMIT_S)
        return [
            *turns,
            *self._carried("carrying", outside),
            _Turn("waiting for the cabin", [call] * count),
            *self._through_doors("driving in", inside, elevator),
            _Turn("riding", [ride] * count),
        ]

    def _carried(self, phase: str, poses: Sequence[Pose], *limits: float) -> list[_Turn]:
        places = self._carry.formation.places()
        trajectory = Trajectory(poses, places, *limits)
        if trajectory.duration == 0.0:
            return []
        limit_s = CARRY_TIMES * trajectory.duration + CARRY_MORE_S
        rows = trajectory.to_rows()
        return [_Turn(phase, [Carry(rows=rows, place=place, limit_s=limit_s) for place in places])]

    def _through_doors(self, phase: str, poses: Sequence[Pose], elevator: str) -> list[_Turn]:
        """Doors don't wait for long: no faster than all have to be. Raises MissionFailed where that is too slow."""
        places = self._carry.formation.places()
        needed_s = Trajectory(poses, places).duration
        most_s = BOARDING_LIMIT_S - SPARE_S
        if needed_s <= most_s:
            return self._carried(phase, poses)
        needed_s = Trajectory(poses, places, *HURRY).duration
        if needed_s > most_s:
            raise MissionFailed(
                f"the doors of {elevator} stay open for {BOARDING_LIMIT_S:g} s; "
                f"{needed_s + SPARE_S:.0f} s are needed for {phase}"
            )
        return self._carried(phase, poses, *HURRY)

    def _at_doors(self, poses: list[Pose], elevator: str) -> tuple[list[Pose], list[Pose]]:
        """A way into a cabin: as far as everything is clear of its doors, and from there on."""
        shaft = shaft_polygon(self._world.building().elevators[elevator]).buffer(CLEAR_M)
        footprint = Polygon(self._carry.formation.footprint(self._thing.outline).convex_hull)
        trajectory = Trajectory(poses, self._carry.formation.places())
        clear_until = 0.0
        while clear_until + LOOK_S < trajectory.duration:
            if placed(footprint, trajectory.at(clear_until + LOOK_S)[0]).intersects(shaft):
                break
            clear_until += LOOK_S
        rows, last = trajectory.to_rows(), trajectory.at(clear_until)[0]
        before = [(x, y, heading) for time, x, y, heading, _ in rows if time < clear_until]
        after = [(x, y, heading) for time, x, y, heading, _ in rows if time > clear_until]
        return [*before, last], [last, *after]


def _poses(leg: Leg) -> list[Pose]:
    return [(float(x), float(y), float(heading)) for x, y, heading in leg.poses]


def _approach(at: Pose) -> Approach:
    return Approach(x=at[0], y=at[1], heading=at[2], limit_s=NEAR_LIMIT_S)


def _placed(place: Pose, at: Pose) -> Pose:
    """A place of a frame that is at a pose, in the building's."""
    return *out_of(place[0], place[1], at), at[2] + place[2]
