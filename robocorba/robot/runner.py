"""Runs a program icon by icon, each as movements of the robot, and reports its progress and result."""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from robocorba.errors.base import RoboCorbaError
from robocorba.errors.robots import MotionFailed, ServerAway
from robocorba.robot.agent_state import IconBegun, ProgramReport, ProgramResult
from robocorba.robot.execution_control import CHECK_INTERVAL_S, Aborted, SensorStop
from robocorba.robot.programs import hands, icons
from robocorba.robot.programs.icons import Condition, Icon, Outcome, kind, sides
from robocorba.robot.programs.program import Program, icons_with_paths
from robocorba.robot.robot import Robot
from robocorba.system.background import Background
from robocorba.system.backoff import Backoff

#: Time without a distance from its sensor after which a stop_if_closer icon fails [s].
BLIND_LIMIT_S = 1.0

_log = logging.getLogger(__name__)


class ReceivedEvent(NamedTuple):
    """An event that the robot's channel has delivered."""

    type: str
    source: str
    payload: Any


class OtherRobots(Protocol):
    """A robot's access to others: events and cooperative icons of its programs, and its part in missions. mission: the
    one that it leads or takes part in; empty for none."""

    @property
    def mission(self) -> str: ...

    def subscribe(self, patterns: Sequence[tuple[str, str]], receive: Callable[[ReceivedEvent], None]) -> None:
        """Subscribe to events of these types and sources; `receive` consumes them. Raises EventError, NotReachable."""

    def publish(self, type: str, payload: Any) -> None:
        """Publish an event. Raises EventError, NotReachable."""

    def cooperate(self, icon: Icon, mission: str) -> None:
        """Perform a cooperative icon as the mission of this name, or of a new one if it is empty. Raises RobotError."""

    def lead_mission(self, mission: str, program: Program, term: int = 0) -> None:
        """Lead a mission; term: the one in which it is offered, 0 if that is not known. Raises InvalidProgram,
        IllegalOrder."""

    def abort_mission(self, mission: str) -> None:
        """Abort the mission if the robot leads it at present. Raises UnknownMission."""


