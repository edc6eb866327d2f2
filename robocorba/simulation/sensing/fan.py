"""Fans: the ray geometry of range sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robocorba.errors.sensing import InvalidScan
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.system.lazy_property import lazy_property

#: Maximum number of rays of a fan.
MAX_RAYS = 8192
#: Maximum range of a sensor [m].
MAX_RANGE_M = 1000.0


@dataclass(frozen=True)
class Fan:
    """`count` rays of length `range_m` in the sensor's frame, spanning at most a full turn.

    first_rad: angle of the first ray, counter-clockwise from straight ahead [rad]. step_rad: angle between rays [rad].
    Raises InvalidScan."""

    first_rad: float
    step_rad: float
    count: int
    range_m: float

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_RAYS:
            raise InvalidScan("rays", f"{self.count} is not 1 to {MAX_RAYS}")
        if not -2 * math.pi <= self.first_rad <= 2 * math.pi:  # also refuses NaN, like those below
            raise InvalidScan("firstAngle", f"{self.first_rad} is not between -2 pi and 2 pi")
        if not 0.0 < self.step_rad <= 2 * math.pi:
            raise InvalidScan("step", f"{self.step_rad} is not above 0 and at most 2 pi")
        if (self.count - 1) * self.step_rad > 2 * math.pi + 1e-9:
            raise InvalidScan("step", f"{self.count} rays {self.step_rad} rad apart span more than a full turn")
        if not 0.0 < self.range_m <= MAX_RANGE_M:
            raise InvalidScan("range", f"{self.range_m} is not above 0 and at most {MAX_RANGE_M:g} m")

    @lazy_property
    def angles(self) -> Floats:
        """Angles of the rays [rad]."""
        return self.first_rad + self.step_rad * np.arange(self.count, dtype=np.float64)

    @lazy_property
    def rays(self) -> tuple[Floats, Floats]:
        """Cosines and sines of the rays."""
        return np.cos(self.angles), np.sin(self.angles)
