"""Which robots take part in missions, and what is logged."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.errors.robots import RobotLost
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.missions import mission_agent
from robocorba.missions.messages import Answer, Assignment, Call, Offer
from robocorba.missions.mission_agent import WARN_AFTER, MissionAgent
from robocorba.missions.subplan import Idle, SubPlan
from robocorba.missions.transport import Transport
from robocorba.robot.kinematics.smartpal import JOINTS
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


@pytest.mark.parametrize("joints", [0, 7, None])
def test_one_without_arms_refuses(joints: int | None) -> None:
    bus, agent = Bus(), FreeAgent(has_joints=joints)
    leader = Transport(BusEnd(bus, "A"), "A")
    leader.subscribe([(Offer, "*"), (Answer, "*")])
    missions = MissionAgent(Transport(BusEnd(bus, "B"), "B"), agent, lambda thing: None).start()  # type: ignore[arg-type]
    assignment = Assignment(mission="m.1", leader="A", phases=("one",), subplan=SubPlan("B", "helper", (Idle(),)))
    answer = None
    while answer is None:
        leader.publish(CALL)
        leader.publish(assignment)
        answer = leader.receive(0.1)
    missions.close()
    assert isinstance(answer.message, Answer)
    assert (answer.message.accepts, answer.message.reason) == (False, "does not have the joints of a SmartPal")
    assert not any(isinstance(received.message, Offer) for received in leader.received)


class Unreachable(BusEnd):
    """A channel that is not there for its first calls."""

    failures = 0

    def subscribe(self, *arguments: Any) -> None:
        if self.failures:
            self.failures -= 1
            raise NotReachable("EventChannels/hall is not reachable")
        super().subscribe(*arguments)


@pytest.mark.parametrize(("failures", "warnings"), [(WARN_AFTER - 1, 0), (WARN_AFTER, 1), (3 * WARN_AFTER, 1)])
def test_a_channel_that_stays_away_is_logged_once_as_a_warning(
    failures: int, warnings: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mission_agent, "RETRY_S", 0.001)
    bus = Bus()
    leader, end = Transport(BusEnd(bus, "A"), "A"), Unreachable(bus, "B")
    leader.subscribe([(Offer, "*")])
    end.failures = failures
    agent: Any = FreeAgent(has_joints=len(JOINTS))
    missions = MissionAgent(Transport(end, "B"), agent, lambda thing: None).start()
    try:
        while not leader.receive(0.1):  # until it has subscribed at last
            leader.publish(CALL)
    finally:
        missions.close()
    logged = [each for each in caplog.records if each.levelno >= logging.WARNING and "event channel" in each.message]
    assert len(logged) == warnings
