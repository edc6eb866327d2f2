"""Scans of robots' own sensors by their agents, from where the robots were at the time of the scan."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.orb import Orb
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramReport
from robocorba.robot.corba import remote_scans as module
from robocorba.robot.corba import robot_states
from robocorba.robot.corba.adaptor_servant import RobotSensorsServant
from robocorba.robot.corba.remote_scans import VIRTUAL, live_scans
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.senses import Ranges
from robocorba.stubs import RoboCorba__POA
from tests.clock import Clock
from tests.orb.test_senses import SONAR, Driver


class Agent(RoboCorba__POA.RobotAgent):
    """An agent behind whose adaptor is a driver with a sonar."""

    def __init__(self, orb: Orb) -> None:
        self.driver, self.adaptor = Driver(SONAR), "smartpal"
        self.actor = RobotState(12.0, 1.0, 2.0, math.pi / 2, (0.4, 0.1, -0.2))
        self.sensors = orb.activate(RobotSensorsServant(lambda: self.driver))
        self.states, self.fails = 0, False

    def _get_state(self) -> Any:
        self.states += 1
        if self.fails:
            raise CORBA.TRANSIENT(0, CORBA.COMPLETED_NO)
        at = Pose("L1", self.actor.x, self.actor.y, self.actor.heading)
        state = AgentState("A", self.adaptor, AgentCondition.IDLE, "", at, self.actor, 1.0, 0.0, ProgramReport())
        return robot_states.agent_state(state)

    def _get_sensors(self) -> Any:
        return self.sensors


class Place:
    """Robot A with this agent, and a naming service that knows it."""

    def __init__(self, orb: Orb) -> None:
        self.agent, self.bound, self.clock = Agent(orb), ["A"], Clock()
        orb.accept_calls()
        reference = orb.activate(self.agent)

        def resolve(name: str, *arguments: Any) -> Any:
            if name.rpartition("/")[2] not in self.bound:
                raise NotReachable(name)
            return reference

        ours: Any = SimpleNamespace(
            names=lambda path, timeout_s: list(self.bound), resolve=resolve, uri=orb.uri, reference=orb.reference
        )
        self.scans = live_scans(ours)._own


@pytest.fixture
def place(orb: Orb, monkeypatch: pytest.MonkeyPatch) -> Place:
    place = Place(orb)
    monkeypatch.setattr(module.time, "monotonic", place.clock)
    return place


def test_a_scan_is_from_where_the_robot_was(place: Place) -> None:
    place.agent.driver.seen = Ranges(12.5, np.array([1.0, 2.0, 4.0]))  # half a second after its state
    (scan,) = place.scans("A") or []
    assert scan.at == pytest.approx(("L1", 1.0 - 0.05, 2.0 + 0.2, math.pi / 2 - 0.1))
    assert (scan.robot, scan.mount, scan.rim_m, scan.noise) == ("A", SONAR.mount, 0.3, (0.01, 0.02, 0.03, 0))
    assert (scan.distances.tolist(), scan.hits.tolist()) == ([1.0, 2.0, 4.0], [True, True, False])
    assert (scan.is_virtual, scan.range_m, scan.first_rad, scan.step_rad) == (False, 4.0, -0.1, 0.1)
    place.agent.driver.seen = Ranges(99.0, np.ones(3))  # of another clock
    assert (place.scans("A") or [])[0].at[2] == pytest.approx(2.0 + 0.2)


def test_whose_sensors_are_virtual(place: Place) -> None:
    assert place.scans("nobody") is None
    assert place.agent.states == 0
    place.agent.adaptor = VIRTUAL
    assert place.scans("A") is None
    place.agent.adaptor, place.agent.sensors = "corba", None
    assert place.scans("A") == []
    place.bound = []
    place.clock.now += 10.0
    assert place.scans("A") is None


def test_a_broken_sensor_sees_nothing_until_it_is_mended(place: Place) -> None:
    place.agent.actor.x = math.nan
    assert place.scans("A") == []
    place.agent.actor.x = 1.0
    place.agent.driver.seen = Ranges(12.0, np.ones(2))
    assert place.scans("A") == []
    place.agent.driver.seen = Ranges(12.1, np.ones(3))
    assert place.scans("A")
    place.bound = []  # it ends, and its name is not read again yet
    place.agent.fails = True
    with pytest.raises(NotReachable):
        place.scans("A")
