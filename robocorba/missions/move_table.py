"""The cooperative icon move_table: the places of the robots around an object, and the steps to carry it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from typing import NamedTuple

from shapely import Polygon

from robocorba.errors.robots import MissionFailed
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.polygons import FloorArea
from robocorba.missions.carry import CarryLeg, CarryPlan, plan_carry
from robocorba.missions.formation import Pose
from robocorba.missions.gathering import GatheringPaths, spread_apart, waves
from robocorba.missions.helpers import assign_places
from robocorba.missions.obstacles import placed
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
from robocorba.missions.swept_area import swept_areas
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import World
from robocorba.planning.request import Place
from robocorba.programs.icons import Destination
from robocorba.simulation.building import PAYLOAD_KG
from robocorba.simulation.elevator import BOARDING_LIMIT_S
from robocorba.simulation.reservations import MAX_LIMIT_S
from robocorba.spatial.frames import out_of

#: Distance behind their places at which robots gather, and that they back off [m].
BACK_M = 0.3
#: Height of the hands below the top of the object [m].
BELOW_TOP_M = 0.02
#: Clearance of the body from the shaft while it waits for the cabin [m].
DOOR_CLEARANCE_M = 0.15
#: Sampling interval of the trajectory when that clearance is checked [s].
DOOR_SAMPLE_S = 0.1
#: Limits in elevator doors if the ordinary ones are too slow [m/s, rad/s, m/s²].
DOOR_LIMITS = (0.4, 0.5, 0.6)
#: Time to spare before the doors close [s].
DOOR_RESERVE_S = 4.0
#: Time limit for other carries to pass, and duration of the reservation then [s]: the server's maximum.
RESERVATION_LIMIT_S = MAX_LIMIT_S
#: Time limits of steps [s].
GATHER_LIMIT_S, NEAR_LIMIT_S, CABIN_LIMIT_S = 240.0, 30.0, 300.0
#: Time limit of a carry: a multiple of its planned duration, plus an extra time [s].
CARRY_LIMIT_FACTOR, CARRY_LIMIT_EXTRA_S = 3.0, 20.0


class _PhaseSteps(NamedTuple):
    """The simultaneous steps of all robots. name: of the phase, for display."""

    name: str
    steps: Sequence[Step | Wait]


class MoveTable:
    """An Expansion. It plans the carry when it is created. robots: 0 for as many as the object's weight needs.

    Raises MissionFailed, ImpossibleCarry, NotReachable."""

    def __init__(self, world: World, table: str, goal: Destination, robots: int = 0) -> None:
        self._world = world
        self._object = carried = world.movable(table)
        count = robots or max(2, math.ceil(carried.mass_kg / PAYLOAD_KG - 1e-9))
        self._carry: CarryPlan = plan_carry(
            world.building(),
            table,
            (carried.floor, carried.x, carried.y, carried.heading),
            (goal.floor, goal.x, goal.y, goal.heading),
            count,
            blocked=world.others(table),
        )
        self.helpers = count - 1
        self.wanted: frozenset[str] = frozenset()
        self.meeting_point = Place(carried.floor, carried.x, carried.y)

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        carried, formation = self._object, self._carry.formation
        at = (carried.x, carried.y, carried.heading)
        paths = GatheringPaths(self._world, carried)
        behind, names = self._gathered(leader, robots, paths)
        limit_s = RESERVATION_LIMIT_S
        reserve = Reserve(areas=self._swept_areas(), hold_s=limit_s, limit_s=limit_s)
        phases = [
            _PhaseSteps("reserving", [reserve if name == leader else Wait(limit_s=limit_s) for name in names]),
            *self._gatherings(behind, [robots[name] for name in names], paths),
            _PhaseSteps("approaching", [_approach(_placed(place, at)) for place in formation.places()]),
            _PhaseSteps("gripping", [self._take_hold(_placed((grip.x, grip.y, 0.0), at)) for grip in formation.grips]),
        ]
        legs = self._carry.legs
        for before, leg, after in zip([None, *legs[:-1]], legs, [*legs[1:], None], strict=True):
            phases += self._leg(mission, leg, before.elevator_after if before else "", after.floor if after else "")
        phases.append(_PhaseSteps("putting down", [PutDown(limit_s=NEAR_LIMIT_S) for _ in names]))
        phases.append(_PhaseSteps("backing off", [BackOff(distance_m=BACK_M, limit_s=NEAR_LIMIT_S) for _ in names]))
        subplans = tuple(
            SubPlan(name, "leader" if name == leader else "helper", tuple(phase.steps[place] for phase in phases))
            for place, name in enumerate(names)
        )
        return CooperativePlan(
            mission, "move table", leader, carried.name, tuple(phase.name for phase in phases), subplans
        )

    def _gathered(self, leader: str, robots: dict[str, Place], paths: GatheringPaths) -> tuple[list[Pose], list[str]]:
        """Poses behind the carriers' places, and the robot for each of them. The poses are spread apart if there is
        room. Raises MissionFailed."""
        carried, close = self._object, self._carry.formation.places(BACK_M)

        def found(places: Sequence[Pose]) -> tuple[list[Pose], list[str]]:
            behind = [_placed(place, (carried.x, carried.y, carried.heading)) for place in places]
            goals = [Place(carried.floor, x, y) for x, y, _ in behind]
            return behind, assign_places(robots, goals, leader, paths.length_m)

        with contextlib.suppress(MissionFailed):
            return found(spread_apart(close))
        return found(close)

    def _gatherings(self, behind: Sequence[Pose], starts: Sequence[Place], paths: GatheringPaths) -> list[_PhaseSteps]:
        """Simultaneously, or one after the other if the robots would block each other."""
        floor, limit_s = self._object.floor, GATHER_LIMIT_S
        goals = [Place(floor, x, y) for x, y, _ in behind]
        points = [paths.points(start, goal) for start, goal in zip(starts, goals, strict=True)]
        phases = []
        for wave in waves(starts, goals, points):
            steps: list[Step | Wait] = [
                Gather(floor=floor, x=x, y=y, heading=heading, limit_s=limit_s) if number in wave else Wait()
                for number, (x, y, heading) in enumerate(behind)
            ]
            phases.append(_PhaseSteps("gathering", steps))
        return phases

    def _swept_areas(self) -> tuple[FloorArea, ...]:
        return swept_areas(self._carry.legs, self._carry.formation, self._object.outline, BACK_M)

    def _take_hold(self, at: Pose) -> TakeHold:
        height_m = self._object.height_m - BELOW_TOP_M
        pose = self._object.x, self._object.y, self._object.heading
        return TakeHold(thing=self._object.name, at=pose, x=at[0], y=at[1], height_m=height_m, limit_s=NEAR_LIMIT_S)

    def _leg(self, mission: str, leg: CarryLeg, came_by: str, next_floor: str) -> list[_PhaseSteps]:
        """The phases on one floor: out of the elevator `came_by`, to the goal or into the next one, and the ride."""
        phases, path, elevator = [], _poses(leg), leg.elevator_after
        if came_by:
            outside, inside = self._at_doors(path[::-1], came_by)
            phases += self._through_doors("driving out", inside[::-1], came_by)
            path = outside[::-1]
        if not elevator:
            return [*phases, *self._carried("carrying", path)]
        outside, inside = self._at_doors(path, elevator)
        count = len(self._carry.formation.grips)
        party = f"{mission} to {next_floor}"
        call = CallCabin(elevator=elevator, destination=next_floor, party=party, size=count, limit_s=CABIN_LIMIT_S)
        ride = Ride(elevator=elevator, destination=next_floor, limit_s=CABIN_LIMIT_S)
        return [
            *phases,
            *self._carried("carrying", outside),
            _PhaseSteps("waiting for the cabin", [call] * count),
            *self._through_doors("driving in", inside, elevator),
            _PhaseSteps("riding", [ride] * count),
        ]

    def _carried(self, phase: str, poses: Sequence[Pose], *limits: float) -> list[_PhaseSteps]:
        places = self._carry.formation.places()
        trajectory = Trajectory(poses, places, *limits)
        if trajectory.duration == 0.0:
            return []
        limit_s = CARRY_LIMIT_FACTOR * trajectory.duration + CARRY_LIMIT_EXTRA_S
        rows = trajectory.to_rows()
        return [_PhaseSteps(phase, [Carry(rows=rows, place=place, limit_s=limit_s) for place in places])]

    def _through_doors(self, phase: str, poses: Sequence[Pose], elevator: str) -> list[_PhaseSteps]:
        """Pass the doors before they close, at DOOR_LIMITS only if needed. Raises MissionFailed if that is too slow."""
        places = self._carry.formation.places()
        needed_s = Trajectory(poses, places).duration
        available_s = BOARDING_LIMIT_S - DOOR_RESERVE_S
        if needed_s <= available_s:
            return self._carried(phase, poses)
        needed_s = Trajectory(poses, places, *DOOR_LIMITS).duration
        if needed_s > available_s:
            raise MissionFailed(
                f"the doors of {elevator} stay open for {BOARDING_LIMIT_S:g} s; "
                f"{phase} needs {needed_s + DOOR_RESERVE_S:.0f} s"
            )
        return self._carried(phase, poses, *DOOR_LIMITS)

    def _at_doors(self, poses: list[Pose], elevator: str) -> tuple[list[Pose], list[Pose]]:
        """A path into a cabin, split at the last pose at which the body is clear of the shaft."""
        shaft = shaft_polygon(self._world.building().elevators[elevator]).buffer(DOOR_CLEARANCE_M)
        footprint = Polygon(self._carry.formation.footprint(self._object.outline).convex_hull)
        trajectory = Trajectory(poses, self._carry.formation.places())
        clear_until = 0.0
        while clear_until + DOOR_SAMPLE_S < trajectory.duration:
            if placed(footprint, trajectory.at(clear_until + DOOR_SAMPLE_S)[0]).intersects(shaft):
                break
            clear_until += DOOR_SAMPLE_S
        rows, last = trajectory.to_rows(), trajectory.at(clear_until)[0]
        before = [(x, y, heading) for time, x, y, heading, _ in rows if time < clear_until]
        after = [(x, y, heading) for time, x, y, heading, _ in rows if time > clear_until]
        return [*before, last], [last, *after]


def _poses(leg: CarryLeg) -> list[Pose]:
    return [(float(x), float(y), float(heading)) for x, y, heading in leg.poses]


def _approach(at: Pose) -> Approach:
    return Approach(x=at[0], y=at[1], heading=at[2], limit_s=NEAR_LIMIT_S)


def _placed(place: Pose, at: Pose) -> Pose:
    """A place in the frame of a body at pose `at`, in the building's frame."""
    return *out_of(place[0], place[1], at), at[2] + place[2]
