"""What robots sense, as real processes: a chair that no map has, an adaptor without sensors, bumpers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocorba.errors.robots import IllegalOrder, InvalidProgram
from robocorba.map_editor import native
from robocorba.map_editor.model import BoxShape, MapObject
from robocorba.orb.orb import Orb
from robocorba.robot.adaptor import RobotAdaptor
from robocorba.robot.agent_state import AgentCondition, AgentState, ProgramResult
from robocorba.robot.corba.adaptor_servant import RobotAdaptorServant, SensingAdaptorServant
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.robot.programs.icons import Result
from robocorba.robot.programs.program import dumps
from robocorba.robot.senses import Ranges, RangeSensor, Reading, Senses, usual_sensors
from robocorba.stubs import RoboCorba
from testkit.actual_robot import StandIn, running_stand_in
from testkit.buildings import two_floors, with_all
from testkit.processes import eventually
from testkit.simulation import about
from testkit.virtual_and_actual import robot_process

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.full]

PATIENCE_S = 60.0
#: Where a robot begins, and the front of the chair before it.
START, CHAIR_X = (2.5, 3.0, 0.0), 4.5
WHERE = ("--floor", "L1", "--at", ",".join(map(str, START)))
#: At what distance the laser stops it, and how much nearer it comes at most [m]: at 0.15 m/s, a distance may be late by
#: half a second on a busy machine, and then it slows down.
STOP_M, LATE_M = 1.0, 0.1


def watched() -> str:
    program = ProgramBuilder("watched")
    with program.stop_if_closer("laser", STOP_M):
        program.mbase_by(ahead=3.0, speed=0.15)
    with program.branch(Result("stopped")):
        program.wait(0.1)
    return dumps(program.program())


def blind(ahead: float) -> str:
    return dumps(ProgramBuilder("blind").mbase_by(ahead=ahead, speed=0.15).program())


def run(agent: RemoteAgent, program: str, *conditions: AgentCondition) -> AgentState:
    """To its end; the robot is then in one of the conditions."""
    agent.load(program)
    agent.run()

    def state() -> AgentState | None:
        found = agent.state()
        has_ended = found.program.result is not ProgramResult.NO_RESULT
        return found if has_ended and found.condition in (conditions or (AgentCondition.IDLE,)) else None

    found: AgentState = eventually(state, PATIENCE_S, "the program's end")
    return found


def sensors(orb: Orb, name: str) -> Any:
    """The agent's RobotSensors, nil without any."""
    return orb.resolve(f"Robots/{name}", RoboCorba.RobotAgent)._get_sensors()


def contacts(orb: Orb, name: str) -> float:
    (bumper,) = sensors(orb, name).readings()
    assert (bumper.name, bumper.unit) == ("bumper", "contacts")
    return float(bumper.value)


@pytest.fixture
def stand_in(system_orb: Orb, tmp_path: Path) -> Iterator[StandIn]:
    """An actual robot in the same building, where somebody has left a chair."""
    chair = MapObject(name="chair", shape=BoxShape(size=(0.5, 0.5)), at=(CHAIR_X + 0.25, START[1]))
    native.save(with_all(two_floors(), [("L1", chair)]), tmp_path / "world.yaml")
    world = ("--world", str(tmp_path / "world.yaml"), "--world-at", *map(str, START))
    noisy = ("--range-noise", "0.005", "--range-lost", "0.2")
    with running_stand_in(tmp_path / "robot", *world, *noisy, orb=system_orb) as found:
        yield found


def test_a_chair_that_no_map_has_stops_the_robot_that_sees_it(
    system_orb: Orb, stand_in: StandIn, tmp_path: Path
) -> None:
    """The same program: a virtual robot drives through, since nothing is there; an actual one stops before it. Driven
    on without a look, it runs into the chair, and its bumper says so."""
    for name in ("virtual", "actual"):
        (tmp_path / name).mkdir()
    with robot_process(tmp_path / "virtual", system_orb, "V", *WHERE) as robot:
        state = run(robot.agent, watched())
        assert (state.program.result, len(robot.agent.begun(0))) == (ProgramResult.DONE, 3)
        assert state.at.x == pytest.approx(START[0] + 3.0, abs=0.02)
    actual = (*WHERE, "--protect", "off", "--adaptor", "smartpal", "--", "--naming", str(stand_in.naming))
    with robot_process(tmp_path / "actual", system_orb, "A", *actual) as robot:
        assert [sensor.name for sensor in sensors(system_orb, "A").rangeSensors()] == ["laser", "proximity"]
        state = run(robot.agent, watched())
        assert (state.program.result, state.program.reason) == (ProgramResult.DONE, "")
        assert [icon.kind for icon in robot.agent.begun(0)][-1] == "wait"
        stopped_at = CHAIR_X - STOP_M
        assert stopped_at - 0.05 < state.at.x < stopped_at + LATE_M
        assert contacts(system_orb, "A") == 0.0
        hit = run(robot.agent, blind(1.0), AgentCondition.STOPPED)
        assert "Mobility" in hit.reason
        assert hit.actor.x == pytest.approx(CHAIR_X - 0.4, abs=0.03)
        assert contacts(system_orb, "A") == 1.0
        robot.agent.reset_stop()
        assert run(robot.agent, blind(-0.2)).program.result is ProgramResult.DONE
        run(robot.agent, blind(1.0), AgentCondition.STOPPED)
        assert contacts(system_orb, "A") == 2.0
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    assert server._get_state().collisions == 0  # its body in the building met nothing


