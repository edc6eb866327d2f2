"""How fast a robot's disc may drive towards points that stand still."""

from __future__ import annotations

import math

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.kinematics.smartpal import BASE_LIMITS, RADIUS_M

#: Distance before which the base stands [m]: 5 cm, and 1 cm for corners between two rays and for noise.
MARGIN_M = 0.06
#: What is at least this far beside the driving robot does not stop it [m]; within MARGIN_M it passes at CRAWL_M_S.
SIDE_M, CRAWL_M_S = 0.01, 0.15
#: Braking that is counted on [m/s^2]; the rest of the limit compensates for a base that follows late.
BRAKING_M_S2 = 0.8 * BASE_LIMITS.acceleration
#: Time for which a base may drive on [s], beside the age of the scan and delays of this process: a control cycle, and
#: the validity of a command.
REACTION_S = 0.12


def allowed_speed(obstacles: Floats, direction: XY, latency_s: float) -> tuple[float, float, XY]:
    """The speed [m/s] at which a robot may drive in a direction (a unit vector), and of what limits it the distance
    from the robot's rim and the place [m]; infinite where nothing does. obstacles: (n, 2) from the robot's centre
    [m]."""
    along = obstacles @ direction
    is_ahead = along > 0.0
    if not is_ahead.any():
        return math.inf, math.inf, (math.inf, math.inf)
    distances = np.hypot(*obstacles.T)
    # Beside a wall that is nearer, the robot may still drive along it.
    side_m = min(max(float(distances.min()) - RADIUS_M - 0.002, 0.0), SIDE_M)
    ahead, distances = along[is_ahead], distances[is_ahead]
    across = np.sqrt(np.maximum(distances**2 - ahead**2, 0.0))
    wide_m = RADIUS_M + MARGIN_M
    free = np.maximum(ahead - np.sqrt(np.maximum(wide_m**2 - across**2, 0.0)), 0.0)
    final = np.where(across < RADIUS_M + side_m, 0.0, CRAWL_M_S)
    speeds = np.maximum(speed_within(free, latency_s, final), final)
    speeds[across >= wide_m] = math.inf
    least = int(speeds.argmin())
    x, y = obstacles[is_ahead][least]
    return float(speeds[least]), float(distances[least]) - RADIUS_M, (float(x), float(y))


def speed_within(free_m: Floats, latency_s: float, final_m_s: Floats) -> Floats:
    """The speed from which, after the latency, the base brakes to its final speed within a distance: the solution of
    v latency + (v^2 - final^2) / (2 braking) = free."""
    late = BRAKING_M_S2 * latency_s
    found: Floats = np.sqrt(late * late + 2.0 * BRAKING_M_S2 * free_m + final_m_s**2) - late
    return found
