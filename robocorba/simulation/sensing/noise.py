"""Sensor noise: pseudo-random, and reproducible for the same seed, robot and scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.scan import Noise


def disturb(noise: Noise, distances: Floats, range_m: float, seed: int, robots: NDArray[np.int64], scan: int) -> Floats:
    """Distances (m, rays) with noise. robots: (m,) numbers of the robots that scan. scan: number of the scan."""
    count, rays = distances.shape
    first = _mixed(_mixed(_mixed(np.array([seed], np.uint64)) + robots.astype(np.uint64)) + np.uint64(scan))
    # Three numbers a ray; the increment is that of SplitMix64.
    states = first[:, None] + np.arange(1, 3 * rays + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    uniforms = ((_mixed(states) >> np.uint64(11)) * 2.0**-53).reshape(count, rays, 3)
    # A normal error, by the method of Box and Muller (1958).
    error = np.sqrt(-2.0 * np.log(1.0 - uniforms[:, :, 0])) * np.cos(2 * np.pi * uniforms[:, :, 1])
    readings = np.clip(distances + error * (noise.sigma_m + noise.relative * distances), 0.0, range_m)
    return np.where((uniforms[:, :, 2] < noise.lost) | (distances >= range_m), range_m, readings)


def _mixed(state: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Pseudo-random numbers of states, by SplitMix64 (Steele, Lea and Flood, 2014)."""
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))
