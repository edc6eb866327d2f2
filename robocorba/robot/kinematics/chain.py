"""Compiled kinematics of both arms on the lumbar: poses of the hands, and joints that bring the hands to target poses.

A joint is a line at zero angles: a point and a direction. Turning about these lines one after the other, starting with
the lumbar, moves a hand from its pose at zero angles to its present pose (product of exponentials).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.robot.kinematics.mujoco_headless import mujoco
from robocorba.robot.kinematics.smartpal import ARM, JOINTS, LUMBAR, Side
from robocorba.system.kernels import kernel

#: Weight of a rotation in the error: one radian counts as this distance [m].
ROTATION_WEIGHT_M = 0.3
#: Error at which `solve_pose` ends [m], far below the accuracy of a robot, so that equal requests have equal answers.
TOLERANCE_M = 1e-6
_MAX_ITERATIONS = 60
#: Maximum change of a joint in one iteration [rad].
_MAX_STEP_RAD = 0.6
#: Damping of the least squares for each square metre of squared error, and its minimum.
_DAMPING, _MIN_DAMPING = 0.5, 1e-8
#: Pull towards the comfortable posture, for each metre of error: the fraction of the distance to it that is added to a
#: step. With a stronger pull hands would miss poses that only uncomfortable postures reach.
_COMFORT_PER_M = 0.2
#: Number of steps after which a seed is abandoned if they do not reduce the error by a tenth.
_PATIENCE = 8


class Chains(NamedTuple):
    """The kinematic chains of both hands, left first.

    order (2, 9): the joints that move each hand, the lumbar's first. anchors, axes (18, 3): points and directions of
    all joints' lines. positions (2, 3), attitudes (2, 3, 3): the hands at zero angles."""

    order: Longs
    anchors: Floats
    axes: Floats
    positions: Floats
    attitudes: Floats


def chains_of(model: mujoco.MjModel) -> Chains:
    """The chains of a model of `model.specification`."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    hands = [data.site(f"{side.value}_hand") for side in Side]
    rows = np.arange(len(JOINTS))
    return Chains(
        np.array([[*rows[LUMBAR], *rows[ARM[side]]] for side in Side]),
        np.array([data.joint(name).xanchor for name in JOINTS]),
        np.array([data.joint(name).xaxis for name in JOINTS]),
        np.array([hand.xpos for hand in hands]),
        np.array([hand.xmat.reshape(3, 3) for hand in hands]),
    )


@kernel
def locate(chains: Chains, hand: int, joints: Floats, lines: Floats) -> tuple[Floats, Floats]:
    """Position (3,) [m] and rotation (3, 3) of a hand. `lines` (9, 6) is an output: present
    direction and a point of each of its joints."""
    turn, shift = _rotation(np.zeros(3), 0.0), np.zeros(3)  # identity
    for i in range(chains.order.shape[1]):
        joint = chains.order[hand, i]
        direction = _turned(turn, chains.axes[joint])
        anchor = _turned(turn, chains.anchors[joint]) + shift
        for k in range(3):
            lines[i, k], lines[i, 3 + k] = direction[k], anchor[k]
        turn = _product(turn, _rotation(chains.axes[joint], joints[joint]))
        shift = anchor - _turned(turn, chains.anchors[joint])
    return _turned(turn, chains.positions[hand]) + shift, _product(turn, chains.attitudes[hand])


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

    Damped least squares with damping proportional to the square of the error (Sugihara 2011). The null space is
    pulled towards the posture `comfort`, in proportion to the error, so that the elbow of a stationary hand does not
    drift."""
    count = len(free)
    error, jacobian = np.zeros(12), np.zeros((12, count))
    lines = np.zeros((chains.order.shape[1], 6))
    min_step, max_step, pull = np.empty(count), np.empty(count), np.empty(count)
    best, steps_without_progress, residual = np.inf, 0, np.inf
    for _ in range(_MAX_ITERATIONS):
        for hand in range(2):
            if weights[hand, 0] or weights[hand, 1]:
                position, attitude = locate(chains, hand, joints, lines)
                _pose_error(position, attitude, positions[hand], attitudes[hand], weights[hand], error[6 * hand :])
                _fill_jacobian(chains.order[hand], lines, position, weights[hand], free, jacobian[6 * hand :])
        residual = math.sqrt((error * error).sum())
        if residual < TOLERANCE_M:
            break
        steps_without_progress += 1
        if residual < 0.9 * best:
            best, steps_without_progress = residual, 0
        if steps_without_progress > _PATIENCE:
            break
        damping = _DAMPING * residual * residual + _MIN_DAMPING
        comforting = _COMFORT_PER_M * min(residual, 1.0)
        for i in range(count):
            joint = free[i]
            min_step[i], max_step[i] = lower[joint] - joints[joint], upper[joint] - joints[joint]
            pull[i] = comforting * (comfort[joint] - joints[joint])
        step = _step(jacobian, error, damping, pull, min_step, max_step)
        longest = _MAX_STEP_RAD
        for i in range(count):
            longest = max(longest, abs(step[i]))
        for i in range(count):
            joints[free[i]] += step[i] * _MAX_STEP_RAD / longest
    return residual