class Runner:
    """One run of a program on a robot, by one thread; any thread may read its report.

    mission: name of the mission of its first cooperative icon, empty for a new one. note: called with the report when
    an icon begins, and before others see that the program has ended."""

    def __init__(
        self,
        program: Program,
        robot: Robot,
        others: OtherRobots,
        mission: str = "",
        note: Callable[[Program, ProgramReport], None] = lambda program, report: None,
    ) -> None:
        self._program, self._robot, self._others, self._mission = program, robot, others, mission
        self._note = note
        self._started_at = time.monotonic()
        self._last_report = ProgramReport(program.name)
        #: The last icons that have begun, and the last events that no condition has consumed.
        self._begun: deque[IconBegun] = deque(maxlen=1000)
        self._events: deque[ReceivedEvent] = deque(maxlen=1000)
        self._last_outcome: Outcome = "done"

    @property
    def report(self) -> ProgramReport:
        report = self._last_report
        if report.result is ProgramResult.NO_RESULT:
            return report._replace(seconds=time.monotonic() - self._started_at)
        return report

    def run(self) -> ProgramReport:
        """Run the program to its end. Its errors are in the returned report."""
        try:
            self._others.subscribe(_event_patterns(self._program), self._events.append)
            self._run_icons("icons", self._program.icons)
            self._end(result=ProgramResult.DONE, icon="", kind="")
        except Aborted as error:
            self._end(result=ProgramResult.ABORTED, reason=str(error))
        except RoboCorbaError as error:
            self._end(result=ProgramResult.FAILED, reason=str(error))
        except Exception as error:
            self._end(result=ProgramResult.FAILED, reason=f"{type(error).__name__}: {error}")
            raise
        return self.report

    def begun(self, first: int) -> list[IconBegun]:
        """Icons that have begun, from number `first`. Thread-safe."""
        return [icon for icon in list(self._begun) if icon.number >= first]

    # ---- icons ----

    def _run_icons(self, parent: str, body: Sequence[Icon]) -> None:
        for number, icon in enumerate(body):
            path = f"{parent}[{number}]"
            self._update(icon=path, kind=kind(icon))
            self._robot.execution.before_icon()
            count = self._begun[-1].number + 1 if self._begun else 0
            self._begun.append(IconBegun(count, path, kind(icon), self.report.seconds))
            self._note(self._program, self.report)
            self._last_outcome = self._perform(icon, path)
            self._update(icons_done=self.report.icons_done + 1)

    def _perform(self, icon: Icon, path: str) -> Outcome:
        """Perform an icon; returns its outcome."""
        if isinstance(icon, icons.MovementIcon):
            icon.perform(self._robot)
        elif isinstance(icon, hands.ArmIcon):
            postures = hands.joint_path(icon, self._robot.joints, self._robot.kinematics)
            self._robot.move_joints_along(postures, icon.seconds or 0.0)
        elif isinstance(icon, icons.WaitUntil):
            with self._robot.execution.awaiting(lambda: _words(icon.condition)):
                is_met = self._robot.wait(icon.seconds, lambda: self._is_met(icon.condition))
            return "done" if is_met else "timed_out"
        elif isinstance(icon, icons.Confirm):
            return self._confirm(icon)
        elif isinstance(icon, icons.StopIfCloser):
            return self._run_watched(icon, path)
        elif isinstance(icon, icons.Repeat):
            for _ in range(icon.times):
                self._run_icons(f"{path}.icons", icon.icons)
        elif isinstance(icon, icons.Branch):
            branch = "then" if self._is_met(icon.condition) else "otherwise"
            self._run_icons(f"{path}.{branch}", getattr(icon, branch))
            return self._last_outcome
        elif isinstance(icon, icons.Say):
            self._others.publish(icon.type, icon.payload)
        elif isinstance(icon, icons.CooperativeIcon):
            mission, self._mission = self._mission, ""
            self._others.cooperate(icon, mission)
        else:
            raise MotionFailed(f"unsupported icon type {kind(icon)}")
        return "done"

    def _confirm(self, icon: icons.Confirm) -> Outcome:
        with self._robot.execution.asking(icon.question) as answer:
            self._robot.wait(icon.seconds, lambda: answer() is not None)
            confirmed = answer()
        if confirmed:
            return "done"
        if icon.on_no == "fail":
            how = f"was not answered within {icon.seconds:g} s" if confirmed is None else "was answered with no"
            raise MotionFailed(f"\u201c{icon.question}\u201d {how}")
        return "timed_out" if confirmed is None else "refused"

    def _run_watched(self, icon: icons.StopIfCloser, path: str) -> Outcome:
        with self._watching(icon):
            try:
                self._run_icons(f"{path}.icons", icon.icons)
                return "done"
            except SensorStop as stop:
                if stop.icon is not icon:
                    raise
        self._robot.stop_base()
        return "stopped"

    # ---- conditions ----

    def _is_met(self, condition: Condition) -> bool:
        if isinstance(condition, icons.CloserThan | icons.FartherThan):
            # A sensor server that restarts is back within two seconds.
            ask = functools.partial(self._robot.nearest_m, condition.sensor)
            nearest_m = Backoff(0.02, 0.1).call(ask, 2 * BLIND_LIMIT_S, ServerAway)
            return (nearest_m < condition.distance) == isinstance(condition, icons.CloserThan)
        if isinstance(condition, icons.Holding):
            return all(self._robot.holds(side) for side in sides(condition.hand))
        if isinstance(condition, icons.Result):
            return self._last_outcome == condition.result
        return self._take_event(condition)

    def _take_event(self, condition: icons.Event) -> bool:
        """Remove the oldest event that matches the condition; returns whether there was one."""
        for event in list(self._events):
            if _matches(event.type, condition.type) and _matches(event.source, condition.source):
                self._events.remove(event)
                return True
        return False

    @contextlib.contextmanager
    def _watching(self, icon: icons.StopIfCloser) -> Iterator[None]:
        """Monitor the icon's sensor in a thread, which interrupts the program if an obstacle is too close."""
        ended = threading.Event()

        def watch() -> None:
            blind_since: float | None = None
            while not ended.wait(CHECK_INTERVAL_S):
                try:
                    nearest = self._robot.nearest_m(icon.sensor)
                    blind_since = None
                except RoboCorbaError as error:
                    blind_since = blind_since or time.monotonic()
                    if time.monotonic() - blind_since > BLIND_LIMIT_S:
                        reason = f"the {icon.sensor} sensor gave no distance for {BLIND_LIMIT_S:g} s: {error}"
                        self._robot.execution.interrupt(MotionFailed(reason))
                        return
                    continue
                if nearest < icon.distance and not ended.is_set():
                    reason = f"the {icon.sensor} sensor sees an obstacle at {nearest:.2f} m, within {icon.distance:g} m"
                    self._robot.execution.interrupt(SensorStop(icon, reason))
                    return

        def blind(reason: str) -> None:
            self._robot.execution.interrupt(MotionFailed(reason))

        watcher = Background("sensor stop", watch, blind)
        watcher.start()
        try:
            yield
        finally:
            ended.set()
            watcher.wait_for_end()
            self._robot.execution.settle(lambda why: isinstance(why, SensorStop) and why.icon is icon)

    def _update(self, **changes: Any) -> None:
        self._last_report = self._changed(**changes)

    def _changed(self, **changes: Any) -> ProgramReport:
        return self.report._replace(seconds=time.monotonic() - self._started_at, **changes)

    def _end(self, **changes: Any) -> None:
        ended = self._changed(**changes)
        try:
            self._note(self._program, ended)
        except RoboCorbaError as error:
            _log.warning("the report of %s is not kept: %s", ended.name, error)
        self._last_report = ended


def _words(condition: Condition) -> str:
    """What a wait for a condition waits for."""
    if isinstance(condition, icons.Event):
        return f"event {condition.type} from {condition.source}"
    if isinstance(condition, icons.CloserThan | icons.FartherThan):
        seen = "an obstacle" if isinstance(condition, icons.CloserThan) else "nothing"
        return f"{seen} within {condition.distance:g} m of the {condition.sensor} sensor"
    return f"an object in hand: {condition.hand}" if isinstance(condition, icons.Holding) else "a result"


def _event_patterns(program: Program) -> list[tuple[str, str]]:
    """The patterns of types and sources of the events that a program's conditions wait for."""
    conditions = [
        icon.condition for _, icon in icons_with_paths(program) if isinstance(icon, icons.WaitUntil | icons.Branch)
    ]
    return sorted({(each.type, each.source) for each in conditions if isinstance(each, icons.Event)})


def _matches(text: str, pattern: str) -> bool:
    return re.fullmatch(fnmatch.translate(pattern.replace("[", "[[]")), text) is not None
