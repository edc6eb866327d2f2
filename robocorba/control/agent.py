"""The control agent of one robot: it runs programs on whatever adaptor it was given, and stops it when it must."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
from collections.abc import Callable, Sequence
from enum import Enum
from typing import NamedTuple, Protocol, TypeVar

from robocorba.collision_avoidance.neighbours import Nearby
from robocorba.control import model_switcher
from robocorba.control.high_controller import HighController
from robocorba.control.model_switcher import Surroundings
from robocorba.control.robot import Robot
from robocorba.control.runner import Begun, OtherRobots, Report, Result, Runner
from robocorba.control.sensors import Sensors
from robocorba.control.session import SessionState
from robocorba.control.tick_file import Tick, TickFile
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotError, RobotLost
from robocorba.errors.simulation import InvalidChoice, SimulationError
from robocorba.kinematics.inverse import InverseKinematics
from robocorba.kinematics.smartpal import BASE, LOWER, RADIUS_M, SPEED, UPPER
from robocorba.motion.robot_state import ActorCommand, RobotState, Velocity
from robocorba.programs.base_checks import Planner
from robocorba.programs.program import Program
from robocorba.repeating import Repeating
from robocorba.simulation.registry import Pose
from robocorba.spatial.frames import into, turned

#: The robot's body in the building goes where an actual robot goes: so much of what is missing in a second, 1/s, and
#: how long each command holds, s.
FOLLOW_GAIN, FOLLOW_VALID_S = 5.0, 0.1
#: A body that is so far behind is held up by who or what stands there in the building: for its robot that is as if it
#: stood in its own way. One that is still farther away can't get there, m.
BODY_BLOCKED_M, BODY_LOST_M = 0.1, 1.0
#: The lease is renewed so often also where no command does it, s.
LEASE_CHECK_S = 0.5
#: A program that was told to end has so long for it, s.
END_LIMIT_S = 5.0

_log = logging.getLogger(__name__)


class Condition(Enum):
    """Of the agent."""

    IDLE = 0
    RUNNING = 1
    PAUSED = 2
    STOPPED = 3


class AgentState(NamedTuple):
    """reason: why it is stopped. speed_cap: m/s. jitter_s: the latest tick of the last ten seconds."""

    name: str
    adaptor: str
    condition: Condition
    reason: str
    at: Pose
    actor: RobotState
    speed_cap: float
    jitter_s: float
    program: Report


class Task(Protocol):
    """What an agent lets a robot do: a program, or a part in a mission."""

    @property
    def report(self) -> Report:
        """How it gets on; its result once it has ended."""

    def begun(self, first: int) -> list[Begun]:
        """Icons, or steps, that have begun: from a number on."""

    def run(self) -> object:
        """To its end."""


TaskT = TypeVar("TaskT", bound=Task)


class ControlAgent:
    """check: refuses a program that can't be run from here; raises InvalidProgram. ticks: takes those of programs.
    nearby: what the robot knows of others. Safe from any thread."""

    def __init__(
        self,
        surroundings: Surroundings,
        planner: Planner,
        others: OtherRobots,
        check: Callable[[Program, AgentState], None] = lambda program, state: None,
        ticks: TickFile | None = None,
        nearby: Nearby | None = None,
    ) -> None:
        self._surroundings, self._planner, self._others, self._check = surroundings, planner, others, check
        self._ticks, self._nearby = ticks, nearby
        self.name, self.session = surroundings.name, surroundings.session
        self._kinematics = InverseKinematics()
        self._lock = threading.RLock()
        self._controller: HighController | None = None
        self._adaptor = ""
        self._robot: Robot | None = None
        self._program: Program | None = None
        self._task: Task | None = None
        self._thread: threading.Thread | None = None
        self._cap: float | None = None
        self._is_virtual = False
        #: How far its body may be behind an actual robot that moves, m. One that has just been started may be somewhat
        #: away from it: bodies brake more gently.
        self._held_at_m = math.inf
        self._lease = Repeating("lease", self._renew, LEASE_CHECK_S)

    # ---- its life ----

    def start(self, adaptor: str, argv: Sequence[str] = ()) -> None:
        """Log on, and take a robot over. Raises UnknownAdaptor, AdaptorFailed, SimulationError, UnknownFloor."""
        with self._lock:
            self._lease.start()  # an actual robot may take longer to start than a lease lasts
            self._take(adaptor, argv)

    def close(self) -> None:
        """Let the robot stand, and log off."""
        self.abort()
        if self._controller:
            self._controller.close()
        self._join()
        self._lease.close()
        self.session.log_off()

    def switch(self, adaptor: str, argv: Sequence[str]) -> None:
        """Another robot behind the same agent; the former one is let go first, and taken back where the new one can't
        be started. Raises UnknownAdaptor, AdaptorFailed; IllegalOrder while a program runs."""
        with self._lock:
            self._refuse_while_running("switch to another robot")
            controller, before = self._controller, self._adaptor
            if controller is None:
                raise IllegalOrder("switch to another robot", "was never started")
            argv_before = controller.argv
            model_switcher.make(adaptor, self._surroundings)  # an unknown one changes nothing
            controller.close()
            try:
                self._take(adaptor, argv)
            except RoboCorbaError as wrong:
                self._take(before, argv_before)
                raise wrong if isinstance(wrong, RobotError) else AdaptorFailed(str(wrong)) from None

    # ---- programs ----

    def load(self, program: Program) -> None:
        """Raises InvalidProgram; IllegalOrder while one runs."""
        with self._lock:
            self._refuse_while_running("load a program")
            self._check(program, self.state)
            self._program = program

    def run(self, is_stepping: bool = False) -> None:
        """Begin what was loaded. Raises IllegalOrder."""
        with self._lock:
            self._refuse_while_running("run a program")
            robot = self.robot
            if self._program is None:
                raise IllegalOrder("run a program", "has none loaded")
            robot.course.reset(is_stepping)
            self._begin(Runner(self._program, robot, self._others))

    def begun(self, first: int) -> list[Begun]:
        """Icons of the program that runs, or ran last, that have begun: from a number on."""
        return self._task.begun(first) if self._task else []

    def pause(self) -> None:
        """Raises IllegalOrder where no program runs."""
        self._running("pause").course.pause()

    def resume(self) -> None:
        """Raises IllegalOrder where no program runs."""
        self._running("go on").course.resume()

    def step(self) -> None:
        """Raises IllegalOrder where no program runs."""
        self._running("step").course.step()

    def abort(self) -> None:
        """End the program, if one runs; the robot slows down and stands."""
        if self._robot and self._is_running:
            self._robot.course.abort()

    # ---- missions ----

    @property
    def is_free(self) -> bool:
        """Whether it could begin something now."""
        controller = self._controller
        return controller is not None and not controller.stopped and not self._is_running

    @property
    def is_busy(self) -> bool:
        """Whether it does something now, and will be free again."""
        controller = self._controller
        return controller is not None and not controller.stopped and self._is_running

    @property
    def place(self) -> Pose:
        """Where the robot is."""
        return self.state.at

    def begin_part(self, make: Callable[[Robot], TaskT], for_own_mission: bool = False) -> TaskT:
        """Begin a part in a mission, as a program is begun; beside the program that leads the mission, where it is the
        robot's own one. Raises IllegalOrder."""
        with self._lock:
            if not for_own_mission:
                self._refuse_while_running("take part in a mission")
            robot = self.robot
            if for_own_mission:
                part = make(robot)
                threading.Thread(target=part.run, name="own part", daemon=True).start()
                return part
            robot.course.reset(False)
            part = make(robot)
            self._begin(part)
            return part

    # ---- safety ----

    def stop(self, reason: str = "emergency stop") -> None:
        """The robot stands as soon as it can, and stays so. Needs no lock: it works while everything else hangs."""
        if (robot := self._robot) and self._is_running:
            robot.course.abort(reason)
        if controller := self._controller:
            controller.emergency_stop(reason)

    def reset_stop(self) -> None:
        """Let the robot be started again. Raises IllegalOrder where it was not stopped, AdaptorFailed."""
        with self._lock:
            self._refuse_while_running("start again")
            if self._controller is None:
                raise IllegalOrder("start again", "was never started")
            self._controller.reset_stop()

    def cap_speed(self, speed: float) -> None:
        """Nothing moves faster, m/s. Raises InvalidChoice."""
        if not 0.0 < speed <= BASE.speed:
            raise InvalidChoice("speed", f"{speed} is not above 0 and at most {BASE.speed:g} m/s")
        self._cap = speed
        if self._controller:
            self._controller.speed_cap = speed

    # ---- what there is to see ----

    @property
    def state(self) -> AgentState:
        controller = self._controller
        if controller is None:
            raise RobotLost(f"{self.name} was not started")
        actor = controller.state
        at = Pose(self.session.latest.at.floor, actor.x, actor.y, actor.heading)
        return AgentState(
            self.name,
            self._adaptor,
            self._condition(controller),
            controller.stopped,
            at,
            actor,
            controller.speed_cap,
            controller.jitter_s,
            self._report,
        )

    @property
    def robot(self) -> Robot:
        """What programs move. Raises IllegalOrder where none was started, or it is stopped."""
        if self._controller is None or self._robot is None:
            raise IllegalOrder("move", "was never started")
        if self._controller.stopped:
            raise IllegalOrder("move", f"is stopped: {self._controller.stopped}")
        return self._robot

    def _condition(self, controller: HighController) -> Condition:
        if controller.stopped:
            return Condition.STOPPED
        if not self._is_running:
            return Condition.IDLE
        return Condition.PAUSED if self._robot and self._robot.course.is_paused else Condition.RUNNING

    # ---- inside ----

    def _take(self, adaptor: str, argv: Sequence[str]) -> None:
        made = model_switcher.make(adaptor, self._surroundings)
        self.session.log_on()
        self.session.state()
        self._is_virtual = made.is_in_building
        controller = HighController(made, BASE, LOWER, UPPER, SPEED, self._follow, self._told, self._log_on)
        if self._cap is not None:
            controller.speed_cap = self._cap
        controller.start(argv)
        self._controller, self._adaptor = controller, adaptor
        sensors = Sensors(self.session, lambda: controller.state, RADIUS_M)
        self._robot = Robot(controller, self.session, sensors, self._kinematics, self._planner, self._nearby)

    @property
    def _is_running(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _refuse_while_running(self, order: str) -> None:
        if self._is_running and self._report.result is not Result.NO_RESULT:
            self._join()  # it is just ending
        if self._is_running:
            raise IllegalOrder(order, "runs a program")

    def _running(self, order: str) -> Robot:
        if not self._is_running or self._robot is None:
            raise IllegalOrder(order, "runs no program")
        return self._robot

    def _join(self) -> None:
        if self._thread:
            self._thread.join(END_LIMIT_S)

    def _begin(self, task: Task) -> None:
        self._task = task
        self._thread = threading.Thread(target=task.run, name="program", daemon=True)
        self._thread.start()

    @property
    def _report(self) -> Report:
        return self._task.report if self._task else Report()

    def _log_on(self) -> None:
        """Before each start of the adaptor: a server that has forgotten the robot learns of it again. A body that was
        held up far from its robot, which can't get to it, is put where that is."""
        try:
            self.session.log_on()
            body = self.session.state().at
            self._held_at_m = math.inf
            if not self._is_virtual and self._controller:
                robot = self._controller.state
                if math.hypot(robot.x - body.x, robot.y - body.y) > BODY_LOST_M:
                    self.session.log_off()
                    self.session.log_on(Pose(body.floor, robot.x, robot.y, robot.heading))
                    self.session.state()
        except (SimulationError, UnknownFloor) as wrong:
            raise RobotLost(f"the simulation server refuses the robot: {wrong}") from None

    def _renew(self) -> None:
        if controller := self._controller:
            controller.check_alive()
        with contextlib.suppress(RobotLost):  # the controller notices it too, and tells
            self.session.heartbeat()

    def _follow(self, state: RobotState) -> None:
        """Where the robot is an actual one: keep the lease, and lead its body in the building after it."""
        if self._is_virtual:
            return
        body = self.session.state()
        missing = math.hypot(state.x - body.at.x, state.y - body.at.y)
        if missing > BODY_LOST_M:
            raise RobotLost(_why_away(body, missing))
        if missing < BODY_BLOCKED_M / 2:
            self._held_at_m = BODY_BLOCKED_M
        elif math.isinf(self._held_at_m):
            self._held_at_m = missing + BODY_BLOCKED_M
        elif missing > self._held_at_m:
            self._held_at_m = missing + BODY_BLOCKED_M  # it has to brake, and may go back
            if self._controller:
                self._controller.cancel(MotionFailed(_why_away(body, missing)))
        self.session.command(_towards(state, body.at), FOLLOW_VALID_S)

    def _told(self, state: RobotState, command: ActorCommand) -> None:
        report = self._report
        if self._ticks and report.icon and report.result is Result.NO_RESULT:
            floor = self.session.latest.at.floor
            self._ticks.add(Tick(self._adaptor, report.name, report.icon, report.icons_done, floor, state, command))


def _why_away(body: SessionState, missing_m: float) -> str:
    return f"its body in the building is {missing_m:.2f} m away, held by {body.touched or 'a wall'}"


def _towards(robot: RobotState, body: Pose) -> Velocity:
    """The velocity of a body that follows a robot, in the body's frame."""
    beside = math.remainder(robot.heading - body.heading, math.tau)
    ahead, left = turned(robot.velocity[0], robot.velocity[1], beside)
    missing_ahead, missing_left = into(robot.x, robot.y, body[1:])
    return (
        ahead + FOLLOW_GAIN * missing_ahead,
        left + FOLLOW_GAIN * missing_left,
        robot.velocity[2] + FOLLOW_GAIN * beside,
    )
