"""The rest of a carry that a former leader planned, as another leader sees it: from the plan alone."""

from __future__ import annotations

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.robots import MissionFailed
from robocorba.missions.clearing import Way, place_aside, united
from robocorba.missions.cooperative_planner import CarriedBody
from robocorba.missions.formation import Formation
from robocorba.missions.subplan import Carry, CooperativePlan, Gather, Reserve, Ride
from robocorba.missions.swept_area import swept
from robocorba.missions.trajectory import Trajectory
from robocorba.missions.world import World
from robocorba.planning.request import Place


class RemainingCarry(CarriedBody):
    """What the robots of a former leader's plan hold: its object, and all of its carriers.

    Raises MissionFailed if the plan carries nothing that exists, NotReachable."""

    def __init__(self, world: World, plan: CooperativePlan) -> None:
        self._world, self.plan = world, plan
        carries = [step for subplan in plan.subplans for step in subplan.steps if isinstance(step, Carry)]
        if not carries:
            raise MissionFailed("the plan carries nothing")
        formation = Formation.of_carriers(dict.fromkeys(carry.place for carry in carries))
        outline = shapely.convex_hull(world.movable(plan.thing).outline)
        self._footprint = formation.footprint(outline)

    @property
    def footprint(self) -> BaseGeometry:
        """See CarriedBody."""
        return self._footprint

    def aside(self, robot: str) -> Place | None:
        """See CarriedBody."""
        return place_aside(self._world, self._way(), robot, self._world.movable(self.plan.thing))

    def _way(self) -> Way:
        """What the carries of the plan sweep on each floor."""
        steps = self.plan.subplans[0].steps
        floor = next((step.floor for step in _all_steps(self.plan) if isinstance(step, Gather)), "")
        areas: list[tuple[str, BaseGeometry]] = []
        for step in steps:
            if isinstance(step, Ride):
                floor = step.destination
            elif isinstance(step, Carry):
                poses = [(x, y, heading) for _, x, y, heading, _ in Trajectory.from_rows(step.rows).to_rows()]
                areas += [(floor, shape) for shape in swept(self._footprint, poses)]
        return united(areas)


def reservation(plan: CooperativePlan) -> Reserve:
    """The reservation of a plan's areas. Raises MissionFailed if it has none."""
    for step in _all_steps(plan):
        if isinstance(step, Reserve):
            return step
    raise MissionFailed("the plan reserves no areas")


def _all_steps(plan: CooperativePlan) -> list[object]:
    return [step for subplan in plan.subplans for step in subplan.steps]
