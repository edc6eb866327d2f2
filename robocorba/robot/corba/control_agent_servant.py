"""Servant of a robot's control agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robocorba.errors.robots import InvalidProgram
from robocorba.errors.services import NotReachable
from robocorba.map_editor.element_rules import name_violations
from robocorba.orb.exceptions import forwarded, translating
from robocorba.orb.server_release import ServerServant
from robocorba.planning.corba import paths
from robocorba.robot import model_switcher
from robocorba.robot.agent import ControlAgent
from robocorba.robot.corba import robot_states
from robocorba.robot.kinematics.body import SmartPalBody
from robocorba.robot.kinematics.smartpal import JOINTS
from robocorba.robot.programs import program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.runner import OtherRobots
from robocorba.robot.uploads import CheckedPrograms
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.stop_latch import EMERGENCY_STOP


class StopTargetServant(RoboCorba__POA.StopTarget):
    """RoboCorba::StopTarget of a robot. stop: called with the reason and the number of a stop, by default that of the
    agent."""

    def __init__(self, agent: ControlAgent, stop: Callable[[str, int], None] | None = None) -> None:
        self._agent, self._stop = agent, stop or agent.stop

    def stop(self, reason: str) -> Any:
        return self.stopNumbered(reason, 0)

    def stopNumbered(self, reason: str, number: int) -> Any:
        self._stop(reason or EMERGENCY_STOP, number)  # also one that is stopped until it answers again
        return self._get_answer()

    def _get_answer(self) -> Any:
        return RoboCorba.StopAnswer(*self._agent.stop_answer)


class RobotAgentServant(ServerServant, RoboCorba__POA.RobotAgent):
    """RoboCorba::RobotAgent. pool, sensors: references of its data pool and its senses. channel: the event channel of
    its sub-network."""

    def __init__(
        self, agent: ControlAgent, pool: Any, sensors: Any, channel: str, others: OtherRobots, programs: CheckedPrograms
    ) -> None:
        self._agent, self._pool, self._sensors, self._channel = agent, pool, sensors, channel
        self._others, self._programs = others, programs

    def _get_name(self) -> str:
        return self._agent.name

    @translating
    def _get_state(self) -> Any:
        return robot_states.agent_state(self._agent.state)

    @translating
    def _get_display(self) -> Any:
        return robot_states.display(self._agent.display)

    def _get_question(self) -> Any:
        return RoboCorba.AgentQuestion(*self._agent.question)

    def _get_pool(self) -> Any:
        return self._pool

    def _get_program(self) -> str:
        loaded = self._agent.program
        return program.dumps(loaded) if loaded else ""

    def _get_channel(self) -> str:
        return self._channel

    def _get_path(self) -> list[Any]:
        return [paths.path_point(point) for point in self._agent.path]

    def _get_mission(self) -> str:
        return self._others.mission

    def _get_sensors(self) -> Any:
        return self._sensors if self._agent.senses else None

    @translating
    def _get_linkPoses(self) -> Any:
        state = self._agent.state
        actor, found = state.actor, {}
        if len(actor.joints) == len(JOINTS):  # a body of its own, since they are not thread-safe
            found = SmartPalBody().links_at((actor.x, actor.y, actor.heading), actor.joints)
        links = [RoboCorba.LinkPose(name, *at, *turn[1:], turn[0]) for name, (at, turn) in found.items()]
        return RoboCorba.RobotLinks(actor.time, state.at.floor, links)

    @translating
    def checkProgram(self, json: str) -> Any:
        try:
            return robot_states.program_check(self._agent.check(program.loads(json)))
        except InvalidProgram as error:  # it can't be read, so there is one finding
            return robot_states.program_check(CheckReport(error))
        except NotReachable as error:  # the path planning agent, without which drives can't be checked
            return robot_states.program_check(CheckReport(InvalidProgram("", "", f"can't be checked: {error}")))

    def startMission(self, mission: str, icon: str) -> None:
        self.leadMission(mission, icon, 0)

    @translating
    def leadMission(self, mission: str, icon: str, term: int) -> None:
        for reason in name_violations("its name", mission):
            raise InvalidProgram("", "mission", reason)
        self._others.lead_mission(mission, program.of_icon(icon), term)

    abortMission = forwarded("_others", OtherRobots.abort_mission)

    @translating
    def loadProgram(self, json: str) -> None:
        self._agent.load(program.loads(json))

    @translating
    def fingerprint(self, json: str) -> str:
        return str(self._programs.fingerprint(json))

    upload = forwarded("_programs", CheckedPrograms.upload)

    @translating
    def reports(self, since: str) -> Any:
        return robot_states.run_reports(*self._programs.reports(since))

    run = forwarded("_agent", ControlAgent.run)

    def iconsFrom(self, number: int) -> list[Any]:
        return [robot_states.begun(icon) for icon in self._agent.begun(number)]

    pause = forwarded("_agent", ControlAgent.pause)
    resume = forwarded("_agent", ControlAgent.resume)
    step = forwarded("_agent", ControlAgent.step)
    answer = forwarded("_agent", ControlAgent.answer)

    def abort(self) -> None:
        self._agent.abort()

    def stop(self) -> None:
        self._agent.stop_durably()

    resetStop = forwarded("_agent", ControlAgent.reset_stop)
    switchAdaptor = forwarded("_agent", ControlAgent.switch)

    def adaptors(self) -> list[str]:
        return model_switcher.installed()

    @translating
    def drive(self, wanted: Any, valid_for: float) -> None:
        self._agent.drive((wanted.ahead, wanted.left, wanted.turn), valid_for)

    setSpeedCap = forwarded("_agent", ControlAgent.cap_speed)
