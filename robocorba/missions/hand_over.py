"""The plan of the cooperative icon hand_over: two robots meet half way, face to face; one hands an object to the other.

The object is as small and light as a sheet of paper: the giver holds it in its hand, the simulation does not model
it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise, product

from shapely import MultiLineString

from robocorba.errors.robots import MissionFailed
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.missions.clearing import Way, place_aside
from robocorba.missions.cooperative_planner import CooperativePlanner
from robocorba.missions.formation import BACK_OFF_M, MARGIN_M
from robocorba.missions.gathering import GATHER_LIMIT_S, NEAR_LIMIT_S, GatheringPaths, clear_way
from robocorba.missions.obstacles import BuildingObstacles
from robocorba.missions.subplan import BackOff, CooperativePlan, Gather, Grip, Idle, PhaseSteps, Reach, plan_of
from robocorba.missions.world import StandingRobot, World
from robocorba.planning.request import PathPoint, Place
from robocorba.robot.kinematics import tasks
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import RADIUS_M, Side

#: Distance between the centres of both bases [m].
BETWEEN_M = 1.2
#: Hands of giver and taker.
GIVING, TAKING = Side.RIGHT, Side.LEFT
#: Distances from the path at which they look for a meeting point if there is no room on it [m].
BESIDE_M = tuple(0.5 * number for number in range(1, 9))


class HandOverPlanner(CooperativePlanner):
    """Plans the missions of the icon hand_over (see CooperativePlanner). The leader may be giver, taker or neither of
    them. held: the object. here: the leader's place.

    Raises MissionFailed, NotReachable."""

    def __init__(self, world: World, held: str, giver: str, taker: str, leader: str, here: Place) -> None:
        if giver == taker:
            raise MissionFailed(f"{giver} can't hand {held} over to itself")
        if held in movables(world.building()):
            raise MissionFailed(
                f"{held} stands in the building and can be carried; only objects held in a hand are handed over"
            )
        self._world, self._object, self._giver, self._taker = world, held, giver, taker
        self.required = frozenset({giver, taker} - {leader})
        self.helpers = len(self.required)
        self.meeting_point = here
        #: The room that the last plan needs.
        self._way: Way = {}

    def plan(
        self, mission: str, leader: str, robots: dict[str, Place], staying: Collection[str] = ()
    ) -> CooperativePlan:
        """See CooperativePlanner. Raises MissionFailed if there is no room on the path between the robots and near it,
        PathError if there is no path; InTheWay."""
        giver, taker = robots[self._giver], robots[self._taker]
        others = [robot for robot in self._world.robots() if robot.name not in (self._giver, self._taker)]
        gathers = self._meeting_poses(giver, taker, others)
        goals = [Place(gather.floor, gather.x, gather.y) for gather in gathers]
        self._way = clear_way(self._world, None, (), [(giver, goals[0]), (taker, goals[1])], others, staying)
        roles = [(self._giver, "giver"), (self._taker, "taker")]
        return plan_of(mission, "hand over", leader, self._object, roles, _phases(*gathers))

    def aside(self, robot: str) -> Place | None:
        """See CooperativePlanner. Raises NotReachable."""
        return place_aside(self._world, self._way, robot)

    def _meeting_poses(self, giver: Place, taker: Place, others: Sequence[StandingRobot]) -> tuple[Gather, Gather]:
        """Poses face to face on the path between the robots, as near to its middle as there is room beside others; near
        the path if there is none on it."""
        paths = GatheringPaths(self._world)
        building = self._world.building()
        blocked = self._world.others("")
        for robot in others:
            blocked.setdefault(robot.floor, []).append(robot.obstacle)
        obstacles = BuildingObstacles(building, "", blocked)
        shafts = {
            floor: [shaft_polygon(elevator) for elevator in building.elevators_through(floor)]
            for floor in building.floors
        }
        half_m, turns_rad = BETWEEN_M / 2, (0.0, math.pi / 4, -math.pi / 4, math.pi / 2)  # relative to the path
        for (floor, x, y, along, away), turn in product(_candidates(paths.path(giver, taker).points), turns_rad):
            at = (x, y, along)
            middle = (*out_of(*away, at), along + turn)
            ends = [out_of(ahead_m, 0.0, middle) for ahead_m in (-half_m - BACK_OFF_M, half_m + BACK_OFF_M)]
            # With the way there from the path: a point behind a wall is not near.
            shape = MultiLineString([ends, [at[:2], middle[:2]]]).buffer(RADIUS_M)
            if obstacles.on_floor(floor).nearest(shape, MARGIN_M) or any(map(shape.intersects, shafts[floor])):
                continue
            giver_goal = Place(floor, *out_of(-half_m, 0.0, middle))
            taker_goal = Place(floor, *out_of(half_m, 0.0, middle))
            if paths.length_m(giver, giver_goal) is not None and paths.length_m(taker, taker_goal) is not None:
                return _gather(giver_goal, middle[2]), _gather(taker_goal, middle[2] + math.pi)
        raise MissionFailed(
            f"no room for both face to face within {BESIDE_M[-1]:g} m of the path from {self._giver} to {self._taker}: "
            f"{BETWEEN_M + 2 * (BACK_OFF_M + RADIUS_M):.1f} m by {2 * RADIUS_M:.1f} m needed"
        )


def _candidates(points: Sequence[PathPoint]) -> Iterator[tuple[str, float, float, float, XY]]:
    """Floor, x, y and direction [rad] of points along a path, those nearest to its middle first, and how far ahead and
    to the left of each of them robots may meet [m]: first on the path, then beside it."""
    length_m = points[-1].distance
    found = []
    for one, other in pairwise(points):
        if one.floor != other.floor:
            continue
        dx, dy = other.x - one.x, other.y - one.y
        count = max(1, math.ceil(math.hypot(dx, dy) / 0.25))  # at most 0.25 m from one to the next
        for number in range(count + 1):
            share = number / count
            passed_m = one.distance + share * (other.distance - one.distance)
            point = (one.floor, one.x + share * dx, one.y + share * dy, math.atan2(dy, dx))
            found.append((abs(passed_m - length_m / 2), point))
    beside = [at for m in BESIDE_M for at in ((0.0, m), (0.0, -m), (m, 0.0), (-m, 0.0))]
    for away, (_, point) in product([(0.0, 0.0), *beside], sorted(found)):
        yield *point, away


def _phases(giver_gathers: Gather, taker_gathers: Gather) -> list[PhaseSteps]:
    """Each with the giver's and the taker's step; the taker grips before the giver lets go."""
    giver, taker = tasks.hand_over(BETWEEN_M, height_m=1.0, aside_m=-0.15)  # on the giver's right
    idle = Idle(limit_s=NEAR_LIMIT_S)
    giver_back, taker_back = giver.moved(-0.1), taker.moved(-0.1)  # m behind the object's ends
    back_off = BackOff(distance_m=BACK_OFF_M, limit_s=NEAR_LIMIT_S)
    return [
        PhaseSteps("gathering", [giver_gathers, taker_gathers]),
        PhaseSteps("getting ready", [_grip(GIVING, True), _grip(TAKING, False)]),
        PhaseSteps("lifting", [_reach(GIVING, giver_back), _reach(TAKING, taker_back)]),  # clear of the trunk
        PhaseSteps("holding out", [_reach(GIVING, giver), idle]),
        PhaseSteps("reaching", [idle, _reach(TAKING, taker)]),
        PhaseSteps("taking", [idle, _grip(TAKING, True)]),
        PhaseSteps("letting go", [_grip(GIVING, False), idle]),
        PhaseSteps("drawing back", [_reach(GIVING, giver_back), _reach(TAKING, taker_back)]),
        PhaseSteps("backing off", [back_off, back_off]),
    ]


def _gather(at: Place, heading: float) -> Gather:
    return Gather(floor=at.floor, x=at.x, y=at.y, heading=math.remainder(heading, math.tau), limit_s=GATHER_LIMIT_S)


def _grip(side: Side, closes: bool) -> Grip:
    return Grip(hand=side.value, closes=closes, limit_s=NEAR_LIMIT_S)


def _reach(side: Side, hand: HandPose) -> Reach:
    return Reach(hand=side.value, pose=(*hand,), limit_s=NEAR_LIMIT_S)
