"""A robot's session as a CORBA object, without an ORB."""

from __future__ import annotations

import time
from typing import Any

import pytest

from robocorba.corba.servants.simulation_server import RobotSessionServant
from robocorba.errors.simulation import CannotGrip
from robocorba.simulation.registry import RobotClient
from robocorba.stubs import RoboCorba
from tests.simulation.places import robot


class Session:
    """Grips after an hour of waiting."""

    def __init__(self, client: RobotClient) -> None:
        self.client, self.calling_meanwhile = client, False

    def grip(self, what: str, at: tuple[float, float]) -> None:
        self.calling_meanwhile = self.client.is_calling
        self.client.last_call_at -= 3600.0
        raise CannotGrip(what, "it is too far away")


def test_a_long_call_keeps_the_lease() -> None:
    client = RobotClient(robot("A"), "key", 0.0, time.monotonic)
    session: Any = Session(client)
    unused: Any = None
    servant = RobotSessionServant(session, 2.0, sensor=unused, stops=unused, uri=unused)
    with pytest.raises(RoboCorba.CannotGrip):
        servant.grip("T1", RoboCorba.XY(1.0, 2.0))
    assert (session.calling_meanwhile, client.is_calling) == (True, False)
    assert client.silent_s < 1800.0
