"""What the whole suite shares."""

from __future__ import annotations

import signal

import hypothesis
import pytest

from robocorba.kinematics.inverse import InverseKinematics
from robocorba.maps.model import Building
from robocorba.planning.planner import PathPlanner
from robocorba.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation import physics
from tests.maps.buildings import two_floors

# How long examples take to make says something of the machine and its load, nothing of what is tested.
hypothesis.settings.register_profile("suite", suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("suite")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that wait for real processes come first, the slow ones before the others, so that no worker is left alone
    with one of them at the end."""
    items.sort(key=lambda item: (item.get_closest_marker("slow") is None, item.get_closest_marker("system") is None))


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
    InverseKinematics()
