"""What stands around the stand-in, which no map needs to have, and what the robot senses of it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame, turned
from robocorba.robot.kinematics.smartpal import RADIUS_M
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses, usual_sensors
from robocorba.robot.smartpal_stand_in.segment import from_frame
from robocorba.simulation.sensing.noise import disturb
from robocorba.simulation.sensing.scan import Noise
from robocorba.simulation.sensing.virtual_sensor import scan_from
from robocorba.simulation.sensing.visible_obstacles import NO_ROBOT, VisibleObstacles, border_segments

if TYPE_CHECKING:  # it loads MuJoCo
    from robocorba.robot.smartpal_stand_in.dynamics import DynamicsState

#: Distance from what the base has touched at which the contact has ended [m]: above what it moves in a step.
PARTING_M = 0.005


class World(Senses):
    """shapes: lines and polygons that stand still. start: where the robot is in it at power-up, whatever its odometry
    is set to later. noise, seed: of the distances."""

    def __init__(
        self,
        shapes: Sequence[BaseGeometry],
        start: Frame = (0.0, 0.0, 0.0),
        noise: Noise = Noise(),  # noqa: B008
        seed: int = 0,
    ) -> None:
        self._start, self._segments = start, border_segments(shapes)
        self._grids = VisibleObstacles(shapes).grids
        self._sensors = [each._replace(spec=replace(each.spec, noise=noise)) for each in usual_sensors()]
        self._seeds = itertools.count(seed)
        #: Time [s] and pose of the last step, replaced together.
        self._now = 0.0, start
        self._is_touching = False
        #: How often the base has begun to touch something.
        self.contacts = 0

    def allowed(self, state: DynamicsState, velocity: Floats) -> Floats:
        """A velocity (3,) of the base in the start frame [m/s, rad/s] without what would move it into something that
        it touches. Called in each step of the dynamics."""
        x, y, heading = state.true_base.tolist()
        at = from_frame(self._start, (x, y, heading))
        self._now = state.time, at
        towards = self._towards(at)
        distances = np.hypot(*towards.T)
        if not self._is_touching and (distances <= RADIUS_M).any():
            self._is_touching = True
            self.contacts += 1
        elif self._is_touching and (distances > RADIUS_M + PARTING_M).all():
            self._is_touching = False
        ahead, left, turn = velocity.tolist()
        vx, vy = turned(ahead, left, self._start[2])
        for (dx, dy), distance in zip(towards, distances, strict=True):
            if distance <= RADIUS_M:
                into = max(0.0, (vx * dx + vy * dy) / max(distance, 1e-9) ** 2)
                vx, vy = vx - into * dx, vy - into * dy
        return np.array([*turned(vx, vy, -self._start[2]), turn])

    def _towards(self, at: Frame) -> Floats:
        """Vectors (n, 2) to the nearest point of each segment [m]."""
        begin, end = self._segments[:, :2], self._segments[:, 2:]
        along = end - begin
        lengths = np.maximum((along * along).sum(axis=1), 1e-18)
        share = np.clip(((np.array(at[:2]) - begin) * along).sum(axis=1) / lengths, 0.0, 1.0)
        return np.asarray(begin + share[:, None] * along - at[:2])

    # ---- the robot's senses ----

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return self._sensors

    def ranges(self, name: str) -> Ranges:
        (_, mount, spec), (time_s, at) = self.sensor(name), self._now
        *_, distances = scan_from(self._grids, np.array([at]), mount, NO_ROBOT, spec.fan.rays, spec.frame)
        if spec.noise:
            distances = disturb(spec.noise, distances, spec.fan.range_m, next(self._seeds), np.zeros(1, np.int64))
        return Ranges(time_s, distances[0])

    def readings(self) -> Sequence[Reading]:
        return [Reading("bumper", "contacts", self._now[0], float(self.contacts))]
