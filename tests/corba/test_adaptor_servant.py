"""A robot adaptor written in Python, behind CORBA."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from robocorba.control.adaptor import RobotAdaptor
from robocorba.corba.servants.adaptor import RobotAdaptorServant
from robocorba.errors.robots import AdaptorFailed
from robocorba.motion.robot_state import ActorCommand, RobotState
from robocorba.stubs import RoboCorba


class Faulty(RobotAdaptor):
    """Raises whatever the test says."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def start(self, argv: Sequence[str]) -> bool:
        raise self._error

    def stop(self) -> bool:
        raise self._error

    def read(self, state: RobotState) -> bool:
        raise self._error

    def write(self, command: ActorCommand) -> bool:
        raise self._error


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (AdaptorFailed("battery empty"), "battery empty"),
        (OSError(5, "no serial port"), "OSError: [Errno 5] no serial port"),
    ],
)
def test_every_error_of_a_driver_reaches_the_agent_with_its_cause(error: Exception, cause: str) -> None:
    servant = RobotAdaptorServant(Faulty(error))
    for call in (lambda: servant.start([]), servant.stop, servant.read):
        with pytest.raises(RoboCorba.AdaptorFailed) as raised:
            call()
        assert raised.value.cause == cause
