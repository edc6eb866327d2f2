"""What a leader knows of the building when it plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from shapely.geometry.base import BaseGeometry

from robocorba.maps.geometry import Obstacle
from robocorba.maps.model import Building
from robocorba.planning.request import Path, PathRequest


class Thing(NamedTuple):
    """A movable object: where it is, m and rad; outline (a polygon in its own frame), mass and height."""

    name: str
    floor: str
    x: float
    y: float
    heading: float
    outline: BaseGeometry
    mass_kg: float
    height_m: float


class World(Protocol):
    """As it is now. Everything raises NotReachable."""

    def building(self) -> Building:
        """The map."""

    def thing(self, name: str) -> Thing:
        """A movable object by its name. Raises MissionFailed where there is none."""

    def others(self, thing: str) -> dict[str, list[Obstacle]]:
        """By floor: movable objects other than this one, where they are now."""

    def paths(self, request: PathRequest) -> Sequence[Path]:
        """The path planning agent. Raises PathError."""
