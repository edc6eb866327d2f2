"""The control agent of one robot: runs programs through its adaptor, and stops the robot on faults."""

from __future__ import annotations

import contextlib
import functools
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from shapely.geometry.base import BaseGeometry

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.paths import UnknownFloor
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotError, RobotLost
from robocorba.errors.simulation import InvalidChoice, SimulationError
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import into, turned
from robocorba.planning.request import PathPoint
from robocorba.robot import model_switcher
from robocorba.robot.agent_state import AgentCondition, AgentState, IconBegun, ProgramReport, ProgramResult, Question
from robocorba.robot.collision_avoidance.neighbours import Nearby
from robocorba.robot.display import Display, DisplayKind, display_of
from robocorba.robot.emergency_stop import EmergencyStop
from robocorba.robot.high_controller import Callbacks, HighController
from robocorba.robot.kinematics.inverse import InverseKinematics
from robocorba.robot.kinematics.smartpal import BASE_LIMITS
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState, Velocity
from robocorba.robot.programs.base_checks import Planner
from robocorba.robot.programs.checker import check_sensors
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.report import CheckReport
from robocorba.robot.protective_field import ProtectiveField
from robocorba.robot.robot import Robot
from robocorba.robot.runner import OtherRobots, Runner
from robocorba.robot.senses import Senses, program_ranges_m
from robocorba.robot.session import SessionState, once_back
from robocorba.robot.teleoperation import Teleoperation, check_order
from robocorba.robot.tick_file import TickFile
from robocorba.simulation.emergency_stops import StopAnswer
from robocorba.simulation.registry import Pose
from robocorba.system.background import Background
from robocorba.system.repeating import Repeating
from robocorba.system.stop_latch import EMERGENCY_STOP

#: Distance of the body from its actual robot above which the body counts as blocked by an obstacle in the building [m].
#: The robot's motion fails then, as if the obstacle blocked the robot.
BODY_BLOCKED_M = 0.1
#: Distance above which the body can't follow any more, and the robot counts as lost [m].
BODY_LOST_M = 1.0

_log = logging.getLogger(__name__)


class Task(Protocol):
    """A task of an agent: a program, or a part in a mission."""

    @property
    def report(self) -> ProgramReport:
        """Its progress, and its result once it has ended."""

    def begun(self, first: int) -> list[IconBegun]:
        """Icons or steps that have begun, from number `first`."""

    def run(self) -> object:
        """Run to the end."""


TaskT = TypeVar("TaskT", bound=Task)


@dataclass(frozen=True)
class AgentCalls:
    """What a control agent calls."""

    #: Checks a program from the present state.
    check: Callable[[Program, AgentState], CheckReport] = lambda program, state: CheckReport()
    #: Before each task, to bring up to date what rests while the robot has none.
    prepare: Callable[[], None] = lambda: None
    #: After changes of condition, task and display; must not block.
    changed: Callable[[], None] = lambda: None
    #: In each control cycle, with the state that was read; must not block.
    observe: Callable[[RobotState], None] | None = None
    #: With a program's report, as `note` of a Runner.
    note: Callable[[Program, ProgramReport], None] = lambda program, report: None


