"""Which robots take part in missions."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.errors.robots import RobotLost
from robocorba.kinematics.smartpal import JOINTS
from robocorba.missions.messages import Answer, Assignment, Call, Offer
from robocorba.missions.mission_agent import MissionAgent
from robocorba.missions.subplan import Idle, SubPlan
from robocorba.missions.transport import Transport
from robocorba.spatial.pose import Pose
from tests.missions.places import Bus, BusEnd

CALL = Call(mission="m.1", leader="A", floor="L1", x=0.0, y=0.0, helpers=1)


class FreeAgent(SimpleNamespace):
    """A control agent without a task, whose robot has this number of joints, or does not answer."""

    is_free, is_busy, place = True, False, Pose("L1", 1.0, 2.0, 0.0)

    @property
    def joints(self) -> Any:
        if self.has_joints is None:
            raise RobotLost("it does not answer")
        return np.zeros(self.has_joints)


@pytest.fixture
def leader(request: pytest.FixtureRequest) -> Iterator[Transport]:
    """The transport of a leader A beside a robot B with the number of joints of the parameter."""
    bus = Bus()
    transport = Transport(BusEnd(bus, "A"), "A")
    transport.subscribe([(Offer, "*"), (Answer, "*")])
    agent: Any = FreeAgent(has_joints=request.param)
    missions = MissionAgent(Transport(BusEnd(bus, "B"), "B"), agent, lambda thing: None).start()
    try:
        yield transport
    finally:
        missions.close()


@pytest.mark.parametrize("leader", [len(JOINTS)], indirect=True)
def test_a_robot_that_is_free_offers_its_help(leader: Transport) -> None:
    found = None
    while found is None:  # it has subscribed then
        leader.publish(CALL)
        found = leader.receive(0.1)
    assert isinstance(found.message, Offer) and found.message.robot == "B"


@pytest.mark.parametrize("leader", [0, 7, None], indirect=True)
def test_one_without_arms_refuses(leader: Transport) -> None:
    assignment = Assignment(mission="m.1", leader="A", phases=("one",), subplan=SubPlan("B", "helper", (Idle(),)))
    answer = None
    while answer is None:
        leader.publish(CALL)
        leader.publish(assignment)
        answer = leader.receive(0.1)
    assert isinstance(answer.message, Answer)
    assert (answer.message.accepts, answer.message.reason) == (False, "does not have the joints of a SmartPal")
    assert not any(isinstance(received.message, Offer) for received in leader.received)
