"""A body, and who solves for its hands."""

from __future__ import annotations

import pytest

from robocorba.kinematics.body import Body
from robocorba.kinematics.inverse import InverseKinematics


@pytest.fixture(scope="session")
def body() -> Body:
    return Body()


@pytest.fixture(scope="session")
def inverse() -> InverseKinematics:
    return InverseKinematics()
