"""Laser scanners of a robot that speaks ROS 2, as its senses."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from robocorba.errors.robots import AdaptorFailed
from robocorba.errors.sensing import InvalidScan
from robocorba.robot.senses import FROZEN_S, Ranges, RangeSensor, Reading, Senses
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import Mount, ScanSpec


def seconds_of(stamp: Any) -> float:
    """A builtin_interfaces/Time [s]."""
    return float(stamp.sec + stamp.nanosec / 1e9)


class Lasers(Senses):
    """The sensors of LaserScan messages, whose first ones say what they are. mounts: where they are, by topic; they are
    called `laser`, `laser_2`, ..."""

    def __init__(self, mounts: Mapping[str, Mount]) -> None:
        numbered = enumerate(mounts.items(), 1)
        self._mounts = {f"laser_{number}" if number > 1 else "laser": each for number, each in numbered}
        self._sensors: dict[str, RangeSensor] = {}
        #: By sensor: its last measurement, and when it arrived [s]; and why there is none.
        self._latest: dict[str, tuple[Ranges, float]] = {}
        self._problems: dict[str, str] = {}

    def receivers(self) -> dict[str, Callable[[Any], None]]:
        """By topic: what takes its messages."""
        return {topic: partial(self._note, name) for name, (topic, _) in self._mounts.items()}

    @property
    def missing(self) -> list[str]:
        """Topics of which no scan has come that can be, and why."""
        silent = [
            (topic, self._problems.get(name)) for name, (topic, _) in self._mounts.items() if name not in self._latest
        ]
        return [f"{topic} ({why})" if why else topic for topic, why in silent]

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return [self._sensors[name] for name in self._mounts]

    def ranges(self, name: str) -> Ranges:
        """Also raises AdaptorFailed after FROZEN_S without a scan."""
        self.sensor(name)
        found, arrived_at = self._latest[name]
        if (silent_s := time.monotonic() - arrived_at) > FROZEN_S:
            raise AdaptorFailed(f"{name} has measured nothing for {silent_s:.1f} s")
        return found

    def readings(self) -> Sequence[Reading]:
        return ()

    def _note(self, name: str, scan: Any) -> None:
        distances, least_m = np.array(scan.ranges, float), float(scan.range_min)
        first, step = float(scan.angle_min), float(scan.angle_increment)
        if step < 0:  # mounted upside down
            first, step, distances = first + step * (len(distances) - 1), -step, distances[::-1]
        if name not in self._sensors:
            try:
                spec = ScanSpec(Fan(first, step, len(distances), float(scan.range_max)))
            except InvalidScan as error:
                self._problems[name] = str(error)
                return
            self._sensors[name] = RangeSensor(name, self._mounts[name][1], spec)
        fan = self._sensors[name].spec.fan
        # REP 117: -inf is too close to measure, inf no echo; nan, and what is below the least, are no measurement.
        distances = np.where(np.isneginf(distances), least_m, distances)
        distances = np.where(distances >= least_m, np.minimum(distances, fan.range_m), fan.range_m)
        rays = np.full(fan.count, fan.range_m)  # some scanners send a ray more or less
        rays[: len(distances)] = distances[: fan.count]
        self._latest[name] = Ranges(seconds_of(scan.header.stamp), rays), time.monotonic()
