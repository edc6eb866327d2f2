"""The plan of the cooperative icon move_table: the robots' places around an object, and the steps to carry it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Sequence
from itertools import islice

from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import GoalReached, MissionFailed
from robocorba.map_editor.geometry import Obstacle, shaft_polygon
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import PAYLOAD_KG, Limits, Pose, Pose2D
from robocorba.missions import subplan
from robocorba.missions.carry_control import GOAL_M, GOAL_RAD
from robocorba.missions.carry_planning import CarryLeg, CarryPlan, plan_carries
from robocorba.missions.clearing import Way, in_the_way, place_aside, united
from robocorba.missions.cooperative_planner import CooperativePlanner, ReserveOneOf
from robocorba.missions.formation import GripPoint
from robocorba.missions.gathering import (
    GATHER_LIMIT_S,
    NEAR_LIMIT_S,
    GatheringPaths,
    assign_places,
    clear_way,
    driving_groups,
    spread_apart,
)
from robocorba.missions.obstacles import placed
from robocorba.missions.subplan import CooperativePlan, PhaseSteps, plan_of
from robocorba.missions.swept_area import swept_areas, swept_shapes
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import StandingRobot, World
from robocorba.planning.request import Place
from robocorba.robot.programs.icons import Destination
from robocorba.simulation.elevator import BOARDING_LIMIT_S, BOARDING_MARGIN_S, MAX_BOARDING_S
from robocorba.simulation.reservations import MAX_ALTERNATIVES, MAX_LIMIT_S

#: Time to spare before the doors close [s].
DOOR_MARGIN_S = 4.0
#: Time for another leader to take over while the party drives through the doors [s].
SUCCESSION_S = 12.0


class MoveTablePlanner(CooperativePlanner):
    """Plans the missions of the icon move_table (see CooperativePlanner). It plans the carry when it is created.

    carriers: how many robots carry; None for as many as the object's mass needs, at least two. Where several elevators
    lead to the goal, it takes the one that it is granted the soonest. Raises GoalReached, MissionFailed,
    ImpossibleCarry, NotReachable."""

    def __init__(self, world: World, table: str, goal: Destination, carriers: int | None = None) -> None:
        self._world = world
        self._object = carried = world.movable(table)
        least = max(2, math.ceil(carried.mass_kg / PAYLOAD_KG - 1e-9))
        count = carriers or least
        if count < least:
            raise MissionFailed(
                f"{table} has a mass of {carried.mass_kg:g} kg, and each robot carries {PAYLOAD_KG:g} kg: "
                f"it needs {least} carriers, not {count}"
            )
        start, to = Pose(carried.floor, *carried.pose), Pose(goal.floor, goal.x, goal.y, goal.heading)
        if _is_at(start, to):
            raise GoalReached(f"{table} is at its goal")
        self._start, self._goal, self._count = start, to, count
        #: The ways by different elevators, and the one that is taken; all have the same formation.
        self._ways = self._plan_ways()
        self._carry = self._ways[0]
        #: The room that the last plan needs.
        self._way: Way = {}
        self.helpers = count - 1
        self.required: frozenset[str] = frozenset()
        self.meeting_point = Place(carried.floor, carried.x, carried.y)

    @property
    def footprint(self) -> BaseGeometry:
        """See CooperativePlanner."""
        return self._carry.footprint()

    def reserve(self, reserve: ReserveOneOf, staying: Collection[str] = ()) -> None:
        """See CooperativePlanner."""
        stay = [robot for robot in self._world.robots() if robot.name in staying] if staying else []
        if any(in_the_way(united(swept_shapes(way)), stay) for way in self._ways):
            self._ways = self._plan_ways(stay)
        self._carry = self._ways[reserve([swept_areas(way) for way in self._ways], MAX_LIMIT_S)]

    def plan(
        self, mission: str, leader: str, robots: dict[str, Place], staying: Collection[str] = ()
    ) -> CooperativePlan:
        """See CooperativePlanner. Raises MissionFailed, InTheWay, ImpossibleCarry, NotReachable."""
        paths = GatheringPaths(self._world, self._object)
        gathering, names = self._assign_gathering_poses(leader, robots, paths)
        carried, formation, legs = self._object, self._carry.formation, self._carry.legs
        others = [robot for robot in self._world.robots() if robot.name not in names]
        starts = [robots[name] for name in names]
        goals = [Place(carried.floor, x, y) for x, y, _ in gathering]
        drives = list(zip(starts, goals, strict=True))
        self._way = clear_way(self._world, carried, swept_shapes(self._carry), drives, others, staying)
        reserve = subplan.Reserve(areas=swept_areas(self._carry), hold_s=MAX_LIMIT_S, limit_s=NEAR_LIMIT_S)
        idle = subplan.Idle(limit_s=NEAR_LIMIT_S)
        phases = [
            PhaseSteps("reserving", [reserve if name == leader else idle for name in names]),
            *self._gathering_phases(gathering, drives, paths),
            PhaseSteps("approaching", [_approach(_in_building(pose, carried.pose)) for pose in self._carrier_poses]),
            PhaseSteps("gripping", [self._take_hold(grip) for grip in formation.grips]),
        ]
        for before, leg, after in zip([None, *legs[:-1]], legs, [*legs[1:], None], strict=True):
            phases += self._leg_phases(mission, before.elevator_after if before else "", leg, after)
        phases.append(PhaseSteps("putting down", [subplan.PutDown(limit_s=NEAR_LIMIT_S)] * len(names)))
        back_off = subplan.BackOff(distance_m=self._carry.back_off_m, limit_s=NEAR_LIMIT_S)
        phases.append(PhaseSteps("backing off", [back_off] * len(names)))
        roles = [(name, "leader" if name == leader else "helper") for name in names]
        enough = formation.enough(self._carry.outline, carried.mass_kg, PAYLOAD_KG)
        groups = tuple(tuple(names[number] for number in group) for group in enough)
        return plan_of(mission, "move table", leader, carried.name, roles, phases, groups)

    def aside(self, robot: str) -> Place | None:
        """See CooperativePlanner. Raises NotReachable."""
        return place_aside(self._world, self._way, robot, self._object)

    def _plan_ways(self, staying: Sequence[StandingRobot] = ()) -> list[CarryPlan]:
        """The carry by each elevator, around robots that stay where they are."""
        name = self._object.name
        blocked: dict[str, list[Obstacle]] = self._world.others(name)
        for robot in staying:
            blocked.setdefault(robot.floor, []).append(robot.obstacle)
        found = plan_carries(self._world.building(), name, self._start, self._goal, self._count, blocked)
        return list(islice(found, MAX_ALTERNATIVES))

    @property
    def _carrier_poses(self) -> tuple[Pose2D, ...]:
        return self._carry.formation.carrier_poses()

    def _assign_gathering_poses(
        self, leader: str, robots: dict[str, Place], paths: GatheringPaths
    ) -> tuple[list[Pose2D], list[str]]:
        """Poses behind the carriers' places, and the robot for each of them. The poses are spread apart if there is
        room. Raises MissionFailed."""
        carried, close = self._object, self._carry.formation.carrier_poses(self._carry.back_off_m)

        def assigned(poses: Sequence[Pose2D]) -> tuple[list[Pose2D], list[str]]:
            poses = [_in_building(pose, carried.pose) for pose in poses]
            goals = [Place(carried.floor, x, y) for x, y, _ in poses]
            return poses, assign_places(robots, goals, leader, paths.length_m)

        with contextlib.suppress(MissionFailed):
            return assigned(spread_apart(close))
        return assigned(close)

    def _gathering_phases(
        self, poses: Sequence[Pose2D], drives: Sequence[tuple[Place, Place]], paths: GatheringPaths
    ) -> list[PhaseSteps]:
        """All robots gather simultaneously, or in groups if they would block each other."""
        floor = self._object.floor
        points = [paths.points(start, goal) for start, goal in drives]
        gathers = [
            subplan.Gather(floor=floor, x=x, y=y, heading=heading, limit_s=GATHER_LIMIT_S) for x, y, heading in poses
        ]
        return [
            PhaseSteps(
                "gathering", [step if number in group else subplan.Idle() for number, step in enumerate(gathers)]
            )
            for group in driving_groups(drives, points)
        ]

    def _take_hold(self, grip: GripPoint) -> subplan.TakeHold:
        carried = self._object
        x, y = out_of(grip.x, grip.y, carried.pose)
        height_m = carried.height_m - 0.02  # the hands are 2 cm below its top
        return subplan.TakeHold(thing=carried.name, at=carried.pose, x=x, y=y, height_m=height_m, limit_s=NEAR_LIMIT_S)

    def _leg_phases(
        self, mission: str, elevator_before: str, leg: CarryLeg, after: CarryLeg | None
    ) -> list[PhaseSteps]:
        """The phases on one floor: out of the elevator `elevator_before`, to the goal or into the next elevator, and
        the ride to the leg `after`."""
        phases: list[PhaseSteps] = []
        path = _poses(leg)
        elevator = leg.elevator_after
        if elevator_before:
            outside, inside = self._split_at_doors(path[::-1], elevator_before)
            phases += self._through_doors("driving out", inside[::-1], elevator_before)
            path = outside[::-1]
        if not elevator or not after:
            return [*phases, *self._carry_phases("carrying", path)]
        outside, inside = self._split_at_doors(path, elevator)
        count = len(self._carry.formation.grips)
        ways = inside, self._split_at_doors(_poses(after)[::-1], elevator)[1][::-1]
        boarding_s = max(self._trajectory_through_doors(each).duration for each in ways)
        call = subplan.CallCabin(
            elevator=elevator,
            destination=after.floor,
            party=f"{mission} to {after.floor}",  # the carriers ride together
            size=count,
            boarding_s=min(MAX_BOARDING_S - BOARDING_MARGIN_S, boarding_s + SUCCESSION_S),
            limit_s=1800.0,  # other missions may use the cabin
        )
        ride = subplan.Ride(elevator=elevator, destination=after.floor, limit_s=300.0)
        return [
            *phases,
            *self._carry_phases("carrying", outside),
            PhaseSteps("waiting for the cabin", [call] * count),
            *self._through_doors("driving in", inside, elevator),
            PhaseSteps("riding", [ride] * count),
        ]

    def _carry_phases(self, phase: str, poses: Sequence[Pose2D]) -> list[PhaseSteps]:
        """The phase that carries along `poses`; none if they are all the same."""
        return self._phases_of(phase, Trajectory(poses, self._carrier_poses))

    def _phases_of(self, phase: str, trajectory: Trajectory) -> list[PhaseSteps]:
        if trajectory.duration == 0.0:
            return []
        limit_s = 3.0 * trajectory.duration + 20.0  # it may have to wait for what is in its way
        rows = trajectory.to_rows()
        return [
            PhaseSteps(phase, [subplan.Carry(rows=rows, place=pose, limit_s=limit_s) for pose in self._carrier_poses])
        ]

    def _through_doors(self, phase: str, poses: Sequence[Pose2D], elevator: str) -> list[PhaseSteps]:
        """The phase that passes the doors. Raises MissionFailed if it takes longer than doors stay open for a party."""
        trajectory = self._trajectory_through_doors(poses)
        if trajectory.duration > MAX_BOARDING_S - BOARDING_MARGIN_S:
            raise MissionFailed(
                f"the doors of {elevator} stay open for {MAX_BOARDING_S:g} s at most; "
                f"{phase} needs {trajectory.duration + BOARDING_MARGIN_S:.0f} s"
            )
        return self._phases_of(phase, trajectory)

    def _trajectory_through_doors(self, poses: Sequence[Pose2D]) -> Trajectory:
        """Faster than elsewhere if that would need the doors open for longer than a lone robot does."""
        ordinary = Trajectory(poses, self._carrier_poses)
        if ordinary.duration <= BOARDING_LIMIT_S - DOOR_MARGIN_S:
            return ordinary
        # Without orders carriers stand a tenth of a second later than elsewhere with each 0.1 m/s more.
        return Trajectory(poses, self._carrier_poses, Limits(0.3, 0.5, 0.6))

    def _split_at_doors(self, poses: list[Pose2D], elevator: str) -> tuple[list[Pose2D], list[Pose2D]]:
        """A path into a cabin, split at the last pose at which the body is clear of the shaft."""
        shaft = shaft_polygon(self._world.building().elevators[elevator]).buffer(0.15)  # m of clearance
        footprint = Polygon(self._carry.footprint().convex_hull)
        trajectory = Trajectory(poses, self._carrier_poses)
        clear_until, step_s = 0.0, 0.1
        while clear_until + step_s < trajectory.duration:
            if placed(footprint, trajectory.at(clear_until + step_s)[0]).intersects(shaft):
                break
            clear_until += step_s
        rows, last = trajectory.to_rows(), trajectory.at(clear_until)[0]
        before = [(x, y, heading) for time, x, y, heading, _ in rows if time < clear_until]
        after = [(x, y, heading) for time, x, y, heading, _ in rows if time > clear_until]
        return [*before, last], [last, *after]


def _is_at(pose: Pose, goal: Pose) -> bool:
    """Whether an object need not be carried from a pose to its goal."""
    off_rad = math.remainder(pose.heading - goal.heading, math.tau)
    return pose.floor == goal.floor and math.dist(pose[1:3], goal[1:3]) <= GOAL_M and abs(off_rad) <= GOAL_RAD


def _poses(leg: CarryLeg) -> list[Pose2D]:
    return [(x, y, heading) for x, y, heading in leg.poses.tolist()]


def _approach(pose: Pose2D) -> subplan.Approach:
    x, y, heading = pose
    return subplan.Approach(x=x, y=y, heading=heading, limit_s=NEAR_LIMIT_S)


def _in_building(pose: Pose2D, body: Pose2D) -> Pose2D:
    """A pose from the frame of a body at pose `body` to the building's frame."""
    return *out_of(pose[0], pose[1], body), body[2] + pose[2]
