"""What the whole suite shares."""

from __future__ import annotations

import signal

import pytest

from robocorba.maps.model import Building
from robocorba.planning.planner import PathPlanner
from robocorba.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation import physics
from tests.maps.buildings import two_floors


@pytest.fixture(scope="session", autouse=True)
def sigint() -> None:
    """Shells let what they start in the background ignore Ctrl-C, and it would be ignored by all that tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile once what servers use, before any test's clock runs and before they would each do it."""
    PathPlanner(Building("none")).warm_up()
    physics.warm_up()
    sensor = VirtualSensor()
    sensor.know(two_floors())
    sensor.warm_up()
