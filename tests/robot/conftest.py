"""A place for the robots of a module's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.simulation.registry import Pose
from tests.robot.places import InProcessSession, Place


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("place"))
    yield place
    place.close()


@pytest.fixture
def session(place: Place, request: pytest.FixtureRequest) -> Iterator[InProcessSession]:
    """Of the robot A, which begins at the pose that a test may give."""
    session = place.session("A", getattr(request, "param", Pose("L1", 7.0, 2.0, 0.0)))
    yield session
    session.is_away = False
    session.log_off()
