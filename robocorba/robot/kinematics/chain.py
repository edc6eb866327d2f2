"""Compiled kinematics of both arms on the lumbar: poses of the hands, and joints that bring the hands to target poses.

A joint is a line at zero angles: a point and a direction. Turning about these lines one after the other, starting with
the lumbar, moves a hand from its pose at zero angles to its present pose (product of exponentials).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.robot.kinematics.model import links
from robocorba.robot.kinematics.pose import rotation_of
from robocorba.robot.kinematics.smartpal import ARM, JOINTS, LUMBAR, Side
from robocorba.system.kernels import inner_kernel, kernel

#: Weight of a rotation in the error: one radian counts as this distance [m].
ROTATION_WEIGHT_M = 0.3
#: Error at which `solve_pose` ends [m], far below the accuracy of a robot, so that equal requests have equal answers.
TOLERANCE_M = 1e-6


class Chains(NamedTuple):
    """The kinematic chains of both hands, left first.

    order (2, 9): the joints that move each hand, the lumbar's first. anchors, axes (18, 3): points and directions of
    all joints' lines. positions (2, 3), attitudes (2, 3, 3): the hands at zero angles."""

    order: Longs
    anchors: Floats
    axes: Floats
    positions: Floats
    attitudes: Floats


def chains() -> Chains:
    """The chains of SmartPal."""
    anchors, axes = np.zeros((2, len(JOINTS), 3))
    origins = {"": np.zeros(3)}
    hands: dict[str, tuple[Floats, Floats]] = {}
    for link in links():
        origin = origins[link.name] = origins[link.parent] + link.at
        for joint in link.joints:
            anchors[joint.number], axes[joint.number] = origin + joint.at, joint.axis
        hands |= {mount.name: (origin + mount.at, rotation_of(mount.attitude)) for mount in link.mounts}
    rows = np.arange(len(JOINTS))
    order = np.array([[*rows[LUMBAR], *rows[ARM[side]]] for side in Side])
    positions, attitudes = zip(*(hands[f"{side.value}_hand"] for side in Side), strict=True)
    return Chains(order, anchors, axes, np.array(positions), np.array(attitudes))


