"""What is asked of a virtual sensor, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.sensing import InvalidScan
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.fan import MAX_RANGE_M, Fan
from robocorba.system.lazy_property import lazy_property

#: Maximum distance from the sensor at which the rays start [m].
MAX_RIM_M = 100.0
#: Maximum of Noise.sigma_m [m].
MAX_SIGMA_M = 10.0
#: Maximum of Noise.relative.
MAX_RELATIVE = 1.0


@dataclass(frozen=True)
class Noise:
    """Noise model: a distance d reads d plus a normal error of deviation `sigma_m` + `relative` x d, within [0, range].
    A share `lost` of the rays gets no echo and reads the range [m]. Raises InvalidScan."""

    sigma_m: float = 0.0
    relative: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        for field, value, maximum in (
            ("sigma", self.sigma_m, MAX_SIGMA_M),
            ("relative", self.relative, MAX_RELATIVE),
            ("lost", self.lost, 1.0),
        ):
            if not 0.0 <= value <= maximum:  # also refuses NaN
                raise InvalidScan(field, f"{value} is not 0 to {maximum:g}")

    def __bool__(self) -> bool:
        return bool(self.sigma_m or self.relative or self.lost)


NO_NOISE = Noise()


class Mount(NamedTuple):
    """Pose of a sensor in the robot's frame: ahead, left [m], heading [rad]."""

    ahead_m: float = 0.0
    left_m: float = 0.0
    heading: float = 0.0


@dataclass(frozen=True)
class ScanSpec:
    """Distances along the rays of `fan`, measured from a circle of radius `rim_m` [m] around the sensor,
    with noise from `seed`. Raises InvalidScan."""

    fan: Fan
    rim_m: float = 0.0
    noise: Noise = NO_NOISE
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.rim_m <= MAX_RIM_M:  # also refuses NaN
            raise InvalidScan("rim", f"{self.rim_m} is not 0 to {MAX_RIM_M:g} m")
        if self.rim_m + self.fan.range_m > MAX_RANGE_M:
            raise InvalidScan("range", f"ends more than {MAX_RANGE_M:g} m from the sensor")

    @lazy_property
    def frame(self) -> tuple[float, float, float, float]:
        """First angle, step [rad], range and rim [m]."""
        return self.fan.first_rad, self.fan.step_rad, self.fan.range_m, float(self.rim_m)


class ScanResult(NamedTuple):
    """Result of a scan: simulated time [s], poses (m, 3) of the sensors, distances (m, rays) [m]."""

    time: float
    sensors: Floats
    distances: Floats
