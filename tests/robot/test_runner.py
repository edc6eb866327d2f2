"""Programs on a virtual robot in one process: a real simulated building, in real time."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from robocorba.errors.robots import ServerAway
from robocorba.errors.sensing import UnknownSensor
from robocorba.robot.agent_state import ProgramReport, ProgramResult
from robocorba.robot.kinematics.smartpal import ARM, GRIP, LUMBAR, OPEN_RAD, Side
from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.programs import icons
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.robot import Robot
from robocorba.robot.runner import Runner
from robocorba.simulation.elevator import RidePhase
from robocorba.simulation.registry import Pose
from tests.robot.places import Channel, InProcessSession, Place, eventually, robot

pytestmark = pytest.mark.slow


def at(x: float, y: float, heading: float) -> pytest.MarkDecorator:
    """Where the robot begins."""
    return pytest.mark.parametrize("session", [Pose("L1", x, y, heading)], indirect=True)


@pytest.fixture
def smartpal(place: Place, session: InProcessSession) -> Iterator[Robot]:
    found = robot(place, session)
    yield found
    found.controller.close()


def run(smartpal: Robot, builder: ProgramBuilder, channel: Channel | None = None) -> tuple[ProgramReport, list[str]]:
    """How it ended, and the kinds of icons that began."""
    runner = Runner(builder.program(), smartpal, channel or Channel())
    report = runner.run()
    return report, [icon.kind for icon in runner.begun(0)]


def test_hands_and_body_go_where_icons_say(smartpal: Robot) -> None:
    builder = ProgramBuilder("hands").mhand_posture("both", "ready").gripper("left", "open")
    builder.mhand_pose("right", 0.45, -0.2, 0.95).mhand_offset("right", dz=0.05).lumbar(0.0, 0.2)
    report, began = run(smartpal, builder)
    assert (report.result, report.icons_done, report.reason) == (ProgramResult.DONE, 5, "")
    joints = smartpal.controller.state.joints
    assert joints[ARM[Side.LEFT]] == pytest.approx(POSTURES["ready"], abs=0.01)
    assert joints[LUMBAR] == pytest.approx((0.0, 0.2), abs=0.01)
    assert joints[GRIP[Side.LEFT]] == pytest.approx(OPEN_RAD, abs=0.01)
    joints[LUMBAR] = 0.0
    hand = smartpal.kinematics.body.hand(Side.RIGHT, joints)
    assert hand[:3] == pytest.approx((0.45, -0.2, 1.0), abs=0.005)
    assert began == ["mhand_posture", "gripper", "mhand_pose", "mhand_offset", "lumbar"]


def test_who_calls_from_within_the_cabin_need_not_see_the_doors_open_for_it(tmp_path: Path) -> None:
    with contextlib.closing(Place(tmp_path)) as place:
        session = place.session("A", Pose("L1", 5.0, 5.0))
        smartpal = robot(place, session)
        with contextlib.closing(smartpal.controller):
            session.call_elevator("E1", "L2")
            eventually(lambda: session.state().ride.phase.value > RidePhase.BOARDING.value, "it does not ride")
            smartpal.wait_for_ride(RidePhase.BOARDING, "E1 did not come", limit_s=1.0)
            shown: set[str] = set()
            awaited = smartpal.execution
            smartpal.wait_for_ride(RidePhase.ALIGHTING, "E1 did not arrive", check=lambda: shown.add(awaited.awaited))
            assert "L2, in elevator E1" in shown
            assert session.latest.at.floor == "L2"


@at(6.5, 8.0, 0.0)
def test_a_watch_that_ends_by_a_defect_ends_the_program(smartpal: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot would drive on without it."""
    monkeypatch.setattr(smartpal, "nearest_m", MagicMock(side_effect=ValueError("a fault")))
    builder = ProgramBuilder("stop")
    with builder.stop_if_closer("front", 0.3):
        builder.mbase_velocity(0.2, 0.0, 0.0, 30.0)
    report, _ = run(smartpal, builder)
    assert report.result is ProgramResult.FAILED
    assert "internal fault in 'sensor stop' (ValueError: a fault)" in report.reason


def test_a_condition_waits_for_a_sensor_server_that_restarts(smartpal: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not for a sensor that the robot does not have."""
    answers = [ServerAway("away"), ServerAway("away"), 0.5, 0.5, UnknownSensor("back", ())]
    monkeypatch.setattr(smartpal, "nearest_m", MagicMock(side_effect=answers))
    builder = ProgramBuilder("look").wait_until(icons.CloserThan("front", 0.6), 10.0)
    with builder.branch(icons.FartherThan("front", 0.5)):
        builder.wait_until(icons.CloserThan("back", 0.6), 10.0)
    report, began = run(smartpal, builder)
    assert (report.result, began) == (ProgramResult.FAILED, ["wait_until", "branch", "wait_until"])
    assert report.reason == "the robot has no sensor 'back'; known are none"


@at(2.0, 2.95, -math.pi / 2)
def test_gripping_carries_an_object(smartpal: Robot, session: InProcessSession) -> None:
    builder = ProgramBuilder("grip").mhand_posture("both", "reach").gripper("left", "close", force=5.0, object="T1")
    with builder.branch(icons.Holding("left")):
        builder.say("held", None)
    builder.gripper("left", "open")
    channel = Channel()
    report, _ = run(smartpal, builder, channel)
    assert (report.result, report.reason) == (ProgramResult.DONE, "")
    assert channel.said == [("held", None)]
    assert session.state().holding == ""
