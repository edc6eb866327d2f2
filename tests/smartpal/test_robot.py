"""The dynamics thread, and the settings of the stand-in's process."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from robocorba.settings import InvalidSetting, SmartPalSettings
from robocorba.smartpal_stand_in.dynamics import STEP_S
from robocorba.smartpal_stand_in.robot import RealTime
from robocorba.testing.processes import eventually
from tests.waits import stays

COMMON = ["--endpoint", "127.0.0.1:2", "--naming", "127.0.0.1:1"]


def test_time_passes_until_it_is_closed_and_outlives_a_fault() -> None:
    steps: list[float] = []

    def step() -> None:
        steps.append(time.monotonic())
        if len(steps) == 5:
            raise RuntimeError("by the test")

    clock = RealTime(step)
    began = time.monotonic()
    clock.start()
    eventually(lambda: len(steps) > 50)
    clock.close()
    assert len(steps) - 1 <= (steps[-1] - began) / STEP_S, "never ahead of real time"
    assert "dynamics" not in {thread.name for thread in threading.enumerate()}
    ended = len(steps)
    stays(lambda: len(steps) == ended, 0.05)


def test_settings(tmp_path: Path) -> None:
    given = [*COMMON, "--state", str(tmp_path), "--seed", "3", "--x=-1.5", "--y", "2", "--heading", "0.5"]
    settings = SmartPalSettings.read(given)
    assert (settings.seed, settings.start) == (3, (-1.5, 2.0, 0.5))
    usual = SmartPalSettings.read(COMMON)
    assert (usual.start, usual.restores_servo, usual.unlocks_by_power, usual.limit_slack) == (
        (0, 0, 0),
        True,
        True,
        1e-7,
    )
    strict = SmartPalSettings.read([*COMMON, "--servo-after-fault", "off", "--unlock", "unlock", "--limit-slack", "0"])
    assert (strict.restores_servo, strict.unlocks_by_power, strict.limit_slack) == (False, False, 0.0)


@pytest.mark.parametrize("error", [["--seed", "-1"], ["--limit-slack", "1"], ["--x", "nan"], ["--heading", "inf"]])
def test_settings_that_can_t_be(error: list[str]) -> None:
    with pytest.raises(InvalidSetting, match=error[0]):
        SmartPalSettings.read([*COMMON, *error])
