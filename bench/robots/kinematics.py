"""Inverse kinematics for random reachable poses of each arm, compared with mink and daqp from the same seeds.

Reachable poses are those of random joint angles within limits. Every solve starts from hanging arms. A solution counts
if forward kinematics finds the hand within 1 mm and half a degree, and the joints are within their limits.

python -m bench.robots.kinematics
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mink
import mujoco
import numpy as np

from bench.common.harness import run
from robocorba.errors.robots import Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.mujoco_headless import specification
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import ARM, JOINT_LOWER, JOINT_UPPER, JOINTS, Side
from testkit.report import at_least, at_most, summarize, summary, timed_ms

POSES = 1000
NEAR_M, NEAR_RAD = 1e-3, math.radians(0.5)
#: Number of poses for the slow peer, and most steps from each seed.
FEW, PEER_STEPS = 200, 60
HOME = np.zeros(len(JOINTS))

Solve = Callable[[HandPose], Floats | None]


def postures(body: SmartPalBody, side: Side, count: int, are_clear: bool) -> list[Floats]:
    """Random joint angles of an arm, with the other arm hanging. are_clear: only postures without collisions."""
    chance = np.random.default_rng(17)
    found: list[Floats] = []
    while len(found) < count:
        joints = HOME.copy()
        joints[ARM[side]] = chance.uniform(JOINT_LOWER[ARM[side]], JOINT_UPPER[ARM[side]])
        if not are_clear or not body.collisions(joints):
            found.append(joints)
    return found


def ours(inverse: InverseKinematics, side: Side, avoid_collisions: bool) -> Solve:
    def solve(target: HandPose) -> Floats | None:
        try:
            return inverse.solve({side: target}, HOME, avoid_collisions=avoid_collisions)
        except Unreachable:
            return None

    return solve


def by_mink(inverse: InverseKinematics, side: Side) -> Solve:
    """Solves with mink on a model in which only this arm moves: full steps until the hand is near or gets no nearer,
    then the next seed."""
    spec = specification()
    names = JOINTS[ARM[side]]
    for joint in spec.joints:
        if joint.name not in names:
            spec.delete(joint)
    configuration = mink.Configuration(spec.compile())
    task = mink.FrameTask(f"{side.value}_hand", "site", position_cost=1.0, orientation_cost=0.3, lm_damping=0.1)
    limits = [mink.ConfigurationLimit(configuration.model)]
    seeds = [HOME[ARM[side]], *inverse.restarts[:, ARM[side]]]

    def solve(target: HandPose) -> Floats | None:
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, target.rotation.ravel())
        task.set_target(mink.SE3(np.concatenate([turn, target.position])))
        for seed in seeds:
            configuration.update(seed.copy())
            least, waited = math.inf, 0
            for _ in range(PEER_STEPS):
                error = task.compute_error(configuration)
                way, turned = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
                if way < NEAR_M / 2 and turned < NEAR_RAD / 2:
                    return np.concatenate([HOME[: ARM[side].start], configuration.q, HOME[ARM[side].stop :]])
                left = float(np.hypot(way, 0.3 * turned))
                least, waited = (left, 0) if left < 0.9 * least else (least, waited + 1)
                if waited > 8:
                    break
                try:
                    configuration.integrate_inplace(
                        mink.solve_ik(configuration, [task], 1.0, "daqp", 1e-6, limits=limits), 1.0
                    )
                except mink.NoSolutionFound:
                    break
        return None

    return solve


def is_solved(body: SmartPalBody, side: Side, target: HandPose, found: Floats | None) -> bool:
    if found is None:
        return False
    way, turn = body.hand(side, found).distance(target)
    is_within = np.all((found >= JOINT_LOWER - 1e-9) & (found <= JOINT_UPPER + 1e-9))
    return bool(way < NEAR_M and turn < NEAR_RAD and is_within)


def main() -> bool:
    body, inverse = SmartPalBody(), InverseKinematics()
    rows: list[dict[str, Any]] = []
    times, marks = {}, []
    for side in Side:
        anywhere = postures(body, side, POSES, False)
        for by, solve, truth in (
            ("ours", ours(inverse, side, False), anywhere),
            ("ours, clear of the body", ours(inverse, side, True), postures(body, side, POSES, True)),
            ("mink + daqp", by_mink(inverse, side), anywhere[:FEW]),
        ):
            targets = [body.hand(side, joints) for joints in truth]
            solve(targets[0])
            answers = [timed_ms(solve, target) for target in targets]
            times[f"{side.value} arm, {by}"] = ms = [took for _, took in answers]
            solved = [is_solved(body, side, target, found) for target, (found, _) in zip(targets, answers, strict=True)]
            row = {"arm": side.value, "by": by, "poses": len(truth), "solved": sum(solved) / len(truth)}
            rows.append({**row, **summary(ms, "median ms", "p99 ms", "worst ms")})
            if by.startswith("ours"):
                marks.append(at_least(f"{side.value} arm, {by}: share solved", rows[-1]["solved"], 0.99))
                marks.append(at_most(f"{side.value} arm, {by}: median ms", rows[-1]["median ms"], 1.0))
    title = f"inverse kinematics, {POSES:,} random reachable poses an arm"
    return summarize("kinematics", title, rows, marks, times, "ms")


if __name__ == "__main__":
    run(main)
