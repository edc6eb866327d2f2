"""Sensor noise: pseudo-random, and reproducible for the same seed, robot and scan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robocorba.errors.sensing import InvalidScan
from robocorba.kernels import kernel
from robocorba.spatial.grids import Floats

#: Maximum of Noise.sigma_m [m].
MAX_SIGMA_M = 10.0
#: Maximum of Noise.relative.
MAX_RELATIVE = 1.0
#: Constants of SplitMix64 (Steele, Lea and Flood, 2014).
_STEP, _MIX_1, _MIX_2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@dataclass(frozen=True)
class Noise:
    """Noise model: a distance d reads d plus a normal error of deviation `sigma_m` + `relative` x d, within [0, range].
    A share `lost` of the rays gets no echo and reads the range [m]. Raises InvalidScan."""

    sigma_m: float = 0.0
    relative: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        for field, value, maximum in (
            ("sigma", self.sigma_m, MAX_SIGMA_M),
            ("relative", self.relative, MAX_RELATIVE),
            ("lost", self.lost, 1.0),
        ):
            if not 0.0 <= value <= maximum:  # also refuses NaN
                raise InvalidScan(field, f"{value} is not 0 to {maximum:g}")

    def __bool__(self) -> bool:
        return bool(self.sigma_m or self.relative or self.lost)

    def disturb(self, distances: Floats, range_m: float, seed: int, robots: NDArray[np.int64], scan: int) -> Floats:
        """Distances (m, rays) with noise. robots: (m,) numbers of the robots that scan. scan: number of the scan."""
        keys = robots.astype(np.uint64)
        return _disturb(
            distances, range_m, self.sigma_m, self.relative, self.lost, np.uint64(seed), keys, np.uint64(scan)
        )


@kernel
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
    scan: np.uint64,
) -> Floats:
    readings = distances.copy()
    for m in range(distances.shape[0]):
        state = _mixed(_mixed(_mixed(seed) + robots[m]) + scan)
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
