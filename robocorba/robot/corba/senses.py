"""What a robot senses, over CORBA: conversion from and to the IDL, and the client of a RoboCorba::RobotSensors."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from robocorba.errors.robots import AdaptorFailed, RobotLost
from robocorba.errors.sensing import InvalidScan, UnknownSensor
from robocorba.orb.exceptions import register
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.robot.senses import FROZEN_S, Ranges, RangeSensor, Reading, Senses
from robocorba.simulation.corba import scans
from robocorba.stubs import RoboCorba

#: Timeout of a call [s].
CALL_TIMEOUT_S = 0.3


def range_sensor(sensor: RangeSensor) -> Any:
    return RoboCorba.RangeSensor(sensor.name, RoboCorba.Mount(*sensor.mount), scans.spec(sensor.spec))


def range_sensor_of(struct: Any) -> RangeSensor:
    """Raises AdaptorFailed for one that can't be."""
    mount = scans.mount_of(struct.where)
    try:
        if not all(map(math.isfinite, mount)):
            raise InvalidScan("where", f"{tuple(mount)} is not finite")
        return RangeSensor(struct.name, mount, scans.spec_of(struct.spec))
    except InvalidScan as error:
        raise AdaptorFailed(f"its sensor {struct.name[:80]!r} has a {error}") from None


def ranges(seen: Ranges, sensor: RangeSensor) -> Any:
    fan = sensor.spec.fan
    return RoboCorba.ScanData(seen.time, fan.first_rad, fan.step_rad, seen.distances.tolist())


def reading(value: Reading) -> Any:
    return RoboCorba.SensorReading(*value)


def reading_of(struct: Any) -> Reading:
    return Reading(struct.name, struct.unit, struct.time, struct.value)


class RemoteSenses(Senses):
    """Client of the RoboCorba::RobotSensors at a URI. is_clock_ours: times become those of arrival by this process's
    monotonic clock, since the robot's state has no other. Raises AdaptorFailed, RobotLost."""

    def __init__(self, orb: Orb, uri: str, is_clock_ours: bool = False) -> None:
        self._remote = orb.reference(uri, RoboCorba.RobotSensors, CALL_TIMEOUT_S)
        self._is_clock_ours = is_clock_ours
        with translated("the robot's sensors", RobotLost):
            self._sensors = [range_sensor_of(struct) for struct in self._remote.rangeSensors()]
        names = [sensor.name for sensor in self._sensors]
        if twice := [name for name in names if names.count(name) > 1]:
            raise AdaptorFailed(f"it has two sensors {twice[0][:80]!r}")
        #: By sensor: the robot's time of the latest measurement, and when it arrived [s].
        self._arrivals: dict[str, tuple[float, float]] = {}

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return self._sensors

    def ranges(self, name: str) -> Ranges:
        """Also raises AdaptorFailed for distances that can't be, and after FROZEN_S without a new measurement."""
        fan = self.sensor(name).spec.fan
        with translated("the robot's sensors", RobotLost):
            seen = self._remote.ranges(name)
        distances, now = np.array(seen.distances, float), time.monotonic()
        if len(distances) != fan.count or not (distances >= 0.0).all():  # NaN, too
            sent = f"{len(distances)}, the least {distances.min(initial=math.inf)}"
            raise AdaptorFailed(f"{name} must send {fan.count} distances of 0 m or more; it sent {sent}")
        measured_at, arrived_at = self._arrivals.get(name, (None, now))
        if seen.time != measured_at:
            self._arrivals[name], arrived_at = (seen.time, now), now
        if now - arrived_at > FROZEN_S:
            raise AdaptorFailed(f"{name} has measured nothing for {now - arrived_at:.1f} s")
        at = arrived_at if self._is_clock_ours else seen.time
        return Ranges(at, np.minimum(distances, fan.range_m))

    def readings(self) -> Sequence[Reading]:
        with translated("the robot's sensors", RobotLost):
            found = [reading_of(struct) for struct in self._remote.readings()]
        return [each._replace(time=time.monotonic()) if self._is_clock_ours else each for each in found]


register(UnknownSensor, RoboCorba.UnknownSensor, "name", "known")
