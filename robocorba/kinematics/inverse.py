"""Inverse kinematics: joints that bring the hands to given poses.

Damped least squares in compiled functions (`chain.py`), restarted from other postures where one fails. mink on
MuJoCo solves as many poses from the same seeds, but takes more than ten times as long, because each step uses Python
objects and a quadratic programming solver (bench/robots/kinematics.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.kinematics.body import SmartPalBody
from robocorba.kinematics.chain import NEAR, TURN_M, chains_of, solve_pose
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, JOINT_LOWER, JOINT_UPPER, JOINTS, LUMBAR, Side
from robocorba.spatial.grids import Floats, Longs

#: A comfortable arm (7,) [rad]: the elbow bent and slightly aside, the wrist in the middle of its range.
COMFORTABLE_ARM = np.radians((5, -10, 0, 75, 0, 14, -10))
#: Number of postures to start from after the seed. They are always the same, so that equal requests have equal answers.
MAX_RESTARTS = 60
_SIDES = tuple(Side)


class InverseKinematics:
    """Joints (18,) for hands of one robot. What the hands leave open stays near the seed's posture, pulled slightly
    towards comfortable arms.

    In all methods `seed` (18,) are the start joints, best the present ones; joints that need not move keep their
    angles. With `use_lumbar` the trunk may move, which also moves the other arm. With `avoid_collisions` no two links
    collide in the answer. With `allow_restarts` the solver also tries other seeds, which may lead to a very different
    posture; without, the answer follows from the seed, as a hand on a straight line needs. Raises Unreachable with
    the remaining error. Not thread-safe."""

    def __init__(self, body: SmartPalBody | None = None) -> None:
        self.body = body or SmartPalBody()
        self._chains = chains_of(self.body.model)
        self._comfort = np.zeros(len(JOINTS))
        for side in Side:
            self._comfort[ARM[side]] = COMFORTABLE_ARM
        spread = np.random.default_rng(1).uniform(JOINT_LOWER, JOINT_UPPER, (MAX_RESTARTS - 1, len(JOINTS)))
        spread[::2, ARM[Side.RIGHT]] = spread[::2, ARM[Side.LEFT]]  # tasks of two hands are often symmetrical
        self.restarts = np.vstack([self._comfort, spread])
        self._solve({}, 0.0, self._comfort, False, False, False)  # compiles the kernels

    def solve(
        self,
        side: Side,
        target: HandPose,
        seed: Floats,
        *,
        use_lumbar: bool = False,
        avoid_collisions: bool = True,
        allow_restarts: bool = True,
    ) -> Floats:
        """Joints for one hand at a pose."""
        return self._solve({side: target}, 1.0, seed, use_lumbar, avoid_collisions, allow_restarts)

    def solve_position(
        self,
        side: Side,
        target: HandPose,
        seed: Floats,
        *,
        use_lumbar: bool = False,
        avoid_collisions: bool = True,
        allow_restarts: bool = True,
    ) -> Floats:
        """Joints for one hand at the position of `target`, with any attitude."""
        return self._solve({side: target}, 0.0, seed, use_lumbar, avoid_collisions, allow_restarts)

    def solve_both(
        self,
        left: HandPose,
        right: HandPose,
        seed: Floats,
        *,
        use_lumbar: bool = False,
        avoid_collisions: bool = True,
        allow_restarts: bool = True,
    ) -> Floats:
        """Joints for both hands simultaneously."""
        return self._solve(
            {Side.LEFT: left, Side.RIGHT: right}, 1.0, seed, use_lumbar, avoid_collisions, allow_restarts
        )

    def _solve(
        self,
        goals: Mapping[Side, HandPose],
        turns_count: float,
        seed: Floats,
        use_lumbar: bool,
        avoid_collisions: bool,
        allow_restarts: bool,
    ) -> Floats:
        places, attitudes, weights = np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((2, 2))
        free = list(range(len(JOINTS)))[LUMBAR] if use_lumbar else []
        for side, goal in goals.items():
            if not all(map(math.isfinite, goal)):
                raise Unreachable(side.value, f"{tuple(goal)} is no pose")
            hand = _SIDES.index(side)
            places[hand], attitudes[hand], weights[hand] = goal.position, goal.rotation, (1.0, turns_count * TURN_M)
            free += range(len(JOINTS))[ARM[side]]
        moving = np.array(free, np.int64)

        best, least, colliding = seed, math.inf, ""
        for joints in self._seeds(seed, moving, allow_restarts):
            left = solve_pose(
                self._chains, joints, places, attitudes, weights, moving, JOINT_LOWER, JOINT_UPPER, self._comfort
            )
            if left < NEAR:
                touching = self.body.collisions(joints) if avoid_collisions else []
                if not touching:
                    return joints
                colliding = " and ".join(touching[0])
            if left < least:
                best, least = joints, left
        raise self._unreachable(goals, turns_count > 0, best, colliding)

    def _seeds(self, seed: Floats, moving: Longs, allow_restarts: bool) -> Iterator[Floats]:
        """Start joints; those that may move are within their limits."""
        joints = np.array(seed, float)
        joints[moving] = np.clip(joints[moving], JOINT_LOWER[moving], JOINT_UPPER[moving])
        yield joints.copy()
        for restart in self.restarts if allow_restarts else ():
            joints[moving] = restart[moving]
            yield joints.copy()

    def _unreachable(
        self, goals: Mapping[Side, HandPose], turns_count: bool, joints: Floats, colliding: str
    ) -> Unreachable:
        """The error for the hand with the larger remaining distance."""
        left = {side: self.body.hand(side, joints).distance(goal) for side, goal in goals.items()}
        side = max(left, key=lambda side: left[side])
        if colliding:
            return Unreachable(side.value, f"it gets there only where {colliding} collide")
        distance_m, turn = left[side]
        also = f" and {math.degrees(turn):.1f} deg" if turns_count else ""
        return Unreachable(side.value, f"the best posture misses the target by {distance_m:.3f} m{also}")
