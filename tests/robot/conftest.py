"""A place for the robots of a module's tests, and one of them with its agent."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from robocorba.robot.agent import AgentCalls, ControlAgent
from robocorba.robot.agent_state import AgentState
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.simulation.registry import Pose
from tests.robot.places import Channel, InProcessSession, Place


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


def check(program: Program, state: AgentState) -> CheckReport:
    report = CheckReport()
    report.add_note("", f"checked from {state.at.floor}")
    if program.name == "wrong":
        report.add_finding("icons[0]", "ahead", "is wrong")
    return report


@pytest.fixture
def agent(place: Place, session: InProcessSession) -> Iterator[ControlAgent]:
    agent = ControlAgent(AdaptorContext("A", session, None), place.planner, Channel(), calls=AgentCalls(check))
    agent.start("simulated")
    yield agent
    session.is_away = False
    agent.close()
