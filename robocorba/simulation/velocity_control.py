"""The forces by which robots follow their velocity commands, and objects slide to a halt."""

from __future__ import annotations

import math

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.substeps import STEP_S
from robocorba.system.kernels import inner_kernel, kernel

#: Deceleration by ground friction, of a sliding object and of a braking robot [m/s^2, rad/s^2]: gravity by a Coulomb
#: friction coefficient of 0.5, our choice.
BRAKING_M_S2, BRAKING_RAD_S2 = 0.5 * 9.81, 4 * 0.5 * 9.81


@inner_kernel
def share_within(x: float, y: float, limit: float) -> float:
    """The factor that shortens a vector to a length of at most `limit`: 1 if it is no longer."""
    # Square roots, sines and cosines dominate the cost of a step, so skip them where possible.
    if abs(x) + abs(y) <= limit:
        return 1.0
    return min(1.0, limit / max(math.hypot(x, y), 1e-12))


@kernel
def limit_speeds(state: Floats, caps: Floats, velocities: Floats) -> bool:
    """Whether a body is faster than its cap (n) [m/s]. `velocities` (n, 3): those in `state` (n, 6) within the caps."""
    is_too_fast = False
    for i in range(len(state)):
        share = share_within(state[i, 3], state[i, 4], caps[i])
        is_too_fast = is_too_fast or share < 1.0
        velocities[i, 0], velocities[i, 1] = state[i, 3] * share, state[i, 4] * share
        velocities[i, 2] = state[i, 5]
    return is_too_fast


@kernel
def control(
    state: Floats, velocities: Floats, commands: Floats, limits: Floats, inertia: Floats, now: float, forces: Floats
) -> bool:
    """Compute the forces (n, 3) that change the bodies' velocities in the next substep, before contacts. Returns
    whether a body moves or is to move.

    velocities: (n, 3), as of `limit_speeds`. They approach the commands (n, 4) within `limits` (n, 4), columns as in
    Limits. A command is a velocity in the body's frame and the time until which it is valid [s]. inertia: (n, 2) mass
    [kg] and moment [kg m^2], over the duration of the substep [s]."""
    is_moving = False
    for i in range(len(state)):
        ahead, left, turn, until = commands[i]
        if until < now:
            ahead = left = turn = 0.0
        share = share_within(ahead, left, limits[i, 0])
        ahead, left = ahead * share, left * share
        turn = min(max(turn, -limits[i, 1]), limits[i, 1])
        vx, vy, turning = velocities[i]
        dx, dy = -vx, -vy
        if ahead != 0.0 or left != 0.0:
            c, s = math.cos(state[i, 2]), math.sin(state[i, 2])
            dx, dy = c * ahead - s * left + dx, s * ahead + c * left + dy
        is_braking = until == -math.inf
        share = share_within(dx, dy, (BRAKING_M_S2 if is_braking else limits[i, 2]) * STEP_S)
        max_turn_change = (BRAKING_RAD_S2 if is_braking else limits[i, 3]) * STEP_S
        spin = min(max(turn - turning, -max_turn_change), max_turn_change)
        # Forces take velocities to 0 but for their rounding errors.
        is_moving = is_moving or max(abs(vx), abs(vy), abs(turning), abs(dx), abs(dy), abs(spin)) > 1e-300
        forces[i, 0], forces[i, 1] = dx * share * inertia[i, 0], dy * share * inertia[i, 0]
        forces[i, 2] = spin * inertia[i, 1]
    return is_moving
