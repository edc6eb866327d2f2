"""Scans of a robot's range sensors, placed on the floor by the robot's pose at their time."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame, out_of
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.senses import RangeSensor, Senses


class Scan(NamedTuple):
    """Rays of a sensor, in the robot's frame or placed on the floor.

    time: by the robot's clock [s]. robot: its pose in that frame. start: where the rays cross the sensor [m]. ends:
    (n, 2) [m]. is_hit: (n,) whether a ray had an echo there; else it ends at the sensor's range. deviations_m: (n,)
    standard deviations of their lengths."""

    time: float
    robot: Frame
    start: XY
    ends: Floats
    is_hit: npt.NDArray[np.bool_]
    deviations_m: Floats

    def placed(self, robot: Frame) -> Scan:
        """A scan in the robot's frame, on the floor where the robot has this pose."""
        c, s = math.cos(robot[2]), math.sin(robot[2])
        ends = self.ends @ np.array([[c, s], [-s, c]]) + robot[:2]
        return self._replace(robot=robot, start=out_of(*self.start, robot), ends=ends)


def read_scan(senses: Senses, sensor: RangeSensor, carried: BaseGeometry | None) -> Scan:
    """A new scan in the robot's frame, without rays that end in what it carries. Raises UnknownSensor, AdaptorFailed,
    RobotLost."""
    asked_at = time.monotonic()
    found = senses.ranges(sensor.name)
    took_s = time.monotonic() - asked_at  # some robots' clock is that of arrival here
    mount, spec = sensor.mount, sensor.spec
    is_hit = found.distances < spec.fan.range_m
    lengths, angles = found.distances + spec.rim_m, spec.fan.angles + mount.heading
    ahead, left = mount.ahead_m + lengths * np.cos(angles), mount.left_m + lengths * np.sin(angles)
    ends, deviations_m = np.column_stack((ahead, left)), spec.noise.sigma_m + spec.noise.relative * found.distances
    kept = ~(is_hit & shapely.contains_xy(carried, ahead, left)) if carried is not None else np.ones(len(ends), bool)
    start = mount.ahead_m, mount.left_m
    return Scan(found.time - took_s, (0.0, 0.0, 0.0), start, ends[kept], is_hit[kept], deviations_m[kept])


class PoseTrack:
    """Time and pose of the last control cycles. One thread observes, others ask."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, Frame]] = deque(maxlen=100)

    def observe(self, state: RobotState) -> bool:
        """Add a pose. Returns whether the track begins again: by another clock, or at another place."""
        here, last = (state.x, state.y, state.heading), self._poses[-1] if self._poses else None
        is_elsewhere = last is not None and (state.time < last[0] or math.dist(here[:2], last[1][:2]) > 0.5)
        if is_elsewhere:
            self._poses.clear()
        if last is None or is_elsewhere or state.time > last[0]:
            self._poses.append((state.time, here))
        return is_elsewhere

    def at(self, when: float) -> Frame | None:
        """The pose at a time [s], between those of control cycles; None before the first one."""
        poses = list(self._poses)
        if not poses:
            return None
        later = poses[-1]
        for earlier in reversed(poses):
            if earlier[0] <= when:
                break
            later = earlier
        else:
            return later[1]
        (before_s, (x, y, heading)), (after_s, (to_x, to_y, to_heading)) = earlier, later
        share = min(1.0, (when - before_s) / (after_s - before_s)) if after_s > before_s else 0.0
        turned_rad = math.remainder(to_heading - heading, math.tau)
        return x + share * (to_x - x), y + share * (to_y - y), heading + share * turned_rad
