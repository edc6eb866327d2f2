"""Joints for tests."""

from __future__ import annotations

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.smartpal import JOINT_LOWER, JOINT_UPPER, JOINTS

HOME = np.zeros(len(JOINTS))


def at(**degrees: float) -> Floats:
    """Zero angles but for those named."""
    joints = HOME.copy()
    for name, angle in degrees.items():
        joints[JOINTS.index(name)] = np.radians(angle)
    return joints


def within_limits(joints: Floats) -> bool:
    return np.allclose(joints, np.clip(joints, JOINT_LOWER, JOINT_UPPER), rtol=0.0, atol=1e-9)


def anywhere(count: int, seed: int) -> Floats:
    """Random joints (count, 18) within limits."""
    return np.random.default_rng(seed).uniform(JOINT_LOWER, JOINT_UPPER, (count, len(JOINTS)))
