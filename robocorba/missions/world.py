"""The state of the building that a leader plans with."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import Obstacle
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.robot.programs.base_checks import Planner


class MovableObject(NamedTuple):
    """A movable object. x, y [m], heading [rad]: its pose now. outline: polygon in its own frame."""

    name: str
    floor: str
    x: float
    y: float
    heading: float
    outline: BaseGeometry
    mass_kg: float
    height_m: float

    @property
    def pose(self) -> Pose2D:
        return self.x, self.y, self.heading


class StandingRobot(NamedTuple):
    """A robot where it is now: x, y [m], radius [m]."""

    name: str
    floor: str
    x: float
    y: float
    radius_m: float

    @property
    def disc(self) -> Polygon:
        return Point(self.x, self.y).buffer(self.radius_m, quad_segs=8)

    @property
    def obstacle(self) -> Obstacle:
        return Obstacle("robot", self.name, self.disc)


class World(Planner, Protocol):
    """The current state, and the path planning agent. All methods raise NotReachable."""

    def building(self) -> Building:
        """The map."""

    def movable(self, name: str) -> MovableObject:
        """A movable object by its name. Raises MissionFailed if it does not exist."""

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        """All movable objects except `carried` at their current poses, and what robots have seen that no map has, by
        floor."""

    def robots(self) -> list[StandingRobot]:
        """All robots of the building, on whatever floor."""
