"""Inverse kinematics: which joints bring the hands where they shall be.

Our own damped least squares in compiled functions (`chain.py`), started again from other postures where one leads
nowhere. mink on MuJoCo solves as many poses from the same seeds, but takes each step through Python objects and a
solver of quadratic programs: more than ten times as long altogether (bench/robots/kinematics.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from robocorba.errors.robots import Unreachable
from robocorba.kinematics.body import Body
from robocorba.kinematics.chain import NEAR, TURN_M, chains_of, pull
from robocorba.kinematics.pose import HandPose
from robocorba.kinematics.smartpal import ARM, JOINTS, LOWER, LUMBAR, UPPER, Side
from robocorba.spatial.grids import Floats, Longs

#: An arm at ease (7,), rad: the elbow bent and a little aside, the wrist in the middle of its range.
EASE = np.radians((5, -10, 0, 75, 0, 14, -10))
#: Postures to start from, after the seed; always the same ones, so that what is asked twice is answered alike.
MOST_RESTARTS = 60
_SIDES = tuple(Side)


class InverseKinematics:
    """Joints (18,) for hands of one robot. What the hands leave open stays near the seed's posture, pulled a little
    towards arms at ease.

    Of every method: `seed` (18,) are the joints to start from, best those of now; joints that need not move keep their
    angles. With `lumbar_helps` the trunk may move, and takes an arm that was not asked for along. With `keeps_clear`
    no two links run into each other in the answer. With `leaps` other seeds are tried after the given one, which may
    lead to quite another posture; without, the answer follows from the seed, for a hand that is led along a line.
    Raises Unreachable, which says how much is left. Like its body, one thread uses it."""

    def __init__(self, body: Body | None = None) -> None:
        self.body = body or Body()
        self._chains = chains_of(self.body.model)
        self._comfort = np.zeros(len(JOINTS))
        for side in Side:
            self._comfort[ARM[side]] = EASE
        spread = np.random.default_rng(1).uniform(LOWER, UPPER, (MOST_RESTARTS - 1, len(JOINTS)))
        spread[::2, ARM[Side.RIGHT]] = spread[::2, ARM[Side.LEFT]]  # what two hands do is often symmetrical
        self.restarts = np.vstack([self._comfort, spread])
        self._solve({}, 0.0, self._comfort, False, False, False)  # compiles, so that no solve has to wait for it

    def solve(
        self,
        side: Side,
        target: HandPose,
        seed: Floats,
        *,
        lumbar_helps: bool = False,
        keeps_clear: bool = True,
        leaps: bool = True,
    ) -> Floats:
        """One hand at a pose."""
        return self._solve({side: target}, 1.0, seed, lumbar_helps, keeps_clear, leaps)

    def solve_position(
        self,
        side: Side,
        target: HandPose,
        seed: Floats,
        *,
        lumbar_helps: bool = False,
        keeps_clear: bool = True,
        leaps: bool = True,
    ) -> Floats:
        """One hand at the position of `target`, turned as it comes."""
        return self._solve({side: target}, 0.0, seed, lumbar_helps, keeps_clear, leaps)

    def solve_both(
        self,
        left: HandPose,
        right: HandPose,
        seed: Floats,
        *,
        lumbar_helps: bool = False,
        keeps_clear: bool = True,
        leaps: bool = True,
    ) -> Floats:
        """Both hands at once."""
        return self._solve({Side.LEFT: left, Side.RIGHT: right}, 1.0, seed, lumbar_helps, keeps_clear, leaps)

    def _solve(
        self,
        goals: Mapping[Side, HandPose],
        turns_count: float,
        seed: Floats,
        lumbar_helps: bool,
        keeps_clear: bool,
        leaps: bool,
    ) -> Floats:
        places, attitudes, weights = np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((2, 2))
        free = list(range(len(JOINTS)))[LUMBAR] if lumbar_helps else []
        for side, goal in goals.items():
            if not all(map(math.isfinite, goal)):
                raise Unreachable(side.value, f"{tuple(goal)} is no pose")
            hand = _SIDES.index(side)
            places[hand], attitudes[hand], weights[hand] = goal.position, goal.rotation, (1.0, turns_count * TURN_M)
            free += range(len(JOINTS))[ARM[side]]
        moves = np.array(free, np.int64)

        best, least, in_the_way = seed, math.inf, ""
        for joints in self._seeds(seed, moves, leaps):
            left = pull(self._chains, joints, places, attitudes, weights, moves, LOWER, UPPER, self._comfort)
            if left < NEAR:
                touching = self.body.collisions(joints) if keeps_clear else []
                if not touching:
                    return joints
                in_the_way = " and ".join(touching[0])
            if left < least:
                best, least = joints, left
        raise self._unreachable(goals, turns_count > 0, best, in_the_way)

    def _seeds(self, seed: Floats, moves: Longs, leaps: bool) -> Iterator[Floats]:
        """Joints to start from, within limits where they may move."""
        joints = np.array(seed, float)
        joints[moves] = np.clip(joints[moves], LOWER[moves], UPPER[moves])
        yield joints.copy()
        for restart in self.restarts if leaps else ():
            joints[moves] = restart[moves]
            yield joints.copy()

    def _unreachable(
        self, goals: Mapping[Side, HandPose], turns_count: bool, joints: Floats, in_the_way: str
    ) -> Unreachable:
        """Names the hand that has the longer way left."""
        left = {side: self.body.hand(side, joints).distance(goal) for side, goal in goals.items()}
        side = max(left, key=lambda side: left[side])
        if in_the_way:
            return Unreachable(side.value, f"it gets there only where {in_the_way} run into each other")
        way_m, turn = left[side]
        also = f" and {math.degrees(turn):.1f} deg" if turns_count else ""
        return Unreachable(side.value, f"{way_m:.3f} m{also} are left at the nearest")
