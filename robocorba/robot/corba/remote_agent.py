"""Client of robots' control agents, for operators and leaders."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from omniORB import CORBA

from robocorba.errors.base import RoboCorbaError
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import Answer, translated
from robocorba.robot.agent_state import MAX_REPORTS, AgentState, IconBegun, Question, RunReport
from robocorba.robot.corba import robot_states
from robocorba.robot.display import Display, display_of
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.programs.report import CheckReport
from robocorba.stubs import RoboCorba
from robocorba.system.background import Background
from robocorba.system.names import ROBOT_AGENT, ROBOTS
from robocorba.system.settings import Address, RoleNaming


class OrderLimits(NamedTuple):
    """How robots get an order together. at_once: of them at a time. Timeouts for finding each, and for all [s]."""

    at_once: int
    resolve_s: float
    all_s: float


#: An emergency stop: nobody waits for others.
URGENT = OrderLimits(10_000, 1.0, 5.0)
#: A restart, which is not urgent: of 200 robots that restart at once, some do not answer within the limits of an
#: emergency stop, and stayed stopped.
CALM = OrderLimits(16, 5.0, 60.0)


class RemoteAgent:
    """The agent of the robot `name`, or of the one whose computer listens at HOST:PORT, without a naming service. A
    role of a guarded system has its rights by the naming service, so it asks the computer for the robot's name only.

    Raises NotReachable if it is not found within `timeout_s`, and in calls that it does not answer within 3 s, or 40 s
    where it checks a program or starts an adaptor; InvalidSetting for a wrong HOST:PORT."""

    def __init__(self, orb: Orb, name: str, timeout_s: float = 3.0) -> None:
        self.name = name
        if ":" in name:  # which no name of a robot contains
            at = orb.uri_at(Address.parse(name, "address of the robot's computer"), ROBOT_AGENT)
            self._agent = orb.reference(at, RoboCorba.RobotAgent, 3.0)
            self.name = str(self._call(self._agent._get_name))
        if ":" not in name or isinstance(orb.naming, RoleNaming):
            self._agent = orb.resolve(f"{ROBOTS}/{self.name}", RoboCorba.RobotAgent, timeout_s, 3.0)
        self._slow_agent = orb.reference(orb.uri(self._agent), RoboCorba.RobotAgent, 40.0)

    def state(self) -> AgentState:
        return robot_states.agent_state_of(self._call(self._agent._get_state))

    def display(self) -> Display:
        """What its touch panel shows."""
        return self._call(lambda: shown_by(self._agent))

    def question(self) -> Question:
        """What its program asks a person."""
        return self._call(lambda: question_of(self._agent))

    def answer(self, number: int, is_yes: bool) -> None:
        """Raises IllegalOrder if this question is not asked at present."""
        self._call(lambda: self._agent.answer(number, is_yes))

    def mission(self) -> str:
        """The mission that the robot leads or takes part in; empty for none."""
        return str(self._call(self._agent._get_mission))

    def channel(self) -> str:
        """The event channel of its sub-network; empty for none."""
        return str(self._call(self._agent._get_channel))

    def program(self) -> str:
        """The loaded program in JSON; empty if there is none."""
        return str(self._call(self._agent._get_program))

    def check(self, json: str) -> CheckReport:
        """Check a program from the robot's present state, also while another one runs."""
        return robot_states.program_check_of(self._call(lambda: self._slow_agent.checkProgram(json)))

    def load(self, json: str) -> None:
        """Raises InvalidProgram, IllegalOrder."""
        self._call(lambda: self._slow_agent.loadProgram(json))

    def fingerprint(self, json: str) -> str:
        """What the robot checks a program against at present. Raises InvalidProgram."""
        return str(self._call(lambda: self._slow_agent.fingerprint(json)))

    def upload(self, json: str, checked: str) -> int:
        """Load a program on the robot's own computer, which keeps it; returns the number of the upload. checked: the
        fingerprint of what it was checked against. Raises InvalidProgram, IllegalOrder, FingerprintMismatch."""
        return int(self._call(lambda: self._slow_agent.upload(json, checked)))

    def reports(self, since: str) -> tuple[list[RunReport], str]:
        """All reports of runs that are kept on the robot's own computer, and what to pass for later ones. since: that
        of an earlier answer, empty for all."""
        found: list[RunReport] = []
        while len(found) < MAX_REPORTS:
            page, since = robot_states.run_reports_of(self._call(partial(self._agent.reports, since)))
            found += page
            if not page:
                break
        return found, since

    def sensors(self) -> list[str]:
        """Names of its range sensors."""
        found = self._call(self._agent._get_sensors)
        return [sensor.name for sensor in self._call(found.rangeSensors)] if found else []

    def run(self, is_stepping: bool = False) -> None:
        """Raises IllegalOrder."""
        self._call(lambda: self._agent.run(is_stepping))

    def begun(self, first: int) -> list[IconBegun]:
        """Icons that have begun, from number `first`."""
        return [robot_states.begun_of(struct) for struct in self._call(lambda: self._agent.iconsFrom(first))]

    def pause(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.pause)

    def resume(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.resume)

    def step(self) -> None:
        """Raises IllegalOrder."""
        self._call(self._agent.step)

    def abort(self) -> None:
        self._call(self._agent.abort)

    def abort_mission(self, mission: str) -> None:
        """Abort this mission. Raises UnknownMission if the robot does not lead it."""
        self._call(lambda: self._agent.abortMission(mission))

    def stop(self) -> None:
        """Emergency stop."""
        self._call(self._agent.stop)

    def reset_stop(self) -> None:
        """Raises IllegalOrder, AdaptorFailed."""
        self._call(self._slow_agent.resetStop)

    def switch(self, adaptor: str, argv: Sequence[str]) -> None:
        """Raises UnknownAdaptor, IllegalOrder, AdaptorFailed."""
        self._call(lambda: self._slow_agent.switchAdaptor(adaptor, list(argv)))

    def adaptors(self) -> list[str]:
        """Names of the installed adaptors."""
        return list(self._call(self._agent.adaptors))

    def drive(self, velocity: Velocity, valid_for_s: float) -> None:
        """Drive at a velocity of the base, ahead and to the left [m/s], turn [rad/s], for some time [s] or until the
        next call. Raises InvalidChoice, IllegalOrder."""
        self._call(lambda: self._agent.drive(RoboCorba.Velocity(*velocity), valid_for_s))

    def _call(self, call: Callable[[], Answer]) -> Answer:
        with translated(f"robot {self.name}"):
            return call()


