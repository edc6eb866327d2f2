"""What a leader does with its areas while the simulation server is away."""

from __future__ import annotations

from robocorba.errors.robots import RobotLost, ServerAway
from robocorba.missions.leader_areas import LeaderAreas


class Session:
    """A session whose server fails a number of times before it answers."""

    def __init__(self, *failures: RobotLost) -> None:
        self.failures = list(failures)
        self.has_areas = True

    def release_areas(self) -> None:
        if self.failures:
            raise self.failures.pop(0)
        self.has_areas = False


def test_areas_are_given_back_once_the_server_is_back() -> None:
    """Else they would keep other missions waiting for ten minutes."""
    session = Session(ServerAway("restarting"), ServerAway("restarting"))
    LeaderAreas(session).release()  # type: ignore[arg-type]
    assert not session.has_areas


def test_a_robot_that_was_logged_off_has_no_areas_to_give_back() -> None:
    session = Session(RobotLost("logged off"))
    LeaderAreas(session).release()  # type: ignore[arg-type]
    assert session.failures == []
