"""The control agent: what it refuses and when, and how it comes back, on a virtual robot in one process."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from robocorba.errors.robots import AdaptorFailed, IllegalOrder, InvalidProgram, MotionFailed, RobotLost, UnknownAdaptor
from robocorba.errors.sensing import UnknownSensor
from robocorba.errors.simulation import InvalidChoice
from robocorba.robot import model_switcher
from robocorba.robot.agent import BODY_BLOCKED_M, BODY_LOST_M, ControlAgent
from robocorba.robot.agent_state import AgentCondition, ProgramResult
from robocorba.robot.display import DisplayKind
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.program import Program
from tests.robot.places import Channel, InProcessSession, Place, documented_adaptor, eventually

pytestmark = pytest.mark.slow

SHORT = ProgramBuilder("short").mbase_by(ahead=0.05).program()
LONG = ProgramBuilder("long").mbase_velocity(0.1, 0.0, 0.0, 60.0).program()
WRONG = ProgramBuilder("wrong").wait(1).program()
#: For which no order holds [s].
WRONG_S = 0.0, 5.1, math.nan


@pytest.fixture
def disc(agent: ControlAgent, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> ControlAgent:
    """The agent with the robot of docs/adaptors.md; it begins so far away from its body [m]."""
    make = model_switcher.make

    def with_disc(name: str, context: AdaptorContext) -> object:
        if name != "disc":
            return make(name, context)
        disc: Any = documented_adaptor()(context)
        start = disc.start

        def start_away(argv: Sequence[str]) -> bool:
            is_started = bool(start(argv))
            disc._x -= getattr(request, "param", 0.0)
            return is_started

        disc.start = start_away
        return disc

    monkeypatch.setattr(model_switcher, "make", with_disc)
    agent.switch("disc", ())
    return agent


def run(agent: ControlAgent, program: Program, wanted: ProgramResult = ProgramResult.DONE) -> str:
    """Run a program to its end; returns the reason."""
    agent.load(program)
    agent.run()
    eventually(lambda: agent.state.program.result is not ProgramResult.NO_RESULT, "its end")
    assert agent.state.program.result is wanted, agent.state.program.reason
    return agent.state.program.reason


def drive(**way: float) -> Program:
    return ProgramBuilder("drive").mbase_by(**way).program()


def test_what_is_refused_says_why(agent: ControlAgent, place: Place) -> None:
    never_started = ControlAgent(AdaptorContext("B", place.session("B"), None), place.planner, Channel())
    never_started.stop()
    never_started.abort()
    refusals: list[tuple[Callable[[], object], type[Exception], str]] = [
        (agent.step, IllegalOrder, "runs no program"),
        (agent.run, IllegalOrder, "has none loaded"),
        (agent.reset_stop, IllegalOrder, "was not stopped"),
        (lambda: agent.load(WRONG), InvalidProgram, r"icons\[0\]\.ahead: is wrong"),
        (lambda: agent.cap_speed(math.nan), InvalidChoice, "speed"),
        (lambda: agent.drive((math.nan, 0.0, 0.0), 0.5), InvalidChoice, r"wanted\.ahead"),
        (lambda: agent.drive((0.0, -1.7e308, 0.0), 0.5), InvalidChoice, r"wanted\.left: -1\.7e\+308 is no velocity"),
        (lambda: agent.drive((0.0, 0.0, -math.inf), 0.5), InvalidChoice, r"wanted\.turn"),
        *((lambda valid_s=valid_s: agent.drive((0.0,) * 3, valid_s), InvalidChoice, "validFor") for valid_s in WRONG_S),
        (lambda: agent.switch("hovering", ()), UnknownAdaptor, "known are corba, ros2, simulated, smartpal"),
        (lambda: agent.switch("simulated", ("--x", "1")), AdaptorFailed, "takes no arguments, such as '--x'"),
        (never_started.run, IllegalOrder, "was never started"),
        (lambda: never_started.switch("simulated", ()), IllegalOrder, "was never started"),
        (lambda: never_started.state, RobotLost, "was not started"),
    ]
    for order, kind, reason in refusals:
        with pytest.raises(kind, match=reason):
            order()
    never_started.close()
    agent.switch("simulated", ())
    eventually(lambda: agent.is_free, "it is as before")
    run(agent, SHORT)


def test_while_one_drives_its_path_is_there_and_others_are_checked(
    agent: ControlAgent, session: InProcessSession
) -> None:
    assert not agent.path
    start = session.latest.at
    goal = start.x + 1.0, start.y
    agent.load(ProgramBuilder("drive").mbase_path("L1", *goal).program())
    agent.run()
    eventually(lambda: len(agent.path) > 1, "driving")
    report, path = agent.check(WRONG), agent.path
    assert [str(finding) for finding in report.findings] == ["icons[0].ahead: is wrong"]
    assert [note.what for note in report.notes] == ["checked from L1"]
    for order in (agent.run, lambda: agent.load(SHORT), lambda: agent.switch("simulated", ())):
        with pytest.raises(IllegalOrder, match="runs a program"):
            order()
    assert (path[0].x, path[0].y) == pytest.approx((start.x, start.y), abs=1e-3)
    assert (path[-1].x, path[-1].y) == pytest.approx(goal, abs=1e-3)
    agent.abort()
    eventually(lambda: agent.is_free, "aborted")
    assert not agent.path


def shows(agent: ControlAgent, kind: DisplayKind, text: str) -> None:
    eventually(lambda: agent.display[:2] == (kind, text), f"{text}, not {agent.display.text}")


def test_the_touch_panel_shows_what_the_robot_does_and_since_when(
    agent: ControlAgent, session: InProcessSession, place: Place
) -> None:
    waiting = DisplayKind.WAITING
    shows(agent, waiting, "waiting for an order")
    eventually(lambda: agent.display.seconds > 0.3, "it shows that for a while")
    agent.load(ProgramBuilder("nap").mbase_velocity(0.05, 0.0, 0.0, 1.0).wait(60).program())
    agent.run()
    shows(agent, DisplayKind.WORKING, "mbase velocity (nap)")
    shows(agent, waiting, "waiting for 60 s")
    place.agent.configure(is_paused=True)
    shows(agent, waiting, "waiting for the simulation server, whose time stands")  # so there is no end of the 60 s
    place.agent.configure(is_paused=False)
    shows(agent, waiting, "waiting for 60 s")
    first = agent.display.seconds
    assert first < 5.0 and agent.display.seconds > first
    agent.pause()
    shows(agent, waiting, "paused, waiting for 60 s")
    agent.stop("fire")
    shows(agent, DisplayKind.EXCEPTIONAL, "stopped: fire")
    eventually(lambda: agent.state.program.result is ProgramResult.ABORTED, "its end")
    agent.reset_stop()
    shows(agent, waiting, "waiting for an order")
    agent.load(LONG)
    agent.run()
    shows(agent, DisplayKind.WORKING, "mbase velocity (long)")
    session.is_away = True
    shows(agent, DisplayKind.EXCEPTIONAL, "lost: nobody answers")
    session.is_away = False
    shows(agent, DisplayKind.EXCEPTIONAL, "long failed: nobody answers")


def test_another_robot_behind_the_same_agent(disc: ControlAgent, session: InProcessSession) -> None:
    """The documented adaptor is no body in the building: that follows it."""
    began = session.latest.at
    run(disc, drive(ahead=0.5, left=0.3, turn=1.0))
    eventually(lambda: abs(session.state().at.x - began.x - 0.5) < 0.01, "the body has followed")
    at = session.state().at
    assert (at.y - began.y, at.heading - began.heading) == pytest.approx((0.3, 1.0), abs=0.01)
    with pytest.raises(MotionFailed, match="0 joints"):
        _ = disc.robot.joints
    disc.switch("simulated", ())
    assert disc.state.adaptor == "simulated"


def test_a_loaded_program_does_not_run_on_a_robot_without_its_sensor(disc: ControlAgent) -> None:
    """The virtual sensor of the map knows nothing of what stands before an actual robot."""
    watch = ProgramBuilder("watch")
    with watch.stop_if_closer("laser", 0.1):
        watch.mbase_by(ahead=0.05)
    disc.load(watch.program())
    with pytest.raises(IllegalOrder, match=r"icons\[0\]\.sensor: the adaptor disc has no sensor laser"):
        disc.run()
    with pytest.raises(UnknownSensor, match="'laser'; known are none"):
        disc.robot.nearest_m("laser")
    disc.switch("simulated", ())
    run(disc, watch.program())


def test_what_holds_up_its_body_is_in_its_way(place: Place, disc: ControlAgent, session: InProcessSession) -> None:
    began = session.latest.at
    ahead = began._replace(x=began.x + 1.2 * math.cos(began.heading), y=began.y + 1.2 * math.sin(began.heading))
    other = place.session("other", ahead)
    other.log_on()
    reason = run(disc, drive(ahead=3.0), ProgramResult.FAILED)
    assert "m away, as if an obstacle blocked it; it last touched other" in reason
    assert disc.state.condition is AgentCondition.IDLE
    # Its body stands after 0.4 m; how soon that is noticed depends on the machine, but not how far it may get.
    assert math.dist((disc.state.actor.x, disc.state.actor.y), began[1:3]) < 0.4 + BODY_LOST_M
    run(disc, drive(ahead=-0.4))
    actor = disc.state.actor
    eventually(lambda: math.dist(session.state().at[1:3], (actor.x, actor.y)) < 0.02, "the body is back, too")
    other.log_off()


@pytest.mark.parametrize("disc", [BODY_BLOCKED_M + 0.03], indirect=True)
def test_a_body_that_went_on_while_its_robot_stood_does_not_hold_it_up(disc: ControlAgent) -> None:
    for _ in range(3):  # a program may begin before the body has moved
        disc.stop()
        disc.reset_stop()
        run(disc, drive(ahead=0.2))


def test_a_body_that_was_only_late_does_not_end_a_program(
    disc: ControlAgent, session: InProcessSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, command, behind_m = session.latest.at, session.command, [0.0]

    def late(velocity: Velocity, valid_s: float) -> None:
        robot = disc.state.actor
        behind_m.append(math.dist((robot.x, robot.y), session.latest.at[1:3]))
        is_driving = math.dist((robot.x, robot.y), began[1:3]) > 0.2
        if not is_driving or max(behind_m) > BODY_BLOCKED_M + 0.05:
            command(velocity, valid_s)

    monkeypatch.setattr(session, "command", late)
    run(disc, drive(ahead=1.0))
    assert max(behind_m) > BODY_BLOCKED_M


def test_a_body_that_is_lost_is_put_where_its_robot_is(
    disc: ControlAgent, session: InProcessSession, place: Place
) -> None:
    at = session.latest.at
    place.agent.place("A", at._replace(x=at.x - 1.5))
    eventually(lambda: "m away" in disc.state.reason, "lost")
    eventually(lambda: disc.state.condition is AgentCondition.IDLE, "back")
    assert session.state().at[1:3] == pytest.approx(at[1:3], abs=0.02)
