"""Inverse kinematics: joints that bring the hands to given poses.

Damped least squares in compiled functions (`chain.py`), restarted from other postures if they fail. mink on MuJoCo
solves as many poses from the same seeds, but takes more than ten times as long, because each step uses Python objects
and a quadratic programming solver (bench/robots/kinematics.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.chain import ROTATION_WEIGHT_M, TOLERANCE_M, chains, solve_pose
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, JOINT_LOWER, JOINT_UPPER, JOINTS, LUMBAR, Side

#: A comfortable arm (7,) [rad]: the elbow bent and slightly aside, the wrist in the middle of its range.
COMFORTABLE_ARM = np.radians((5, -10, 0, 75, 0, 14, -10))
#: Number of restart postures tried after the seed. They are fixed, so that equal requests have equal answers.
MAX_RESTARTS = 60


class InverseKinematics:
    """Solves for the joints (18,) [rad] of one robot that bring its hands to target poses. Not thread-safe."""

    def __init__(self) -> None:
        self.body = SmartPalBody()
        self._chains = chains()
        self._comfort = np.zeros(len(JOINTS))
        for side in Side:
            self._comfort[ARM[side]] = COMFORTABLE_ARM
        random = np.random.default_rng(1).uniform(JOINT_LOWER, JOINT_UPPER, (MAX_RESTARTS - 1, len(JOINTS)))
        random[::2, ARM[Side.RIGHT]] = random[::2, ARM[Side.LEFT]]  # tasks of two hands are often symmetrical
        self.restarts = np.vstack([self._comfort, random])
        self.solve({}, self._comfort, avoid_collisions=False, allow_restarts=False)  # compiles the kernels

    def solve(
        self,
        targets: Mapping[Side, HandPose],
        seed: Floats,
        *,
        with_attitude: bool = True,
        use_lumbar: bool = False,
        avoid_collisions: bool = True,
        allow_restarts: bool = True,
    ) -> Floats:
        """Joints with one or both hands at their targets. Raises Unreachable with the remaining error.

        seed (18,): the start joints, best the present ones; joints that need not move keep its angles. What the targets
        leave open stays near the seed's posture, pulled slightly towards comfortable arms.
        with_attitude: False for hands at the positions of their targets with any attitude.
        use_lumbar: the trunk may move, which also moves the other arm.
        avoid_collisions: no two links collide in the answer.
        allow_restarts: also try other seeds, which may lead to a very different posture. Without restarts the answer
        follows continuously from the seed, as needed for a straight line."""
        positions, attitudes, weights = np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((2, 2))
        free = list(range(len(JOINTS)))[LUMBAR] if use_lumbar else []
        for hand, side in enumerate(Side):
            if target := targets.get(side):
                if not all(map(math.isfinite, target)):
                    raise Unreachable(side.value, f"{tuple(target)} is no pose")
                positions[hand], attitudes[hand] = target.position, target.rotation
                weights[hand] = 1.0, ROTATION_WEIGHT_M if with_attitude else 0.0
                free += range(len(JOINTS))[ARM[side]]
        moving = np.array(free, np.int64)

        best, smallest, colliding = seed, math.inf, ""
        limits = JOINT_LOWER, JOINT_UPPER
        for joints in self._seeds(seed, moving, allow_restarts):
            error = solve_pose(self._chains, joints, positions, attitudes, weights, moving, *limits, self._comfort)
            if error < TOLERANCE_M:
                collisions = self.body.collisions(joints) if avoid_collisions else []
                if not collisions:
                    return joints
                colliding = " and ".join(collisions[0])
            if error < smallest:
                best, smallest = joints, error
        raise self._unreachable(targets, with_attitude, best, colliding)

    def _seeds(self, seed: Floats, moving: Longs, allow_restarts: bool) -> Iterator[Floats]:
        """Start joints; those that may move are within their limits."""
        joints = np.array(seed, float)
        joints[moving] = np.clip(joints[moving], JOINT_LOWER[moving], JOINT_UPPER[moving])
        yield joints.copy()
        for restart in self.restarts if allow_restarts else ():
            joints[moving] = restart[moving]
            yield joints.copy()

    def _unreachable(
        self, targets: Mapping[Side, HandPose], with_attitude: bool, joints: Floats, colliding: str
    ) -> Unreachable:
        """The error for the hand with the larger remaining distance."""
        errors = {side: self.body.hand(side, joints).distance(target) for side, target in targets.items()}
        side = max(errors, key=lambda side: errors[side])
        if colliding:
            return Unreachable(side.value, f"it gets there only where {colliding} collide")
        distance_m, angle = errors[side]
        also = f" and {math.degrees(angle):.1f} deg" if with_attitude else ""
        return Unreachable(side.value, f"the best posture misses the target by {distance_m:.3f} m{also}")
