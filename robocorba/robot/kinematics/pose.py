"""Pose of a hand: position and attitude, as six numbers or as a rotation matrix."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats


class HandPose(NamedTuple):
    """Pose of a hand's control point in the robot's frame: x, y, z [m]; roll, pitch, yaw [rad] about x, then y, then
    z of the robot. At zero angles the hand points ahead and its fingers open up and down."""

    x: float
    y: float
    z: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @classmethod
    def of(cls, position: Floats, rotation: Floats) -> HandPose:
        """From a position (3,) [m] and a rotation matrix (3, 3). If the hand points straight up or down, only the
        sum of roll and yaw is defined: roll is 0."""
        pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
        if abs(pitch) > math.pi / 2 - 1e-7:
            roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
        else:
            roll = math.atan2(rotation[2, 1], rotation[2, 2])
            yaw = math.atan2(rotation[1, 0], rotation[0, 0])
        x, y, z = position.tolist()
        return cls(x, y, z, roll, pitch, yaw)

    @property
    def position(self) -> Floats:
        """Position (3,) [m]."""
        return np.array(self[:3])

    @property
    def rotation(self) -> Floats:
        """Rotation matrix (3, 3); its columns are the hand's x, y and z in the robot's frame."""
        cr, cp, cy = (math.cos(angle) for angle in self[3:])
        sr, sp, sy = (math.sin(angle) for angle in self[3:])
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    def distance(self, other: HandPose) -> tuple[float, float]:
        """Distance [m] and rotation angle [rad] to another pose."""
        turn = self.rotation.T @ other.rotation
        sine = math.hypot(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        return math.dist(self[:3], other[:3]), math.atan2(sine, float(np.trace(turn)) - 1.0)

    def moved(self, ahead_m: float) -> HandPose:
        """The pose moved along the direction in which the hand points; negative draws it back."""
        x, y, z = (self.position + ahead_m * self.rotation[:, 0]).tolist()
        return self._replace(x=x, y=y, z=z)

    def mirrored(self) -> HandPose:
        """The pose of the other hand in a posture that mirrors this one."""
        return HandPose(self.x, -self.y, self.z, -self.roll, self.pitch, -self.yaw)


def rotation_of(attitude: Sequence[float]) -> Floats:
    """The rotation matrix (3, 3) of a unit quaternion w, x, y, z."""
    w, x, y, z = attitude
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
