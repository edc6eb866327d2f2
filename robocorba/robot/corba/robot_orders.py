"""Orders from other systems to one robot: velocities, goals and programs, executed by its control agent."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from robocorba.errors.robots import IllegalOrder, InvalidProgram, MotionFailed
from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.pose import Pose
from robocorba.robot.agent_state import TELEOPERATION, AgentCondition, AgentState, ProgramResult
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.display import Display
from robocorba.robot.motion.robot_state import Velocity
from robocorba.robot.programs import program
from robocorba.robot.programs.graphic_programming import ProgramBuilder
from robocorba.system.last_order import LastOrder

#: Name of the program that drives to a goal.
GOAL = "goal_pose"

Answer = TypeVar("Answer")


class RobotOrders:
    """Thread-safe. connect: finds the robot's agent, raises NotReachable. warn: reports an order that failed."""

    def __init__(self, name: str, connect: Callable[[], RemoteAgent], warn: Callable[[str], None]) -> None:
        self.name = name
        self._connect, self._warn = connect, warn
        self._lock = threading.Lock()
        self._agent: RemoteAgent | None = None
        #: The last program that was loaded and was no goal; empty if none is known.
        self._program = ""
        #: The goal to which the robot was sent last, and the last one of which it is known what became of it.
        self._driven: Pose | None = None
        self._ended: Pose | None = None
        self._problems: dict[str, tuple[str, float]] = {}
        self._velocities = LastOrder(f"{name} velocity", self._drive, lambda why: self._note("velocity", why))
        self._goals = LastOrder(f"{name} goal", self._drive_to, lambda why: self._note("goal", why))

    def close(self) -> None:
        """No further orders."""
        self._velocities.close()
        self._goals.close()

    def drive(self, velocity: Velocity, valid_s: float = 0.5) -> None:
        """Drive at a velocity ahead and to the left [m/s], turn [rad/s], for some time [s] after the last message."""
        self._velocities.give((velocity, valid_s, time.monotonic()))

    def drive_to(self, goal: Pose) -> None:
        """Drive to a pose, instead of to an earlier one."""
        self._goals.give(goal)

    def load(self, json: str) -> None:
        """Load a program in JSON. Raises InvalidProgram, IllegalOrder, NotReachable."""
        self.order(lambda agent: agent.load(json))
        self._program = json

    def run(self) -> None:
        """Run the loaded program: the robot's, or if a goal has taken its place, the one that was loaded before.

        Raises InvalidProgram, IllegalOrder, NotReachable."""
        self.order(self._load_again)
        self.order(lambda agent: agent.run())

    def look(self) -> tuple[AgentState, Display]:
        """The robot's state and display; reports a goal that was not reached. Raises NotReachable."""
        driven = self._driven
        state, display = self.order(lambda agent: (agent.state(), agent.display()))
        result = state.program.result if state.program.name == GOAL else ProgramResult.DONE
        if driven and driven is self._driven is not self._ended and result is not ProgramResult.NO_RESULT:
            self._ended = driven
            if result is not ProgramResult.DONE:
                at = f"{driven.floor}:{driven.x:.2f},{driven.y:.2f}"
                self._warn(f"{self.name}: goal {at} was not reached: {result.name.lower()}: {state.program.reason}")
        return state, display

    def order(self, order: Callable[[RemoteAgent], Answer]) -> Answer:
        """Call the agent, which may be a new process by now. Raises what it raises, and NotReachable."""
        with self._lock:
            agent = self._agent
        if agent is not None:
            try:
                return order(agent)
            except NotReachable:
                pass
        agent = self._connect()
        with self._lock:
            self._agent = agent
        return order(agent)

    def _drive(self, order: tuple[Velocity, float, float]) -> None:
        velocity, valid_s, given_at = order
        if time.monotonic() - given_at < 0.5:  # else it has waited for its turn for too long
            self.order(lambda agent: agent.drive(velocity, valid_s))

    def _drive_to(self, goal: Pose) -> None:
        drive = ProgramBuilder(GOAL).mbase_path(goal.floor, goal.x, goal.y, goal.heading).program()
        self._driven = None
        self.order(_end_drive)
        self.order(self._remember)
        self.order(lambda agent: agent.load(program.dumps(drive)))
        self.order(lambda agent: agent.run())
        self._driven = goal

    def _remember(self, agent: RemoteAgent) -> None:
        """Keep the program whose place a goal takes."""
        loaded = agent.program()
        if loaded and not _is_goal(loaded):
            self._program = loaded

    def _load_again(self, agent: RemoteAgent) -> None:
        if _is_goal(agent.program()):
            if not self._program:
                raise IllegalOrder("run a program", "has loaded none, only driven to a goal")
            agent.load(self._program)

    def _note(self, kind: str, why: str) -> None:
        """Report a problem once every 2 s."""
        before, at_s = self._problems.get(kind, ("", 0.0))
        now_s = time.monotonic()
        if why and (why != before or now_s - at_s >= 2.0):
            self._warn(f"{self.name}: {kind}: {why}")
            self._problems[kind] = why, now_s
        elif not why:
            self._problems.pop(kind, None)


def _is_goal(loaded: str) -> bool:
    """Whether a loaded program is a drive to a goal."""
    try:
        return program.loads(loaded).name == GOAL
    except InvalidProgram:  # none is loaded, or one of another release
        return False


def _end_drive(agent: RemoteAgent) -> None:
    """End teleoperation, and a drive to an earlier goal. Raises IllegalOrder if another program runs, MotionFailed if
    it has not ended within 5 s."""
    state = agent.state()
    if state.condition is AgentCondition.IDLE:
        return
    if state.program.name not in (GOAL, TELEOPERATION) or state.program.result is not ProgramResult.NO_RESULT:
        raise IllegalOrder("drive to a goal", f"is {state.condition.name}: {state.reason or state.program.name}")
    agent.abort()
    deadline = time.monotonic() + 5.0
    while agent.state().condition is not AgentCondition.IDLE:
        if time.monotonic() > deadline:
            raise MotionFailed("the last drive did not end within 5 s")
        time.sleep(0.05)
