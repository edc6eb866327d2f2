"""The cooperative icon hand_over: two robots meet half way, face to face, and one hands an object to the other.

The object is as small and light as a sheet of paper: the giver holds it in its hand, the simulation does not model
it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from shapely import LineString

from robocorba.errors.robots import MissionFailed
from robocorba.kinematics import tasks
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import RADIUS_M, Side
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.movable import movables
from robocorba.missions.gathering import GatheringPaths
from robocorba.missions.obstacles import BuildingObstacles
from robocorba.missions.subplan import BackOff, CooperativePlan, Gather, Grip, Reach, Step, SubPlan, Wait
from robocorba.missions.world import World
from robocorba.planning.request import PathPoint, Place

#: Distance between the centres of both bases [m].
BETWEEN_M = 1.2
#: Height of the object, and its offset to the left of the giver [m].
HEIGHT_M, OFFSET_M = 1.0, -0.15
#: Hands of giver and taker.
GIVING, TAKING = Side.RIGHT, Side.LEFT
#: Distance that hands keep behind the object's ends before and after the hand-over [m].
HAND_BACK_M = 0.1
#: Distance that the bases back off [m].
BACK_M = 0.3
#: Distance between candidate meeting points along the path [m].
SPACING_M = 0.25
#: Directions tried at each of them, relative to the path [rad].
TURNS_RAD = (0.0, math.pi / 4, -math.pi / 4, math.pi / 2)
#: Clearance around both robots [m].
MARGIN_M = 0.05
GATHER_LIMIT_S, STEP_LIMIT_S = 240.0, 30.0


class _PhaseSteps(NamedTuple):
    """The simultaneous steps of both robots. name: of the phase, for display."""

    name: str
    giver: Step | Wait
    taker: Step | Wait


class HandOver:
    """An Expansion. The leader may be giver, taker or neither of them. here: its place.

    Raises MissionFailed, NotReachable."""

    def __init__(self, world: World, held: str, giver: str, taker: str, leader: str, here: Place) -> None:
        if giver == taker:
            raise MissionFailed(f"{giver} can't hand {held} over to itself")
        if held in movables(world.building()):
            raise MissionFailed(
                f"{held} stands in the building and can be carried; only objects held in a hand are handed over"
            )
        self._world, self._object, self._giver, self._taker = world, held, giver, taker
        self.wanted = frozenset({giver, taker} - {leader})
        self.helpers = len(self.wanted)
        self.meeting_point = here

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        """Raises MissionFailed if there is no room on the path between the robots, PathError if there is no path."""
        places = self._meeting(robots[self._giver], robots[self._taker])
        phases = _phase_steps(*places)
        names = tuple(phase.name for phase in phases)
        subplans = (
            SubPlan(self._giver, "giver", tuple(phase.giver for phase in phases)),
            SubPlan(self._taker, "taker", tuple(phase.taker for phase in phases)),
        )
        return CooperativePlan(mission, "hand over", leader, self._object, names, subplans)

    # ---- the meeting point ----

    def _meeting(self, giver: Place, taker: Place) -> tuple[Gather, Gather]:
        """Poses face to face on the path between the robots, as near to its middle as there is room."""
        paths = GatheringPaths(self._world)
        points = paths.path(giver, taker).points
        building = self._world.building()
        obstacles = BuildingObstacles(building, "", self._world.others(""))
        shafts = [shaft_polygon(elevator) for elevator in building.elevators.values()]
        for floor, x, y, along in _candidates(points):
            for facing in (along + turn for turn in TURNS_RAD):
                half_m = BETWEEN_M / 2
                needed = LineString([_ahead(x, y, facing, ahead) for ahead in (-half_m - BACK_M, half_m + BACK_M)])
                shape = needed.buffer(RADIUS_M)
                if obstacles.on_floor(floor).nearest(shape, MARGIN_M) or any(map(shape.intersects, shafts)):
                    continue
                found = (
                    _gather(floor, *_ahead(x, y, facing, -half_m), facing),
                    _gather(floor, *_ahead(x, y, facing, half_m), facing + math.pi),
                )
                goals = [Place(at.floor, at.x, at.y) for at in found]
                if all(paths.length_m(*ends) is not None for ends in zip((giver, taker), goals, strict=True)):
                    return found
        raise MissionFailed(
            f"no room for both face to face on the path from {self._giver} to {self._taker}: "
            f"{BETWEEN_M + 2 * (BACK_M + RADIUS_M):.1f} m by {2 * RADIUS_M:.1f} m needed"
        )


def _candidates(points: Sequence[PathPoint]) -> Iterator[tuple[str, float, float, float]]:
    """Floor, x, y and direction [rad] of points along a path, those nearest to its middle first."""
    length_m = points[-1].distance
    found = []
    for one, other in pairwise(points):
        if one.floor != other.floor:
            continue
        dx, dy = other.x - one.x, other.y - one.y
        count = max(1, math.ceil(math.hypot(dx, dy) / SPACING_M))
        for number in range(count + 1):
            share = number / count
            x, y = one.x + share * dx, one.y + share * dy
            passed_m = one.distance + share * (other.distance - one.distance)
            found.append((abs(passed_m - length_m / 2), (one.floor, x, y, math.atan2(dy, dx))))
    return (place for _, place in sorted(found))


# ---- the steps ----


def _phase_steps(giver_at: Gather, taker_at: Gather) -> list[_PhaseSteps]:
    """The phases; the taker grips before the giver lets go."""
    ends = tasks.hand_over(BETWEEN_M, HEIGHT_M, OFFSET_M)
    wait = Wait(limit_s=STEP_LIMIT_S)
    giver_back, taker_back = ends.giver.moved(-HAND_BACK_M), ends.taker.moved(-HAND_BACK_M)
    back_off = BackOff(distance_m=BACK_M, limit_s=STEP_LIMIT_S)
    return [
        _PhaseSteps("gathering", giver_at, taker_at),
        _PhaseSteps("getting ready", _grip(GIVING, True), _grip(TAKING, False)),
        _PhaseSteps("lifting", _reach(GIVING, giver_back), _reach(TAKING, taker_back)),  # clear of the trunk
        _PhaseSteps("holding out", _reach(GIVING, ends.giver), wait),
        _PhaseSteps("reaching", wait, _reach(TAKING, ends.taker)),
        _PhaseSteps("taking", wait, _grip(TAKING, True)),
        _PhaseSteps("letting go", _grip(GIVING, False), wait),
        _PhaseSteps("drawing back", _reach(GIVING, giver_back), _reach(TAKING, taker_back)),
        _PhaseSteps("backing off", back_off, back_off),
    ]


def _ahead(x: float, y: float, facing: float, ahead: float) -> tuple[float, float]:
    return x + ahead * math.cos(facing), y + ahead * math.sin(facing)


def _gather(floor: str, x: float, y: float, heading: float) -> Gather:
    return Gather(floor=floor, x=x, y=y, heading=math.remainder(heading, math.tau), limit_s=GATHER_LIMIT_S)


def _grip(side: Side, closes: bool) -> Grip:
    return Grip(hand=side.value, closes=closes, limit_s=STEP_LIMIT_S)


def _reach(side: Side, hand: HandPose) -> Reach:
    return Reach(hand=side.value, pose=(*hand,), limit_s=STEP_LIMIT_S)
