"""What the planner of a cooperative icon gives to its leader."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, Protocol, TypeAlias

from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.polygons import FloorArea
from robocorba.missions.subplan import CooperativePlan
from robocorba.missions.world import World
from robocorba.planning.request import Place

#: Reserves one of several ways, each as its areas (floor, corners [m]), for a time [s], and waits until it is granted.
#: Returns its index.
ReserveOneOf = Callable[[Sequence[Sequence[FloorArea]], float], int]


class CarriedBody(Protocol):
    """What robots carry, with these robots."""

    @property
    def footprint(self) -> BaseGeometry | None:
        """Its outline, in the frame of the trajectories of its plan's `Carry` steps [m]; None if nothing is to be
        watched."""
        return None

    def aside(self, robot: str) -> Place | None:
        """Where a robot that came into its way would step aside; None if there is no room. Raises NotReachable."""
        return None


class CooperativePlanner(CarriedBody, Protocol):
    """Plans the mission of a cooperative icon, and knows what the robots of its last plan carry."""

    #: Number of robots needed in addition to the leader.
    helpers: int
    #: Robots that must be among the helpers.
    required: frozenset[str]
    #: Where the helpers are needed.
    meeting_point: Place

    def reserve(self, reserve: ReserveOneOf, staying: Collection[str] = ()) -> None:
        """Reserve the areas that the mission needs, around robots that stay where they are, before helpers are called.
        If that has to wait, another planner is made afterwards, since what this one knows may be outdated. Raises
        ImpossibleCarry, MissionFailed, SimulationError, NotReachable."""
        return None

    def plan(
        self, mission: str, leader: str, robots: dict[str, Place], staying: Collection[str] = ()
    ) -> CooperativePlan:
        """A plan for some of these robots, including the leader. staying: others that stay where they are.

        Raises InTheWay for other robots where room is needed; MissionFailed, ImpossibleCarry, PathError."""


#: Makes a planner from the icon, the world, the leader's name and its place. Raises MissionFailed.
MakePlanner: TypeAlias = Callable[[Any, World, str, Place], CooperativePlanner]
