"""Sensor noise: pseudo-random, and reproducible for the same seed and robot."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.scan import Noise
from robocorba.system.kernels import inner_kernel, kernel

#: Constants of SplitMix64 (Steele, Lea and Flood, 2014).
_STEP, _MIX_1, _MIX_2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def disturb(noise: Noise, distances: Floats, range_m: float, seed: int, robots: NDArray[np.int64]) -> Floats:
    """Distances (m, rays) with noise. robots: (m,) numbers of the robots that scan."""
    keys = robots.astype(np.uint64)
    sigma_m, relative, lost = noise.sigma_m, noise.relative, noise.lost
    return _disturb(distances, range_m, sigma_m, relative, lost, np.uint64(seed), keys)


@inner_kernel
def _mixed(state: np.uint64) -> np.uint64:
    """Pseudo-random number of a state, by SplitMix64."""
    state = (state ^ (state >> _30)) * _MIX_1
    state = (state ^ (state >> _27)) * _MIX_2
    return state ^ (state >> _31)


@kernel
def _disturb(
    distances: Floats,
    range_m: float,
    sigma_m: float,
    relative: float,
    lost: float,
    seed: np.uint64,
    robots: NDArray[np.uint64],
) -> Floats:
    readings = distances.copy()
    for m in range(distances.shape[0]):
        state = _mixed(_mixed(_mixed(seed) + robots[m]))
        for k in range(distances.shape[1]):
            uniforms = np.empty(3)
            for u in range(3):
                state += _STEP
                uniforms[u] = (_mixed(state) >> _11) * 2.0**-53
            distance = distances[m, k]
            if uniforms[2] < lost:
                readings[m, k] = range_m
            elif distance < range_m:
                error = math.sqrt(-2.0 * math.log(1.0 - uniforms[0])) * math.cos(2 * math.pi * uniforms[1])
                readings[m, k] = min(max(distance + error * (sigma_m + relative * distance), 0.0), range_m)
    return readings
