"""A body, and who solves for its hands."""

from __future__ import annotations

import pytest

from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.inverse import InverseKinematics


@pytest.fixture(scope="session")
def body() -> SmartPalBody:
    return SmartPalBody()


@pytest.fixture(scope="session")
def inverse() -> InverseKinematics:
    return InverseKinematics()
