"""Noise: distribution and reproducibility."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robocorba.errors.sensing import InvalidScan
from robocorba.sensing.noise import disturb
from robocorba.sensing.scan import Noise

DISTANCES = np.full((20, 1000), 4.0)
ROBOTS = np.arange(20)


def test_the_error_has_the_stated_deviation() -> None:
    errors = disturb(Noise(0.01, 0.005), DISTANCES, 8.0, 1, ROBOTS, 0) - 4.0
    assert abs(errors.mean()) < 4 * 0.03 / math.sqrt(errors.size)
    assert errors.std() == pytest.approx(0.03, rel=0.02)
    share = (np.abs(errors) < 0.03).mean()
    assert share == pytest.approx(0.6827, abs=0.015)  # as of a normal distribution


def test_noise_depends_on_seed_robot_and_scan_only() -> None:
    noise = Noise(0.01)
    first = disturb(noise, DISTANCES, 8.0, 7, ROBOTS, 3)
    assert np.array_equal(first, disturb(noise, DISTANCES, 8.0, 7, ROBOTS, 3))
    assert np.array_equal(first[4:5], disturb(noise, DISTANCES[:1], 8.0, 7, ROBOTS[4:5], 3))  # whatever the others
    for seed, scan in ((8, 3), (7, 4)):
        other = disturb(noise, DISTANCES, 8.0, seed, ROBOTS, scan)
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.05
    assert abs(np.corrcoef(first[0], first[1])[0, 1]) < 0.15


def test_lost_echoes_read_the_range_and_nothing_is_read_beyond_it() -> None:
    read = disturb(Noise(3.0, 0.0, 0.1), DISTANCES, 8.0, 1, ROBOTS, 0)
    assert read.min() == 0.0
    assert read.max() == 8.0
    lost = disturb(Noise(0.0, 0.0, 0.1), DISTANCES, 8.0, 1, ROBOTS, 0)
    assert (lost == 8.0).mean() == pytest.approx(0.1, abs=0.01)
    nothing_met = np.full((1, 50), 8.0)
    assert np.array_equal(disturb(Noise(1.0), nothing_met, 8.0, 1, ROBOTS[:1], 0), nothing_met)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf, 11.0])
@pytest.mark.parametrize("field", ["sigma", "relative", "lost"])
def test_an_invalid_noise_names_the_field(field: str, value: float) -> None:
    with pytest.raises(InvalidScan) as refused:
        Noise(**{{"sigma": "sigma_m"}.get(field, field): value})
    assert refused.value.field == field
