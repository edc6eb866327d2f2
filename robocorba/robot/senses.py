"""A robot's own senses: its range sensors, and what else it measures, such as its bumper.

An adaptor offers them as its `senses`. Programs and the control agent ask nothing else: a robot that lacks a sensor
never gets the virtual one of the map in its place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robocorba.errors.sensing import UnknownSensor
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.simulation.sensing.scan import RAY_SENSORS, Mount, ScanSpec, ray_sensor

#: Time without a new measurement after which a sensor has failed [s].
FROZEN_S = 1.0


class RangeSensor(NamedTuple):
    """A sensor of rays. name: as in programs, `laser` or `proximity`; others serve CORBA clients only."""

    name: str
    mount: Mount
    spec: ScanSpec


class Ranges(NamedTuple):
    """A measurement. time: by the robot's clock, as that of its state [s]. distances: (rays,), the sensor's range where
    a ray has no echo [m]."""

    time: float
    distances: Floats


class Reading(NamedTuple):
    """A value of a sensor without rays. time: by the robot's clock [s]. `bumper`, in `contacts`, counts them since the
    robot's start."""

    name: str
    unit: str
    time: float
    value: float


class Senses(ABC):
    """Thread-safe. No call takes longer than a second."""

    @property
    @abstractmethod
    def sensors(self) -> Sequence[RangeSensor]:
        """The range sensors; known once the adaptor has started."""

    @abstractmethod
    def ranges(self, name: str) -> Ranges:
        """The latest measurement of a range sensor. Raises UnknownSensor, AdaptorFailed, RobotLost."""

    @abstractmethod
    def readings(self) -> Sequence[Reading]:
        """The latest values of the other sensors. Raises AdaptorFailed, RobotLost."""

    def sensor(self, name: str) -> RangeSensor:
        """The range sensor of this name. Raises UnknownSensor."""
        for sensor in self.sensors:
            if sensor.name == name:
                return sensor
        raise UnknownSensor(name, [sensor.name for sensor in self.sensors])


def usual_sensors() -> list[RangeSensor]:
    """SmartPal's, as the paper has them: the laser at the waist, the ring of proximity sensors around the base."""
    return [RangeSensor(kind.name, Mount(), kind.spec(RADIUS_M)) for kind in RAY_SENSORS.values()]


def program_ranges_m(senses: Senses | None) -> dict[str, float]:
    """What programs can sense: the range [m] by the sensor's name, its own or that of some of its rays."""
    found = {}
    for sensor in senses.sensors if senses else ():
        if kind := RAY_SENSORS.get(sensor.name):
            names = [name for name in (kind.name, *kind.rays) if _rays(sensor, name).any()]
            found.update(dict.fromkeys(names, sensor.spec.fan.range_m))
    return found


def nearest_m(senses: Senses | None, name: str) -> float:
    """The least distance [m] that a sensor measures, from where its rays begin; its range if it sees nothing. name: in
    programs. Raises UnknownSensor, AdaptorFailed, RobotLost."""
    if senses:
        for sensor in senses.sensors:
            if sensor.name == ray_sensor(name).name and (rays := _rays(sensor, name)).any():
                return float(senses.ranges(sensor.name).distances[rays].min())
    raise UnknownSensor(name, sorted(program_ranges_m(senses)))


def _rays(sensor: RangeSensor, name: str) -> npt.NDArray[np.bool_]:
    """Which rays (rays,) of a sensor belong to a name in programs: all, or those in one of the ring's directions, half
    its step to each side."""
    angles, usual = sensor.spec.fan.angles, ray_sensor(name)
    if name == usual.name:
        return np.ones(len(angles), bool)
    direction = usual.fan.angles[usual.rays.index(name)]
    apart = np.mod(angles + sensor.mount.heading - direction + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.abs(apart) <= usual.fan.step_rad / 2 + 1e-9)
