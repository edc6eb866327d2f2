"""What the whole suite shares."""

from __future__ import annotations

import fcntl
import os
import signal
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

from robocorba.kinematics.inverse import InverseKinematics
from robocorba.maps.model import Building
from robocorba.missions import carry_planning
from robocorba.planning.planner import PathPlanner
from robocorba.sensing.virtual_sensor import VirtualSensor
from robocorba.simulation import omni_database, physics
from robocorba.testing.buildings import two_floors

# The same examples in each run, so that it says the same on every machine; `--hypothesis-profile random` looks for
# new ones. How long examples take to make says something of the machine and its load, nothing of what is tested.
hypothesis.settings.register_profile("suite", derandomize=True, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.register_profile("random", suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("suite")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that wait for real processes come first, the slow ones before the others, so that no worker is left alone
    with one of them at the end."""
    items.sort(key=lambda item: (item.get_closest_marker("slow") is None, item.get_closest_marker("system") is None))


@pytest.fixture(scope="session", autouse=True)
def sigint() -> None:
    """Shells let what they start in the background ignore Ctrl-C, and it would be ignored by all that tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def compile_sensing() -> None:
    sensor = VirtualSensor()
    sensor.set_map(two_floors())
    sensor.warm_up()


def compile_simulation() -> None:
    physics.warm_up()
    omni_database.warm_up()


#: What compiles the kernels of a package, longest first.
COMPILERS: dict[str, Callable[[], object]] = {
    "planning": lambda: PathPlanner(Building("none")).warm_up(),
    "missions": carry_planning.warm_up,
    "sensing": compile_sensing,
    "kinematics": InverseKinematics,
    "simulation": compile_simulation,
}


@pytest.fixture(scope="session", autouse=True)
def kernels(worker_id: str) -> None:
    """Compile once what servers and robots use, before any test's clock runs.

    Workers begin with different packages; one that comes to what another compiles waits for it, and loads it then."""
    names = deque(COMPILERS)
    names.rotate(-int(worker_id.removeprefix("gw")) if worker_id != "master" else 0)
    for name in names:
        with Path(tempfile.gettempdir(), f"robocorba-{os.getuid()}-{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            COMPILERS[name]()
