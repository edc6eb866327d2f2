"""A try of the bench of the protective field, with real processes."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from bench.robots.protection import FAR_M, MARGIN_M, stage

pytestmark = [pytest.mark.system, pytest.mark.slow(50), pytest.mark.full]


def test_an_actual_robot_stands_before_a_chair_that_no_map_has(tmp_path: Path) -> None:
    with stage(tmp_path, 0.8) as place:
        stands_at_m, report = place.approach(0.8, random.Random(2))
        assert "laser sees something" in report.reason
        assert MARGIN_M <= stands_at_m < FAR_M
        assert place.contacts() == 0.0