class Standing(RobotAdaptor, Senses):
    """A driver in this process whose robot stands at START, and the distance that its laser measures."""

    def __init__(self) -> None:
        self.senses, self.distance_m, self.count = self, 8.0, 0

    def start(self, argv: Sequence[str]) -> bool:
        return True

    def stop(self) -> bool:
        return True

    def read(self, state: RobotState) -> bool:
        self.count += 1
        state.time, (state.x, state.y, state.heading) = 0.02 * self.count, START
        return True

    def write(self, command: ActorCommand) -> bool:
        return True

    @property
    def sensors(self) -> Sequence[RangeSensor]:
        return usual_sensors()[:1]

    def ranges(self, name: str) -> Ranges:
        return Ranges(0.02 * self.count, np.full(self.sensor(name).spec.fan.count, self.distance_m))

    def readings(self) -> Sequence[Reading]:
        return [Reading("bumper", "contacts", 0.02 * self.count, 7.0)]


def test_a_program_that_senses_is_refused_behind_an_adaptor_without_sensors(system_orb: Orb, tmp_path: Path) -> None:
    driver = Standing()
    system_orb.accept_calls()
    four_methods, with_senses = (
        system_orb.uri(system_orb.activate(kind(driver))) for kind in (RobotAdaptorServant, SensingAdaptorServant)
    )
    with robot_process(tmp_path, system_orb, "C", *WHERE) as robot:
        robot.agent.load(watched())  # on the virtual robot
        robot.agent.switch("corba", ["--uri", four_methods])
        assert sensors(system_orb, "C") is None
        lacks = "the adaptor corba has no sensor laser; it has no sensors"
        with pytest.raises(InvalidProgram, match=lacks) as refused:
            robot.agent.load(watched())
        assert (refused.value.icon, refused.value.parameter) == ("icons[0]", "sensor")
        with pytest.raises(IllegalOrder, match=lacks):
            robot.agent.run()
        (finding,) = robot.agent.check(watched()).findings
        assert lacks in str(finding)

        robot.agent.switch("corba", ["--uri", with_senses])
        assert contacts(system_orb, "C") == 7.0
        with pytest.raises(RoboCorba.UnknownSensor) as unknown:
            sensors(system_orb, "C").ranges("sonar")
        assert (unknown.value.name, unknown.value.known) == ("sonar", ["laser"])
        robot.agent.load(watched())
        robot.agent.run()
        eventually(lambda: robot.agent.state().program.icon.startswith("icons[0].icons"), PATIENCE_S, "driving")
        driver.distance_m = 0.9
        eventually(lambda: robot.agent.state().program.result is ProgramResult.DONE, PATIENCE_S, "stopped")
        assert [icon.kind for icon in robot.agent.begun(0)] == ["stop_if_closer", "mbase_by", "branch", "wait"]

        driver.distance_m = math.nan  # its laser fails: the robot does not drive on blindly
        state = run(robot.agent, watched())
        assert state.program.result is ProgramResult.FAILED
        assert "the laser sensor gave no distance for 1 s: laser must send 181 distances" in state.program.reason


def test_no_contact_is_missing_from_the_bumper_of_a_virtual_robot(system_orb: Orb, tmp_path: Path) -> None:
    """Another robot pushes it while it rests, so that it reads its state twice a second; both count each contact."""
    server = system_orb.resolve("SimulationServer", RoboCorba.SimulationServer)
    with robot_process(tmp_path, system_orb, "B", *WHERE):
        pusher = server.registerRobot(about("pusher", START[0] + 1.0, START[1], math.pi))
        try:
            for count in range(1, 4):

                def drive(speed: float, is_there: Any) -> None:
                    def step() -> bool:
                        pusher.command(RoboCorba.Velocity(speed, 0.0, 0.0), 0.3)
                        return bool(is_there(pusher.state()))

                    eventually(step, PATIENCE_S, "the pusher")

                drive(0.4, lambda state, count=count: state.collisions >= count)
                left_at = pusher.state().at.x
                drive(-0.4, lambda state, left_at=left_at: state.at.x > left_at + 0.15)
            eventually(lambda: contacts(system_orb, "B") >= 3.0, PATIENCE_S, "that it has read them")
            assert contacts(system_orb, "B") == pusher.state().collisions == 3
        finally:
            pusher.deregister()
