"""An actual robot that loses what it needs, or is stopped: it stands, its agent says why, and it works again after."""

from __future__ import annotations

import contextlib
import math
import os
import signal
from collections.abc import Callable, Iterator

import pytest

from robocorba.control.agent_state import AgentCondition, AgentState, ProgramResult
from robocorba.corba.orb import Orb
from robocorba.corba.remote.control_agent import RemoteAgent
from robocorba.errors.robots import IllegalOrder
from robocorba.programs.graphic_programming import ProgramBuilder
from robocorba.programs.program import Program, dumps
from robocorba.stubs import YeRTUnitMobility, _GlobalIDL
from robocorba.supervision.launch import module_command
from robocorba.testing.actual_robot import ROOT, StandIn, running_stand_in
from robocorba.testing.processes import Launcher, Running, eventually, hang
from tests.waits import outlast, pause

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

PATIENCE_S = 40.0
LONG = ProgramBuilder("long").mbase_velocity(0.2, 0.0, 0.4, 60.0).program()
WAITING = ProgramBuilder("waiting").wait(600.0).program()
SHORT = ProgramBuilder("short").mbase_by(ahead=0.05).program()
#: What the robot's odometry errs by and more, m.
STANDS_M = 0.003


class Robot:
    """A robot process on the stand-in; `agent` is how it is called."""

    def __init__(self, place: StandIn, pid: int, agent: RemoteAgent) -> None:
        self._place, self.pid, self.agent = place, pid, agent
        self._base = place.unit("Mobility.Unit", YeRTUnitMobility.mobility)

    def set_off(self, program: Program = LONG) -> None:
        self.agent.load(dumps(program))
        self.agent.run()
        if program is LONG:
            eventually(lambda: self.agent.state().actor.velocity[0] > 0.15, PATIENCE_S, "moving")

    def stopped(self) -> AgentState:
        """When its agent says so, and the program has ended."""

        def is_so() -> bool:
            state = self.agent.state()
            return state.condition is AgentCondition.STOPPED and state.program.result is not ProgramResult.NO_RESULT

        eventually(is_so, PATIENCE_S, "stopped")
        return self.agent.state()

    def failed(self) -> AgentState:
        eventually(
            lambda: self.agent.state().program.result is not ProgramResult.NO_RESULT, PATIENCE_S, "the program's end"
        )
        return self.agent.state()

    def stands(self) -> bool:
        """By what its own base says, now and half a second later."""
        (_, *before), _ = self._base.getPosition(), pause(0.5)
        _, *after = self._base.getPosition()
        return math.dist(before[:2], after[:2]) / 1000 < STANDS_M

    def works(self) -> bool:
        """Whether it runs a program again, at the latest when it has come back by itself."""

        def runs() -> bool:
            with contextlib.suppress(IllegalOrder):
                self.agent.load(dumps(SHORT))
                self.agent.run()
                return True
            return False

        eventually(runs, PATIENCE_S, "that it may run a program")
        return self.failed().program.result is ProgramResult.DONE


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, system_orb: Orb) -> Iterator[StandIn]:
    with running_stand_in(tmp_path_factory.mktemp("robot"), orb=system_orb) as found:
        yield found


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, system: Running, place: StandIn) -> Iterator[Robot]:
    folder = tmp_path_factory.mktemp("agent")
    where = ("--floor", "L1", "--at", "5,3,0", "--naming", str(system.naming), "--state", str(folder / "state"))
    adaptor = ("--adaptor", "smartpal", "--", "--naming", str(place.naming), "--pose=5,3,0")
    with Launcher(folder) as launch:
        process = launch(*module_command("robocorba.clients.robot"), "A", *where, *adaptor, PYTHONPATH=str(ROOT))
        assert process.stdout is not None and process.stderr is not None
        if process.stdout.readline() != "ready\n":
            raise AssertionError(process.stderr.read())
        yield Robot(place, process.pid, RemoteAgent(place.orb, "A"))
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)


def lose_unit(place: StandIn) -> None:
    place.faults.lost("MnpL", True)


def alarm(place: StandIn) -> None:
    place.faults.alarm("MnpR", 0x99, _GlobalIDL.FAULT, "too hot")


def press_switch(place: StandIn) -> None:
    place.faults.emergencySwitch(True)


def cut_off(place: StandIn) -> None:
    place.faults.slowNetwork(5.0)


@pytest.mark.parametrize(
    ("happens", "program", "why"),
    [
        (lose_unit, LONG, "MnpL does not answer"),
        (lose_unit, WAITING, "MnpL does not answer"),
        (alarm, LONG, "alarm 0x99 too hot"),
        (press_switch, LONG, "the emergency switch is pressed"),
        (cut_off, LONG, "not answer"),
    ],
)
def test_an_actual_robot_that_fails(
    robot: Robot, place: StandIn, happens: Callable[[StandIn], None], program: Program, why: str
) -> None:
    robot.set_off(program)
    happens(place)
    state = robot.stopped()
    assert why in state.reason
    assert (state.program.result, why in state.program.reason) == (ProgramResult.FAILED, True)
    with pytest.raises(IllegalOrder, match="is stopped"):
        robot.agent.run()
    place.faults.none()
    eventually(robot.stands)
    robot.agent.reset_stop()
    assert robot.works()


def test_an_emergency_stop_of_an_actual_robot(robot: Robot) -> None:
    robot.set_off()
    robot.agent.stop()
    state = robot.stopped()
    assert (state.reason, state.program.result) == ("emergency stop", ProgramResult.ABORTED)
    eventually(robot.stands)
    x, y = state.at.x, state.at.y
    robot.agent.reset_stop()
    at = robot.agent.state().at
    assert math.dist((at.x, at.y), (x, y)) < 0.1  # it still knows where it is
    assert robot.works()


def test_an_actual_robot_stands_without_its_body_in_the_building(robot: Robot, system: Running) -> None:
    robot.set_off()
    os.kill(system.pid("simulation"), signal.SIGKILL)
    state = robot.failed()
    assert state.program.result is ProgramResult.FAILED
    assert "the simulation server does not answer" in state.program.reason
    eventually(robot.stands)
    assert robot.works()


def test_a_robot_process_that_hung_does_not_go_on_as_if_it_had_not(robot: Robot) -> None:
    robot.set_off()
    hang(robot.pid)
    eventually(robot.stands)  # its last command ends after 0.1 s
    outlast(3.0)  # longer than its lease
    os.kill(robot.pid, signal.SIGCONT)
    state = robot.failed()
    assert state.program.result is ProgramResult.FAILED
    assert "paused for" in state.program.reason or "logged the robot off" in state.program.reason
    eventually(robot.stands)
    assert robot.works()


def test_a_short_pause_of_the_process_is_no_loss(robot: Robot) -> None:
    robot.set_off()
    hang(robot.pid)
    pause(0.4)
    os.kill(robot.pid, signal.SIGCONT)
    eventually(lambda: robot.agent.state().actor.velocity[0] > 0.15, PATIENCE_S, "moving again")
    robot.agent.abort()
    assert robot.failed().program.result is ProgramResult.ABORTED
    assert robot.works()