@kernel
def _pose_error(
    position: Floats, attitude: Floats, goal: Floats, goal_attitude: Floats, weight: Floats, error: Floats
) -> None:
    """Set error (6,): displacement to the goal and rotation vector to its attitude, weighted."""
    turn = _product(goal_attitude, attitude.T)
    x, y, z = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    sine, cosine = math.sqrt(x * x + y * y + z * z), turn[0, 0] + turn[1, 1] + turn[2, 2] - 1.0
    scale = 0.5 if sine < 1e-9 else math.atan2(sine, cosine) / sine
    if sine < 1e-6 and cosine < 0.0:  # half a turn: the axis is a nonzero column of turn + 1
        k = 0 if turn[0, 0] >= max(turn[1, 1], turn[2, 2]) else 1 if turn[1, 1] >= turn[2, 2] else 2
        x, y, z = turn[0, k], turn[1, k], turn[2, k]
        x, y, z = (x + 1.0, y, z) if k == 0 else (x, y + 1.0, z) if k == 1 else (x, y, z + 1.0)
        scale = math.pi / math.sqrt(x * x + y * y + z * z)
    for i in range(3):
        error[i] = weight[0] * (goal[i] - position[i])
    error[3], error[4], error[5] = weight[1] * scale * x, weight[1] * scale * y, weight[1] * scale * z


@kernel
def _fill_jacobian(
    order: Longs, lines: Floats, position: Floats, weight: Floats, free: Longs, jacobian: Floats
) -> None:
    """Set jacobian (6, free): how a hand at `position` moves and turns with each free joint, weighted."""
    for i in range(len(free)):
        for j in range(len(order)):
            if order[j] == free[i]:
                a, b, c = lines[j, 0], lines[j, 1], lines[j, 2]
                x, y, z = position[0] - lines[j, 3], position[1] - lines[j, 4], position[2] - lines[j, 5]
                jacobian[0, i], jacobian[3, i] = weight[0] * (b * z - c * y), weight[1] * a
                jacobian[1, i], jacobian[4, i] = weight[0] * (c * x - a * z), weight[1] * b
                jacobian[2, i], jacobian[5, i] = weight[0] * (a * y - b * x), weight[1] * c


@kernel
def _step(jacobian: Floats, error: Floats, damping: float, pull: Floats, min_step: Floats, max_step: Floats) -> Floats:
    """The step between `min_step` and `max_step` that reduces the error most, and approaches `pull` in the null space.
    A joint that reaches its limit stays there, and the others compensate."""
    count, rows = len(pull), len(error)
    normal, wanted = np.empty((count, count)), damping * pull
    for i in range(count):
        for k in range(rows):
            wanted[i] += jacobian[k, i] * error[k]
        for j in range(i + 1):
            total = damping if i == j else 0.0
            for k in range(rows):
                total += jacobian[k, i] * jacobian[k, j]
            normal[i, j] = normal[j, i] = total
    step = _solved(normal, wanted)
    stopped = np.zeros(count, np.bool_)
    for _ in range(count):
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
        if not beyond:
            break
        step = _solved(normal, wanted)
    return step


@kernel
def _solved(matrix: Floats, right: Floats) -> Floats:
    """x of matrix x = right, for a symmetric positive matrix (Cholesky); LAPACK is slower for such small ones."""
    count = len(right)
    root, x = np.zeros((count, count)), np.empty(count)
    for i in range(count):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(max(total, 1e-18)) if i == j else total / root[j, j]
    for i in range(count):
        total = right[i]
        for k in range(i):
            total -= root[i, k] * x[k]
        x[i] = total / root[i, i]
    for i in range(count - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, count):
            total -= root[k, i] * x[k]
        x[i] = total / root[i, i]
    return x


@kernel
def _rotation(axis: Floats, angle: float) -> Floats:
    """Rotation matrix (3, 3) by an angle about an axis (Rodrigues)."""
    a, b, c = axis
    s, v = math.sin(angle), 1.0 - math.cos(angle)
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - v * (b * b + c * c), v * a * b - s * c, v * a * c + s * b
    turn[1, 0], turn[1, 1], turn[1, 2] = v * a * b + s * c, 1 - v * (a * a + c * c), v * b * c - s * a
    turn[2, 0], turn[2, 1], turn[2, 2] = v * a * c - s * b, v * b * c + s * a, 1 - v * (a * a + b * b)
    return turn


@kernel
def _turned(turn: Floats, vector: Floats) -> Floats:
    x, y, z = vector
    found = np.empty(3)
    for i in range(3):
        found[i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
    return found


@kernel
def _product(one: Floats, other: Floats) -> Floats:
    """Product of two matrices (3, 3); BLAS would take ten times as long."""
    found = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            found[i, j] = one[i, 0] * other[0, j] + one[i, 1] * other[1, j] + one[i, 2] * other[2, j]
    return found