@kernel
def locate(chains: Chains, hand: int, joints: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """Position (3,) [m] and rotation (3, 3) of a hand. `lines` (9, 6) is an output: present
    direction and a point of each of its joints."""
    turn, shift, rotation = np.zeros((3, 3)), np.zeros(3), np.empty((3, 3))
    turn[0, 0] = turn[1, 1] = turn[2, 2] = 1.0
    for i in range(chains.order.shape[1]):
        joint = chains.order[hand, i]
        direction, anchor = _turned(turn, chains.axes[joint]), _turned(turn, chains.anchors[joint])
        for k in range(3):
            anchor[k] += shift[k]
            lines[i, k], lines[i, 3 + k] = direction[k], anchor[k]
        # The rotation about the joint's axis (Rodrigues' formula).
        a, b, c = chains.axes[joint]
        s, v = math.sin(joints[joint]), 1.0 - math.cos(joints[joint])
        rotation[0, 0], rotation[0, 1], rotation[0, 2] = 1 - v * (b * b + c * c), v * a * b - s * c, v * a * c + s * b
        rotation[1, 0], rotation[1, 1], rotation[1, 2] = v * a * b + s * c, 1 - v * (a * a + c * c), v * b * c - s * a
        rotation[2, 0], rotation[2, 1], rotation[2, 2] = v * a * c - s * b, v * b * c + s * a, 1 - v * (a * a + b * b)
        turn = _product(turn, rotation)
        offset = _turned(turn, chains.anchors[joint])
        for k in range(3):
            shift[k] = anchor[k] - offset[k]
    position = _turned(turn, chains.positions[hand])
    for k in range(3):
        position[k] += shift[k]
    return position, _product(turn, chains.attitudes[hand])


@kernel
def solve_pose(
    chains: Chains,
    joints: Floats,
    positions: Floats,
    attitudes: Floats,
    weights: Floats,
    free: Longs,
    lower: Floats,
    upper: Floats,
    comfort: Floats,
) -> float:
    """Move the `free` ones of `joints` (18,) in place, within their limits, until the hands are at `positions` (2, 3)
    with `attitudes` (2, 3, 3). Returns the remaining error [m]; below TOLERANCE_M the targets are reached.

    weights (2, 2): of each hand's position and attitude, 0 for what is not constrained, 1 for a position,
    ROTATION_WEIGHT_M for an attitude.

    Damped least squares (Levenberg-Marquardt) whose damping is half of the squared error plus a bias, after Sugihara,
    "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE Transactions on Robotics 27
    (2011); the bias is ours. The null space is pulled towards the posture `comfort`, so that the elbow of a stationary
    hand does not drift: by 0.2 of the distance for each metre of error, up to 1 m. With a stronger pull hands would
    miss poses that only uncomfortable postures reach. A seed is abandoned after 60 iterations, or eight that do not
    reduce the error by a tenth; none turns a joint by more than 0.6 rad."""
    count, max_step_rad = len(free), 0.6
    error, jacobian = np.zeros(12), np.zeros((12, count))
    min_step, max_step, pull = np.empty(count), np.empty(count), np.empty(count)
    best, steps_without_progress, residual = np.inf, 0, np.inf
    for _ in range(60):
        for hand in range(2):
            if weights[hand, 0] or weights[hand, 1]:
                at = slice(6 * hand, 6 * hand + 6)
                _linearise(chains, hand, joints, positions, attitudes, weights, free, error[at], jacobian[at])
        square = 0.0
        for k in range(12):
            square += error[k] * error[k]
        residual = math.sqrt(square)
        if residual < TOLERANCE_M or not math.isfinite(residual):  # not if a joint of the seed is no number
            break
        steps_without_progress += 1
        if residual < 0.9 * best:
            best, steps_without_progress = residual, 0
        if steps_without_progress > 8:
            break
        damping = 0.5 * residual * residual + 1e-8
        for i in range(count):
            joint = free[i]
            min_step[i], max_step[i] = lower[joint] - joints[joint], upper[joint] - joints[joint]
            pull[i] = 0.2 * min(residual, 1.0) * (comfort[joint] - joints[joint])
        step = _step(jacobian, error, damping, pull, min_step, max_step)
        longest = max_step_rad
        for i in range(count):
            longest = max(longest, abs(step[i]))
        for i in range(count):
            joints[free[i]] += step[i] * max_step_rad / longest
    return residual


@inner_kernel
def _linearise(
    chains: Chains,
    hand: int,
    joints: Floats,
    goals: Floats,
    goal_attitudes: Floats,
    weights: Floats,
    free: Longs,
    error: Floats,
    jacobian: Floats,
) -> None:
    """Set error (6,), a hand's displacement to its goal and rotation vector to its attitude, and jacobian (6, free),
    how the hand moves and turns with each free joint, both weighted."""
    order, lines = chains.order[hand], np.empty((chains.order.shape[1], 6))
    at, attitude = locate(chains, hand, joints, lines)
    move, turn_weight = weights[hand]
    turn = _product(goal_attitudes[hand], attitude.T)
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    sine, cosine = math.sqrt(x * x + y * y + z * z), turn[0, 0] + turn[1, 1] + turn[2, 2] - 1.0
    scale = 0.5 if sine < 1e-9 else math.atan2(sine, cosine) / sine
    if sine < 1e-6 and cosine < 0.0:  # half a turn: the axis is a nonzero column of turn + 1
        k = 0 if turn[0, 0] >= max(turn[1, 1], turn[2, 2]) else 1 if turn[1, 1] >= turn[2, 2] else 2
        x, y, z = turn[0, k], turn[1, k], turn[2, k]
        x, y, z = (x + 1.0, y, z) if k == 0 else (x, y + 1.0, z) if k == 1 else (x, y, z + 1.0)
        scale = math.pi / math.sqrt(x * x + y * y + z * z)
    for i in range(3):
        error[i] = move * (goals[hand, i] - at[i])
    error[3], error[4], error[5] = turn_weight * scale * x, turn_weight * scale * y, turn_weight * scale * z
    for i in range(len(free)):
        for j in range(len(order)):
            if order[j] == free[i]:
                a, b, c = lines[j, 0], lines[j, 1], lines[j, 2]
                x, y, z = at[0] - lines[j, 3], at[1] - lines[j, 4], at[2] - lines[j, 5]
                jacobian[0, i], jacobian[3, i] = move * (b * z - c * y), turn_weight * a
                jacobian[1, i], jacobian[4, i] = move * (c * x - a * z), turn_weight * b
                jacobian[2, i], jacobian[5, i] = move * (a * y - b * x), turn_weight * c


@inner_kernel
def _step(jacobian: Floats, error: Floats, damping: float, pull: Floats, min_step: Floats, max_step: Floats) -> Floats:
    """The step between `min_step` and `max_step` that reduces the error most, and approaches `pull` in the null space.
    A joint that reaches its limit stays there, and the others compensate."""
    count, rows = len(pull), len(error)
    normal, wanted = np.empty((count, count)), np.empty(count)
    for i in range(count):
        wanted[i] = damping * pull[i]
        for k in range(rows):
            wanted[i] += jacobian[k, i] * error[k]
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(rows):
                total += jacobian[k, i] * jacobian[k, j]
            normal[i, j] = normal[j, i] = total
    step, stopped, beyond = np.empty(count), np.zeros(count, np.bool_), True
    while beyond:  # at most once for each joint, and once more
        _solve(normal, wanted, step)
        beyond = False
        for i in range(count):
            if not stopped[i] and (step[i] < min_step[i] or step[i] > max_step[i]):
                step[i] = min(max(step[i], min_step[i]), max_step[i])
                stopped[i] = beyond = True
                for j in range(count):
                    if j != i:
                        wanted[j] -= normal[j, i] * step[i]
                        normal[i, j] = normal[j, i] = 0.0
                normal[i, i], wanted[i] = 1.0, step[i]
    return step


@inner_kernel
def _solve(matrix: Floats, right: Floats, solution: Floats) -> None:
    """Set `solution` (n,) so that a symmetric, positive definite matrix times it is `right` (Cholesky). LAPACK takes as
    long, and its interface to Python compiles for longer than the rest of this module."""
    count = len(right)
    lower = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(total) if i == j else total / lower[j, j]
    for i in range(count):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * solution[k]
        solution[i] = total / lower[i, i]
    for back in range(count):
        i = count - 1 - back
        total = solution[i]
        for k in range(i + 1, count):
            total -= lower[k, i] * solution[k]
        solution[i] = total / lower[i, i]


@inner_kernel
def _turned(turn: Floats, vector: Floats) -> Floats:
    x, y, z = vector
    found = np.empty(3)
    for i in range(3):
        found[i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
    return found


@inner_kernel
def _product(one: Floats, other: Floats) -> Floats:
    """Product of two matrices (3, 3); BLAS would take ten times as long."""
    found = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            found[i, j] = one[i, 0] * other[0, j] + one[i, 1] * other[1, j] + one[i, 2] * other[2, j]
    return found
