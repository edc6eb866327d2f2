"""Points, poses and a base's limits: values that every part uses, and that load nothing else."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

#: A point of a floor: x and y [m].
XY: TypeAlias = tuple[float, float]


class Pose(NamedTuple):
    """Where a robot stands: x, y in m, heading in rad."""

    floor: str
    x: float
    y: float
    heading: float = 0.0


class Limits(NamedTuple):
    """Of a robot's base: m/s, rad/s, m/s^2, rad/s^2."""

    speed: float = 1.0
    turn: float = math.radians(100)
    acceleration: float = 1.0
    turn_acceleration: float = math.radians(100)
