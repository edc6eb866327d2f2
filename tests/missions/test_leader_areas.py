"""What a leader does with its areas while the simulation server is away."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from robocorba.errors.robots import RobotLost, ServerAway
from robocorba.missions.leader_areas import LeaderAreas


@pytest.mark.parametrize("failures", [[ServerAway("restarting")] * 2 + [None], [RobotLost("logged off")]])
def test_areas_are_given_back_once_the_server_is_back(failures: list[Exception | None]) -> None:
    """Else they would keep other missions waiting for ten minutes. A robot that was logged off has none."""
    session = Mock()
    session.release_areas.side_effect = failures
    LeaderAreas(session).release()
    assert session.release_areas.call_count == len(failures)