def shown_by(agent: Any) -> Display:
    """What the touch panel of a robot shows, by its reference. One of 0.1.0 does not say what it waits for."""
    try:
        return robot_states.display_of(agent._get_display())
    except (CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT):
        state = robot_states.agent_state_of(agent._get_state())
        return display_of(state.condition, state.reason, state.program)


def question_of(agent: Any) -> Question:
    """What the program of a robot asks, by its reference. Robots of earlier releases ask nothing."""
    try:
        asked = agent._get_question()
    except (CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT):
        return Question()
    return Question(asked.number, asked.text)


def robots(orb: Orb) -> list[str]:
    """Names of the robots whose agents are bound. Raises NotReachable."""
    return orb.names(ROBOTS)


def displays(orb: Orb) -> dict[str, Display | None]:
    """What all robots show on their touch panels, by name; None for one that does not answer within a second. Raises
    NotReachable."""
    shown: dict[str, Display] = {}

    def ask(agent: RemoteAgent) -> None:
        shown[agent.name] = agent.display()

    names = [name for name, _ in order_all(orb, robots(orb), ask, OrderLimits(16, 0.5, 1.0))]
    return {name: shown.get(name) for name in names}


def order_all(
    orb: Orb, names: Sequence[str], order: Callable[[RemoteAgent], None], limits: OrderLimits = URGENT
) -> Iterator[tuple[str, str]]:
    """Give an order to robots; each name with the reason if the robot did not confirm, else empty."""
    results: dict[str, str] = {}
    places, deadline = threading.Semaphore(limits.at_once), time.monotonic() + limits.all_s

    def call(name: str) -> None:
        with places:
            if time.monotonic() >= deadline:
                return
            try:
                order(RemoteAgent(orb, name, limits.resolve_s))
                results[name] = ""
            except RoboCorbaError as error:
                results[name] = str(error)

    calls = [Background(f"order to {name}", partial(call, name), partial(results.__setitem__, name)) for name in names]
    for thread in calls:
        thread.start()
    for name, thread in zip(names, calls, strict=True):
        thread.join(max(0.0, deadline - time.monotonic()))
        yield name, results.get(name, f"did not answer within {limits.all_s:g} s")