class ControlAgent:
    """Thread-safe. others: for events and cooperative icons. ticks: records programs. nearby: other robots and
    obstacles; see Robot. protects: whether robots have a protective field; None: actual ones that have range
    sensors. perceives: whether they need range sensors to perceive with."""

    def __init__(
        self,
        context: AdaptorContext,
        planner: Planner,
        others: OtherRobots,
        nearby: Nearby | None = None,
        ticks: TickFile | None = None,
        calls: AgentCalls = AgentCalls(),
        protects: bool | None = None,
        perceives: bool = False,
    ) -> None:
        self._context, self._planner, self._others = context, planner, others
        self._nearby, self._ticks, self._calls, self._protects = nearby, ticks, calls, protects
        self._perceives = perceives
        self.name, self.session = context.name, context.session
        self._kinematics = InverseKinematics()
        self._lock = threading.RLock()
        self._controller: HighController | None = None
        self._adaptor = ""
        #: The arguments with which each adaptor can be started again.
        self._argv: dict[str, Sequence[str]] = {}
        self._robot: Robot | None = None
        self._program: Program | None = None
        self._task: Task | None = None
        #: Its part in the mission that the task leads, if that is so.
        self._part: Task | None = None
        #: What the touch panel shows, and since when [s, monotonic].
        self._shown, self._shown_at = Display(DisplayKind.WAITING, ""), 0.0
        self._showing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._cap: float | None = None
        self._is_virtual = False
        self._emergency = EmergencyStop(context.session)
        #: Distance of an actual robot's body above which it is blocked [m]; infinite after a start until it is known.
        #: The body brakes more gently than the robot, so it may begin some distance away.
        self._blocked_at_m = math.inf
        self._body_time_s = self._body_distance_m = self._body_speed_m_s = 0.0
        #: Number of control cycles above that distance in which the body neither got closer nor gained speed while the
        #: simulation went on. A body that was only late, because a process got no processor time, gains speed until it
        #: gets closer.
        self._cycles_falling_behind = 0
        # The lease is renewed twice a second, independent of commands.
        self._lease = Repeating("lease", self._renew, 0.5)

    # ---- start and end ----

    def start(self, adaptor: str, argv: Sequence[str] = ()) -> None:
        """Log on, and start an adaptor. Raises UnknownAdaptor, AdaptorFailed, SimulationError, UnknownFloor."""
        with self._lock:
            self._lease.start()  # an actual robot may take longer to start than a lease lasts
            self._emergency.start()
            self._start_adaptor(adaptor, argv)
            self._context = self._context._replace(last_pose=None)  # from here on the session knows

    def close(self) -> None:
        """Stop the robot, and log off."""
        self.abort()
        if self._controller:
            self._controller.close()
        self._join()
        self._lease.close()
        self._emergency.close()
        self.session.log_off()

    def switch(self, adaptor: str, argv: Sequence[str]) -> None:
        """Replace the adaptor. The previous one is stopped first, and restarted if the new one can't be started. If it
        can't be started either, the robot is stopped, and a reset starts it. Empty argv: that with which the adaptor
        was started last, but for its pose.

        Raises UnknownAdaptor, AdaptorFailed; IllegalOrder while a program runs."""
        with self._lock:
            self._refuse_while_running("switch the adaptor")
            controller, before = self._controller, self._adaptor
            if controller is None:
                raise IllegalOrder("switch the adaptor", "was never started")
            argv_before = controller.argv
            argv = argv or self._argv.get(adaptor, ())
            model_switcher.make(adaptor, self._context)  # raises UnknownAdaptor before anything is stopped
            try:
                self.session.state()  # and so does a server that is away
            except RobotLost as error:
                raise AdaptorFailed(str(error)) from None
            controller.close()
            try:
                self._start_adaptor(adaptor, argv)
            except RoboCorbaError as error:
                try:
                    once_back(lambda: self._start_adaptor(before, argv_before))
                except RoboCorbaError as second:
                    self.stop(f"the adaptor {adaptor} did not start ({error}), and {before} not again ({second})")
                raise _as_robot_error(error) from None

    # ---- programs ----

    @property
    def program(self) -> Program | None:
        """The loaded program."""
        return self._program

    def check(self, program: Program) -> CheckReport:
        """Check a program from the present state, also while another one runs. Raises NotReachable."""
        return self._calls.check(program, self.state)

    def load(self, program: Program) -> None:
        """Check and keep a program. Raises InvalidProgram; IllegalOrder while a program runs."""
        with self._lock:
            self._refuse_while_running("load a program")
            self.check(program).require_valid()
            self._program = program

    def run(self, is_stepping: bool = False, mission: str = "") -> None:
        """Start the loaded program. mission: name of the mission of its cooperative icon, empty for a new one. Raises
        IllegalOrder."""
        with self._lock:
            self._refuse_while_running("run a program")
            robot = self.robot
            if self._program is None:
                raise IllegalOrder("run a program", "has none loaded")
            lacking = CheckReport()  # since the program was loaded, the adaptor may have been switched
            check_sensors(self._program, lacking, self._adaptor, program_ranges_m(self.senses))
            for finding in lacking.findings:
                raise IllegalOrder("run the loaded program", f"can't sense what it needs: {finding}")
            robot.execution.reset(is_stepping)
            self._begin(Runner(self._program, robot, self._others, mission, self._calls.note))

    def start_mission(self, mission: str, program: Program) -> None:
        """Load and run a program of one cooperative icon (`program.of_icon`) as the mission of this name. Raises
        InvalidProgram, IllegalOrder."""
        with self._lock:
            self.load(program)
            self.run(mission=mission)

    def take_over(self, mission: str, program: Program, goes_on: bool = False) -> None:
        """Run a program of one cooperative icon as the mission of this name; the loaded program stays. goes_on: the
        robot's part in the mission, if it runs, goes on beside the program. Raises IllegalOrder."""
        with self._lock:
            robot = self.robot
            if not (goes_on and self._is_running):
                self._refuse_while_running("lead a mission")
                robot.execution.reset(False)
            self._begin(Runner(program, robot, self._others, mission))

    def drive(self, velocity: Velocity, valid_for_s: float) -> None:
        """Drive at a velocity of the base, ahead and to the left [m/s], turn [rad/s], for some time [s] or until the
        next call; see Teleoperation. Raises InvalidChoice; IllegalOrder while a program runs."""
        check_order(velocity, valid_for_s)
        with self._lock:
            robot = self.robot
            task = self._task
            if isinstance(task, Teleoperation) and self._is_running and task.order(velocity, valid_for_s):
                return
            self._refuse_while_running("drive")
            robot.execution.reset(False)
            begun = Teleoperation(robot)
            begun.order(velocity, valid_for_s)
            self._begin(begun)

    def begun(self, first: int) -> list[IconBegun]:
        """Icons of the present or last program that have begun, from number `first`."""
        return self._task.begun(first) if self._task else []

    def pause(self) -> None:
        """Raises IllegalOrder if no program runs."""
        self._running_robot("pause").execution.pause()
        self._calls.changed()

    def resume(self) -> None:
        """Raises IllegalOrder if no program runs."""
        self._running_robot("resume").execution.resume()
        self._calls.changed()

    def step(self) -> None:
        """Raises IllegalOrder if no program runs."""
        self._running_robot("step").execution.step()
        self._calls.changed()

    @property
    def question(self) -> Question:
        """What the program asks a person."""
        return self._robot.execution.question if self._robot else Question()

    def answer(self, number: int, is_yes: bool) -> None:
        """Answer the question of this number, also while the program is paused. Raises IllegalOrder if that is not
        asked at present."""
        if not (self._robot and self._robot.execution.answer(number, is_yes)):
            raise IllegalOrder("answer", "asks something else" if self.question.number else "asks nothing")
        self._calls.changed()

    def abort(self) -> None:
        """End the running program, if any; the robot slows down and stops."""
        if self._robot and self._is_running:
            self._robot.execution.abort()

    # ---- missions ----

    @property
    def is_free(self) -> bool:
        """Whether the agent can start a task now."""
        return self._is_ready and not self._is_running

    @property
    def is_busy(self) -> bool:
        """Whether the agent runs a task, and is not stopped."""
        return self._is_ready and self._is_running

    @property
    def place(self) -> Pose:
        """The robot's pose."""
        return self.state.at

    def begin_part(self, make: Callable[[Robot], TaskT], for_own_mission: bool = False) -> TaskT:
        """Start the robot's part in a mission, like a program. for_own_mission: the robot's program leads the mission
        and runs beside the part. Raises IllegalOrder."""
        with self._lock:
            if not for_own_mission:
                self._refuse_while_running("take part in a mission")
            robot = self.robot
            if for_own_mission:
                self._part = part = make(robot)
                Background("own part", part.run, functools.partial(self._task_failed, part)).start()
                return part
            robot.execution.reset(False)
            part = make(robot)
            self._begin(part)
            return part

    @property
    def path(self) -> Sequence[PathPoint]:
        """The path that the base is driving, from its start; empty if it drives none."""
        return self._robot.path if self._robot else ()

    # ---- safety ----

    def stop(self, reason: str = EMERGENCY_STOP, number: int = 0) -> None:
        """Emergency stop, until `reset_stop`, whatever happens to adaptor and session. number: of the simulation
        server's stop, 0 for another one. It takes no lock of the agent, so it works while other calls hang."""
        self._emergency.stop(reason, number)
        if (robot := self._robot) and self._is_running:
            robot.execution.abort(reason)
        if controller := self._controller:  # one that is about to replace it stops its adaptor itself
            controller.halt()

    def stop_durably(self, reason: str = EMERGENCY_STOP) -> None:
        """The same; returns when the stop outlives this process, or after a second."""
        self.stop(reason)
        if not self._emergency.wait_until_reported(1.0):
            _log.warning("stopped, but the simulation server does not know of it yet")

    def reset_stop(self) -> None:
        """Restart a stopped robot: ends the stops until this call, and no later one. Raises IllegalOrder if it is not
        stopped, or is stopped again meanwhile; AdaptorFailed."""
        seen = self._emergency.latch.number
        with self._lock:
            self._refuse_while_running("restart")
            if self._controller is None:
                raise IllegalOrder("restart", "was never started")
            if self._controller.is_closed:  # after a switch to an adaptor that did not start
                try:
                    self._start_adaptor(self._adaptor, self._controller.argv)
                except RoboCorbaError as error:
                    raise _as_robot_error(error) from None
            self._controller.reset_stop(seen, self._emergency.end)

    @property
    def stopped(self) -> str:
        """Why the robot is stopped or lost, or empty."""
        return self._emergency.latch.reason or (self._controller.stopped if self._controller else "")

    @property
    def held(self) -> str:
        """Why an emergency stop holds the robot, or empty."""
        return self._emergency.latch.reason

    @property
    def stop_answer(self) -> StopAnswer:
        """Whether the robot is stopped, and whether its adaptor has confirmed that."""
        controller = self._controller
        is_confirmed = controller is not None and controller.is_stop_confirmed
        return StopAnswer(bool(self.stopped), is_confirmed, self.stopped)

    def cap_speed(self, speed: float) -> None:
        """Limit the base's speed [m/s]. Raises InvalidChoice."""
        if not 0.0 < speed <= BASE_LIMITS.speed:
            raise InvalidChoice("speed", f"{speed} is not above 0 and at most {BASE_LIMITS.speed:g} m/s")
        self._cap = speed
        if self._controller:
            self._controller.speed_cap = speed

    # ---- state ----

    @property
    def is_resting(self) -> bool:
        """Whether the robot has no task, and nothing has moved it for a while."""
        return self._controller is not None and self._controller.is_idle and not self._is_running

    @property
    def actor(self) -> RobotState | None:
        """What the adaptor has read last; None before it has started."""
        return self._controller.state if self._controller else None

    @property
    def joints(self) -> Floats:
        """The joints' last known angles (n,) [rad]. Raises RobotLost."""
        if self._controller is None:
            raise RobotLost(f"{self.name} was not started")
        return self._controller.state.joints

    @property
    def senses(self) -> Senses | None:
        """What the robot behind the present adaptor senses; None without sensors."""
        return self._controller.senses if self._controller else None

    def refresh(self) -> None:
        """Read the robot's state now if it rests."""
        if controller := self._controller:
            controller.refresh()

    @property
    def state(self) -> AgentState:
        controller = self._controller
        if controller is None:
            raise RobotLost(f"{self.name} was not started")
        controller.refresh()
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
    def display(self) -> Display:
        """What the robot's touch panel shows. It calls nobody, so it is there while others hang. Raises RobotLost."""
        controller, robot = self._controller, self._robot
        if controller is None or robot is None:
            raise RobotLost(f"{self.name} was not started")
        with self._showing:
            part, awaited = self._part, controller.awaited or robot.execution.awaited
            is_in_part = part is not None and part.report.result is ProgramResult.NO_RESULT
            report = part.report if part and is_in_part else self._report
            shown = display_of(self._condition(controller), controller.stopped, report, awaited, controller.is_lost)
            now = time.monotonic()
            if shown != self._shown:
                self._shown, self._shown_at = shown, now
                self._calls.changed()
            return shown._replace(seconds=now - self._shown_at)

    @property
    def robot(self) -> Robot:
        """The robot that tasks move. Raises IllegalOrder if none was started or it is stopped."""
        if self._controller is None or self._robot is None:
            raise IllegalOrder("move", "was never started")
        if reason := self.stopped:
            raise IllegalOrder("move", f"is stopped: {reason}")
        return self._robot

    def _condition(self, controller: HighController) -> AgentCondition:
        if controller.stopped:
            return AgentCondition.STOPPED
        if not self._is_running:
            return AgentCondition.IDLE
        return AgentCondition.PAUSED if self._robot and self._robot.execution.is_paused else AgentCondition.RUNNING

    # ---- implementation ----

    def _start_adaptor(self, adaptor: str, argv: Sequence[str]) -> None:
        made = model_switcher.make(adaptor, self._context)
        self.session.log_on()
        self.session.state()
        self._is_virtual = made.is_in_building
        self.session.announce_body(made.is_in_building)
        calls = Callbacks(
            on_state=self._follow,
            on_command=self._record,
            before_start=self._log_on,
            rests=lambda: not self._is_running,
            on_stop=self._calls.changed,
            on_held=self.stop,
        )
        is_protected = not made.is_in_building if self._protects is None else self._protects
        robot_at = self._nearby.robot_at if self._nearby else lambda x, y: None
        field = ProtectiveField(lambda: made.senses, self._carried, robot_at) if is_protected else None
        controller = HighController(made, self._emergency.latch, calls, field=field)
        if self._cap is not None:
            controller.speed_cap = self._cap
        controller.start(argv)
        if not (made.senses and made.senses.sensors) and (field or self._perceives):
            if self._protects or self._perceives:
                controller.close()
                use = "a protective field" if self._protects else "perception"
                raise AdaptorFailed(f"the robot of the adaptor {adaptor} has no range sensors for {use}")
            _log.warning("the robot of the adaptor %s has no range sensors: no protective field", adaptor)
        self._controller, self._adaptor = controller, adaptor
        self._argv[adaptor] = model_switcher.argv_again(argv)
        self._robot = Robot(controller, self.session, self._kinematics, self._planner, self._nearby)

    def _carried(self) -> BaseGeometry | None:
        return self._nearby.carried(self.session.latest.holding) if self._nearby else None

    @property
    def _is_ready(self) -> bool:
        controller = self._controller
        return controller is not None and not controller.stopped

    @property
    def _is_running(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _refuse_while_running(self, order: str) -> None:
        if self._is_running and self._report.result is not ProgramResult.NO_RESULT:
            self._join()  # its thread is about to end
        if self._is_running:
            raise IllegalOrder(order, "runs a program")

    def _running_robot(self, order: str) -> Robot:
        if not self._is_running or self._robot is None:
            raise IllegalOrder(order, "runs no program")
        return self._robot

    def _join(self) -> None:
        if self._thread:
            self._thread.join(5.0)

    def _begin(self, task: Task) -> None:
        self.refresh()
        self._calls.prepare()

        def run() -> None:
            try:
                task.run()
            finally:
                self._calls.changed()

        self._task, self._part = task, None
        self._thread = Background("program", run, functools.partial(self._task_failed, task))
        self._thread.start()
        if controller := self._controller:
            controller.wake()
        if (reason := self.stopped) and self._robot:  # the stop may have come before there was a task to abort
            self._robot.execution.abort(reason)
        self._calls.changed()

    def _task_failed(self, task: Task, reason: str) -> None:
        """A task has ended by a defect: stop the robot, unless the task has ended safely and reports why."""
        if task.report.result is ProgramResult.NO_RESULT:
            self.stop(reason)

    @property
    def _report(self) -> ProgramReport:
        return self._task.report if self._task else ProgramReport()

    def _log_on(self) -> None:
        """Before each start of the adaptor: log on if the server has no session for the robot. An actual robot's body
        that is more than BODY_LOST_M away is logged on again at the robot's pose."""
        try:
            self.session.log_on()
            self._emergency.attend()
            body = self.session.state().at
            self._blocked_at_m = math.inf
            if not self._is_virtual and self._controller:
                robot = self._controller.state
                if math.hypot(robot.x - body.x, robot.y - body.y) > BODY_LOST_M:
                    self.session.log_off()
                    self.session.log_on(Pose(body.floor, robot.x, robot.y, robot.heading))
                    self._emergency.attend()
                    self.session.state()
        except (SimulationError, UnknownFloor) as error:
            raise RobotLost(f"the simulation server refuses the robot: {error}") from None

    def _renew(self) -> None:
        if controller := self._controller:
            controller.check_alive()
        with contextlib.suppress(RobotLost):  # the controller detects and reports it, too
            self.session.heartbeat()
        if self._robot:
            _ = self.display  # notes since when it shows that, also while nobody asks

    def _follow(self, state: RobotState) -> None:
        """Make the body in the building follow an actual robot; this also keeps the lease."""
        if self._calls.observe:
            self._calls.observe(state)
        if self._is_virtual:
            return
        body = self.session.state()
        distance_m = math.hypot(state.x - body.at.x, state.y - body.at.y)
        speed_m_s = math.hypot(*body.velocity[:2])
        if distance_m > BODY_LOST_M:
            raise RobotLost(_blocked_reason(body, distance_m))
        if distance_m <= self._blocked_at_m:
            self._cycles_falling_behind = 0
        elif (
            body.time > self._body_time_s and distance_m >= self._body_distance_m and speed_m_s <= self._body_speed_m_s
        ):
            self._cycles_falling_behind += 1
        self._body_time_s, self._body_distance_m, self._body_speed_m_s = body.time, distance_m, speed_m_s
        if distance_m < BODY_BLOCKED_M / 2:
            self._blocked_at_m = BODY_BLOCKED_M
        elif math.isinf(self._blocked_at_m):
            self._blocked_at_m = distance_m + BODY_BLOCKED_M
        elif self._cycles_falling_behind > 25:  # half a second
            self._cycles_falling_behind = 0
            self._blocked_at_m = distance_m + BODY_BLOCKED_M  # the robot brakes, and may return
            if self._controller:
                self._controller.cancel(MotionFailed(_blocked_reason(body, distance_m)))
        self.session.command(follow_velocity(state, body.at), 0.1)

    def _record(self, state: RobotState, command: ActorCommand) -> None:
        report = self._report
        if self._ticks and report.icon and report.result is ProgramResult.NO_RESULT:
            floor = self.session.latest.at.floor
            self._ticks.add((self._adaptor, report.name, report.icon, report.icons_done, floor), state, command)


def _as_robot_error(error: RoboCorbaError) -> RobotError:
    return error if isinstance(error, RobotError) else AdaptorFailed(str(error))


def _blocked_reason(body: SessionState, distance_m: float) -> str:
    obstacle = f"; it last touched {body.touched}" if body.touched else ""
    return f"its body in the simulation is {distance_m:.2f} m away, as if an obstacle blocked it{obstacle}"


def follow_velocity(robot: RobotState, body: Pose) -> Velocity:
    """The velocity of a body that follows a robot, in the body's frame."""
    gain = 5.0  # [1/s]
    error_rad = math.remainder(robot.heading - body.heading, math.tau)
    ahead, left = turned(robot.velocity[0], robot.velocity[1], error_rad)
    error_ahead, error_left = into(robot.x, robot.y, body[1:])
    return (ahead + gain * error_ahead, left + gain * error_left, robot.velocity[2] + gain * error_rad)
