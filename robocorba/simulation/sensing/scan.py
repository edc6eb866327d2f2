"""What is asked of a virtual sensor, and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from robocorba.errors.sensing import InvalidScan
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose
from robocorba.simulation.robot_scans import RobotScan
from robocorba.simulation.sensing.fan import MAX_RANGE_M, Fan
from robocorba.system.lazy_property import lazy_property


@dataclass(frozen=True)
class Noise:
    """Noise model: a distance d reads d plus a normal error of deviation `sigma_m` + `relative` x d, within [0, range].
    A share `lost` of the rays gets no echo and reads the range [m]. Raises InvalidScan."""

    sigma_m: float = 0.0
    relative: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        for field, value, maximum in (
            ("sigma", self.sigma_m, 10.0),
            ("relative", self.relative, 1.0),
            ("lost", self.lost, 1.0),
        ):
            if not 0.0 <= value <= maximum:  # also refuses NaN
                raise InvalidScan(field, f"{value} is not 0 to {maximum:g}")

    def __bool__(self) -> bool:
        return bool(self.sigma_m or self.relative or self.lost)


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
    noise: Noise = Noise()
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.rim_m <= 100.0:  # also refuses NaN
            raise InvalidScan("rim", f"{self.rim_m} is not 0 to 100 m")
        if self.rim_m + self.fan.range_m > MAX_RANGE_M:
            raise InvalidScan("range", f"ends more than {MAX_RANGE_M:g} m from the sensor")

    @lazy_property
    def frame(self) -> tuple[float, float, float, float]:
        """First angle, step [rad], range and rim [m]."""
        return self.fan.first_rad, self.fan.step_rad, self.fan.range_m, float(self.rim_m)


class RaySensor(NamedTuple):
    """A kind of sensor on robots. is_on_rim: its rays begin at the robot's rim, else at its centre. rays: names of its
    single rays in programs, if they have any, from the first one on."""

    name: str
    fan: Fan
    is_on_rim: bool = False
    rays: tuple[str, ...] = ()

    def spec(self, radius_m: float) -> ScanSpec:
        """What a robot of this radius asks for. Raises InvalidScan."""
        return ScanSpec(self.fan, radius_m if self.is_on_rim else 0.0)


#: The paper's laser range finder at the waist: half a turn ahead, one ray per degree.
LASER = Fan(-math.pi / 2, math.pi / 180, 181, 8.0)
#: The paper's ring of eight proximity sensors around the base.
PROXIMITY = Fan(0.0, math.pi / 4, 8, 1.0)
_RING = ("front", "front_left", "left", "back_left", "back", "back_right", "right", "front_right")
#: All of them, by name. A new one also needs its name in `Sensor` of robot/programs/icons.py, and for clients in other
#: languages an operation in idl/virtual_sensor.idl and its servant.
RAY_SENSORS = {
    sensor.name: sensor for sensor in (RaySensor("laser", LASER), RaySensor("proximity", PROXIMITY, True, _RING))
}


def ray_sensor(name: str) -> RaySensor:
    """The sensor of a name in programs, its own or that of one of its rays."""
    return next(sensor for sensor in RAY_SENSORS.values() if name == sensor.name or name in sensor.rays)


class ScanResult(NamedTuple):
    """Result of a scan: simulated time [s], poses (m, 3) of the sensors, distances (m, rays) [m]."""

    time: float
    sensors: Floats
    distances: Floats


def robot_scan(robot: str, at: Pose, mount: Mount, spec: ScanSpec, result: ScanResult) -> RobotScan:
    """The scan of a robot at a pose, from a result that has one row of distances."""
    distances, hits = result.distances[0], result.distances[0] < spec.fan.range_m
    noise = spec.noise.sigma_m, spec.noise.relative, spec.noise.lost, spec.seed
    return RobotScan(robot, result.time, at, mount, *spec.frame, noise, distances, hits)
