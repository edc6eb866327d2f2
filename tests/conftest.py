"""What the whole suite shares."""

from __future__ import annotations

import signal

import pytest

from robocorba.maps.model import Building
from robocorba.planning.planner import PathPlanner


@pytest.fixture(scope="session", autouse=True)
def sigint() -> None:
    """Shells let what they start in the background ignore Ctrl-C, and it would be ignored by all that tests start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile the planner once, before any test's clock runs and before servers would each do it."""
    PathPlanner(Building("none")).warm_up()
