"""The cooperative icon hand_over: two robots meet half way, face to face, and what one hand holds goes to another.

What is handed over is as small and light as a sheet of paper: the giver's hand holds it, the building knows nothing of
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
from robocorba.missions.gathering import Ways
from robocorba.missions.subplan import BackOff, CooperativePlan, Gather, Grip, Reach, Step, SubPlan, Wait
from robocorba.missions.surroundings import Surroundings
from robocorba.missions.world import World
from robocorba.planning.request import PathPoint, Place

#: Between the middles of both bases, m; how high the object is held, and how far to the left of the giver.
BETWEEN_M, HEIGHT_M, ASIDE_M = 1.2, 1.0, -0.15
GIVING, TAKING = Side.RIGHT, Side.LEFT
#: A hand comes from so far behind the object's end and goes back there; a base backs off so far, m.
HAND_BACK_M, BACK_M = 0.1, 0.3
#: Places of the way are tried so far from each other, m; and at each of them directions, rad, first along the way.
EVERY_M, TURNS = 0.25, (0.0, math.pi / 4, -math.pi / 4, math.pi / 2)
#: What stays free around both, m.
MARGIN_M = 0.05
GATHER_LIMIT_S, STEP_LIMIT_S = 240.0, 30.0


class _Turn(NamedTuple):
    """What both do at the same time, and what that is for people."""

    phase: str
    giver: Step | Wait
    taker: Step | Wait


class HandOver:
    """As an Expansion. The robot that leads may be giver, taker or neither of them; it stands `here`.

    Raises MissionFailed, NotReachable."""

    def __init__(self, world: World, thing: str, giver: str, taker: str, leader: str, here: Place) -> None:
        if giver == taker:
            raise MissionFailed(f"{giver} can't hand {thing} over to itself")
        if thing in movables(world.building()):
            raise MissionFailed(
                f"{thing} stands in the building and can be carried; only what a hand holds is handed over"
            )
        self._world, self._thing, self._giver, self._taker = world, thing, giver, taker
        self.wanted = frozenset({giver, taker} - {leader})
        self.helpers = len(self.wanted)
        self.meeting_point = here

    def plan(self, mission: str, leader: str, robots: dict[str, Place]) -> CooperativePlan:
        """Raises MissionFailed where nowhere is room; PathError."""
        places = self._meeting(robots[self._giver], robots[self._taker])
        turns = _turns(*places)
        phases = tuple(turn.phase for turn in turns)
        subplans = (
            SubPlan(self._giver, "giver", tuple(turn.giver for turn in turns)),
            SubPlan(self._taker, "taker", tuple(turn.taker for turn in turns)),
        )
        return CooperativePlan(mission, "hand over", leader, self._thing, phases, subplans)

    # ---- where they meet ----

    def _meeting(self, giver: Place, taker: Place) -> tuple[Gather, Gather]:
        """Places on the way from one to the other, as near to its middle as there is room for both."""
        ways = Ways(self._world)
        points = ways.path(giver, taker).points
        building = self._world.building()
        surroundings = Surroundings(building, "", self._world.others(""))
        shafts = [shaft_polygon(elevator) for elevator in building.elevators.values()]
        for floor, x, y, along in _candidates(points):
            for facing in (along + turn for turn in TURNS):
                half_m = BETWEEN_M / 2
                needed = LineString([_ahead(x, y, facing, way) for way in (-half_m - BACK_M, half_m + BACK_M)])
                shape = needed.buffer(RADIUS_M)
                if surroundings.ground(floor).nearest(shape, MARGIN_M) or any(map(shape.intersects, shafts)):
                    continue
                found = (
                    _gather(floor, *_ahead(x, y, facing, -half_m), facing),
                    _gather(floor, *_ahead(x, y, facing, half_m), facing + math.pi),
                )
                goals = [Place(at.floor, at.x, at.y) for at in found]
                if all(ways.length_m(*way) is not None for way in zip((giver, taker), goals, strict=True)):
                    return found
        raise MissionFailed(
            f"nowhere on the way from {self._giver} to {self._taker} is room for both, face to face: "
            f"{BETWEEN_M + 2 * (BACK_M + RADIUS_M):.1f} m by {2 * RADIUS_M:.1f} m"
        )


def _candidates(points: Sequence[PathPoint]) -> Iterator[tuple[str, float, float, float]]:
    """Floor, x and y of places of a way and where it leads there, rad; those next to its middle first."""
    length_m = points[-1].distance
    found = []
    for one, other in pairwise(points):
        if one.floor != other.floor:
            continue
        way = other.x - one.x, other.y - one.y
        count = max(1, math.ceil(math.hypot(*way) / EVERY_M))
        for number in range(count + 1):
            share = number / count
            x, y = one.x + share * way[0], one.y + share * way[1]
            passed_m = one.distance + share * (other.distance - one.distance)
            found.append((abs(passed_m - length_m / 2), (one.floor, x, y, math.atan2(way[1], way[0]))))
    return (place for _, place in sorted(found))


# ---- what they do there ----


def _turns(giver_at: Gather, taker_at: Gather) -> list[_Turn]:
    """The taker has gripped before the giver lets go."""
    ends = tasks.hand_over(BETWEEN_M, HEIGHT_M, ASIDE_M)
    wait = Wait(limit_s=STEP_LIMIT_S)
    giver_back, taker_back = ends.giver.moved(-HAND_BACK_M), ends.taker.moved(-HAND_BACK_M)
    back_off = BackOff(distance_m=BACK_M, limit_s=STEP_LIMIT_S)
    return [
        _Turn("gathering", giver_at, taker_at),
        _Turn("getting ready", _grip(GIVING, True), _grip(TAKING, False)),
        _Turn("lifting", _reach(GIVING, giver_back), _reach(TAKING, taker_back)),  # clear of the trunk
        _Turn("holding out", _reach(GIVING, ends.giver), wait),
        _Turn("reaching", wait, _reach(TAKING, ends.taker)),
        _Turn("taking", wait, _grip(TAKING, True)),
        _Turn("letting go", _grip(GIVING, False), wait),
        _Turn("drawing back", _reach(GIVING, giver_back), _reach(TAKING, taker_back)),
        _Turn("backing off", back_off, back_off),
    ]


def _ahead(x: float, y: float, facing: float, way: float) -> tuple[float, float]:
    return x + way * math.cos(facing), y + way * math.sin(facing)


def _gather(floor: str, x: float, y: float, heading: float) -> Gather:
    return Gather(floor=floor, x=x, y=y, heading=math.remainder(heading, math.tau), limit_s=GATHER_LIMIT_S)


def _grip(side: Side, closes: bool) -> Grip:
    return Grip(hand=side.value, closes=closes, limit_s=STEP_LIMIT_S)


def _reach(side: Side, hand: HandPose) -> Reach:
    return Reach(hand=side.value, pose=(*hand,), limit_s=STEP_LIMIT_S)
